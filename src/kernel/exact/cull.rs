//! Conservative rejection of triangle pairs, eight at a time, by a slab that separates them.
//!
//! Two triangles whose projections on any direction are farther apart than a distance are themselves farther apart, so
//! every direction gives a proof, however it was found and rounded. Two kinds are tried: the triangles' normals, then,
//! for the pairs left, the direction between their closest features as f32 finds them, which is the best there is. What
//! no direction rejects goes to the exact test; what lies within range is never rejected.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use std::cmp::Ordering;

use glam::Vec3;

use super::lanes::{Lanes, Mask, VectorLanes, WIDTH};

/// Gaps must exceed the range by this factor, and by [`ROUNDING`] times the pair's extent, before a pair is rejected:
/// the projections' own rounding is a few units in the last place of the extent (6e-8 each).
const RANGE_SLACK: f32 = 1.0 + 1.0e-5;
const ROUNDING: f32 = 2.0e-6;

/// A squared direction below this is too close to the smallest f32 to be relied on.
const LEAST_SQUARED: f32 = 1.0e-30;

/// Pairs of a larger extent are never rejected. Up to here a projection on any direction whose square is finite, below
/// 1.9e19 long, is finite too; beyond, infinities of both signs would add up to what is no number and proves nothing.
const LARGEST_EXTENT: f32 = 1.0e18;

/// Eight pairs of triangles, relative to the first triangle's first corner.
struct PairLanes {
    a: [VectorLanes; 3],
    b: [VectorLanes; 3],
    /// Sum of the largest coordinates' magnitudes, which no projection on a unit vector exceeds.
    extent: Lanes,
}

impl PairLanes {
    const EMPTY: Self = Self { a: [VectorLanes::ZERO; 3], b: [VectorLanes::ZERO; 3], extent: Lanes::ZERO };

    // Kept apart, so that the lanes come from memory: of numbers it has just loaded one by one the compiler makes
    // no vectors.
    #[inline(never)]
    fn gather(&mut self, positions: [&[Vec3]; 2], triangles: [&[[u32; 3]]; 2], pairs: &[[u32; 2]]) {
        for (lane, &[triangle_a, triangle_b]) in pairs.iter().enumerate().take(WIDTH) {
            let (corners_a, corners_b) = (triangles[0][triangle_a as usize], triangles[1][triangle_b as usize]);
            let origin = positions[0][corners_a[0] as usize];
            let mut largest = Vec3::ZERO;
            for k in 0..3 {
                let corner_a = positions[0][corners_a[k] as usize] - origin;
                let corner_b = positions[1][corners_b[k] as usize] - origin;
                largest = largest.max(corner_a.abs()).max(corner_b.abs());
                self.a[k].set(lane, corner_a);
                self.b[k].set(lane, corner_b);
            }
            let extent = largest.element_sum();
            self.extent.0[lane] = if extent <= LARGEST_EXTENT { extent } else { f32::INFINITY };
        }
    }

    /// By how much the gap along `direction` exceeds the one that proves a pair apart, in units of the direction's
    /// length: more than 0 where it does.
    #[inline(always)]
    fn excess_along(&self, direction: VectorLanes, range: Lanes) -> Lanes {
        let (low_a, high_a) = project(&self.a, direction);
        let (low_b, high_b) = project(&self.b, direction);
        let gap = (low_b - high_a).max(low_a - high_b);
        let squared = direction.dot(direction);
        let needed = squared.sqrt() * (range * Lanes::splat(RANGE_SLACK) + self.extent * Lanes::splat(ROUNDING));
        let reliable = squared.greater_than(Lanes::splat(LEAST_SQUARED));
        Lanes::select(reliable, gap - needed, Lanes::splat(f32::NEG_INFINITY))
    }

    #[inline(always)]
    fn excess_along_normals(&self, range: Lanes) -> Lanes {
        self.excess_along(normal(&self.a), range).max(self.excess_along(normal(&self.b), range))
    }

    #[inline(always)]
    fn excess_along_closest_features(&self, range: Lanes) -> Lanes {
        self.excess_along(self.closest_direction(), range)
    }

    /// From the closest point on one triangle to that on the other, as well as f32 can tell.
    #[inline(always)]
    fn closest_direction(&self) -> VectorLanes {
        let mut nearest = Nearest { squared: Lanes::splat(f32::INFINITY), direction: VectorLanes::ZERO };
        let (edges_a, edges_b) = (edges(&self.a), edges(&self.b));
        nearest.vertices_and_edges(&self.a, &self.b, &edges_b);
        nearest.vertices_and_edges(&self.b, &self.a, &edges_a);
        nearest.vertices_and_face(&self.a, &self.b, &edges_b);
        nearest.vertices_and_face(&self.b, &self.a, &edges_a);
        for k in 0..3 {
            for l in 0..3 {
                nearest.edges(self.b[l] - self.a[k], edges_a[k], edges_b[l]);
            }
        }
        nearest.direction
    }
}

#[inline(always)]
fn edges(corners: &[VectorLanes; 3]) -> [VectorLanes; 3] {
    [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]]
}

#[inline(always)]
fn normal(corners: &[VectorLanes; 3]) -> VectorLanes {
    (corners[1] - corners[0]).cross(corners[2] - corners[0])
}

/// The interval of a triangle's projections on a direction of any length.
#[inline(always)]
fn project(corners: &[VectorLanes; 3], direction: VectorLanes) -> (Lanes, Lanes) {
    let (first, second, third) = (direction.dot(corners[0]), direction.dot(corners[1]), direction.dot(corners[2]));
    (first.min(second).min(third), first.max(second).max(third))
}

/// Where a position along an edge is strictly between its ends.
#[inline(always)]
fn inside(along: Lanes) -> Mask {
    along.greater_than(Lanes::ZERO).and(Lanes::splat(1.0).greater_than(along))
}

/// The shortest connection found so far.
struct Nearest {
    squared: Lanes,
    direction: VectorLanes,
}

impl Nearest {
    #[inline(always)]
    fn offer(&mut self, possible: Mask, squared: Lanes, direction: VectorLanes) {
        let better = possible.and(self.squared.greater_than(squared));
        self.squared = Lanes::select(better, squared, self.squared);
        self.direction = VectorLanes::select(better, direction, self.direction);
    }

    #[inline(always)]
    fn vertices_and_edges(
        &mut self,
        vertices: &[VectorLanes; 3],
        corners: &[VectorLanes; 3],
        edges: &[VectorLanes; 3],
    ) {
        for l in 0..3 {
            let inverse = edges[l].dot(edges[l]).recip();
            for k in 0..3 {
                let from_start = vertices[k] - corners[l];
                let along = (from_start.dot(edges[l]) * inverse).max(Lanes::ZERO).min(Lanes::splat(1.0));
                let connection = from_start - edges[l].scaled(along);
                let squared = connection.dot(connection);
                self.offer(self.squared.greater_than(squared), squared, connection);
            }
        }
    }

    #[inline(always)]
    fn vertices_and_face(&mut self, vertices: &[VectorLanes; 3], corners: &[VectorLanes; 3], edges: &[VectorLanes; 3]) {
        let normal = edges[0].cross(edges[1]);
        let inverse = normal.dot(normal).recip();
        let inward = [normal.cross(edges[0]), normal.cross(edges[1]), normal.cross(edges[2])];
        for k in 0..3 {
            let height = normal.dot(vertices[k] - corners[0]);
            let over_face = inward[0]
                .dot(vertices[k] - corners[0])
                .min(inward[1].dot(vertices[k] - corners[1]))
                .min(inward[2].dot(vertices[k] - corners[2]))
                .greater_than(Lanes::ZERO);
            self.offer(over_face, height * height * inverse, normal.scaled(height * inverse));
        }
    }

    /// Two edges, `between` from the start of one to the start of the other.
    #[inline(always)]
    fn edges(&mut self, between: VectorLanes, u: VectorLanes, v: VectorLanes) {
        let normal = u.cross(v);
        let inverse = normal.dot(normal).recip();
        let height = normal.dot(between);
        let along_u = between.cross(v).dot(normal) * inverse;
        let along_v = between.cross(u).dot(normal) * inverse;
        self.offer(inside(along_u).and(inside(along_v)), height * height * inverse, normal.scaled(height * inverse));
    }
}

/// Appends the pairs that may be within `range` of each other (in the unit of the positions, 0 or more): all that are,
/// and few that are not. `positions` and `triangles` are those of the first and the second surface.
pub fn cull_pairs(
    positions: [&[Vec3]; 2],
    triangles: [&[[u32; 3]]; 2],
    pairs: &[[u32; 2]],
    range: f64,
    kept: &mut Vec<[u32; 2]>,
) {
    let mut past_planes = Vec::with_capacity(pairs.len());
    let range = range as f32;
    cull_by_planes(positions, triangles, pairs, range, &mut past_planes);
    cull_by_closest_features(positions, triangles, &past_planes, range, kept);
}

/// Appends the pairs that their planes do not separate by more than `range`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
pub fn cull_by_planes(
    positions: [&[Vec3]; 2],
    triangles: [&[[u32; 3]]; 2],
    pairs: &[[u32; 2]],
    range: f32,
    kept: &mut Vec<[u32; 2]>,
) {
    let mut lanes = PairLanes::EMPTY;
    for pairs in pairs.chunks(WIDTH) {
        lanes.gather(positions, triangles, pairs);
        keep(pairs, &lanes.excess_along_normals(Lanes::splat(range)), kept);
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
fn cull_by_closest_features(
    positions: [&[Vec3]; 2],
    triangles: [&[[u32; 3]]; 2],
    pairs: &[[u32; 2]],
    range: f32,
    kept: &mut Vec<[u32; 2]>,
) {
    let mut lanes = PairLanes::EMPTY;
    for pairs in pairs.chunks(WIDTH) {
        lanes.gather(positions, triangles, pairs);
        keep(pairs, &lanes.excess_along_closest_features(Lanes::splat(range)), kept);
    }
}

/// Appends the pairs without excess. Kept apart like the gathering: numbers that are stored side by side are computed
/// side by side.
#[inline(never)]
fn keep(pairs: &[[u32; 2]], excess: &Lanes, kept: &mut Vec<[u32; 2]>) {
    // An excess that is not a number, of coordinates near the end of f32, proves nothing.
    let apart = |excess: f32| excess.partial_cmp(&0.0) == Some(Ordering::Greater);
    kept.extend(pairs.iter().zip(excess.0).filter(|&(_, excess)| !apart(excess)).map(|(&pair, _)| pair));
}
