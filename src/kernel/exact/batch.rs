//! Contacts between features of one kind, eight side by side.
//!
//! What the screen has found to count needs no second look: its weights, points and directions follow, by the arithmetic of
//! `triangle_pair`, operation by operation. What is too close for a direction is left to that.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use arrayvec::ArrayVec;
use fearless_simd::{Level, dispatch, f64x8, mask64x8, prelude::*};
use glam::DVec3;

use super::{
    barycentric::edge_weights,
    feature::{Feature, FeaturePair},
    screen::{Cases, Vectors, WIDTH},
};
use crate::kernel::pair::RowPair;

/// Of separations whose square is smaller, the direction is left to the test of a pair alone, which scales them first.
const LEAST_SQUARED: f64 = 1.0e-150;

/// A vector of each of eight pairs.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Rows([[f64; WIDTH]; 3]);

impl Rows {
    pub(super) const ZERO: Self = Self([[0.0; WIDTH]; 3]);

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, place: DVec3) {
        let Self([x, y, z]) = self;
        (x[lane], y[lane], z[lane]) = (place.x, place.y, place.z);
    }

    #[inline(always)]
    pub(super) fn get(&self, lane: usize) -> DVec3 {
        let Self([x, y, z]) = self;
        DVec3::new(x[lane], y[lane], z[lane])
    }
}

impl<S: Simd> Vectors<S> {
    #[inline(always)]
    fn load(simd: S, Rows([x, y, z]): &Rows) -> Self {
        Self { x: f64x8::from_slice(simd, x), y: f64x8::from_slice(simd, y), z: f64x8::from_slice(simd, z) }
    }

    #[inline(always)]
    fn store(self, Rows([x, y, z]): &mut Rows) {
        self.x.store_slice(x);
        self.y.store_slice(y);
        self.z.store_slice(z);
    }
}

/// A contact of two triangles that have no inside.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct FeatureContact {
    /// The two triangles.
    pub(in crate::kernel) triangles: [u32; 2],
    /// Which of their features.
    pub(in crate::kernel) features: FeaturePair,
    /// The [numbers](crate::kernel::contact::feature_number) of those.
    pub(in crate::kernel) numbers: [u32; 2],
    /// Weights of the corners of either triangle.
    pub(in crate::kernel) barycentrics: [[f64; 3]; 2],
    /// The point on the second triangle.
    pub(in crate::kernel) point_b: DVec3,
    /// Unit vector from the second to the first; `None` where it is too short to tell.
    pub(in crate::kernel) normal: Option<DVec3>,
    /// Distance of the two points.
    pub(in crate::kernel) distance: f64,
}

/// One feature pair on its way.
#[derive(Clone, Copy)]
struct Task {
    triangles: [u32; 2],
    features: FeaturePair,
    numbers: [u32; 2],
    /// Whether the first feature, the vertex or the piercing edge, is of the first triangle.
    first_is_a: bool,
    /// From the centroid of the second triangle to that of the first.
    from_b_to_a: DVec3,
    /// Below this a distance is none.
    nothing: f64,
}

/// The tasks of one kind that wait for their company, with up to five points each: those of the feature named first, then
/// those of the other.
struct Batch {
    points: [Rows; 5],
    origin: Rows,
    tasks: ArrayVec<Task, WIDTH>,
}

impl Batch {
    fn new() -> Self {
        Self { points: [Rows::ZERO; 5], origin: Rows::ZERO, tasks: ArrayVec::new() }
    }

    #[inline(always)]
    fn push(&mut self, task: Task, origin: DVec3, points: &[DVec3]) {
        let lane = self.tasks.len();
        for (rows, &point) in self.points.iter_mut().zip(points) {
            rows.set(lane, point);
        }
        self.origin.set(lane, origin);
        self.tasks.push(task);
    }
}

/// What comes out of a batch.
struct Results {
    /// Along the first feature where it is an edge.
    along: [f64; WIDTH],
    /// Along the second edge, or the weights of the face's last two corners.
    weights: [[f64; WIDTH]; 2],
    point_b: Rows,
    direction: Rows,
    distance: [f64; WIDTH],
    reliable: u64,
}

/// All kinds, and what is found of them.
pub(in crate::kernel) struct FeatureBatches {
    vertex_face: Batch,
    edge_edge: Batch,
    piercing: Batch,
    results: Results,
}

impl FeatureBatches {
    pub(in crate::kernel) fn new() -> Self {
        let results = Results {
            along: [0.0; WIDTH],
            weights: [[0.0; WIDTH]; 2],
            point_b: Rows::ZERO,
            direction: Rows::ZERO,
            distance: [0.0; WIDTH],
            reliable: 0,
        };
        Self { vertex_face: Batch::new(), edge_edge: Batch::new(), piercing: Batch::new(), results }
    }

    /// Adds cases of a pair of triangles, all of which count, and gives the contacts of whatever is complete by that.
    /// Distances up to `nothing` are none.
    #[inline(always)]
    pub(in crate::kernel) fn add(
        &mut self,
        pair: &RowPair<'_>,
        cases: Cases,
        nothing: f64,
        mut found: impl FnMut(FeatureContact),
    ) {
        let corner = |side: usize, corner: usize| pair.corner(side, corner);
        let origin = corner(0, 0);
        for case in cases.each() {
            let [part_a, part_b] = case.parts();
            let features = FeaturePair { a: Feature::of_part(part_a), b: Feature::of_part(part_b) };
            let numbers = [pair.number(0, features.a), pair.number(1, features.b)];
            let first_is_a = features.b == Feature::Face;
            let mut task =
                Task { triangles: pair.triangles, features, numbers, first_is_a, from_b_to_a: DVec3::ZERO, nothing };
            let [own, face] = if first_is_a { [0, 1] } else { [1, 0] };
            let own_feature = if first_is_a { features.a } else { features.b };
            match (features.a, features.b) {
                (Feature::Edge(edge_a), Feature::Edge(edge_b)) => {
                    let (a, b) = (edge_a as usize, edge_b as usize);
                    let ends = [corner(0, a), corner(0, (a + 1) % 3), corner(1, b), corner(1, (b + 1) % 3)];
                    self.edge_edge.push(task, origin, &ends);
                    if self.edge_edge.tasks.is_full() {
                        self.finish_edge_edge(&mut found);
                    }
                }
                _ => match own_feature {
                    Feature::Edge(edge) => {
                        let edge = edge as usize;
                        let sum = |corners: [DVec3; 3]| corners.iter().sum::<DVec3>();
                        task.from_b_to_a = (sum(pair.corners(0)) - sum(pair.corners(1))) / 3.0;
                        let [first, second, third] = pair.corners(face);
                        let points = [corner(own, edge), corner(own, (edge + 1) % 3), first, second, third];
                        self.piercing.push(task, origin, &points);
                        if self.piercing.tasks.is_full() {
                            self.finish_piercing(&mut found);
                        }
                    }
                    Feature::Vertex(vertex) => {
                        let [first, second, third] = pair.corners(face);
                        self.vertex_face.push(task, origin, &[corner(own, vertex as usize), first, second, third]);
                        if self.vertex_face.tasks.is_full() {
                            self.finish_vertex_face(&mut found);
                        }
                    }
                    Feature::Face => {}
                },
            }
        }
    }

    /// Gives the contacts of all that is left.
    pub(in crate::kernel) fn finish(&mut self, mut found: impl FnMut(FeatureContact)) {
        self.finish_vertex_face(&mut found);
        self.finish_edge_edge(&mut found);
        self.finish_piercing(&mut found);
    }

    fn finish_vertex_face(&mut self, found: &mut impl FnMut(FeatureContact)) {
        let (batch, results) = (&mut self.vertex_face, &mut self.results);
        let swap =
            batch.tasks.iter().enumerate().fold(0, |bits, (lane, task)| bits | u64::from(!task.first_is_a) << lane);
        dispatch!(Level::new(), simd => vertices_over_faces(simd, batch, swap, results));
        for (lane, task) in batch.tasks.drain(..).enumerate() {
            let Feature::Vertex(vertex) = (if task.first_is_a { task.features.a } else { task.features.b }) else {
                continue;
            };
            let mut weights = [[0.0; 3]; 2];
            weights[0][vertex as usize] = 1.0;
            weights[1] = results.face_weights(lane);
            found(results.contact(lane, &task, weights));
        }
    }

    fn finish_edge_edge(&mut self, found: &mut impl FnMut(FeatureContact)) {
        let (batch, results) = (&mut self.edge_edge, &mut self.results);
        dispatch!(Level::new(), simd => pairs_of_edges(simd, batch, results));
        for (lane, mut task) in batch.tasks.drain(..).enumerate() {
            let (Feature::Edge(edge_a), Feature::Edge(edge_b)) = (task.features.a, task.features.b) else { continue };
            task.first_is_a = true;
            let [along_a, along_b] = [results.along[lane], results.weights[0][lane]];
            let weights = [edge_weights(edge_a as usize, along_a), edge_weights(edge_b as usize, along_b)];
            found(results.contact(lane, &task, weights));
        }
    }

    fn finish_piercing(&mut self, found: &mut impl FnMut(FeatureContact)) {
        let (batch, results) = (&mut self.piercing, &mut self.results);
        let swap =
            batch.tasks.iter().enumerate().fold(0, |bits, (lane, task)| bits | u64::from(!task.first_is_a) << lane);
        let mut across = Rows::ZERO;
        for (lane, task) in batch.tasks.iter().enumerate() {
            across.set(lane, task.from_b_to_a);
        }
        dispatch!(Level::new(), simd => edges_through_faces(simd, batch, &across, swap, results));
        for (lane, task) in batch.tasks.drain(..).enumerate() {
            let Feature::Edge(edge) = (if task.first_is_a { task.features.a } else { task.features.b }) else {
                continue;
            };
            let weights = [edge_weights(edge as usize, results.along[lane]), results.face_weights(lane)];
            found(results.contact(lane, &task, weights));
        }
    }
}

impl Results {
    #[inline(always)]
    fn face_weights(&self, lane: usize) -> [f64; 3] {
        let [second, third] = [self.weights[0][lane], self.weights[1][lane]];
        [1.0 - second - third, second, third]
    }

    /// `weights` are those of the feature named first, then of the other.
    #[inline(always)]
    fn contact(&self, lane: usize, task: &Task, weights: [[f64; 3]; 2]) -> FeatureContact {
        let distance = self.distance[lane];
        let reliable = self.reliable >> lane & 1 != 0 && (distance > task.nothing || distance == 0.0);
        FeatureContact {
            triangles: task.triangles,
            features: task.features,
            numbers: task.numbers,
            barycentrics: if task.first_is_a { weights } else { [weights[1], weights[0]] },
            point_b: self.point_b.get(lane),
            normal: reliable.then(|| self.direction.get(lane)),
            distance,
        }
    }

    /// Keeps the direction of a separation, turned round in some lanes.
    #[inline(always)]
    fn set_direction<S: Simd>(&mut self, simd: S, separation: Vectors<S>, swap: u64) {
        let squared = separation.dot(separation);
        let reliable = squared.simd_gt(LEAST_SQUARED) & squared.simd_lt(f64::MAX);
        self.reliable = reliable.to_bitmask();
        let direction = separation.scaled(f64x8::splat(simd, 1.0) / squared.sqrt());
        direction.negated(mask64x8::from_bitmask(simd, swap)).store(&mut self.direction);
    }
}

#[inline(always)]
fn vertices_over_faces<S: Simd>(simd: S, batch: &Batch, swap: u64, results: &mut Results) {
    let origin = Vectors::load(simd, &batch.origin);
    let [vertex, first, second, third, _] = &batch.points;
    let corners = [Vectors::load(simd, first), Vectors::load(simd, second), Vectors::load(simd, third)];
    let absolute = Vectors::load(simd, vertex);
    let position = absolute.minus(origin);
    let local = [corners[0].minus(origin), corners[1].minus(origin), corners[2].minus(origin)];
    let edges = [local[1].minus(local[0]), local[2].minus(local[1]), local[0].minus(local[2])];
    let normal = edges[0].cross(edges[1]);
    let inverse = f64x8::splat(simd, 1.0) / normal.dot(normal);
    let height = normal.dot(position.minus(local[0]));
    let distance_squared = height * height * inverse;
    let first = normal.cross(edges[1]).dot(position.minus(local[1]));
    let second = normal.cross(edges[2]).dot(position.minus(local[2]));
    let third = normal.cross(edges[0]).dot(position.minus(local[0]));
    let (weights, point) = normalized(simd, [first, second, third], corners);
    weights[1].store_slice(&mut results.weights[0]);
    weights[2].store_slice(&mut results.weights[1]);
    let swapped = mask64x8::from_bitmask(simd, swap);
    Vectors::select(swapped, absolute, point).store(&mut results.point_b);
    results.set_direction(simd, normal.scaled(height * inverse), swap);
    distance_squared.sqrt().store_slice(&mut results.distance);
}

#[inline(always)]
fn pairs_of_edges<S: Simd>(simd: S, batch: &Batch, results: &mut Results) {
    let origin = Vectors::load(simd, &batch.origin);
    let [start_a, end_a, start_b, end_b, _] = &batch.points;
    let (start_a, end_a) = (Vectors::load(simd, start_a).minus(origin), Vectors::load(simd, end_a).minus(origin));
    let (absolute_start, absolute_end) = (Vectors::load(simd, start_b), Vectors::load(simd, end_b));
    let (start_b, end_b) = (absolute_start.minus(origin), absolute_end.minus(origin));
    let (u, v) = (end_a.minus(start_a), end_b.minus(start_b));
    let normal = u.cross(v);
    let between = start_b.minus(start_a);
    let height = normal.dot(between);
    let one = f64x8::splat(simd, 1.0);
    let inverse = one / normal.dot(normal);
    let distance_squared = height * height * inverse;
    let along_a = between.cross(v).dot(normal) * inverse;
    let along_b = between.cross(u).dot(normal) * inverse;
    along_a.store_slice(&mut results.along);
    along_b.store_slice(&mut results.weights[0]);
    absolute_start.scaled(one - along_b).plus(absolute_end.scaled(along_b)).store(&mut results.point_b);
    results.set_direction(simd, normal.scaled(-height * inverse), 0);
    distance_squared.sqrt().store_slice(&mut results.distance);
}

/// `across` is the way from the second triangle to the first, `swap` where the face is of the first.
#[inline(always)]
fn edges_through_faces<S: Simd>(simd: S, batch: &Batch, across: &Rows, swap: u64, results: &mut Results) {
    let origin = Vectors::load(simd, &batch.origin);
    let [start, end, first, second, third] = &batch.points;
    let corners = [Vectors::load(simd, first), Vectors::load(simd, second), Vectors::load(simd, third)];
    let (absolute_start, absolute_end) = (Vectors::load(simd, start), Vectors::load(simd, end));
    let (start, end) = (absolute_start.minus(origin), absolute_end.minus(origin));
    let local = [corners[0].minus(origin), corners[1].minus(origin), corners[2].minus(origin)];
    let edge = end.minus(start);
    let normal = local[1].minus(local[0]).cross(local[2].minus(local[1]));
    let (from, to) = (normal.dot(start.minus(local[0])), normal.dot(end.minus(local[0])));
    let (p, q, r) = (local[0].minus(start), local[1].minus(start), local[2].minus(start));
    let volumes = [edge.dot(q.cross(r)), edge.dot(r.cross(p)), edge.dot(p.cross(q))];
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let along = (from / (from - to)).max(zero).min(one);
    along.store_slice(&mut results.along);
    let (weights, point_on_face) = normalized(simd, volumes, corners);
    weights[1].store_slice(&mut results.weights[0]);
    weights[2].store_slice(&mut results.weights[1]);
    let point_on_edge = absolute_start.scaled(one - along).plus(absolute_end.scaled(along));
    let swapped = mask64x8::from_bitmask(simd, swap);
    Vectors::select(swapped, point_on_edge, point_on_face).store(&mut results.point_b);

    // The normal of the face, on the side where more of the first triangle lies.
    let normal = corners[1].minus(corners[0]).cross(corners[2].minus(corners[0]));
    let normal = normal.scaled(one / normal.dot(normal).sqrt());
    let away = normal.dot(Vectors::load(simd, across)).simd_lt(zero);
    results.set_direction(simd, normal.negated(away), 0);
    zero.store_slice(&mut results.distance);
}

/// Weights that are proportional to three values of the same sign, and the point they stand for.
#[inline(always)]
fn normalized<S: Simd>(simd: S, areas: [f64x8<S>; 3], corners: [Vectors<S>; 3]) -> ([f64x8<S>; 3], Vectors<S>) {
    let one = f64x8::splat(simd, 1.0);
    let inverse = one / (areas[0] + areas[1] + areas[2]);
    let (second, third) = (areas[1] * inverse, areas[2] * inverse);
    let first = one - second - third;
    let point = corners[0].scaled(first).plus(corners[1].scaled(second)).plus(corners[2].scaled(third));
    ([first, second, third], point)
}
