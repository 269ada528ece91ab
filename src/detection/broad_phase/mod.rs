//! Stage 2: finds which surfaces and shapes are near each other, and which of their triangles may be.
//!
//! [`BroadPhasePlugin`] pairs surfaces. One algorithm plugin beside it pairs their triangles. Every algorithm results
//! in the same contacts. To use your own, disable [`TreeBroadPhasePlugin`] and add a system in
//! [`BroadPhaseSystems::PairTriangles`] that calls [`CandidateWriter::write`].

mod brute_force;
mod custom;
mod moved;
mod tree;

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use super::{
    bounds::{moved_box, world_growth},
    kept_pairs::KeptPairs,
    memory::DetectionMemory,
    state::SurfaceStates,
};
use crate::{
    diagnostics::DetectionDiagnostics,
    kernel::{bvh::tree::BoxTree, capacity, mesh::bounds::Aabb, pose::Pose},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::{CircumsphereSettings, EVENT_HYSTERESIS},
    surface::{ActiveShape, ActiveSurface, ActiveSurfaces, ContactMethod},
};
pub use brute_force::BruteForceBroadPhasePlugin;
pub use custom::{BoxSide, CandidateWriter, SurfaceBoxes};
pub(super) use tree::SurfaceTree;
pub use tree::TreeBroadPhasePlugin;
pub(super) use tree::{MovedLeaves, Traversal, asked::Asked};

/// A tree is rebuilt when its boxes have grown by this factor relative to the whole. A refitted tree gives correct
/// results at any age, but becomes slower.
const REBUILD_DECAY: f32 = 1.5;

/// The two steps of the broad phase, in this order.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BroadPhaseSystems {
    /// Pairs surfaces and shapes whose boxes overlap.
    PairSurfaces,
    /// Pairs triangles whose boxes overlap and that no slab separates.
    PairTriangles,
}

/// The second side of a pair, by its index in [`ActiveSurfaces`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OtherSide {
    /// A surface. In a self-collision, the same one.
    Surface(usize),
    /// A rigid shape.
    Shape(usize),
}

/// Which side's frame a pair is tested in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// The first surface.
    First,
    /// The second surface or the shape.
    Second,
}

/// A surface and something that it may touch, with the triangles that may be within range.
#[derive(Clone, Debug)]
pub struct SurfacePair {
    /// The index of the first side in [`ActiveSurfaces::surfaces`].
    pub first: usize,
    /// The second side. Of two surfaces, the later one.
    pub second: OtherSide,
    /// How the pair is tested.
    pub method: ContactMethod,
    /// Triangles touch within this distance, in world units.
    pub contact_distance: f32,
    /// Contacts are reported up to this distance, in world units.
    pub reported_distance: f32,
    /// The largest distance at which a pair of triangles matters, in world units.
    pub range: f32,
    /// Whose own frame the pair is tested in: that of the shape, or of the surface with more triangles.
    pub frame: Frame,
    /// World pose of that frame.
    pub frame_pose: Pose,
    /// Transforms the other side's own frame to that frame.
    pub relative_pose: Pose,
    /// Triangles of the other surface that may be near, with their boxes in that frame, if the algorithm lists them.
    pub moved_triangles: Vec<(u32, Aabb)>,
    /// Vertices of the other surface in that frame. NaN if none of their triangles was transformed. Empty if none was,
    /// or if the positions are in that frame already.
    pub moved_positions: Vec<Vec3>,
    /// Upper bound of the rounding error of those, in the unit of the frame.
    pub moved_rounding: f32,
    /// The candidate pairs: triangles of the first and second surface whose boxes overlap. In a self-collision, the
    /// lower triangle comes first, and neighbors are left out. With a shape, the second number is 0. If the method
    /// culls, pairs that a slab separates by more than the range may be missing (the tree leaves them out, see
    /// [`PairFate::Planes`](crate::kernel::pair_fate::PairFate::Planes)), and so may pairs that are known to be farther
    /// apart, see [`PairFate::Remembered`](crate::kernel::pair_fate::PairFate::Remembered).
    pub triangles: Vec<[u32; 2]>,
}

impl SurfacePair {
    /// Whether a surface is paired with itself.
    #[must_use]
    pub fn is_self(&self) -> bool {
        self.second == OtherSide::Surface(self.first)
    }

    /// The vertices of the first and second surface in the pair's frame, given those in their own frames.
    pub(crate) fn positions<'a>(&'a self, first: &'a [Vec3], second: &'a [Vec3]) -> [&'a [Vec3]; 2] {
        match self.frame {
            _ if self.moved_positions.is_empty() => [first, second],
            Frame::First => [first, &self.moved_positions],
            Frame::Second => [&self.moved_positions, second],
        }
    }

    /// The poses of the first and second surface in the pair's frame.
    pub(crate) fn poses(&self) -> [&Pose; 2] {
        match self.frame {
            Frame::First => [&Pose::IDENTITY, &self.relative_pose],
            Frame::Second => [&self.relative_pose, &Pose::IDENTITY],
        }
    }
}

/// The results of the broad phase: pairs of surfaces in their order, then surfaces with shapes.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct CandidateTrianglePairs {
    pub(crate) pairs: Vec<SurfacePair>,
}

impl CandidateTrianglePairs {
    /// The pairs.
    #[must_use]
    pub fn pairs(&self) -> &[SurfacePair] {
        &self.pairs
    }

    /// The number of candidate pairs of triangles.
    #[must_use]
    pub fn triangle_pair_count(&self) -> usize {
        self.pairs.iter().map(|pair| pair.triangles.len()).sum()
    }
}

/// Writes for each active surface whether it is part of a pair that is tested by `method`.
pub(crate) fn surfaces_with_method<'a>(
    active: &ActiveSurfaces,
    pairs: impl Iterator<Item = &'a SurfacePair>,
    method: ContactMethod,
    used: &mut Vec<bool>,
) {
    used.clear();
    used.resize(active.surfaces.len(), false);
    for pair in pairs.filter(|pair| pair.method == method) {
        used[pair.first] = true;
        if let OtherSide::Surface(second) = pair.second {
            used[second] = true;
        }
    }
}

/// Pairs surfaces and shapes. Needs one algorithm plugin beside it.
pub struct BroadPhasePlugin;

impl Plugin for BroadPhasePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<CandidateTrianglePairs>().init_resource::<DetectionMemory>().init_resource::<KeptPairs>();
        app.configure_sets(
            SurfaceDetection,
            (BroadPhaseSystems::PairSurfaces, BroadPhaseSystems::PairTriangles)
                .chain()
                .in_set(SurfaceDetectionSystems::BroadPhase),
        );
        app.add_systems(SurfaceDetection, pair_surfaces.in_set(BroadPhaseSystems::PairSurfaces));
    }
}

/// State and buffers that are kept from tick to tick.
#[derive(Default)]
struct PairingBuffers {
    bounds: Vec<Aabb>,
    tree: BoxTree,
    places: Vec<[u32; 2]>,
    with_shapes: Vec<[usize; 2]>,
    /// The pairs of the last tick, until they are kept or their lists are reused.
    last: Vec<Option<SurfacePair>>,
    /// The names of those pairs, ascending.
    last_names: Vec<(bool, usize, usize)>,
}

impl PairingBuffers {
    /// Refits the tree over the surfaces, or rebuilds it.
    fn update_tree(&mut self, surfaces: &[ActiveSurface]) {
        self.bounds.clear();
        self.bounds.extend(surfaces.iter().map(|surface| surface.world_bounds));
        let Self { bounds, tree, .. } = self;
        if tree.len() == bounds.len() {
            tree.refit(bounds);
        }
        if tree.len() != bounds.len() || tree.decay() > REBUILD_DECAY {
            tree.rebuild(bounds);
        }
    }

    /// The pair of two sides from the last detection, and its index there, if nothing about them has changed.
    fn keep(&mut self, memory: &DetectionMemory, first: usize, second: OtherSide) -> Option<(SurfacePair, u32)> {
        let (last_first, last_second) = memory.last_sides(first, second)?;
        let place = self.last_names.binary_search(&name(last_first, last_second)).ok()?;
        Some((SurfacePair { first, second, ..self.last[place].take()? }, place as u32))
    }

    /// The lists that two sides had in the last detection, cleared, and the index of their pair there.
    fn reuse(&mut self, memory: &DetectionMemory, first: usize, second: OtherSide) -> (PairLists, Option<u32>) {
        let former = memory.former_sides(first, second).and_then(|(first, second)| {
            let place = self.last_names.binary_search(&name(first, second)).ok()?;
            Some((self.last[place].take()?, place as u32))
        });
        let Some((pair, place)) = former else { return Default::default() };
        let mut lists = (pair.triangles, pair.moved_triangles, pair.moved_positions);
        capacity::clear(&mut lists.0);
        capacity::clear(&mut lists.1);
        capacity::clear(&mut lists.2);
        (lists, Some(place))
    }
}

fn pair_surfaces(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut buffers: Local<PairingBuffers>,
    states: Res<SurfaceStates>,
) {
    let start = Instant::now();
    let surfaces = &active.surfaces;
    if surfaces.is_empty() {
        buffers.tree = BoxTree::default();
    }
    buffers.update_tree(surfaces);
    capacity::trim(&mut buffers.bounds, surfaces.len());
    let mut places = std::mem::take(&mut buffers.places);
    places.clear();
    buffers.tree.self_pairs(&mut places);
    places.retain(|&[first, second]| surfaces[first as usize].meets(&surfaces[second as usize]));
    let selves = surfaces.iter().enumerate().filter(|(_, surface)| surface.self_collision);
    places.extend(selves.map(|(place, _)| [place as u32, place as u32]));
    places.sort_unstable();

    memory.begin(&active, &settings, states.all());
    buffers.last_names.clear();
    buffers.last_names.extend(candidates.pairs.iter().map(|pair| name(pair.first, pair.second)));
    buffers.last.clear();
    buffers.last.extend(candidates.pairs.drain(..).map(Some));
    for &[first, second] in &places {
        let [first, second] = [first as usize, second as usize];
        if let Some((pair, origin)) = buffers.keep(&memory, first, OtherSide::Surface(second)) {
            memory.keep_pair(origin);
            candidates.pairs.push(pair);
            continue;
        }
        let (lists, former) = buffers.reuse(&memory, first, OtherSide::Surface(second));
        memory.add_pair(former);
        candidates.pairs.push(surface_pair(surfaces, first, second, lists));
    }
    let mut with_shapes = std::mem::take(&mut buffers.with_shapes);
    with_shapes.clear();
    for (place, shape) in active.shapes.iter().enumerate() {
        let meet = |surface: u32| {
            let surface = &surfaces[surface as usize];
            !surface.rigid && surface.layers.interacts_with(shape.layers)
        };
        match shape.geometry.bounds() {
            // The boxes of the surfaces include half the margin. A shape has no box that includes the other half.
            Some(bounds) => {
                let reach = moved_box(&bounds, &shape.pose).grown(0.5 * shape.margin);
                buffers.tree.query(&reach, |surface| {
                    with_shapes.extend(meet(surface).then_some([surface as usize, place]));
                });
            }
            None => with_shapes.extend(
                (0..surfaces.len() as u32).filter(|&surface| meet(surface)).map(|surface| [surface as usize, place]),
            ),
        }
    }
    with_shapes.sort_unstable();
    for &[first, place] in &with_shapes {
        if let Some((pair, origin)) = buffers.keep(&memory, first, OtherSide::Shape(place)) {
            memory.keep_pair(origin);
            candidates.pairs.push(pair);
            continue;
        }
        let (lists, former) = buffers.reuse(&memory, first, OtherSide::Shape(place));
        memory.add_pair(former);
        let pair = shape_pair(&surfaces[first], first, &active.shapes[place], place, lists);
        candidates.pairs.push(pair);
    }
    memory.end_pairs();
    let count = candidates.pairs.len();
    capacity::trim(&mut candidates.pairs, count);
    // Frees the lists of pairs that no longer exist.
    buffers.last.clear();
    capacity::trim(&mut buffers.last, count);
    capacity::trim(&mut buffers.last_names, count);
    buffers.places = places;
    capacity::trim(&mut buffers.places, count);
    buffers.with_shapes = with_shapes;
    capacity::trim(&mut buffers.with_shapes, count);
    diagnostics.finish("pair surfaces", start, surfaces.len() + active.shapes.len(), count);
}

/// The sort key of pairs: by their surfaces, with shapes last.
fn name(first: usize, second: OtherSide) -> (bool, usize, usize) {
    match second {
        OtherSide::Surface(second) => (false, first, second),
        OtherSide::Shape(shape) => (true, first, shape),
    }
}

/// Pairs of triangles, transformed triangles, and transformed positions.
type PairLists = (Vec<[u32; 2]>, Vec<(u32, Aabb)>, Vec<Vec3>);

/// The margin of a pair. Halves are added, because the boxes of both sides are grown by them.
fn mean_margin(a: f32, b: f32) -> f32 {
    0.5 * a + 0.5 * b
}

fn range(contact_distance: f32, margin: f32) -> f32 {
    (contact_distance * (1.0 + EVENT_HYSTERESIS)).max(contact_distance + margin)
}

fn surface_pair(
    surfaces: &[ActiveSurface],
    first: usize,
    second: usize,
    (triangles, moved_triangles, moved_positions): PairLists,
) -> SurfacePair {
    let (a, b) = (&surfaces[first], &surfaces[second]);
    let contact_distance = a.thickness + b.thickness;
    let margin = mean_margin(a.margin, b.margin);
    // The smaller surface is transformed, so a body of a few triangles over a landscape costs what the body costs.
    let (frame, frame_pose, relative_pose) = if b.topology.triangles().len() > a.topology.triangles().len() {
        (Frame::Second, b.pose, a.pose.relative_to(&b.pose))
    } else {
        (Frame::First, a.pose, b.pose.relative_to(&a.pose))
    };
    SurfacePair {
        first,
        second: OtherSide::Surface(second),
        method: a.method.max(b.method),
        contact_distance,
        reported_distance: contact_distance + margin,
        range: range(contact_distance, margin),
        frame,
        frame_pose,
        relative_pose,
        moved_triangles,
        moved_positions,
        moved_rounding: 0.0,
        triangles,
    }
}

fn shape_pair(
    surface: &ActiveSurface,
    first: usize,
    shape: &ActiveShape,
    place: usize,
    (triangles, moved_triangles, moved_positions): PairLists,
) -> SurfacePair {
    let margin = mean_margin(surface.margin, shape.margin);
    SurfacePair {
        first,
        second: OtherSide::Shape(place),
        method: ContactMethod::Exact,
        contact_distance: surface.thickness,
        reported_distance: surface.thickness + margin,
        range: range(surface.thickness, margin),
        frame: Frame::Second,
        frame_pose: shape.pose,
        relative_pose: surface.pose.relative_to(&shape.pose),
        moved_triangles,
        moved_positions,
        moved_rounding: 0.0,
        triangles,
    }
}

/// The box of a shape in a surface's own frame, grown by what the surface's boxes lack. `None` for a half-space.
pub(super) fn shape_bounds(pair: &SurfacePair, shape: &ActiveShape, surface: &ActiveSurface) -> Option<Aabb> {
    let bounds = moved_box(&shape.geometry.bounds()?, &pair.relative_pose.inverse());
    // The boxes of the triangles include the thickness and half the surface's margin. A shape has no thickness, and no
    // box that includes half of its own margin.
    let missing = (pair.range - world_growth(surface.thickness, surface.margin)).max(0.0);
    Some(bounds.grown((f64::from(missing) / surface.pose.scale()) as f32))
}

/// Whether a triangle's box reaches a half-space.
pub(super) fn reaches_half_space(pair: &SurfacePair, normal: glam::DVec3, bounds: &Aabb) -> bool {
    let moved = moved_box(bounds, &pair.relative_pose);
    let lowest = glam::DVec3::select(normal.cmpgt(glam::DVec3::ZERO), moved.min.as_dvec3(), moved.max.as_dvec3());
    normal.dot(lowest) <= f64::from(pair.range) / pair.frame_pose.scale()
}
