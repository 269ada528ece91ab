//! Eight pairs of triangles side by side.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use glam::Vec3;

use super::{Lanes, VectorLanes, WIDTH};

/// Eight pairs of triangles, relative to the first triangle's first corner.
pub(in crate::kernel) struct PairLanes {
    pub(in crate::kernel) a: [VectorLanes; 3],
    pub(in crate::kernel) b: [VectorLanes; 3],
    /// Sum of the largest coordinates' magnitudes, which no projection on a unit vector exceeds;
    /// infinite where f32 cannot tell.
    pub(in crate::kernel) extent: Lanes,
}

impl PairLanes {
    /// Of pairs of a larger extent nothing is known. Up to here a projection on any direction whose square is finite, below
    /// 1.9e19 long, is finite too; beyond, infinities of both signs would add up to what is no number and proves nothing.
    pub(in crate::kernel) const LARGEST_EXTENT: f32 = 1.0e18;

    pub(in crate::kernel) const EMPTY: Self =
        Self { a: [VectorLanes::ZERO; 3], b: [VectorLanes::ZERO; 3], extent: Lanes::ZERO };

    // Kept apart, so that the lanes come from memory: of numbers it has just loaded one by one the compiler makes
    // no vectors.
    #[inline(never)]
    pub(in crate::kernel) fn gather(
        &mut self,
        positions: [&[Vec3]; 2],
        triangles: [&[[u32; 3]]; 2],
        pairs: &[[u32; 2]],
    ) {
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
            self.extent.0[lane] = if extent <= Self::LARGEST_EXTENT { extent } else { f32::INFINITY };
        }
    }
}

#[inline(always)]
pub(in crate::kernel) fn normal(corners: &[VectorLanes; 3]) -> VectorLanes {
    (corners[1] - corners[0]).cross(corners[2] - corners[0])
}

/// The interval of a triangle's projections on a direction of any length.
#[inline(always)]
pub(in crate::kernel) fn project(corners: &[VectorLanes; 3], direction: VectorLanes) -> (Lanes, Lanes) {
    let (first, second, third) = (direction.dot(corners[0]), direction.dot(corners[1]), direction.dot(corners[2]));
    (first.min(second).min(third), first.max(second).max(third))
}
