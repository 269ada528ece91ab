//! Eight triangles of one surface: their edges, and the frame of the longest one.
//!
//! Curvatures and spheres are computed from these. The operations have the same order as those for one triangle at a
//! time in `circumsphere`, so both agree to the last bit. Triangles without area, and lengths whose squares leave the
//! reliable range of f32, are flagged and left to that code.

use fearless_simd::{f32x8, mask32x8, prelude::*};
use glam::Vec3;

use super::{VectorLanes, WIDTH};

/// A triangle has no area if its normal is shorter than this, relative to the square of its longest edge.
pub(in crate::kernel) const ZERO_AREA: f32 = 1.0e-6;

/// Radii are multiplied by this factor, so that rounding never leaves a vertex outside its ball.
pub(in crate::kernel) const RADIUS_SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Squares below this have lost precision at the lower end of f32: 2^23 times its smallest normal number.
pub(in crate::kernel) const LEAST_EXACT_SQUARE: f32 = f32::MIN_POSITIVE / f32::EPSILON;

/// The inverse of a length is finite if the length is greater than 2^-128, a quarter of the smallest normal number.
const LEAST_LENGTH: f32 = 0.25 * f32::MIN_POSITIVE;

/// Where squares are exact enough to take their roots.
#[cfg_attr(not(unoptimized), inline(always))]
fn is_exact<S: Simd>(squared: f32x8<S>) -> mask32x8<S> {
    squared.simd_ge(LEAST_EXACT_SQUARE) & squared.is_finite()
}

/// The corners of eight triangles.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct TriangleLanes<S: Simd>(pub(in crate::kernel) [VectorLanes<S>; 3]);

impl<S: Simd> TriangleLanes<S> {
    /// Gathers the first eight of `triangles`. If there are fewer, the other lanes have no meaning.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn gather(simd: S, positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        if let Some(triangles) = triangles.first_chunk() {
            return Self::gather_all(simd, positions, triangles);
        }
        let mut block = [[0; 3]; WIDTH];
        block[..triangles.len()].copy_from_slice(triangles);
        Self::gather_all(simd, positions, &block)
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn gather_all(simd: S, positions: &[Vec3], triangles: &[[u32; 3]; WIDTH]) -> Self {
        let mut corners = [[Vec3::ZERO; WIDTH]; 3];
        for (lane, vertices) in triangles.iter().enumerate() {
            for k in 0..3 {
                corners[k][lane] = positions[vertices[k] as usize];
            }
        }
        let [a, b, c] = corners;
        Self([VectorLanes::of(simd, a), VectorLanes::of(simd, b), VectorLanes::of(simd, c)])
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn relative_to(&self, origin: VectorLanes<S>) -> Self {
        Self([self.0[0] - origin, self.0[1] - origin, self.0[2] - origin])
    }

    /// Edge `k` joins corners `k` and `k + 1`.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn edge(&self, k: usize) -> VectorLanes<S> {
        self.0[(k + 1) % 3] - self.0[k]
    }

    /// The lengths of the edges, and where they are exact.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn edge_lengths(&self) -> ([f32x8<S>; 3], mask32x8<S>) {
        let [a, b, c] = [self.edge(0), self.edge(1), self.edge(2)];
        let [a, b, c] = [a.dot(a), b.dot(b), c.dot(c)];
        ([a.sqrt(), b.sqrt(), c.sqrt()], is_exact(a) & is_exact(b) & is_exact(c))
    }

    /// Distance from a point to the farthest corner, and where it is exact.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn farthest_corner(&self, center: VectorLanes<S>) -> (f32x8<S>, mask32x8<S>) {
        let [a, b, c] = [self.0[0] - center, self.0[1] - center, self.0[2] - center];
        let farthest = a.dot(a).max(b.dot(b)).max(c.dot(c));
        (farthest.sqrt(), is_exact(farthest))
    }

    /// The radius of a ball around a point that contains the triangle, and where it is exact.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn containing_radius(&self, center: VectorLanes<S>) -> (f32x8<S>, mask32x8<S>) {
        let (farthest, exact) = self.farthest_corner(center);
        ((farthest * RADIUS_SLACK).min(f32::MAX), exact)
    }
}

/// One edge of each of eight triangles: the second or third where its mask is set, otherwise the first.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct EdgeChoice<S: Simd> {
    second: mask32x8<S>,
    third: mask32x8<S>,
}

impl<S: Simd> EdgeChoice<S> {
    /// The longest edges. The first of equally long ones.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn longest(lengths: &[f32x8<S>; 3]) -> Self {
        let second = lengths[1].simd_gt(lengths[0]);
        let third = lengths[2].simd_gt(second.select(lengths[1], lengths[0]));
        Self { second: second & !third, third }
    }

    /// Restores the choice that [`bits`](Self::bits) returned.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn from_bits(simd: S, [second, third]: [u8; 2]) -> Self {
        Self { second: mask32x8::from_bitmask(simd, second.into()), third: mask32x8::from_bitmask(simd, third.into()) }
    }

    /// One bit for each triangle whose edge is the second, and one for each whose edge is the third.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn bits(self) -> [u8; 2] {
        [self.second.to_bitmask() as u8, self.third.to_bitmask() as u8]
    }

    /// This choice where `mask` is set, otherwise `other`.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn where_else(self, mask: mask32x8<S>, other: Self) -> Self {
        Self {
            second: (mask & self.second) | (!mask & other.second),
            third: (mask & self.third) | (!mask & other.third),
        }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn number(&self, [first, second, third]: &[f32x8<S>; 3]) -> f32x8<S> {
        self.third.select(*third, self.second.select(*second, *first))
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn of(&self, [first, second, third]: [&VectorLanes<S>; 3]) -> VectorLanes<S> {
        VectorLanes::select(self.third, *third, VectorLanes::select(self.second, *second, *first))
    }
}

/// [`LongestEdgeFrame`](crate::kernel::spheres::circumsphere) of eight triangles.
pub(in crate::kernel) struct FrameLanes<S: Simd> {
    pub(in crate::kernel) midpoint: VectorLanes<S>,
    pub(in crate::kernel) half_length: f32x8<S>,
    pub(in crate::kernel) normal: VectorLanes<S>,
    pub(in crate::kernel) inward: VectorLanes<S>,
    pub(in crate::kernel) cotangent: f32x8<S>,
    /// Where the triangle has an area.
    pub(in crate::kernel) exact: mask32x8<S>,
}

impl<S: Simd> FrameLanes<S> {
    /// Computes the frames relative to `origin`, given the [lengths of the edges](TriangleLanes::edge_lengths), which
    /// are exact.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(
        triangles: &TriangleLanes<S>,
        origin: VectorLanes<S>,
        edge: EdgeChoice<S>,
        lengths: &[f32x8<S>; 3],
    ) -> Self {
        let length = edge.number(lengths);
        let [a, b, c] = &triangles.0;
        let simd = a.x.simd;
        let (from, to, apex) = (edge.of([a, b, c]), edge.of([b, c, a]), edge.of([c, a, b]));
        let (half, one) = (f32x8::splat(simd, 0.5), f32x8::splat(simd, 1.0));
        let along = to - from;
        let scale = one / length;
        let (u, v) = ((from - apex).scaled(scale), (to - apex).scaled(scale));
        let cross = u.cross(v);
        let doubled_area = cross.dot(cross).sqrt();
        let normal = cross.over(doubled_area);
        let (inward, has_inward) = normal.cross(along.scaled(scale)).normalized();
        let exact = is_exact(cross.dot(cross)) & doubled_area.simd_gt(ZERO_AREA) & has_inward;
        Self {
            midpoint: (from - origin).plus(along.scaled(half)),
            half_length: half * length,
            normal,
            inward,
            cotangent: u.dot(v) / doubled_area,
            exact,
        }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn point_across(&self, halves: f32x8<S>) -> VectorLanes<S> {
        let across = (halves * self.half_length).min(f32::MAX);
        self.midpoint.plus(self.inward.scaled(across))
    }
}

impl<S: Simd> VectorLanes<S> {
    /// Normalizes, and returns where the length is reliable. Elsewhere the vector is zero.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn normalized(self) -> (Self, mask32x8<S>) {
        let simd = self.x.simd;
        let length = self.dot(self).sqrt();
        let has_length = length.simd_gt(LEAST_LENGTH) & length.is_finite();
        let unit = self.scaled(f32x8::splat(simd, 1.0) / length);
        (Self::select(has_length, unit, Self::splat(simd, Vec3::ZERO)), has_length)
    }
}
