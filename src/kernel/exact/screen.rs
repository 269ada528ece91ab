//! Which features of eight pairs of triangles can count, side by side, before the exact test looks at those of each pair.
//!
//! The arithmetic is that of `triangle_pair`, operation by operation, so that a feature passes here exactly where it
//! passes there: what is left out changes the time, never the result.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use glam::DVec3;

use super::triangle_pair::{PARALLEL_SINE, ROUND_OFF};
use crate::kernel::lanes::{DoubleLanes, DoubleMask, DoubleVectorLanes, WIDTH};

/// Features of a pair of triangles, one bit each: a vertex over a face, two edges, an edge that pierces a face, or
/// anything on the boundaries of both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::kernel) struct Cases(u32);

impl Cases {
    pub(in crate::kernel) const ALL: Self = Self(u32::MAX);
    pub(super) const BOUNDARY: Self = Self(1 << 21);

    pub(super) const fn vertex_face(vertex_of_a: bool, vertex: usize) -> Self {
        Self(1 << (if vertex_of_a { vertex } else { 3 + vertex }))
    }

    pub(super) const fn edges(edge_a: usize, edge_b: usize) -> Self {
        Self(1 << (6 + 3 * edge_a + edge_b))
    }

    pub(super) const fn piercing(edge_of_a: bool, edge: usize) -> Self {
        Self(1 << (if edge_of_a { 15 + edge } else { 18 + edge }))
    }

    pub(super) const fn contain(self, case: Self) -> bool {
        self.0 & case.0 != 0
    }
}

/// A pair of triangles that may be within range.
pub(in crate::kernel) struct ScreenedPair<'a> {
    /// Its place among those that were screened.
    pub(in crate::kernel) place: usize,
    /// Corners of the first and second triangle.
    pub(in crate::kernel) corners: &'a [[DVec3; 3]; 2],
    /// What of it can count.
    pub(in crate::kernel) cases: Cases,
    /// Least squared distance of a vertex of either from an edge of the other.
    pub(in crate::kernel) boundary: f64,
}

/// Eight pairs of triangles and what is known of them.
pub(in crate::kernel) struct PairScreen {
    corners: [[[DVec3; 3]; 2]; WIDTH],
    a: [DoubleVectorLanes; 3],
    b: [DoubleVectorLanes; 3],
    boundary: DoubleLanes,
    cases: [u64; WIDTH],
}

impl PairScreen {
    pub(in crate::kernel) const WIDTH: usize = WIDTH;

    pub(in crate::kernel) fn new() -> Self {
        Self {
            corners: [[[DVec3::ZERO; 3]; 2]; WIDTH],
            a: [DoubleVectorLanes::ZERO; 3],
            b: [DoubleVectorLanes::ZERO; 3],
            boundary: DoubleLanes::ZERO,
            cases: [0; WIDTH],
        }
    }

    /// Screens up to eight pairs of triangles for `range` (0 or more), and gives those that may be within it.
    pub(in crate::kernel) fn screen(
        &mut self,
        pairs: impl ExactSizeIterator<Item = [[DVec3; 3]; 2]>,
        range: f64,
    ) -> impl Iterator<Item = ScreenedPair<'_>> {
        let count = pairs.len().min(WIDTH);
        for (lane, corners) in pairs.enumerate().take(WIDTH) {
            let origin = corners[0][0];
            for k in 0..3 {
                self.a[k].set(lane, corners[0][k] - origin);
                self.b[k].set(lane, corners[1][k] - origin);
            }
            self.corners[lane] = corners;
        }
        screen(&self.a, &self.b, range, &mut self.boundary, &mut self.cases);
        let screened = |place: usize| ScreenedPair {
            place,
            corners: &self.corners[place],
            cases: Cases(self.cases[place] as u32),
            boundary: self.boundary.0[place],
        };
        (0..count).map(screened).filter(|pair| pair.cases.0 != 0)
    }
}

/// A triangle of each pair with what every case needs.
struct SideLanes<'a> {
    corners: &'a [DoubleVectorLanes; 3],
    edges: [DoubleVectorLanes; 3],
    inverse_lengths_squared: [DoubleLanes; 3],
    normal: DoubleVectorLanes,
    normal_length_squared: DoubleLanes,
}

impl<'a> SideLanes<'a> {
    #[inline(always)]
    fn new(corners: &'a [DoubleVectorLanes; 3]) -> Self {
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        let mut inverse_lengths_squared = [DoubleLanes::ZERO; 3];
        for k in 0..3 {
            let squared = edges[k].dot(edges[k]);
            let long = squared.greater_than(DoubleLanes::ZERO);
            inverse_lengths_squared[k] = DoubleLanes::select(long, squared.recip(), DoubleLanes::ZERO);
        }
        let normal = edges[0].cross(edges[1]);
        Self { corners, edges, inverse_lengths_squared, normal, normal_length_squared: normal.dot(normal) }
    }
}

/// The cases found so far, one bit each.
struct CaseLanes([u64; WIDTH]);

impl CaseLanes {
    #[inline(always)]
    fn add(&mut self, possible: DoubleMask, Cases(case): Cases) {
        for lane in 0..WIDTH {
            self.0[lane] |= possible.0[lane] & u64::from(case);
        }
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
fn screen(
    a: &[DoubleVectorLanes; 3],
    b: &[DoubleVectorLanes; 3],
    range: f64,
    boundary: &mut DoubleLanes,
    cases: &mut [u64; WIDTH],
) {
    let mut largest = DoubleLanes::ZERO;
    for corners in [a, b] {
        for corner in corners {
            largest = largest.max(corner.x.abs()).max(corner.y.abs()).max(corner.z.abs());
        }
    }
    let range = DoubleLanes::splat(range).max(DoubleLanes::splat(ROUND_OFF) * largest);
    let range_squared = range * range;
    let (a, b) = (SideLanes::new(a), SideLanes::new(b));
    let mut found = CaseLanes([0; WIDTH]);
    let least = least_boundary_distance_squared(&a, &b).min(least_boundary_distance_squared(&b, &a));
    *boundary = least;
    found.add(least.greater_than(range_squared).not(), Cases::BOUNDARY);
    vertices_over_face(&a, &b, range_squared, true, &mut found);
    vertices_over_face(&b, &a, range_squared, false, &mut found);
    for edge_a in 0..3 {
        for edge_b in 0..3 {
            edge_edge(&a, &b, edge_a, edge_b, range_squared, &mut found);
        }
    }
    pierce(&a, &b, true, &mut found);
    pierce(&b, &a, false, &mut found);
    *cases = found.0;
}

#[inline(always)]
fn least_boundary_distance_squared(own: &SideLanes<'_>, other: &SideLanes<'_>) -> DoubleLanes {
    let mut least = DoubleLanes::splat(f64::INFINITY);
    for vertex in 0..3 {
        for edge in 0..3 {
            let from_start = own.corners[vertex] - other.corners[edge];
            let along = from_start.dot(other.edges[edge]) * other.inverse_lengths_squared[edge];
            let along = along.max(DoubleLanes::ZERO).min(DoubleLanes::splat(1.0));
            let between = from_start - other.edges[edge].scaled(along);
            least = least.min(between.dot(between));
        }
    }
    least
}

#[inline(always)]
fn vertices_over_face(
    own: &SideLanes<'_>,
    other: &SideLanes<'_>,
    range_squared: DoubleLanes,
    vertex_of_a: bool,
    found: &mut CaseLanes,
) {
    for vertex in 0..3 {
        let position = own.corners[vertex];
        let height = other.normal.dot(position - other.corners[0]);
        let distance_squared = height * height / other.normal_length_squared;
        let mut possible = distance_squared.greater_than(range_squared).not();
        for k in 0..3 {
            let area = other.normal.dot(other.edges[k].cross(position - other.corners[k]));
            possible = possible.and(DoubleLanes::ZERO.greater_than(area).not());
        }
        found.add(possible, Cases::vertex_face(vertex_of_a, vertex));
    }
}

#[inline(always)]
fn edge_edge(
    a: &SideLanes<'_>,
    b: &SideLanes<'_>,
    edge_a: usize,
    edge_b: usize,
    range_squared: DoubleLanes,
    found: &mut CaseLanes,
) {
    let (u, v) = (a.edges[edge_a], b.edges[edge_b]);
    let normal = u.cross(v);
    let normal_squared = normal.dot(normal);
    let between = b.corners[edge_b] - a.corners[edge_a];
    let height = normal.dot(between);
    let inverse = normal_squared.recip();
    let distance_squared = height * height * inverse;
    let parallel = DoubleLanes::splat(PARALLEL_SINE * PARALLEL_SINE) * u.dot(u) * v.dot(v);
    let along_a = between.cross(v).dot(normal) * inverse;
    let along_b = between.cross(u).dot(normal) * inverse;
    let one = DoubleLanes::splat(1.0);
    let possible = normal_squared
        .greater_than(parallel)
        .and(distance_squared.greater_than(range_squared).not())
        .and(along_a.greater_than(DoubleLanes::ZERO))
        .and(one.greater_than(along_a))
        .and(along_b.greater_than(DoubleLanes::ZERO))
        .and(one.greater_than(along_b));
    found.add(possible, Cases::edges(edge_a, edge_b));
}

#[inline(always)]
fn pierce(own: &SideLanes<'_>, other: &SideLanes<'_>, edge_of_a: bool, found: &mut CaseLanes) {
    let zero = DoubleLanes::ZERO;
    let mut heights = [zero; 3];
    for k in 0..3 {
        heights[k] = other.normal.dot(own.corners[k] - other.corners[0]);
    }
    for edge in 0..3 {
        let (from, to) = (heights[edge], heights[(edge + 1) % 3]);
        let same_side =
            from.greater_than(zero).and(to.greater_than(zero)).or(zero.greater_than(from).and(zero.greater_than(to)));
        let start = own.corners[edge];
        let corners = [other.corners[0] - start, other.corners[1] - start, other.corners[2] - start];
        let mut least = DoubleLanes::splat(f64::INFINITY);
        let mut largest = DoubleLanes::splat(f64::NEG_INFINITY);
        for k in 0..3 {
            let volume = own.edges[edge].dot(corners[(k + 1) % 3].cross(corners[(k + 2) % 3]));
            least = least.min(volume);
            largest = largest.max(volume);
        }
        let passed_on_both_sides = zero.greater_than(least).and(largest.greater_than(zero));
        found.add(same_side.or(passed_on_both_sides).not(), Cases::piercing(edge_of_a, edge));
    }
}
