//! Contacts between features of one kind, eight side by side.
//!
//! What the screen has found to count needs no second look: its weights, points and directions follow, by the arithmetic of
//! `triangle_pair`, operation by operation. What is too close for a direction is left to that.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use arrayvec::ArrayVec;
use fearless_simd::{Level, dispatch, f64x8, prelude::*};
use glam::DVec3;

use self::kernels::{edges_through_faces, pairs_of_edges, vertices_on_edges, vertices_over_faces};
use super::{
    cases::{BoundaryCases, Cases},
    feature::{Feature, FeaturePair},
};
use crate::kernel::{
    contact::CompactContact,
    lanes::{DoubleVectorLanes, DoubleVectorRows, VectorRows, WIDTH, rounded},
    pair::{PairSettings, RowPair, SurfaceSide, is_inside},
};

mod kernels;

/// Of separations whose square is smaller, the direction is left to the test of a pair alone, which scales them first.
const LEAST_SQUARED: f64 = 1.0e-150;

/// One feature pair on its way.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct FeatureTask {
    pub(in crate::kernel) triangles: [u32; 2],
    pub(in crate::kernel) features: FeaturePair,
    /// Of those, see [`feature_number`](crate::kernel::contact::feature_number).
    pub(in crate::kernel) numbers: [u32; 2],
    pub(in crate::kernel) is_shared: bool,
    /// Where the contact belongs.
    pub(in crate::kernel) place: u32,
}

impl FeatureTask {
    #[inline(always)]
    fn new(pair: &RowPair<'_>, features: FeaturePair, is_shared: bool, contacts: &mut Vec<CompactContact>) -> Self {
        let numbers = [pair.number(0, features.a), pair.number(1, features.b)];
        let place = contacts.len() as u32;
        contacts.push(CompactContact::NONE);
        Self { triangles: pair.triangles, features, numbers, is_shared, place }
    }
}

/// The tasks of one kind that wait for their company, with up to five points each: those of the feature named first, then
/// those of the other.
struct Batch {
    points: [DoubleVectorRows; 5],
    origin: DoubleVectorRows,
    /// Below this a distance is none.
    nothing: [f64; WIDTH],
    /// Where the feature named first is of the second triangle, one bit each.
    swapped: u64,
    tasks: ArrayVec<FeatureTask, WIDTH>,
}

impl Batch {
    fn new() -> Self {
        let tasks = ArrayVec::new();
        Self {
            points: [DoubleVectorRows::ZERO; 5],
            origin: DoubleVectorRows::ZERO,
            nothing: [0.0; WIDTH],
            swapped: 0,
            tasks,
        }
    }

    /// Adds a task, of which the feature named first is on the given side. Whether they are complete.
    #[inline(always)]
    fn push(&mut self, task: FeatureTask, first: usize, origin: DVec3, points: &[DVec3], nothing: f64) -> bool {
        let lane = self.tasks.len();
        for (rows, &point) in self.points.iter_mut().zip(points) {
            rows.set(lane, point);
        }
        self.origin.set(lane, origin);
        self.nothing[lane] = nothing;
        self.swapped |= (first as u64) << lane;
        self.tasks.push(task);
        self.tasks.is_full()
    }
}

/// What comes out of a batch, rounded as contacts are.
struct Results {
    /// Weights of the start and the end of the first feature where it is an edge.
    first: [[f32; WIDTH]; 2],
    /// Those of the start and the end of the second edge, or of the face's first two corners.
    second: [[f32; WIDTH]; 2],
    point_b: VectorRows,
    normal: VectorRows,
    distance: [f32; WIDTH],
    /// From the point on the second triangle to that on the first.
    separation: DoubleVectorRows,
    /// The contacts whose points are far enough apart for a direction, one bit each.
    reliable: u64,
    /// Those of them that are near enough to be reported.
    reported: u64,
}

/// All kinds of feature pairs, and what becomes of them.
pub(in crate::kernel) struct FeatureBatches<'a> {
    vertex_face: Batch,
    edge_edge: Batch,
    piercing: Batch,
    vertex_edge: Batch,
    /// From the centroid of the second triangle to that of the first, of piercing edges.
    across: DoubleVectorRows,
    results: Results,
    limits: Limits,
    sides: Sides<'a>,
    /// What does not become a contact here.
    left: LeftOver,
}

/// What batches leave: places of contacts that nothing is written to.
#[derive(Default)]
pub(in crate::kernel) struct LeftOver {
    /// Feature pairs too close for a direction: their contacts only the test of the pair alone can tell.
    pub(in crate::kernel) doubtful: Vec<FeatureTask>,
    /// Whether a place is empty because its contact is too far away to be reported.
    pub(in crate::kernel) has_gaps: bool,
}

/// What of the surfaces decides about contacts.
#[derive(Clone, Copy)]
struct Sides<'a> {
    same_surface: bool,
    /// Both, if they can be inside each other.
    solid: Option<[&'a SurfaceSide<'a>; 2]>,
}

impl<'a> FeatureBatches<'a> {
    pub(in crate::kernel) fn new(sides: [&'a SurfaceSide<'a>; 2], settings: &PairSettings) -> Self {
        let results = Results {
            first: [[0.0; WIDTH]; 2],
            second: [[0.0; WIDTH]; 2],
            point_b: VectorRows::ZERO,
            normal: VectorRows::ZERO,
            distance: [0.0; WIDTH],
            separation: DoubleVectorRows::ZERO,
            reliable: 0,
            reported: 0,
        };
        Self {
            vertex_face: Batch::new(),
            edge_edge: Batch::new(),
            piercing: Batch::new(),
            vertex_edge: Batch::new(),
            across: DoubleVectorRows::ZERO,
            results,
            limits: Limits { scale: settings.scale, reported: settings.reported_distance },
            sides: Sides {
                same_surface: settings.same_surface,
                solid: (!settings.same_surface && sides.iter().any(|side| side.one_sided)).then_some(sides),
            },
            left: LeftOver::default(),
        }
    }

    /// Adds cases of a pair of triangles, all of which count, appends a place for the contact of each, and writes those of
    /// whatever is complete by that. Which of them other pairs may report as well is in `shared`. Distances up to `nothing`
    /// are none.
    #[inline(always)]
    pub(in crate::kernel) fn add(
        &mut self,
        pair: &RowPair<'_>,
        [cases, shared]: [Cases; 2],
        nothing: f64,
        contacts: &mut Vec<CompactContact>,
    ) {
        let corner = |side: usize, corner: usize| pair.corner(side, corner);
        let origin = corner(0, 0);
        for case in cases.and(Cases::EDGES).each() {
            let [a, b] = case.parts().map(|part| part - 3);
            let ends = [corner(0, a), corner(0, (a + 1) % 3), corner(1, b), corner(1, (b + 1) % 3)];
            if self.edge_edge.push(
                FeatureTask::new(pair, case.features(), shared.contain(case), contacts),
                0,
                origin,
                &ends,
                nothing,
            ) {
                self.finish_edge_edge(contacts);
            }
        }
        for case in cases.and(Cases::VERTICES_OVER_FACES).each() {
            let task = FeatureTask::new(pair, case.features(), shared.contain(case), contacts);
            let side = usize::from(task.features.b != Feature::Face);
            let [first, second, third] = pair.corners(1 - side);
            let points = [corner(side, case.parts()[side]), first, second, third];
            if self.vertex_face.push(task, side, origin, &points, nothing) {
                self.finish_vertex_face(contacts);
            }
        }
        for case in cases.and(Cases::PIERCING).each() {
            let task = FeatureTask::new(pair, case.features(), shared.contain(case), contacts);
            let side = usize::from(task.features.b != Feature::Face);
            let sum = |corners: [DVec3; 3]| corners.iter().sum::<DVec3>();
            self.across.set(self.piercing.tasks.len(), (sum(pair.corners(0)) - sum(pair.corners(1))) / 3.0);
            let (edge, [first, second, third]) = (case.parts()[side] - 3, pair.corners(1 - side));
            let points = [corner(side, edge), corner(side, (edge + 1) % 3), first, second, third];
            if self.piercing.push(task, side, origin, &points, nothing) {
                self.finish_piercing(contacts);
            }
        }
    }

    /// Adds what of a pair is on the boundaries of both, in the same way: other pairs may always report it as well.
    #[inline(always)]
    pub(in crate::kernel) fn add_boundary(
        &mut self,
        pair: &RowPair<'_>,
        cases: BoundaryCases,
        nothing: f64,
        contacts: &mut Vec<CompactContact>,
    ) {
        let origin = pair.corner(0, 0);
        for (side, vertex, edge, is_start) in cases.each() {
            let own = Feature::Vertex(vertex as u8);
            let other = if is_start { Feature::Vertex(edge as u8) } else { Feature::Edge(edge as u8) };
            let features = if side == 0 { FeaturePair { a: own, b: other } } else { FeaturePair { a: other, b: own } };
            let task = FeatureTask::new(pair, features, true, contacts);
            let ends = [pair.corner(1 - side, edge), pair.corner(1 - side, (edge + 1) % 3)];
            let points = [pair.corner(side, vertex), ends[0], ends[1]];
            if self.vertex_edge.push(task, side, origin, &points, nothing) {
                self.finish_vertex_edge(contacts);
            }
        }
    }

    /// Writes the contacts of all that is left.
    pub(in crate::kernel) fn finish(mut self, contacts: &mut [CompactContact]) -> LeftOver {
        self.finish_vertex_face(contacts);
        self.finish_edge_edge(contacts);
        self.finish_piercing(contacts);
        self.finish_vertex_edge(contacts);
        self.left
    }

    fn finish_vertex_face(&mut self, contacts: &mut [CompactContact]) {
        let Self { vertex_face: batch, results, left, limits, .. } = self;
        dispatch!(Level::new(), simd => vertices_over_faces(simd, batch, *limits, results));
        results.write(batch, self.sides, contacts, left);
    }

    fn finish_edge_edge(&mut self, contacts: &mut [CompactContact]) {
        let Self { edge_edge: batch, results, left, limits, .. } = self;
        dispatch!(Level::new(), simd => pairs_of_edges(simd, batch, *limits, results));
        results.write(batch, self.sides, contacts, left);
    }

    fn finish_vertex_edge(&mut self, contacts: &mut [CompactContact]) {
        let Self { vertex_edge: batch, results, left, limits, .. } = self;
        dispatch!(Level::new(), simd => vertices_on_edges(simd, batch, *limits, results));
        results.write(batch, self.sides, contacts, left);
    }

    fn finish_piercing(&mut self, contacts: &mut [CompactContact]) {
        let Self { piercing: batch, across, results, left, limits, .. } = self;
        dispatch!(Level::new(), simd => edges_through_faces(simd, batch, across, *limits, results));
        results.write(batch, self.sides, contacts, left);
    }
}

/// Up to where contacts are reported, and how many world units one of the pair's frame is.
#[derive(Clone, Copy)]
struct Limits {
    scale: f64,
    reported: f64,
}

impl Results {
    /// Writes the contacts of a batch, and empties it.
    #[inline(always)]
    fn write(&self, batch: &mut Batch, sides: Sides<'_>, contacts: &mut [CompactContact], left: &mut LeftOver) {
        for (lane, task) in batch.tasks.iter().enumerate() {
            if self.reported >> lane & 1 != 0 {
                // Written where it stays: whoever copies a record that has just been put together waits for its parts.
                contacts[task.place as usize] = self.contact(lane, task, sides.same_surface);
                if let Some(solid) = sides.solid
                    && is_inside(solid, task.triangles, task.features, self.separation.get(lane))
                {
                    let contact = &mut contacts[task.place as usize];
                    (contact.normal, contact.distance) = (-contact.normal, -contact.distance);
                }
            } else if self.reliable >> lane & 1 == 0 {
                left.doubtful.push(*task);
            } else {
                left.has_gaps = true;
            }
        }
        batch.swapped = 0;
        batch.tasks.clear();
    }

    #[inline(always)]
    fn contact(&self, lane: usize, task: &FeatureTask, same_surface: bool) -> CompactContact {
        let FeaturePair { a, b } = task.features;
        let [first, second] = [&self.first, &self.second].map(|[start, end]| [start[lane], end[lane]]);
        let weights = |feature: Feature, edge: [f32; 2]| {
            let [start, end] = edge;
            match feature {
                Feature::Vertex(corner) => [f32::from(corner == 0), f32::from(corner == 1)],
                Feature::Edge(0) => [start, end],
                Feature::Edge(1) => [0.0, start],
                Feature::Edge(_) => [end, 0.0],
                Feature::Face => second,
            }
        };
        // An edge that pierces a face is named first, whichever side it is of.
        let of_b = if matches!(a, Feature::Face) { first } else { second };
        CompactContact::between_features(
            task.triangles,
            same_surface,
            task.features,
            task.numbers,
            task.is_shared,
            [weights(a, first), weights(b, of_b)],
            self.point_b.get(lane),
            self.normal.get(lane),
            self.distance[lane],
        )
    }

    /// Keeps separations, how long they are, and which of them and of their directions can be relied on. Returns the
    /// directions.
    #[inline(always)]
    fn set_distance<S: Simd>(
        &mut self,
        simd: S,
        separation: DoubleVectorLanes<S>,
        distance: f64x8<S>,
        batch: &Batch,
        limits: Limits,
    ) -> DoubleVectorLanes<S> {
        let squared = separation.dot(separation);
        let is_something = distance.simd_gt(f64x8::from_slice(simd, &batch.nothing)) | distance.simd_eq(0.0);
        let reliable = squared.simd_gt(LEAST_SQUARED) & squared.simd_lt(f64::MAX) & is_something;
        let scaled = distance * limits.scale;
        self.reliable = reliable.to_bitmask();
        self.reported = (reliable & scaled.simd_le(limits.reported)).to_bitmask();
        rounded(scaled).store_slice(&mut self.distance);
        separation.store(&mut self.separation);
        separation.scaled(f64x8::splat(simd, 1.0) / squared.sqrt())
    }
}
