//! The components a game spawns. [`DeformableSurface`] brings all the others with their defaults.

use std::sync::Arc;

use bevy_ecs::{change_detection::Tick, lifecycle::HookContext, prelude::*, world::DeferredWorld};
use bevy_transform::components::Transform;
use bytemuck::cast_slice;
use glam::Vec3;

use super::{
    prepare::QuarantineReason,
    spheres::{Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature},
};
use crate::kernel::{
    mesh::{ids::VertexId, topology::SurfaceTopology, validation::TopologyError},
    pose::Pose,
};

/// A triangle mesh that may deform, and takes part in contacts.
///
/// Make one with [`from_mesh`](Self::from_mesh). Replace it to give the entity another mesh.
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
    SurfaceFrame,
    Registration,
    Transform,
    TriangleCurvature,
    EnclosingBalls,
    Circumspheres,
    TriangleCones
)]
pub struct DeformableSurface {
    topology: Arc<SurfaceTopology>,
    mean_edge: f32,
}

impl DeformableSurface {
    /// Makes a surface from vertex positions and triangles (vertex numbers, counter-clockwise seen from outside).
    /// Spawn the returned pair as a bundle. Vertices with exactly equal positions count as connected; those that differ by
    /// rounding can be [welded](SurfaceBuilder::weld_within).
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
    /// No triangle, a vertex number out of range, a position that is not finite, too many elements: see
    /// [`TopologyError`].
    pub fn from_mesh(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(Self, SurfacePositions), TopologyError> {
        Self::builder(positions, triangles).build()
    }

    /// The same with more to say about how the surface is made.
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

    /// Another surface with the same triangles: the adjacency is shared, not copied. Give it its own
    /// [`SurfacePositions`], or it waits until it has some.
    #[must_use]
    pub fn instance(&self) -> Self {
        self.clone()
    }

    /// The triangles and their adjacency.
    #[must_use]
    pub fn topology(&self) -> &Arc<SurfaceTopology> {
        &self.topology
    }

    /// Mean length of the unique edges in the mesh that the surface was made from, in the unit of the positions.
    #[must_use]
    pub fn mean_edge(&self) -> f32 {
        self.mean_edge
    }
}

/// Makes a [`DeformableSurface`], see [`DeformableSurface::builder`].
#[derive(Clone, Copy, Debug)]
pub struct SurfaceBuilder<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    weld_distance: f32,
}

impl SurfaceBuilder<'_> {
    /// Takes vertices for connected whose positions are no farther apart than `distance`, in the unit of the positions: finite,
    /// 0 or more. Default 0, where only exactly equal positions count. Vertices in a chain of such steps are all connected.
    ///
    /// For meshes whose seams differ by rounding, as exporters leave them: then a closed mesh is open, and has neither an inside
    /// nor a volume. 1e-5 of the size of the mesh closes such seams. The distance has to stay below the shortest edge:
    /// triangles with a shorter edge collapse.
    ///
    /// Positions are not changed. While connected vertices are apart, each triangle reports contacts of its own corner. An
    /// [`XpbdBody`](crate::response::XpbdBody) moves them as one: its first tick sets them to the position of the first of
    /// them, and so closes the seam, by no more than the distance (or a chain of them).
    #[must_use]
    pub const fn weld_within(mut self, distance: f32) -> Self {
        self.weld_distance = distance;
        self
    }

    /// Makes the surface. Spawn the returned pair as a bundle.
    ///
    /// # Errors
    /// A distance to weld within that is negative or not finite, and those of [`DeformableSurface::from_mesh`].
    pub fn build(self) -> Result<(DeformableSurface, SurfacePositions), TopologyError> {
        let Self { positions, triangles, weld_distance } = self;
        let topology = Arc::new(SurfaceTopology::welded_within(positions, triangles, weld_distance)?);
        let mean_edge = topology.mean_edge_length(positions) as f32;
        Ok((DeformableSurface { topology, mean_edge }, SurfacePositions(positions.to_vec())))
    }
}

/// The current vertex positions of a surface, in the order of the mesh it was made from: what the game writes every
/// tick. Empty: the surface waits. A [rigid shape](super::RigidShape) made of triangles has its vertices in one, to be read
/// only. Where Bevy has seen nobody write to them since the last tick, what was made of them is kept:
/// of what is written past change detection nobody can say which stages notice it.
#[derive(Component, Clone, Debug, Default, PartialEq)]
pub struct SurfacePositions(pub Vec<Vec3>);

/// Half the distance at which two surfaces touch: a pair touches within the sum of both thicknesses. A rigid shape has
/// none: a surface touches it within its own.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub enum SurfaceThickness {
    /// World units, 0 or more.
    World(f32),
    /// Times the mean edge length of the mesh that the surface was made from (and its pose's scale), 0 or more.
    MeanEdges(f32),
}

impl Default for SurfaceThickness {
    /// A twentieth of the mean edge: thin enough that the triangles of a well-shaped mesh at rest do not touch each
    /// other.
    fn default() -> Self {
        Self::MeanEdges(0.05)
    }
}

/// Tests a surface against itself too, whatever its layers. Triangles that share a vertex, or vertices at exactly equal
/// positions of the first mesh, are neighbors and not tested against each other.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SelfCollision;

/// Has the surface's motion since the last tick swept against every surface that it meets by its layers, and with
/// [`SelfCollision`] against itself: what passes through another surface between two ticks is found, with the time at
/// which it first meets it. Read by [`SurfaceImpacts`](crate::SurfaceImpacts). For bullets, thin sheets, whatever may move
/// farther than its contact distance in a tick; contacts are the same with or without it.
///
/// - Vertices move in straight lines in the world between where they were in the last detection and where they are. With a
///   [`SweptTarget`] they do so between where they are and that.
/// - A surface without this component stands where it is now, even if it has moved since the last tick, but for a way to its
///   [`SweptTarget`]. Give it to both of two that move. [Rigid shapes](super::RigidShape) of all kinds are met on their way from
///   their pose of the last detection to this one whether they have it or not; a shape that has it meets surfaces without it, too.
/// - Only what is fast is tested: pairs of triangles of which at least one has a vertex that moves farther than half
///   of its surface's thickness, less what the larger of both surfaces moves by as a whole. What passes through each
///   other more slowly is in contact before and after, within half of the contact distance. A surface of which nothing is fast costs a look at its vertices.
/// - An impact is when two triangles are at distance 0, thickness left aside. A time is never later than the true one,
///   and earlier by no more than the way that f64 rounds, some 1e-13 of the size of the surfaces. What touches or crosses before it
///   moves is an impact at time 0.
/// - In its first tick, after a jump ([`Teleported`]) and after a pause a surface has no motion but that to a target.
/// - Solids are as they are, but for cylinders and cones, which have 256 flat sides in theirs. What is inside of one to begin with
///   meets it on its way out.
///
/// This is about detection, which finds impacts and prevents none. With
/// [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin) the component also keeps an
/// [`XpbdBody`](crate::response::XpbdBody) from passing through things: [what is
/// guaranteed](crate::response#what-is-guaranteed).
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[require(PreviousPositions, SweptTarget)]
#[component(on_remove = Self::on_remove)]
pub struct SweptCollision;

impl SweptCollision {
    fn on_remove(mut world: DeferredWorld, context: HookContext) {
        world.commands().entity(context.entity).try_remove::<PreviousPositions>();
    }
}

/// Where a surface with [`SweptCollision`] was in the last detection: where its motion begins in the next one.
#[derive(Component, Clone, Debug, Default)]
pub struct PreviousPositions {
    /// Its positions, in its own frame.
    pub positions: Vec<Vec3>,
    /// Where it stood in the world.
    pub pose: Pose,
    /// The version of the positions: with the same version they are the same bit by bit.
    pub(crate) version: u64,
    /// The detection that this is of.
    pub(crate) detection: u64,
}

impl PreviousPositions {
    pub(crate) fn remember(&mut self, positions: &[Vec3], pose: Pose, version: u64, detection: u64) {
        if self.version != version || self.detection + 1 != detection {
            self.positions.clear();
            self.positions.extend_from_slice(positions);
        }
        (self.pose, self.version, self.detection) = (pose, version, detection);
    }
}

/// Where a solver expects the vertices of a surface at the end of this tick, in the surface's own
/// frame and the order of [`SurfacePositions`]: the way from the current positions to these is swept instead of that since
/// the last tick. Write it in [`DeformableSystems::Predict`](crate::DeformableSystems::Predict).
///
/// Every surface has one, and every rigid shape made of triangles. Default empty: no target. A surface without [`SweptCollision`] that
/// has a target is on its way, too, for those that it meets.
///
/// Ignored where it is empty, has another length than the positions, or a coordinate is not finite. It stays until it is
/// written again: empty it after a jump.
/// [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin) writes it itself for every body, and for what the game moves near
/// one.
#[derive(Component, Clone, Debug, Default, PartialEq)]
pub struct SweptTarget(pub Vec<Vec3>);

/// How a pair of triangles is tested. Of two different methods the more exact one, the later here, decides. Against a
/// [`RigidShape`](super::RigidShape) the test is exact, whatever the method.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ContactMethod {
    /// Touching is when the enclosing balls come within the contact distance. Coarse.
    BoundingSphere,
    /// Touching is when the offset spheres do so, neither the triangles' planes nor those across the line between the
    /// centers separate the triangles, and that line lies in both safety cones. Fast and smooth, and misses some contacts.
    Circumsphere,
    /// Touching is when the triangles cross or come within the contact distance. Misses none. Of a pair that does not
    /// cross only the closest features make a contact, where `Refined` has all within the contact distance.
    Closest,
    /// Touching is when the triangles cross or come within the contact distance. Misses none.
    #[default]
    Refined,
    /// The same result as `Refined`, with every candidate tested exactly, alone and whole: the baseline to compare with.
    Polygon,
}

impl ContactMethod {
    /// Every method, the coarsest first.
    pub const ALL: [Self; 5] = [Self::BoundingSphere, Self::Circumsphere, Self::Closest, Self::Refined, Self::Polygon];

    /// Whether it finds the pairs that touch and no others.
    #[must_use]
    pub fn is_exact(self) -> bool {
        self >= Self::Closest
    }
}

/// Which groups a surface or shape belongs to, and which it meets. Two meet where each belongs to a group that the
/// other meets.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceLayers {
    /// One bit a group that it belongs to. Default: the first.
    pub memberships: u32,
    /// One bit a group that it meets. Default: all.
    pub filters: u32,
}

impl Default for SurfaceLayers {
    fn default() -> Self {
        Self { memberships: 1, filters: u32::MAX }
    }
}

impl SurfaceLayers {
    /// Whether two meet.
    #[must_use]
    pub const fn interacts_with(self, other: Self) -> bool {
        self.memberships & other.filters != 0 && other.memberships & self.filters != 0
    }
}

/// Whether a surface, or a [`RigidShape`](super::RigidShape) made of triangles, has an inside. Solids have one in any case. It
/// decides about the sign of distances and the direction of normals, never about
/// what touches.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sidedness {
    /// One-sided where the mesh is closed and consistently wound, two-sided otherwise.
    #[default]
    Auto,
    /// Its normals point out of the solid; what is behind it has penetrated. Contacts of the surface with itself are
    /// two-sided all the same: behind a face may be just the other side of a thin wall.
    OneSided,
    /// A sheet. What was on one side of it in the last tick and is on the other now has penetrated, for as long as the
    /// same two features stay in contact, even if the [`SurfaceOrder`] changes. Remembered between sheets, rigid ones included, and
    /// within one surface; against a one-sided surface, that one's inside decides.
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

/// What the positions are relative to.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SurfaceFrame {
    /// The entity's transform and those of its parents: rotation, translation, uniform scale, mirroring.
    #[default]
    Local,
    /// The world, whatever the transform says: skinned meshes.
    World,
}

/// Takes a surface or shape out of detection for as long as it is there.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceDisabled;

/// Insert it when positions or pose of a surface or shape jump: nothing remembered from earlier ticks is used for the next one.
/// Removed by the next tick.
///
/// With [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin): a body goes along with its transform, free vertices too,
/// instead of keeping its place in the world. Anything else jumps to where the game has written it, instead of sweeping all that
/// is between.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Teleported;

/// Asks for messages and entity events about the contacts of a surface or shape, for as long as it is there: inserted
/// during a contact, it brings the end of that contact but not its start.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ContactEventsEnabled;

/// A place in the order of contacts that does not depend on spawn order, lower first; for worlds that must agree
/// between machines. Without it, or where it is equal, the order of registration decides. Of a surface and a rigid
/// shape, the shape is always the second side.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct SurfaceOrder(pub u32);

/// What became of a surface or shape in the last tick.
#[derive(Component, Clone, Debug, Default, PartialEq)]
pub enum SurfaceStatus {
    /// It has no positions yet, or no tick has run yet.
    #[default]
    Waiting,
    /// It took part.
    Active,
    /// It is [disabled](SurfaceDisabled).
    Disabled,
    /// It cannot be used; it is taken back as soon as it can.
    Quarantined(QuarantineReason),
}

/// The number under which an entity was first registered as a surface or shape.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[component(on_add = Self::on_add)]
pub(crate) struct Registration(pub(crate) u64);

/// The next registration number.
#[derive(Resource, Default)]
pub(crate) struct NextRegistration(u64);

impl Registration {
    fn on_add(mut world: DeferredWorld, context: HookContext) {
        let Some(mut next) = world.get_resource_mut::<NextRegistration>() else { return };
        next.0 += 1;
        let number = next.0;
        if let Some(mut registration) = world.get_mut::<Self>(context.entity) {
            registration.0 = number;
        }
    }
}

/// What the last check of a surface's positions found: the one place where NaN and infinity are noticed.
#[derive(Component, Clone, Copy, Debug, Default)]
pub(crate) struct CheckedPositions {
    /// The change tick of the positions, where all were finite, and what no coordinate is larger than.
    passed: Option<(Tick, f32)>,
}

impl CheckedPositions {
    /// Checks positions that have been written to since the last check. Returns a bound on the magnitude of the coordinates.
    pub(crate) fn check(&mut self, positions: &Ref<SurfacePositions>) -> Result<f32, QuarantineReason> {
        let changed = positions.last_changed();
        if let Some((seen, at_most)) = self.passed
            && seen == changed
        {
            return Ok(at_most);
        }
        self.passed = None;
        let at_most = if first_large(&positions.0).is_none() { LARGE } else { f32::MAX };
        if at_most == f32::MAX
            && let Some(vertex) = first_non_finite(&positions.0)
        {
            return Err(QuarantineReason::NonFinitePosition(vertex));
        }
        self.passed = Some((changed, at_most));
        Ok(at_most)
    }
}

/// 2^60: in a usual pose, smaller coordinates are far from the end of f32.
const LARGE: f32 = f32::from_bits((127 + 60) << 23);

/// The first position that is not finite.
pub(crate) fn first_non_finite(positions: &[Vec3]) -> Option<VertexId> {
    first_beyond(positions, f32::INFINITY)
}

/// The first position with a coordinate of [`LARGE`] or more, or that is not finite.
fn first_large(positions: &[Vec3]) -> Option<VertexId> {
    first_beyond(positions, LARGE)
}

/// The first position with a coordinate of a power of two or more, or that is no number.
fn first_beyond(positions: &[Vec3], power: f32) -> Option<VertexId> {
    /// Numbers, enough for the loop over a block to be worth more than the question after it.
    const BLOCK: usize = 192;
    const EXPONENT: u32 = 0x7f80_0000;
    // Infinity and what is no number have the largest exponent.
    let is_special = |bits: u32| bits & EXPONENT >= power.to_bits();
    let numbers: &[u32] = cast_slice(positions);
    let has_special = |block: &[u32]| block.iter().fold(false, |found, &bits| found | is_special(bits));
    let block = numbers.chunks(BLOCK).position(has_special)?;
    let within = numbers[block * BLOCK..].iter().position(|&bits| is_special(bits))?;
    Some(VertexId(((block * BLOCK + within) / 3) as u32))
}
