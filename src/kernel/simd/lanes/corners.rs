//! Eight pairs of triangles in f64, unrounded even after a pose has transformed them.
//!
//! Sphere contacts are measured on these: a lower bound of the distance of two triangles, and the weights of their
//! corners at a point. The operations have the same order as those for one pair at a time.

use fearless_simd::{f32x8, f64x8, prelude::*};
use glam::DVec3;

use super::{DoubleVectorLanes, VectorLanes, rounded};

/// The inverse of a length is finite if the length is greater than 2^-1024, a quarter of the smallest normal number.
const LEAST_LENGTH: f64 = 0.25 * f64::MIN_POSITIVE;

impl<S: Simd> DoubleVectorLanes<S> {
    /// Normalizes, or returns `otherwise` where the length is not reliable.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn normalized_or(self, otherwise: DVec3) -> Self {
        let simd = self.x.simd;
        let length = self.dot(self).sqrt();
        let has_length = length.simd_gt(LEAST_LENGTH) & length.is_finite();
        let unit = self.scaled(f64x8::splat(simd, 1.0) / length);
        Self::select(has_length, unit, Self::splat(simd, otherwise))
    }
}

/// One triangle of each of eight pairs.
pub(in crate::kernel) struct CornerLanes<S: Simd> {
    corners: [DoubleVectorLanes<S>; 3],
}

impl<S: Simd> CornerLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(corners: [DoubleVectorLanes<S>; 3]) -> Self {
        Self { corners }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn normal(&self) -> DoubleVectorLanes<S> {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a)
    }

    /// The first two weights of `barycentric::barycentric_of`.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn barycentrics(&self, point: VectorLanes<S>) -> [f32x8<S>; 2] {
        let (point, normal) = (point.widened(), self.normal());
        let first = self.area(1, 2, point, normal);
        let second = self.area(2, 0, point, normal);
        let third = self.area(0, 1, point, normal);
        let sum = first + second + third;
        let has_area = sum.simd_gt(0.0) & sum.is_finite();
        let third = f64x8::splat(sum.simd, 1.0 / 3.0);
        [rounded(has_area.select(first / sum, third)), rounded(has_area.select(second / sum, third))]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn area(&self, from: usize, to: usize, point: DoubleVectorLanes<S>, normal: DoubleVectorLanes<S>) -> f64x8<S> {
        let edge = self.corners[to] - self.corners[from];
        normal.dot(edge.cross(point - self.corners[from])).max(0.0)
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn low(&self) -> DoubleVectorLanes<S> {
        self.corners[0].min(self.corners[1]).min(self.corners[2])
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn high(&self) -> DoubleVectorLanes<S> {
        self.corners[0].max(self.corners[1]).max(self.corners[2])
    }
}

/// Eight pairs of triangles.
pub(in crate::kernel) struct TrianglePairLanes<S: Simd> {
    pub(in crate::kernel) a: CornerLanes<S>,
    pub(in crate::kernel) b: CornerLanes<S>,
}

impl<S: Simd> TrianglePairLanes<S> {
    /// The gap between the axis-aligned boxes of two triangles along the axis that separates them most, or 0 if they
    /// overlap.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn box_gap(&self) -> f64x8<S> {
        let (a, b) = (&self.a, &self.b);
        let apart = (a.low() - b.high()).max(b.low() - a.high());
        apart.x.max(apart.y).max(apart.z).max(0.0)
    }

    /// The gap between two triangles along the unit direction that separates them most, or 0 if none separates them.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn gap_along<const COUNT: usize>(&self, directions: [VectorLanes<S>; COUNT]) -> f64x8<S> {
        let (a, b) = (&self.a.corners, &self.b.corners);
        let origin = a[0];
        let own = [a[0] - origin, a[1] - origin, a[2] - origin];
        let other = [b[0] - origin, b[1] - origin, b[2] - origin];
        let mut widest = f64x8::splat(origin.x.simd, 0.0);
        for direction in directions {
            widest = widest.max(gap_along(direction.widened(), &own, &other));
        }
        widest
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn gap_along<S: Simd>(
    direction: DoubleVectorLanes<S>,
    own: &[DoubleVectorLanes<S>; 3],
    other: &[DoubleVectorLanes<S>; 3],
) -> f64x8<S> {
    let (a, b, c) = (direction.dot(own[0]), direction.dot(own[1]), direction.dot(own[2]));
    let (p, q, r) = (direction.dot(other[0]), direction.dot(other[1]), direction.dot(other[2]));
    (p.min(q).min(r) - a.max(b).max(c)).max(a.min(b).min(c) - p.max(q).max(r))
}
