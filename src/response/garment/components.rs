//! The components that make meshes garments.

use std::{collections::HashMap, fmt, sync::Arc};

use bevy_ecs::prelude::*;
use bevy_mesh::{Mesh, MeshVertexAttribute, VertexFormat};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::freedom::Freedom;
use crate::{
    geometry::SurfaceTopology,
    response::material::XpbdMaterial,
    surface::{SelfCollision, SurfaceFromMesh, SurfaceFromMeshHierarchy, SweptCollision},
};

/// Makes the mesh of this entity cloth that a character wears: a cape, a skirt, or a sleeve. It goes beside the
/// [`Mesh3d`](bevy_mesh::Mesh3d), and is a [`SurfaceFromMesh`]. For meshes that are spawned with a scene, use
/// [`XpbdGarments`].
///
/// As soon as the meshes of the garment and of all its skins have become surfaces, the garment gets an
/// [`XpbdBody`](crate::response::XpbdBody), [`XpbdTethers`](crate::response::XpbdTethers) to the nearest places on the skins, and
/// [`WriteSurfaceToMesh`](crate::WriteSurfaceToMesh), with a copy of its mesh, so that characters can share one asset. The
/// garment should fit at that time: outside the skin. A garment that is skinned fits in every pose. Its joints lead it to
/// the present pose and no further, it loses its [`SkinnedMesh`](bevy_mesh::skinning::SkinnedMesh), and its edges keep the
/// lengths that they have without joints. Morph targets stay as they are at that time. A closed garment, such as one
/// with a lining, becomes [`TwoSided`](crate::Sidedness::TwoSided) unless the game has set its sidedness.
///
/// # How far vertices may move
///
/// Each vertex has a longest distance from its place on the skin; where it is 0, the vertex is pinned. It is
/// [painted](Self::paint), or follows from the distance to the upper edge: the highest vertices of each connected part of
/// the garment are [pinned](Self::pinned_height), and the others may get as far from their places as they are from these
/// along the edges of the mesh, but no farther than [`longest`](Self::longest).
///
/// # What can change
///
/// | change | effect |
/// |---|---|
/// | another mesh, or other triangles | the garment is made anew, in the pose that the new mesh has |
/// | another mesh of a skin, other skins, `longest`, or `clearance` | tethers are made anew: pins hold the nearest places, and other vertices are held where they hang |
/// | a skin is despawned | its tethers have no effect, and the garment falls. A warning says so |
/// | [`SurfaceDisabled`](crate::SurfaceDisabled) or Bevy's `Disabled` on the garment or a skin | nothing is made while it is there |
/// | this component is removed | body and tethers stay |
///
/// A garment that cannot be worn is left as it is. A warning in the log and [`XpbdGarmentNotWorn`](super::XpbdGarmentNotWorn)
/// give the reason.
///
/// ```
/// # use bevy_circumsphere::{prelude::*, response::*};
/// # use bevy_ecs::prelude::*;
/// # use bevy_mesh::Mesh3d;
/// # fn spawn(mut commands: Commands, body: Mesh3d, cape: Mesh3d) {
/// let skin = commands.spawn((body, SurfaceFromMesh::default())).id();
/// commands.spawn((cape, XpbdGarment { longest: 0.8, ..XpbdGarment::worn_by([skin]) }));
/// # }
/// ```
#[derive(Component, Clone, Debug, PartialEq)]
#[require(GarmentLink, SurfaceFromMesh, SelfCollision, SweptCollision)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct XpbdGarment {
    /// The surfaces that wear it, such as the parts of a body with several materials. Default: none, which is an error
    /// unless [`XpbdGarments`] fills them in.
    #[entities]
    pub skins: Vec<Entity>,
    /// What is painted on the mesh. Default: [`GarmentPaint::Attribute`].
    pub paint: GarmentPaint,
    /// The longest distance from its place on the skin of a vertex that is painted 1, in world units; 0 or more, and
    /// finite. Without paint, the longest distance of any vertex. Default: 0.5.
    pub longest: f32,
    /// Without paint, how far below the highest vertex of each connected part vertices are pinned, as a share of the
    /// part's height: 0 to 1. Up is +y. Default: 0.02.
    pub pinned_height: f32,
    /// How near to the skin vertices may come, in world units: their least height above the plane of the triangle that
    /// they are tethered to; negative if they may be that far behind it. Finite. Default: 0.
    pub clearance: f32,
    /// The material of the body when it is made. Default: [`XpbdMaterial::CLOTH`].
    pub material: XpbdMaterial,
}

impl Default for XpbdGarment {
    fn default() -> Self {
        Self {
            skins: Vec::new(),
            paint: GarmentPaint::default(),
            longest: 0.5,
            pinned_height: 0.02,
            clearance: 0.0,
            material: XpbdMaterial::CLOTH,
        }
    }
}

impl XpbdGarment {
    /// The attribute of [`GarmentPaint::Attribute`], one `Float32` for each vertex. To load an
    /// attribute `_GARMENT` from glTF, register it with the loader, without the underscore:
    /// `GltfPlugin::default().add_custom_vertex_attribute("GARMENT", XpbdGarment::ATTRIBUTE_FREEDOM)`.
    pub const ATTRIBUTE_FREEDOM: MeshVertexAttribute =
        MeshVertexAttribute::new("Vertex_GarmentFreedom", 0x6761_726d_656e_7431, VertexFormat::Float32);

    /// A garment that these surfaces wear.
    #[must_use]
    pub fn worn_by(skins: impl IntoIterator<Item = Entity>) -> Self {
        Self { skins: skins.into_iter().collect(), ..Self::default() }
    }
}

/// Where a garment's mesh says how far each vertex may move: 0 pins it to the skin, and 1 lets it get
/// [`longest`](XpbdGarment::longest) away. Values above 1 let it get farther. The copy of the mesh that is drawn has no
/// paint, so colors that mean distances do not tint the garment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum GarmentPaint {
    /// In [`XpbdGarment::ATTRIBUTE_FREEDOM`] if the mesh has it. If it has not, nothing is painted.
    #[default]
    Attribute,
    /// In the red channel of the vertex colors (`COLOR_0` in glTF), which the mesh must have.
    Red,
    /// In the green channel.
    Green,
    /// In the blue channel.
    Blue,
    /// In the alpha channel.
    Alpha,
    /// Nowhere, even if the mesh has the attribute.
    Nothing,
}

impl GarmentPaint {
    /// The attribute that holds it.
    pub(super) const fn attribute(self) -> Option<MeshVertexAttribute> {
        match self {
            Self::Attribute => Some(XpbdGarment::ATTRIBUTE_FREEDOM),
            Self::Red | Self::Green | Self::Blue | Self::Alpha => Some(Mesh::ATTRIBUTE_COLOR),
            Self::Nothing => None,
        }
    }
}

impl fmt::Display for GarmentPaint {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.attribute().map_or("no attribute", |attribute| attribute.name))
    }
}

/// Makes garments of the meshes below this entity that are listed by name, as soon as they are there. For the root of a
/// character, such as a loaded glTF file. It brings [`SurfaceFromMeshHierarchy`], which makes surfaces of all meshes; spawn
/// one beside it to choose.
///
/// Meshes are found by [`Name`] as there: that of the mesh entity, or of its nearest ancestor below the root that is
/// listed. Meshes with the name of the skin wear the garments that name no skins of their own.
///
/// ```
/// # use bevy_circumsphere::{prelude::*, response::*};
/// # use bevy_ecs::prelude::*;
/// # fn spawn(mut commands: Commands) {
/// commands.spawn((
///     // The scene, and:
///     XpbdGarments::worn_by("Body").with_name("Cape", XpbdGarment::default()),
/// ));
/// # }
/// ```
#[derive(Component, Clone, Debug, Default, PartialEq)]
#[require(SurfaceFromMeshHierarchy)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
pub struct XpbdGarments {
    /// The name of the meshes that wear the garments.
    pub skin: String,
    /// The garments by name.
    pub by_name: HashMap<String, XpbdGarment>,
}

impl XpbdGarments {
    /// Garments that meshes with this name wear.
    #[must_use]
    pub fn worn_by(skin: impl Into<String>) -> Self {
        Self { skin: skin.into(), by_name: HashMap::new() }
    }

    /// Makes garments of meshes with this name.
    #[must_use]
    pub fn with_name(mut self, name: impl Into<String>, garment: XpbdGarment) -> Self {
        self.by_name.insert(name.into(), garment);
        self
    }
}

/// What a garment was last made from.
#[derive(Component, Clone, Debug, Default)]
pub(super) struct GarmentLink {
    pub(super) made: Option<Made>,
    /// Why it is not worn, as it was reported.
    pub(super) not_worn: Option<String>,
}

/// The state of a garment that was made.
#[derive(Clone, Debug)]
pub(super) struct Made {
    pub(super) mesh: Arc<SurfaceTopology>,
    pub(super) freedom: Freedom,
    pub(super) settings: XpbdGarment,
    /// The meshes of the skins.
    pub(super) skins: Vec<Arc<SurfaceTopology>>,
}
