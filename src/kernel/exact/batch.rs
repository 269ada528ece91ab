//! Contacts between features of one kind, eight side by side.
//!
//! What the screen has found to count needs no second look: its weights, points and directions follow, by the arithmetic of
//! `triangle_pair`, operation by operation. What is too close for a direction is left to that.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use arrayvec::ArrayVec;
use fearless_simd::{Level, dispatch, f64x8, mask64x8, prelude::*};
use glam::DVec3;

use super::{
    cases::{BoundaryCases, Cases},
    feature::{Feature, FeaturePair},
    triangle_pair::AT_END,
};
use crate::kernel::{
    contact::CompactContact,
    lanes::{DoubleVectorLanes, DoubleVectorRows, VectorRows, WIDTH, rounded},
    pair::{PairSettings, RowPair},
};

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
    fn new(
        pair: &RowPair<'_>,
        features: FeaturePair,
        is_shared: bool,
        contacts: &mut Vec<CompactContact>,
    ) -> Self {
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
    /// The contacts whose points are far enough apart for a direction, one bit each.
    reliable: u64,
    /// Those of them that are near enough to be reported.
    reported: u64,
}

/// All kinds of feature pairs of surfaces that have no inside, and what becomes of them.
pub(in crate::kernel) struct FeatureBatches {
    vertex_face: Batch,
    edge_edge: Batch,
    piercing: Batch,
    vertex_edge: Batch,
    /// From the centroid of the second triangle to that of the first, of piercing edges.
    across: DoubleVectorRows,
    results: Results,
    limits: Limits,
    same_surface: bool,
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

impl FeatureBatches {
    pub(in crate::kernel) fn new(settings: &PairSettings) -> Self {
        let results = Results {
            first: [[0.0; WIDTH]; 2],
            second: [[0.0; WIDTH]; 2],
            point_b: VectorRows::ZERO,
            normal: VectorRows::ZERO,
            distance: [0.0; WIDTH],
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
            same_surface: settings.same_surface,
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
            if self.edge_edge.push(FeatureTask::new(pair, case.features(), shared.contain(case), contacts), 0, origin, &ends, nothing) {
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
            let features =
                if side == 0 { FeaturePair { a: own, b: other } } else { FeaturePair { a: other, b: own } };
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
        results.write(batch, self.same_surface, contacts, left);
    }

    fn finish_edge_edge(&mut self, contacts: &mut [CompactContact]) {
        let Self { edge_edge: batch, results, left, limits, .. } = self;
        dispatch!(Level::new(), simd => pairs_of_edges(simd, batch, *limits, results));
        results.write(batch, self.same_surface, contacts, left);
    }

    fn finish_vertex_edge(&mut self, contacts: &mut [CompactContact]) {
        let Self { vertex_edge: batch, results, left, limits, .. } = self;
        dispatch!(Level::new(), simd => vertices_on_edges(simd, batch, *limits, results));
        results.write(batch, self.same_surface, contacts, left);
    }

    fn finish_piercing(&mut self, contacts: &mut [CompactContact]) {
        let Self { piercing: batch, across, results, left, limits, .. } = self;
        dispatch!(Level::new(), simd => edges_through_faces(simd, batch, across, *limits, results));
        results.write(batch, self.same_surface, contacts, left);
    }
}

#[inline(always)]
fn vertices_on_edges<S: Simd>(simd: S, batch: &Batch, limits: Limits, results: &mut Results) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [vertex, start, end, ..] = &batch.points;
    let absolute = [
        DoubleVectorLanes::load(simd, vertex),
        DoubleVectorLanes::load(simd, start),
        DoubleVectorLanes::load(simd, end),
    ];
    let [vertex, start, end] = [absolute[0] - origin, absolute[1] - origin, absolute[2] - origin];
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let (edge, from_start) = (end - start, vertex - start);
    let squared = edge.dot(edge);
    let inverse = squared.simd_gt(zero).select(one / squared, zero);
    let along = (from_start.dot(edge) * inverse).max(zero).min(one);
    let between = from_start - edge.scaled(along);
    let distance = between.dot(between).sqrt();
    let along = along.simd_le(AT_END).select(zero, along);
    let weights = [one - along, along];
    for side in [&mut results.first, &mut results.second] {
        rounded(weights[0]).store_slice(&mut side[0]);
        rounded(weights[1]).store_slice(&mut side[1]);
    }
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    let point = absolute[1].scaled(weights[0]).plus(absolute[2].scaled(weights[1]));
    DoubleVectorLanes::select(swapped, absolute[0], point).rounded().store(&mut results.point_b);
    let separation = vertex - start.scaled(weights[0]).plus(end.scaled(weights[1]));
    let direction = results.set_distance(simd, separation, distance, batch, limits);
    DoubleVectorLanes::select(swapped, direction.negated(), direction).rounded().store(&mut results.normal);
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
    fn write(&self, batch: &mut Batch, same_surface: bool, contacts: &mut [CompactContact], left: &mut LeftOver) {
        let lanes = (1 << batch.tasks.len()) - 1;
        let is_whole = self.reported & lanes == lanes;
        for (lane, task) in batch.tasks.iter().enumerate() {
            if is_whole || self.reported >> lane & 1 != 0 {
                // Written where it stays: whoever copies a record that has just been put together waits for its parts.
                contacts[task.place as usize] = self.contact(lane, task, same_surface);
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

    /// Keeps how long separations are, and which of them and of their directions can be relied on. Returns the
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
        separation.scaled(f64x8::splat(simd, 1.0) / squared.sqrt())
    }
}

#[inline(always)]
fn vertices_over_faces<S: Simd>(simd: S, batch: &Batch, limits: Limits, results: &mut Results) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [vertex, first, second, third, _] = &batch.points;
    let corners = [
        DoubleVectorLanes::load(simd, first),
        DoubleVectorLanes::load(simd, second),
        DoubleVectorLanes::load(simd, third),
    ];
    let absolute = DoubleVectorLanes::load(simd, vertex);
    let position = absolute - origin;
    let local = [(corners[0] - origin), (corners[1] - origin), (corners[2] - origin)];
    let edges = [(local[1] - local[0]), (local[2] - local[1]), (local[0] - local[2])];
    let normal = edges[0].cross(edges[1]);
    let inverse = f64x8::splat(simd, 1.0) / normal.dot(normal);
    let height = normal.dot(position - local[0]);
    let distance_squared = height * height * inverse;
    let first = normal.cross(edges[1]).dot(position - local[1]);
    let second = normal.cross(edges[2]).dot(position - local[2]);
    let third = normal.cross(edges[0]).dot(position - local[0]);
    let (weights, point) = normalized(simd, [first, second, third], corners);
    rounded(weights[0]).store_slice(&mut results.second[0]);
    rounded(weights[1]).store_slice(&mut results.second[1]);
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    DoubleVectorLanes::select(swapped, absolute, point).rounded().store(&mut results.point_b);
    let separation = normal.scaled(height * inverse);
    let direction = results.set_distance(simd, separation, distance_squared.sqrt(), batch, limits);
    DoubleVectorLanes::select(swapped, direction.negated(), direction).rounded().store(&mut results.normal);
}

#[inline(always)]
fn pairs_of_edges<S: Simd>(simd: S, batch: &Batch, limits: Limits, results: &mut Results) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [start_a, end_a, start_b, end_b, _] = &batch.points;
    let (start_a, end_a) =
        (DoubleVectorLanes::load(simd, start_a) - origin, DoubleVectorLanes::load(simd, end_a) - origin);
    let (absolute_start, absolute_end) = (DoubleVectorLanes::load(simd, start_b), DoubleVectorLanes::load(simd, end_b));
    let (start_b, end_b) = ((absolute_start - origin), (absolute_end - origin));
    let (u, v) = ((end_a - start_a), (end_b - start_b));
    let normal = u.cross(v);
    let between = start_b - start_a;
    let height = normal.dot(between);
    let one = f64x8::splat(simd, 1.0);
    let inverse = one / normal.dot(normal);
    let distance_squared = height * height * inverse;
    let along_a = between.cross(v).dot(normal) * inverse;
    let along_b = between.cross(u).dot(normal) * inverse;
    let (from_a, from_b) = (one - along_a, one - along_b);
    rounded(from_a).store_slice(&mut results.first[0]);
    rounded(along_a).store_slice(&mut results.first[1]);
    rounded(from_b).store_slice(&mut results.second[0]);
    rounded(along_b).store_slice(&mut results.second[1]);
    absolute_start.scaled(from_b).plus(absolute_end.scaled(along_b)).rounded().store(&mut results.point_b);
    let separation = normal.scaled(-height * inverse);
    let direction = results.set_distance(simd, separation, distance_squared.sqrt(), batch, limits);
    direction.rounded().store(&mut results.normal);
}

/// `across` is the way from the second triangle to the first.
#[inline(always)]
fn edges_through_faces<S: Simd>(
    simd: S,
    batch: &Batch,
    across: &DoubleVectorRows,
    limits: Limits,
    results: &mut Results,
) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [start, end, first, second, third] = &batch.points;
    let corners = [
        DoubleVectorLanes::load(simd, first),
        DoubleVectorLanes::load(simd, second),
        DoubleVectorLanes::load(simd, third),
    ];
    let (absolute_start, absolute_end) = (DoubleVectorLanes::load(simd, start), DoubleVectorLanes::load(simd, end));
    let (start, end) = ((absolute_start - origin), (absolute_end - origin));
    let local = [(corners[0] - origin), (corners[1] - origin), (corners[2] - origin)];
    let edge = end - start;
    let normal = (local[1] - local[0]).cross(local[2] - local[1]);
    let (from, to) = (normal.dot(start - local[0]), normal.dot(end - local[0]));
    let (p, q, r) = ((local[0] - start), (local[1] - start), (local[2] - start));
    let volumes = [edge.dot(q.cross(r)), edge.dot(r.cross(p)), edge.dot(p.cross(q))];
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let along = (from / (from - to)).max(zero).min(one);
    rounded(one - along).store_slice(&mut results.first[0]);
    rounded(along).store_slice(&mut results.first[1]);
    let (weights, point_on_face) = normalized(simd, volumes, corners);
    rounded(weights[0]).store_slice(&mut results.second[0]);
    rounded(weights[1]).store_slice(&mut results.second[1]);
    let point_on_edge = absolute_start.scaled(one - along).plus(absolute_end.scaled(along));
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    DoubleVectorLanes::select(swapped, point_on_edge, point_on_face).rounded().store(&mut results.point_b);

    // The normal of the face, on the side where more of the first triangle lies.
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let normal = normal.scaled(one / normal.dot(normal).sqrt());
    let away = normal.dot(DoubleVectorLanes::load(simd, across)).simd_lt(zero);
    let direction = results.set_distance(simd, normal, zero, batch, limits);
    DoubleVectorLanes::select(away, direction.negated(), direction).rounded().store(&mut results.normal);
}

/// Weights that are proportional to three values of the same sign, and the point they stand for.
#[inline(always)]
fn normalized<S: Simd>(
    simd: S,
    areas: [f64x8<S>; 3],
    corners: [DoubleVectorLanes<S>; 3],
) -> ([f64x8<S>; 3], DoubleVectorLanes<S>) {
    let one = f64x8::splat(simd, 1.0);
    let inverse = one / (areas[0] + areas[1] + areas[2]);
    let (second, third) = (areas[1] * inverse, areas[2] * inverse);
    let first = one - second - third;
    let point = corners[0].scaled(first).plus(corners[1].scaled(second)).plus(corners[2].scaled(third));
    ([first, second, third], point)
}
