//! Conservative rejection of triangle pairs by a separating slab, eight pairs at a time.
//!
//! If the projections of two triangles on any direction are farther apart than some distance, so are the triangles.
//! Every direction therefore gives a proof, however it was found and rounded: the normals of the triangles, or a
//! direction that a method already has. Pairs that no direction rejects go on to the next test, and pairs within range
//! are never rejected. Runs before the cap tests, on candidates that no traversal has tested in its leaves; for those
//! see `leaf_triangles`.

use fearless_simd::{f32x8, prelude::*};

use super::lanes::{PairLanes, VectorLanes};

/// A pair is rejected only if its gap exceeds the range by this factor, and by [`ROUNDING`] times the extent of the
/// pair. The projections themselves round by a few units in the last place of the extent (6e-8 each).
pub(in crate::kernel) const RANGE_SLACK: f32 = 1.0 + 1.0e-5;
pub(in crate::kernel) const ROUNDING: f32 = 2.0e-6;

/// A squared direction below this is too close to the smallest f32 to be reliable.
pub(in crate::kernel) const LEAST_SQUARED: f32 = 1.0e-30;

impl<S: Simd> PairLanes<S> {
    /// By how much the gap along `direction` exceeds the gap that proves a pair separated, multiplied by the
    /// direction's length. Greater than 0 where the pair is separated.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn excess_along(&self, direction: VectorLanes<S>, range: f32) -> f32x8<S> {
        let (low_a, high_a) = project(&self.a, direction);
        let (low_b, high_b) = project(&self.b, direction);
        let gap = (low_b - high_a).max(low_a - high_b);
        let squared = direction.dot(direction);
        let needed = squared.sqrt() * (self.extent * ROUNDING + range * RANGE_SLACK);
        squared.simd_gt(LEAST_SQUARED).select(gap - needed, f32x8::splat(gap.simd, f32::NEG_INFINITY))
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn excess_along_normals(&self, range: f32) -> f32x8<S> {
        self.excess_along(normal(&self.a), range).max(self.excess_along(normal(&self.b), range))
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn normal<S: Simd>(corners: &[VectorLanes<S>; 3]) -> VectorLanes<S> {
    (corners[1] - corners[0]).cross(corners[2] - corners[0])
}

/// The interval of a triangle's projections on a direction of any length.
#[cfg_attr(not(unoptimized), inline(always))]
fn project<S: Simd>(corners: &[VectorLanes<S>; 3], direction: VectorLanes<S>) -> (f32x8<S>, f32x8<S>) {
    let (first, second, third) = (direction.dot(corners[0]), direction.dot(corners[1]), direction.dot(corners[2]));
    (first.min(second).min(third), first.max(second).max(third))
}
