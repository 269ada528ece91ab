//! The interface for a broad phase of your own: boxes come in, pairs of overlapping boxes go out.

use bevy_ecs::{prelude::*, system::SystemParam};

use crate::{
    detection::{
        pairs::{CandidateTrianglePairs, Frame, OtherSide, SurfacePair, reaches_half_space, shape_bounds},
        reuse::DetectionMemory,
        state::{SurfaceState, SurfaceStates},
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        exact::rigid_shape::ShapeGeometry,
        mesh::{bounds::Aabb, ids::TriangleId},
        spatial_hash::HashCounts,
    },
    surface::ActiveSurfaces,
};

/// The boxes of a surface's triangles in the frame of a pair.
#[derive(Clone, Copy, Debug)]
pub struct BoxSide<'a> {
    /// The surface.
    pub entity: Entity,
    /// Increases by 1 whenever the boxes change. Unique among all surfaces. `None` if the boxes were transformed into
    /// the frame of another surface, for this pair only.
    pub version: Option<u64>,
    /// One box per triangle.
    pub boxes: &'a [Aabb],
}

/// The boxes whose overlapping pairs an algorithm has to find.
#[derive(Clone, Copy, Debug)]
pub enum SurfaceBoxes<'a> {
    /// All pairs of boxes of one surface, the lower index first.
    Own(BoxSide<'a>),
    /// All pairs of a box of the first surface and a box of the second.
    Between([BoxSide<'a>; 2]),
}

/// The triangles of a surface with their boxes in the frame of another one, and these boxes alone.
pub(super) type MovedBoxes = (Vec<(u32, Aabb)>, Vec<Aabb>);

/// Writes the candidates that a broad phase of your own finds.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::{
/// #     SurfaceDetection, detection::{BroadPhaseSystems, CandidateWriter, SurfaceBoxes, TreeBroadPhasePlugin},
/// #     prelude::*,
/// # };
/// # use bevy_ecs::prelude::*;
/// fn find_by_hand(mut candidates: CandidateWriter) {
///     candidates.write(|surfaces, pairs| {
///         let [first, second] = match surfaces {
///             SurfaceBoxes::Own(side) => [side, side],
///             SurfaceBoxes::Between(sides) => sides,
///         };
///         let is_own = matches!(surfaces, SurfaceBoxes::Own(_));
///         for (a, own) in (0..).zip(first.boxes) {
///             for (b, other) in (0..).zip(second.boxes) {
///                 if own.overlaps(other) && (!is_own || a < b) {
///                     pairs.push([a, b]);
///                 }
///             }
///         }
///     });
/// }
///
/// let mut app = App::new();
/// app.add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>());
/// app.add_systems(SurfaceDetection, find_by_hand.in_set(BroadPhaseSystems::PairTriangles));
/// ```
#[derive(SystemParam)]
pub struct CandidateWriter<'w, 's> {
    active: Res<'w, ActiveSurfaces>,
    candidates: ResMut<'w, CandidateTrianglePairs>,
    memory: Res<'w, DetectionMemory>,
    states: Res<'w, SurfaceStates>,
    diagnostics: ResMut<'w, DetectionDiagnostics>,
    moved: Local<'s, MovedBoxes>,
}

impl CandidateWriter<'_, '_> {
    /// Calls `find` for every pair of surfaces that has changed. `find` appends every pair of boxes that overlap, each
    /// once, by their indices. Neighbors are dropped afterwards. Unchanged pairs keep their candidates, and pairs with
    /// shapes are handled here.
    pub fn write(&mut self, mut find: impl FnMut(SurfaceBoxes<'_>, &mut Vec<[u32; 2]>)) {
        self.write_counted(|surfaces, pairs| {
            find(surfaces, pairs);
            HashCounts::default()
        });
    }

    /// Like [`write`](Self::write), for an algorithm that counts cells.
    pub(super) fn write_counted(&mut self, mut find: impl FnMut(SurfaceBoxes<'_>, &mut Vec<[u32; 2]>) -> HashCounts) {
        let start = StageWatch::start("broad phase");
        let Self { active, candidates, memory, states, diagnostics, moved } = self;
        let active = &**active;
        for (place, pair) in candidates.pairs.iter_mut().enumerate() {
            if memory.keeps(place) {
                continue;
            }
            let second = match pair.second {
                OtherSide::Surface(second) => second,
                OtherSide::Shape(shape) => {
                    pair_with_shape(active, pair, shape, states.all()[pair.first].triangle_boxes());
                    continue;
                }
            };
            let surfaces = surface_boxes(active, states.all(), (pair, second), moved);
            diagnostics.count_cells(&find(surfaces, &mut pair.triangles));
            if pair.is_self() {
                let topology = &active.surfaces[pair.first].topology;
                pair.triangles.retain(|&[a, b]| !topology.share_vertex(TriangleId(a), TriangleId(b)));
            }
        }
        let count = memory.changed(&candidates.pairs).map(|pair| pair.triangles.len()).sum();
        diagnostics.finish(start, count, count);
    }
}

/// The boxes of a pair of surfaces in its frame. `second` is its second side.
pub(super) fn surface_boxes<'a>(
    active: &ActiveSurfaces,
    states: &'a [SurfaceState],
    (pair, second): (&mut SurfacePair, usize),
    (triangles, boxes): &'a mut MovedBoxes,
) -> SurfaceBoxes<'a> {
    let side = |place: usize| {
        let state = &states[place];
        BoxSide { entity: active.surfaces[place].entity, version: Some(state.version()), boxes: state.triangle_boxes() }
    };
    if pair.is_self() {
        return SurfaceBoxes::Own(side(pair.first));
    }
    let mut sides = [side(pair.first), side(second)];
    if let Some(surface) = pair.moved_surface(active) {
        let (number, place) = match pair.frame {
            Frame::First => (1, second),
            Frame::Second => (0, pair.first),
        };
        triangles.clear();
        pair.mover(surface, states[place].positions()).move_all(triangles);
        boxes.clear();
        boxes.extend(triangles.iter().map(|(_, bounds)| *bounds));
        sides[number] = BoxSide { version: None, boxes, ..sides[number] };
    }
    SurfaceBoxes::Between(sides)
}

/// Appends the triangles of a surface whose boxes reach a shape.
pub(super) fn pair_with_shape(active: &ActiveSurfaces, pair: &mut SurfacePair, shape: usize, boxes: &[Aabb]) {
    let shape = &active.shapes[shape];
    let reach = shape_bounds(pair, shape, &active.surfaces[pair.first]);
    let mut triangles = std::mem::take(&mut pair.triangles);
    let reached = (0u32..).zip(boxes).filter(|(_, bounds)| match (&reach, &*shape.geometry) {
        (Some(reach), _) => reach.overlaps(bounds),
        (None, ShapeGeometry::HalfSpace { normal }) => reaches_half_space(pair, *normal, bounds),
        (None, _) => true,
    });
    triangles.extend(reached.map(|(triangle, _)| [triangle, 0]));
    pair.triangles = triangles;
}
