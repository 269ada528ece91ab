//! The components that a game spawns. [`DeformableSurface`] adds the ones that it requires, with their defaults.
//!
//! `Prepare` reads and validates them once a tick.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use bevy_transform::components::Transform;
use glam::Vec3;

use super::{
    checked::{CheckedPositions, Registration},
    quarantine::QuarantineReason,
    spheres::{Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature},
    swept::SweptTarget,
};
use crate::kernel::mesh::{topology::SurfaceTopology, validation::TopologyError};

/// A triangle mesh that may deform and takes part in contacts.
///
/// Create one with [`from_mesh`](Self::from_mesh). Replace the component to give the entity another mesh.
#[derive(Component, Clone, Debug)]
#[component(immutable)]
#[require(
    SurfacePositions,
    CheckedPositions,
    SweptTarget,
    SurfaceStatus,
    SurfaceThickness,
    ContactMethod,
    SurfaceLayers,
    Sidedness,
    SurfaceShape,
    SurfaceFrame,
    Registration,
    Transform,
    TriangleCurvature,
    EnclosingBalls,
    Circumspheres,
    TriangleCones
)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug))]
pub struct DeformableSurface {
    pub(super) topology: Arc<SurfaceTopology>,
    pub(super) mean_edge: f32,
}

impl DeformableSurface {
    /// Creates a surface from vertex positions and triangles. Triangles are vertex numbers, counter-clockwise as seen
    /// from outside. Spawn the returned pair as a bundle.
    ///
    /// Vertices at exactly equal positions count as connected. Vertices that differ by rounding can be
    /// [welded](SurfaceBuilder::weld_within).
    ///
    /// ```
    /// # use bevy_circumsphere::prelude::*;
    /// # use glam::Vec3;
    /// # let mut world = bevy_ecs::world::World::new();
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    /// let surface = DeformableSurface::from_mesh(&positions, &[[0, 1, 2]])?;
    /// world.spawn((surface, SelfCollision));
    /// # Ok::<(), TopologyError>(())
    /// ```
    ///
    /// # Errors
    /// If there is no triangle, a vertex number is out of range, a position is not finite, or there are too many
    /// elements. See [`TopologyError`].
    pub fn from_mesh(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(Self, SurfacePositions), TopologyError> {
        Self::builder(positions, triangles).build()
    }

    /// Like [`from_mesh`](Self::from_mesh), with options.
    ///
    /// ```
    /// # use bevy_circumsphere::prelude::*;
    /// # use glam::Vec3;
    /// // Two triangles with a seam that rounding has opened.
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X + 1.0e-7, Vec3::ONE, Vec3::Y];
    /// let triangles = [[0, 1, 2], [5, 3, 4]];
    /// let (surface, _) = DeformableSurface::builder(&positions, &triangles).weld_within(1.0e-5).build()?;
    /// assert_eq!(surface.topology().edges().len(), 5);
    /// # Ok::<(), TopologyError>(())
    /// ```
    #[must_use]
    pub fn builder<'a>(positions: &'a [Vec3], triangles: &'a [[u32; 3]]) -> SurfaceBuilder<'a> {
        SurfaceBuilder { positions, triangles, weld_distance: 0.0 }
    }

    /// Another surface with the same topology, which is shared, not copied. Give it its own [`SurfacePositions`]. It
    /// waits until it has some.
    #[must_use]
    pub fn instance(&self) -> Self {
        self.clone()
    }

    /// The triangles and their adjacency.
    #[must_use]
    pub fn topology(&self) -> &Arc<SurfaceTopology> {
        &self.topology
    }

    /// Mean length of the unique edges of the mesh that the surface was made from, in the unit of the positions.
    #[must_use]
    pub fn mean_edge(&self) -> f32 {
        self.mean_edge
    }
}

/// Builds a [`DeformableSurface`]. See [`DeformableSurface::builder`].
#[derive(Clone, Copy, Debug)]
pub struct SurfaceBuilder<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    weld_distance: f32,
}

impl SurfaceBuilder<'_> {
    /// Connects vertices whose positions are no farther apart than `distance`, in the unit of the positions. Finite, 0
    /// or more. Default: 0, which connects only exactly equal positions. Vertices in a chain of such steps are all
    /// connected.
    ///
    /// Use it for meshes whose seams differ by rounding, as exporters leave them. Without welding, such a mesh is open,
    /// and has neither an inside nor a volume. 1e-5 of the size of the mesh closes the seams. The distance must be
    /// smaller than the shortest edge: triangles with a shorter edge collapse.
    ///
    /// Positions do not change. While connected vertices are apart, each triangle reports contacts of its own corner.
    /// An [`XpbdBody`](crate::response::XpbdBody) moves them as one. Its first tick moves all of them to the position
    /// of the first one, which closes the seam. No vertex moves by more than the distance, or by more than a chain of
    /// such steps.
    #[must_use]
    pub const fn weld_within(mut self, distance: f32) -> Self {
        self.weld_distance = distance;
        self
    }

    /// Builds the surface. Spawn the returned pair as a bundle.
    ///
    /// # Errors
    /// If the weld distance is negative or not finite, and in the cases of [`DeformableSurface::from_mesh`].
    pub fn build(self) -> Result<(DeformableSurface, SurfacePositions), TopologyError> {
        let Self { positions, triangles, weld_distance } = self;
        let topology = Arc::new(SurfaceTopology::welded_within(positions, triangles, weld_distance)?);
        let mean_edge = topology.mean_edge_length(positions) as f32;
        Ok((DeformableSurface { topology, mean_edge }, SurfacePositions(positions.to_vec())))
    }
}

/// The current vertex positions of a surface, in the order of the mesh that it was made from. The game writes them
/// every tick. While they are empty, the surface waits. A [rigid shape](super::RigidShape) made of triangles has its
/// vertices here, read-only.
///
/// What was computed from them is reused until Bevy's change detection reports a write. Do not bypass change detection:
/// it is unspecified which stages notice such a write.
#[derive(Component, Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfacePositions(pub Vec<Vec3>);

/// Half the distance at which two equal surfaces touch. Two surfaces touch within the sum of their thicknesses. A rigid
/// shape has no thickness: a surface touches it within its own.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SurfaceThickness {
    /// In world units, 0 or more.
    World(f32),
    /// In mean edge lengths of the mesh that the surface was made from, times the scale of its pose. 0 or more.
    MeanEdges(f32),
}

impl Default for SurfaceThickness {
    /// A twentieth of the mean edge. This is so thin that the triangles of a well-shaped mesh at rest do not touch each
    /// other.
    fn default() -> Self {
        Self::MeanEdges(0.05)
    }
}

/// Tests a surface against itself too, whatever its layers. Neighbors are not tested against each other. These are
/// triangles that share a vertex, or that have [welded](SurfaceBuilder::weld_within) vertices in common.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SelfCollision;

/// How a pair of triangles is tested. If two surfaces have different methods, the more exact one decides, which is the
/// later one here. Against a [`RigidShape`](super::RigidShape) the test is always exact.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ContactMethod {
    /// Triangles touch if their enclosing balls come within the contact distance. Coarse.
    BoundingSphere,
    /// Triangles touch if their offset spheres come within the contact distance, the line between the sphere centers
    /// lies in both safety cones, and no slab along that line or along a normal separates them. Fast and smooth, but
    /// misses some contacts.
    Circumsphere,
    /// Triangles touch if they cross or come within the contact distance. Misses none. A pair that does not cross makes
    /// contacts of its closest features only, where `Exact` has all features within the contact distance.
    Closest,
    /// Triangles touch if they cross or come within the contact distance. Misses none.
    #[default]
    Exact,
    /// The same result as `Exact`, but every candidate is tested exactly and by itself, without shortcuts. The
    /// baseline for comparisons.
    Polygon,
}

impl ContactMethod {
    /// All methods, coarsest first.
    pub const ALL: [Self; 5] = [Self::BoundingSphere, Self::Circumsphere, Self::Closest, Self::Exact, Self::Polygon];

    /// Whether it reports exactly the pairs that touch.
    #[must_use]
    pub fn is_exact(self) -> bool {
        self >= Self::Closest
    }
}

/// Which groups a surface or shape belongs to, and which groups it meets. Two of them meet if each belongs to a group
/// that the other one meets.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SurfaceLayers {
    /// One bit per group that it belongs to. Default: the first group.
    pub memberships: u32,
    /// One bit per group that it meets. Default: all groups.
    pub filters: u32,
}

impl Default for SurfaceLayers {
    fn default() -> Self {
        Self { memberships: 1, filters: u32::MAX }
    }
}

impl SurfaceLayers {
    /// Whether the two meet.
    #[must_use]
    pub const fn interacts_with(self, other: Self) -> bool {
        self.memberships & other.filters != 0 && other.memberships & self.filters != 0
    }
}

/// Whether a surface, or a [`RigidShape`](super::RigidShape) made of triangles, has an inside. Solids always have one.
/// This determines the sign of distances and the direction of normals, never what touches.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Sidedness {
    /// One-sided if the mesh is closed and consistently wound, two-sided otherwise.
    #[default]
    Auto,
    /// Has an inside. Normals point out of the solid, and what is behind the surface has penetrated. Contacts of the
    /// surface with itself are still two-sided, because behind a face may be the other side of a thin wall.
    OneSided,
    /// A sheet. What was on one side of it in the last tick and is on the other side now has penetrated, for as long as
    /// the same two features stay in contact, even if the [`SurfaceOrder`] changes. Where connected sheets do not cross,
    /// they are on one side of each other, so most of their contacts decide for all. Sides are remembered between sheets,
    /// including rigid ones, and within one surface. Against a one-sided surface, the inside of that surface decides.
    TwoSided,
}

impl Sidedness {
    /// Whether a mesh has an inside.
    pub(crate) fn has_inside(self, topology: &SurfaceTopology) -> bool {
        match self {
            Self::Auto => topology.is_closed(),
            Self::OneSided => true,
            Self::TwoSided => false,
        }
    }
}

/// Which surface a mesh stands for. Both sides of a pair may differ.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SurfaceShape {
    /// The flat triangles themselves.
    #[default]
    Flat,
    /// The smooth surface on which the vertices lie: each triangle is covered by a curved patch that follows the normals
    /// at its corners. Points, normals, and distances of contacts are those of the patches. Edges bent by
    /// [`crease_angle`](field@crate::CircumsphereSettings::crease_angle) or more stay sharp.
    ///
    /// For meshes whose vertices lie on a smooth body. Where they do not, as in CAD meshes or scans whose vertices were
    /// moved, the patches may be farther from the body than the triangles.
    ///
    /// Used between surfaces and against rigid shapes. With the method `Circumsphere`, each triangle has the sphere that
    /// osculates its patch, and each pair of surfaces one contact per pair of these spheres. The balls of
    /// `BoundingSphere` contain the patches. [`SweptCollision`](super::SweptCollision) sees the flat triangles.
    Smooth,
}

/// What the positions of a surface, or a rigid shape, are relative to.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SurfaceFrame {
    /// The entity. Its transform and those of its parents apply: rotation, translation, uniform scale, mirroring.
    #[default]
    Local,
    /// The entity, without any scale: of its transform and those of its parents, only rotation and translation apply.
    /// For what is scaled already, such as the colliders of physics engines, whatever the scale of the entity.
    Unscaled,
    /// The world. Transforms do not apply. For skinned meshes.
    World,
}

/// Excludes a surface or shape from detection while present.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceDisabled;

/// Insert it when the positions or the pose of a surface or shape jump. The next tick uses no results of earlier ticks
/// for it, and removes the component. On a parent, such as the root of a character, it counts for everything below.
///
/// With [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin), a body follows its transform, including free
/// vertices, instead of keeping its place in the world. Anything else jumps to where the game has put it, without
/// sweeping the way. What its pins or tethers hold is [carried along](crate::response::XpbdDiagnostics::carried), also
/// without this component.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Teleported;

/// Enables messages and entity events about the contacts of a surface or shape, while present. If inserted during a
/// contact, it reports the end of that contact but not its start.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ContactEventsEnabled;

/// How many ticks in a row a contact of a surface or shape may be absent without ending. Such a gap is neither reported
/// as an end nor as a new start, so what flickers makes no noise. Of two sides, the larger number counts. Default: 0,
/// which reports the end in the first tick without the contact.
///
/// Only messages and entity events wait, see [`ContactEventsEnabled`]. Contacts themselves come and go as they are. If a
/// side is despawned, disabled, quarantined, or teleported, or if the two no longer meet by their layers, the contact ends
/// in the same tick.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ContactEventHold(pub u32);

/// The order of contacts, independent of the spawn order, lower first. For worlds that must agree between machines.
/// Default: 0. If equal, the order of registration decides. In a pair of a surface and a rigid shape, the shape is
/// always the second side.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceOrder(pub u32);

/// The state of a surface or shape in the last tick.
#[derive(Component, Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
pub enum SurfaceStatus {
    /// It has no positions yet, or no tick has run yet.
    #[default]
    Waiting,
    /// It took part.
    Active,
    /// It is [disabled](SurfaceDisabled), or its entity is, by Bevy's `Disabled`.
    Disabled,
    /// It cannot be used. It becomes active again as soon as it can.
    Quarantined(QuarantineReason),
}
