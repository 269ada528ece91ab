//! The components that turn meshes into surfaces and back.

use std::collections::HashMap;

use bevy_asset::AssetId;
use bevy_ecs::{change_detection::Tick, prelude::*};
use bevy_math::Affine3A;
use bevy_mesh::Mesh;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::SurfaceMeshError;
use crate::surface::{
    ContactEventsEnabled, ContactMethod, SelfCollision, Sidedness, SurfaceLayers, SurfaceShape, SurfaceStatus,
    SurfaceThickness, SweptCollision, checked::Registration,
};

/// Makes the entity a [`DeformableSurface`](crate::DeformableSurface) from its
/// [`Mesh3d`](bevy_mesh::Mesh3d) once the asset is loaded, and keeps its positions where Bevy draws the mesh.
///
/// Indexed and unindexed triangle lists and strips can be surfaces. Triangles keep their numbers, except that those of
/// a strip that only lead to its next part are left out. Vertices keep theirs:
/// [`SurfaceTopology::weld`](crate::geometry::SurfaceTopology::weld) tells which ones are connected.
///
/// Every tick, before surfaces are read in [`DeformableSystems::Prepare`](crate::DeformableSystems::Prepare):
///
/// - If the positions in the mesh asset changed, they are copied. If its triangles changed, the surface is replaced.
///   The change is found in the same tick, by comparison. Other attributes of a changed mesh, such as joint weights,
///   take effect after Bevy has sent `AssetEvent::Modified`.
/// - Morph targets displace vertices by the weights in [`MeshMorphWeights`](bevy_mesh::morph::MeshMorphWeights).
/// - With a [`SkinnedMesh`](bevy_mesh::skinning::SkinnedMesh), vertices follow their joints, and positions are in world
///   space ([`SurfaceFrame::World`](crate::SurfaceFrame::World)). The `Transform`s of the joints and their parents are
///   read, not `GlobalTransform`s, so they are never stale. Animations set them in `PostUpdate`: add
///   [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins) with `new(PostUpdate)`, and order
///   `DeformableSystems::Prepare` after the systems that animate.
///
/// Nothing is written, and change detection sees nothing, while the game changes none of these. What moves the surface
/// otherwise, such as the response, is not undone: see [`WriteSurfaceToMesh`].
///
/// The surface is quarantined with [`QuarantineReason::Mesh`](crate::QuarantineReason::Mesh) while its mesh cannot be
/// used, and waits while the asset is not loaded. If the `Mesh3d` is removed, so is the surface. If `SurfaceFromMesh`
/// is removed, the surface stays and no longer follows the mesh.
#[derive(Component, Clone, Debug, Default, PartialEq)]
#[require(MeshLink, SurfaceStatus, Registration)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SurfaceFromMesh {
    /// Connects vertices that are no farther apart, in the unit of the mesh: see
    /// [`SurfaceBuilder::weld_within`](crate::SurfaceBuilder::weld_within). Default: 0, which connects vertices at
    /// exactly equal positions. A change makes the surface anew.
    pub weld_distance: f32,
    /// Components that the surface gets when it is made.
    pub settings: SurfaceSettings,
}

impl SurfaceFromMesh {
    /// Connects vertices that are no farther apart than `distance`, in the unit of the mesh.
    #[must_use]
    pub const fn weld_within(mut self, distance: f32) -> Self {
        self.weld_distance = distance;
        self
    }

    /// Gives the surface these components when it is made.
    #[must_use]
    pub const fn with_settings(mut self, settings: SurfaceSettings) -> Self {
        self.settings = settings;
        self
    }
}

/// Components that a surface gets when it is [made from its mesh](SurfaceFromMesh). What is `None` or `false` stays as
/// the entity has it. For an entity that the game spawns itself, it is simpler to spawn the components beside
/// [`SurfaceFromMesh`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SurfaceSettings {
    /// Half the contact distance.
    pub thickness: Option<SurfaceThickness>,
    /// How triangles are tested.
    pub method: Option<ContactMethod>,
    /// What the surface meets.
    pub layers: Option<SurfaceLayers>,
    /// Whether it has an inside.
    pub sidedness: Option<Sidedness>,
    /// Which surface the mesh stands for.
    pub shape: Option<SurfaceShape>,
    /// Inserts [`SelfCollision`].
    pub self_collision: bool,
    /// Inserts [`SweptCollision`].
    pub swept_collision: bool,
    /// Inserts [`ContactEventsEnabled`].
    pub contact_events: bool,
}

impl SurfaceSettings {
    pub(super) fn insert(&self, entity: &mut EntityCommands) {
        fn insert_if<C: Component>(entity: &mut EntityCommands, component: Option<C>) {
            if let Some(component) = component {
                entity.try_insert(component);
            }
        }
        insert_if(entity, self.thickness);
        insert_if(entity, self.method);
        insert_if(entity, self.layers);
        insert_if(entity, self.sidedness);
        insert_if(entity, self.shape);
        insert_if(entity, self.self_collision.then_some(SelfCollision));
        insert_if(entity, self.swept_collision.then_some(SweptCollision));
        insert_if(entity, self.contact_events.then_some(ContactEventsEnabled));
    }
}

/// Inserts [`SurfaceFromMesh`] into every descendant that has a [`Mesh3d`](bevy_mesh::Mesh3d), as soon as it is there.
/// For the root of a scene, such as a loaded glTF file. Stays on the root, so meshes that are spawned below it later
/// become surfaces too. A descendant whose `SurfaceFromMesh` the game removes stays without.
///
/// Descendants are found by the [`Name`] of the mesh entity, or of its nearest ancestor below the root that is listed.
/// In a glTF scene, that ancestor is the node.
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_ecs::prelude::*;
/// # fn spawn(mut commands: Commands) {
/// commands.spawn((
///     // The scene, and:
///     SurfaceFromMeshHierarchy::new(SurfaceFromMesh::default())
///         .with_name("Skirt", SurfaceFromMesh::default().weld_within(1.0e-5))
///         .without_name("Eyes"),
/// ));
/// # }
/// ```
#[derive(Component, Clone, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
pub struct SurfaceFromMeshHierarchy {
    /// For meshes that are not listed by name. `None` leaves them out. Default: [`SurfaceFromMesh::default`].
    pub default: Option<SurfaceFromMesh>,
    /// By name. `None` leaves a mesh out.
    pub by_name: HashMap<String, Option<SurfaceFromMesh>>,
}

impl Default for SurfaceFromMeshHierarchy {
    /// Makes surfaces of all meshes.
    fn default() -> Self {
        Self::new(SurfaceFromMesh::default())
    }
}

impl SurfaceFromMeshHierarchy {
    /// Makes surfaces of all meshes, or with `None` only of those that are listed by name.
    #[must_use]
    pub fn new(default: impl Into<Option<SurfaceFromMesh>>) -> Self {
        Self { default: default.into(), by_name: HashMap::new() }
    }

    /// Makes surfaces with other options of meshes with this name.
    #[must_use]
    pub fn with_name(mut self, name: impl Into<String>, from_mesh: SurfaceFromMesh) -> Self {
        self.by_name.insert(name.into(), Some(from_mesh));
        self
    }

    /// Leaves meshes with this name out.
    #[must_use]
    pub fn without_name(mut self, name: impl Into<String>) -> Self {
        self.by_name.insert(name.into(), None);
        self
    }
}

/// Writes the surface to its mesh at the end of each tick in which something else than the mesh has moved it, such as
/// the response or a solver of the game: between [`DeformableSystems::Writeback`](crate::DeformableSystems::Writeback)
/// and [`DeformableSystems::Events`](crate::DeformableSystems::Events). The asset is changed in place. Normals are
/// computed anew if the mesh has any. Tangents are not.
///
/// The mesh must belong to the entity alone, and must not be skinned or morphed when it is drawn. If it cannot be
/// written, [`SurfaceMeshNotWritten`](super::SurfaceMeshNotWritten) is sent with the reason, and contacts go on.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[require(SurfaceFromMesh)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
pub struct WriteSurfaceToMesh {
    /// Angle between the normals of two faces, in radians, from which their edge is a crease, if the mesh has one
    /// vertex for each side of the edge. Up to half of it, the edge is smooth. In between, the smoothing fades out.
    /// 0 to π. Default: 1, or 57°, as in [`CircumsphereSettings`](crate::CircumsphereSettings).
    pub crease_angle: f32,
}

impl Default for WriteSurfaceToMesh {
    fn default() -> Self {
        Self { crease_angle: crate::settings::CircumsphereSettings::default().crease_angle }
    }
}

/// The mesh, and the bits of the weld distance.
pub(super) type SourceKey = (AssetId<Mesh>, u32);

/// What a surface was last made and posed from.
#[derive(Component, Clone, Debug, Default)]
pub(super) struct MeshLink {
    /// `None` while the entity has no surface from a mesh.
    pub(super) made: Option<Made>,
    /// Why it has none.
    pub(super) failure: Option<Failure>,
    /// The change tick of the positions that were last written to the mesh, or compared with it.
    pub(super) written: Option<Tick>,
    /// Why they could not be written.
    pub(super) not_written: Option<SurfaceMeshError>,
}

/// The state of a surface that was made from a mesh.
#[derive(Clone, Debug)]
pub(super) struct Made {
    pub(super) key: SourceKey,
    /// The version of the triangles.
    pub(super) triangles: u64,
    /// The version of everything else in the mesh.
    pub(super) version: u64,
    /// The matrices of the joints, if it is skinned.
    pub(super) joints: Option<Vec<Affine3A>>,
    /// The weights of the morph targets.
    pub(super) weights: Vec<f32>,
}

/// Why a mesh is no surface.
#[derive(Clone, Debug)]
pub(super) struct Failure {
    pub(super) reason: SurfaceMeshError,
    /// Whether the quarantine has been reported.
    pub(super) is_reported: bool,
}
