//! The features of eight pairs of triangles, case by case.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{f64x8, mask64x8, prelude::*, u64x8};

use crate::kernel::{
    exact::{
        cases::{BoundaryCases, Cases},
        triangle_pair::{AT_END, PARALLEL_SINE},
    },
    lanes::DoubleVectorLanes,
};

/// A triangle of each pair with what every case needs.
pub(super) struct Side<S: Simd> {
    pub(super) corners: [DoubleVectorLanes<S>; 3],
    pub(super) edges: [DoubleVectorLanes<S>; 3],
    pub(super) lengths_squared: [f64x8<S>; 3],
    pub(super) normal: DoubleVectorLanes<S>,
}

impl<S: Simd> Side<S> {
    #[inline(always)]
    pub(super) fn new(_: S, corners: [DoubleVectorLanes<S>; 3]) -> Self {
        let edges = [(corners[1] - corners[0]), (corners[2] - corners[1]), (corners[0] - corners[2])];
        let lengths_squared = [edges[0].dot(edges[0]), edges[1].dot(edges[1]), edges[2].dot(edges[2])];
        Self { corners, edges, lengths_squared, normal: edges[0].cross(edges[1]) }
    }
}

/// The cases found so far, one bit each, the least squared distance, and whose it is.
pub(super) struct Found<S: Simd> {
    pub(super) cases: u64x8<S>,
    pub(super) nearest: f64x8<S>,
    pub(super) closest: u64x8<S>,
}

impl<S: Simd> Found<S> {
    #[inline(always)]
    pub(super) fn add(&mut self, possible: mask64x8<S>, Cases(case): Cases) {
        self.cases = possible.select(self.cases | u64::from(case), self.cases);
    }

    /// A distance counts wherever there is one, a case only within the range.
    #[inline(always)]
    fn add_distance(
        &mut self,
        possible: mask64x8<S>,
        within_range: mask64x8<S>,
        case: Cases,
        distance_squared: f64x8<S>,
    ) {
        self.add(possible & within_range, case);
        let nearer = possible & distance_squared.simd_lt(self.nearest);
        self.nearest = nearer.select(distance_squared, self.nearest);
        self.closest = nearer.select(u64x8::splat(self.cases.simd, u64::from(case.0)), self.closest);
    }
}

/// The squared distance of every vertex of one from every edge of the other, and where along the edge it is closest.
#[inline(always)]
pub(super) fn vertices_and_edges<S: Simd>(
    simd: S,
    own: &Side<S>,
    other: &Side<S>,
    distances_squared: &mut [f64x8<S>],
    alongs: &mut [f64x8<S>],
) {
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    for edge in 0..3 {
        let squared = other.lengths_squared[edge];
        let inverse = squared.simd_gt(zero).select(one / squared, zero);
        for vertex in 0..3 {
            let from_start = own.corners[vertex] - other.corners[edge];
            let along = (from_start.dot(other.edges[edge]) * inverse).max(zero).min(one);
            let between = from_start - other.edges[edge].scaled(along);
            distances_squared[3 * vertex + edge] = between.dot(between);
            alongs[3 * vertex + edge] = along;
        }
    }
}

/// The [`BoundaryCases`] within a squared distance.
#[inline(always)]
pub(super) fn boundary_cases<S: Simd>(
    simd: S,
    distances_squared: &[f64x8<S>; 18],
    alongs: &[f64x8<S>; 18],
    most: f64x8<S>,
) -> u64x8<S> {
    let mut cases = u64x8::splat(simd, 0);
    for place in 0..18 {
        let is_case = distances_squared[place].simd_le(most) & !alongs[place].simd_ge(1.0 - AT_END);
        let at_start = alongs[place].simd_le(AT_END);
        if place < 9 {
            let case =
                at_start.select(u64x8::splat(simd, BoundaryCases::of_vertices(place)), u64x8::splat(simd, 1 << place));
            cases = is_case.select(cases | case, cases);
        } else {
            cases = (is_case & !at_start).select(cases | 1u64 << place, cases);
        }
    }
    cases
}

/// Returns how high each vertex is, in lengths of the face's normal.
#[inline(always)]
pub(super) fn vertices_over_face<S: Simd>(
    simd: S,
    own: &Side<S>,
    other: &Side<S>,
    range_squared: f64x8<S>,
    vertex_of_a: bool,
    found: &mut Found<S>,
) -> [f64x8<S>; 3] {
    let inward =
        [other.normal.cross(other.edges[0]), other.normal.cross(other.edges[1]), other.normal.cross(other.edges[2])];
    let inverse = f64x8::splat(simd, 1.0) / other.normal.dot(other.normal);
    let mut heights = [inverse; 3];
    for vertex in 0..3 {
        let from_first = own.corners[vertex] - other.corners[0];
        let height = other.normal.dot(from_first);
        let distance_squared = height * height * inverse;
        // Of a face without an area it is no number, or infinite.
        let mut possible = distance_squared.simd_lt(f64::INFINITY);
        for k in 0..3 {
            let from_corner = own.corners[vertex] - other.corners[k];
            let area = inward[k].dot(from_corner);
            possible &= !area.simd_le(0.0);
        }
        let within_range = distance_squared.simd_le(range_squared);
        found.add_distance(possible, within_range, Cases::vertex_face(vertex_of_a, vertex), distance_squared);
        heights[vertex] = height;
    }
    heights
}

/// Returns six times the volume between the edges, but for the sign.
#[inline(always)]
pub(super) fn edge_edge<S: Simd>(
    simd: S,
    a: &Side<S>,
    b: &Side<S>,
    [edge_a, edge_b]: [usize; 2],
    range_squared: f64x8<S>,
    found: &mut Found<S>,
) -> f64x8<S> {
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let (u, v) = (a.edges[edge_a], b.edges[edge_b]);
    let normal = u.cross(v);
    let normal_squared = normal.dot(normal);
    let between = b.corners[edge_b] - a.corners[edge_a];
    let height = normal.dot(between);
    let inverse = one / normal_squared;
    let distance_squared = height * height * inverse;
    let lengths_squared = a.lengths_squared[edge_a] * (PARALLEL_SINE * PARALLEL_SINE) * b.lengths_squared[edge_b];
    let along_a = between.cross(v).dot(normal) * inverse;
    let along_b = between.cross(u).dot(normal) * inverse;
    let inside = along_a.simd_gt(zero) & along_a.simd_lt(one) & along_b.simd_gt(zero) & along_b.simd_lt(one);
    let possible = inside & !normal_squared.simd_le(lengths_squared);
    let within_range = !distance_squared.simd_gt(range_squared);
    found.add_distance(possible, within_range, Cases::edges(edge_a, edge_b), distance_squared);
    height
}

/// Whether the ends of an edge may lie on different sides of a face's plane, and the face's three edges pass it on the same
/// side; and whether there is no doubt about either.
#[inline(always)]
pub(super) fn may_pierce<S: Simd>(
    simd: S,
    heights: &[f64x8<S>; 3],
    edge: usize,
    volumes: [f64x8<S>; 3],
    rounding: f64x8<S>,
) -> (mask64x8<S>, mask64x8<S>) {
    let zero = f64x8::splat(simd, 0.0);
    let (from, to) = (heights[edge], heights[(edge + 1) % 3]);
    let same_side = (from.simd_gt(zero) & to.simd_gt(zero)) | (from.simd_lt(zero) & to.simd_lt(zero));
    let least = volumes[0].min(volumes[1]).min(volumes[2]);
    let largest = volumes[0].max(volumes[1]).max(volumes[2]);
    let passed_on_both_sides = least.simd_lt(-rounding) & largest.simd_gt(rounding);
    let on_both_sides = (from.simd_gt(zero) & to.simd_lt(zero)) | (from.simd_lt(zero) & to.simd_gt(zero));
    let passed_on_one_side = least.simd_gt(rounding) | largest.simd_lt(-rounding);
    (!(same_side | passed_on_both_sides), on_both_sides & passed_on_one_side)
}
