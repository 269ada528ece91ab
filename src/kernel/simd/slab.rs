//! Conservative rejection of triangle pairs, eight at a time, by a slab that separates them.
//!
//! Two triangles whose projections on any direction are farther apart than a distance are themselves farther apart, so
//! every direction gives a proof, however it was found and rounded: the triangles' normals, or one that a method has
//! already. What no direction rejects goes on to the next test; what lies within range is never rejected. Of candidates
//! that no traversal has tested in its leaves already, see `leaf_triangles`, and before caps.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{f32x8, prelude::*};

use super::lanes::{PairLanes, VectorLanes};

/// Gaps must exceed the range by this factor, and by [`ROUNDING`] times the pair's extent, before a pair is rejected:
/// the projections' own rounding is a few units in the last place of the extent (6e-8 each).
pub(in crate::kernel) const RANGE_SLACK: f32 = 1.0 + 1.0e-5;
pub(in crate::kernel) const ROUNDING: f32 = 2.0e-6;

/// A squared direction below this is too close to the smallest f32 to be relied on.
pub(in crate::kernel) const LEAST_SQUARED: f32 = 1.0e-30;

impl<S: Simd> PairLanes<S> {
    /// By how much the gap along `direction` exceeds the one that proves a pair apart, in units of the direction's
    /// length: more than 0 where it does.
    #[inline(always)]
    pub(in crate::kernel) fn excess_along(&self, direction: VectorLanes<S>, range: f32) -> f32x8<S> {
        let (low_a, high_a) = project(&self.a, direction);
        let (low_b, high_b) = project(&self.b, direction);
        let gap = (low_b - high_a).max(low_a - high_b);
        let squared = direction.dot(direction);
        let needed = squared.sqrt() * (self.extent * ROUNDING + range * RANGE_SLACK);
        squared.simd_gt(LEAST_SQUARED).select(gap - needed, f32x8::splat(gap.simd, f32::NEG_INFINITY))
    }

    #[inline(always)]
    pub(in crate::kernel) fn excess_along_normals(&self, range: f32) -> f32x8<S> {
        self.excess_along(normal(&self.a), range).max(self.excess_along(normal(&self.b), range))
    }
}

#[inline(always)]
fn normal<S: Simd>(corners: &[VectorLanes<S>; 3]) -> VectorLanes<S> {
    (corners[1] - corners[0]).cross(corners[2] - corners[0])
}

/// The interval of a triangle's projections on a direction of any length.
#[inline(always)]
fn project<S: Simd>(corners: &[VectorLanes<S>; 3], direction: VectorLanes<S>) -> (f32x8<S>, f32x8<S>) {
    let (first, second, third) = (direction.dot(corners[0]), direction.dot(corners[1]), direction.dot(corners[2]));
    (first.min(second).min(third), first.max(second).max(third))
}
