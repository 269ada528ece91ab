//! Eight pairs of triangles.

use fearless_simd::{f32x8, prelude::*};

use super::VectorLanes;

/// Nothing is known about pairs with a larger extent. Up to here, the projection on any direction with a finite square,
/// shorter than 1.9e19, is finite too. Beyond, infinities of opposite signs would add up to NaN, which proves nothing.
pub(in crate::kernel) const LARGEST_EXTENT: f32 = 1.0e18;

/// Eight pairs of triangles, relative to the first corner of the first triangle.
pub(in crate::kernel) struct PairLanes<S: Simd> {
    pub(in crate::kernel) a: [VectorLanes<S>; 3],
    pub(in crate::kernel) b: [VectorLanes<S>; 3],
    /// Sum of the largest coordinate magnitudes, which no projection on a unit vector exceeds. Infinite above
    /// [`LARGEST_EXTENT`].
    pub(in crate::kernel) extent: f32x8<S>,
}

impl<S: Simd> PairLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(a: &[VectorLanes<S>; 3], b: &[VectorLanes<S>; 3]) -> Self {
        let origin = a[0];
        let (a, b) = ([a[0] - origin, a[1] - origin, a[2] - origin], [b[0] - origin, b[1] - origin, b[2] - origin]);
        let simd = origin.x.simd;
        let zero = f32x8::splat(simd, 0.0);
        let mut largest = VectorLanes { x: zero, y: zero, z: zero };
        for corner in [a[0], a[1], a[2], b[0], b[1], b[2]] {
            largest.x = largest.x.max(corner.x.abs());
            largest.y = largest.y.max(corner.y.abs());
            largest.z = largest.z.max(corner.z.abs());
        }
        let extent = largest.x + largest.y + largest.z;
        let is_known = extent.simd_le(LARGEST_EXTENT);
        Self { a, b, extent: is_known.select(extent, f32x8::splat(simd, f32::INFINITY)) }
    }
}
