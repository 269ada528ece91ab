//! Lower bounds of distances from the slabs of a traversal, for the list of near pairs.

use fearless_simd::{f32x8, prelude::*};

use super::{LanePairs, Separation, line_gap};
use crate::kernel::simd::{
    approach::{Corners, bounds_by, in_units},
    lanes::fused::dot,
};

impl Separation<'_> {
    /// Returns which of the `requested` pairs of lanes, at most eight, no slab separates, and lower bounds of their
    /// distances from the widest slab. A bound is 0 if no slab gives one.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn lower_bounds<S: Simd>(
        &self,
        simd: S,
        pairs: &LanePairs<S>,
        corners: &Corners<S>,
        requested: u32,
    ) -> (u32, f32x8<S>) {
        let (zero, needed) = (f32x8::splat(simd, 0.0), self.needed);
        if needed == f32::INFINITY {
            return (requested, zero);
        }
        let [own_gap, other_gap] = self.plane_gaps(simd, pairs, corners);
        let by_planes = own_gap.max(other_gap);
        let (gap, between) = line_gap(corners);
        let widest = by_planes.max(in_units(gap, dot(between, between)));
        let bounds = bounds_by(widest, f32x8::splat(simd, self.rounding()));
        (requested & !widest.simd_gt(needed).to_bitmask() as u32, bounds.simd_gt(0.0).select(bounds, zero))
    }
}
