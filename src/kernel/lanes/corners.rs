//! Eight pairs of triangles side by side in double precision, not rounded even where a pose has moved them.
//!
//! What the contacts of spheres are measured on: how far apart two triangles are at least, and the weights of their
//! corners at a point. The same arithmetic in the same order as one pair at a time in `exact`.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use glam::Vec3;

use super::{DoubleLanes, DoubleMask, DoubleVectorLanes, Lanes, VectorLanes, WIDTH};
use crate::kernel::pair::SurfaceSide;

/// The inverse of a length is finite where the length is more than 2^-1024, a quarter of the least normal number.
const LEAST_LENGTH: f64 = 0.25 * f64::MIN_POSITIVE;

impl DoubleLanes {
    // Of a comparison with infinity the compiler makes a question about bits, lane by lane.
    #[expect(clippy::eq_op, reason = "infinities and what is no number are no number apart from themselves")]
    #[inline(always)]
    fn is_finite(self) -> DoubleMask {
        Self::splat(1.0).greater_than(self - self)
    }
}

impl VectorLanes {
    #[inline(always)]
    pub(in crate::kernel) fn get(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x.0[lane], self.y.0[lane], self.z.0[lane])
    }
}

impl DoubleVectorLanes {
    #[inline(always)]
    pub(in crate::kernel) fn rounded(self) -> VectorLanes {
        VectorLanes { x: self.x.rounded(), y: self.y.rounded(), z: self.z.rounded() }
    }

    /// Of unit length, or `otherwise` where that cannot be told.
    #[inline(always)]
    pub(in crate::kernel) fn normalized_or(self, otherwise: Self) -> Self {
        let length = self.dot(self).sqrt();
        let has_length = length.greater_than(DoubleLanes::splat(LEAST_LENGTH)).and(length.is_finite());
        Self::select(has_length, self.scaled(length.recip()), otherwise)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self { x: self.x.min(other.x), y: self.y.min(other.y), z: self.z.min(other.z) }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self { x: self.x.max(other.x), y: self.y.max(other.y), z: self.z.max(other.z) }
    }
}

/// One triangle of each of eight pairs.
pub(in crate::kernel) struct CornerLanes {
    corners: [DoubleVectorLanes; 3],
}

impl CornerLanes {
    pub(in crate::kernel) const EMPTY: Self = Self { corners: [DoubleVectorLanes::ZERO; 3] };

    /// `rounded` are the same corners as far as single precision holds them: all there is of a side that has not been moved.
    #[inline(always)]
    pub(in crate::kernel) fn fetch<const SIDE: usize>(
        &mut self,
        side: &SurfaceSide<'_>,
        pairs: &[[u32; 2]],
        rounded: &[VectorLanes; 3],
    ) {
        if side.moved.is_some() {
            self.gather_moved::<SIDE>(side, pairs);
        } else {
            for corner in 0..3 {
                self.corners[corner] = rounded[corner].widened();
            }
        }
    }

    // Kept apart for the same reason as the gathering of pairs.
    #[inline(never)]
    fn gather_moved<const SIDE: usize>(&mut self, side: &SurfaceSide<'_>, pairs: &[[u32; 2]]) {
        for (lane, pair) in pairs.iter().enumerate().take(WIDTH) {
            for (lanes, corner) in self.corners.iter_mut().zip(side.corners(pair[SIDE])) {
                lanes.set(lane, corner);
            }
        }
    }

    #[inline(always)]
    fn normal(&self) -> DoubleVectorLanes {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a)
    }

    /// The first two of the weights that `exact::barycentric_of` gives.
    #[inline(always)]
    pub(in crate::kernel) fn barycentrics(&self, point: VectorLanes) -> [Lanes; 2] {
        let (point, normal) = (point.widened(), self.normal());
        let first = self.area(1, 2, point, normal);
        let second = self.area(2, 0, point, normal);
        let third = self.area(0, 1, point, normal);
        let sum = first + second + third;
        let has_area = sum.greater_than(DoubleLanes::ZERO).and(sum.is_finite());
        let third = DoubleLanes::splat(1.0 / 3.0);
        [
            DoubleLanes::select(has_area, first / sum, third).rounded(),
            DoubleLanes::select(has_area, second / sum, third).rounded(),
        ]
    }

    #[inline(always)]
    fn area(&self, from: usize, to: usize, point: DoubleVectorLanes, normal: DoubleVectorLanes) -> DoubleLanes {
        let edge = self.corners[to] - self.corners[from];
        normal.dot(edge.cross(point - self.corners[from])).max(DoubleLanes::ZERO)
    }

    #[inline(always)]
    fn low(&self) -> DoubleVectorLanes {
        self.corners[0].min(self.corners[1]).min(self.corners[2])
    }

    #[inline(always)]
    fn high(&self) -> DoubleVectorLanes {
        self.corners[0].max(self.corners[1]).max(self.corners[2])
    }
}

/// Eight pairs of triangles.
pub(in crate::kernel) struct TrianglePairLanes {
    pub(in crate::kernel) a: CornerLanes,
    pub(in crate::kernel) b: CornerLanes,
}

impl TrianglePairLanes {
    pub(in crate::kernel) const EMPTY: Self = Self { a: CornerLanes::EMPTY, b: CornerLanes::EMPTY };

    /// How far apart the axis-aligned boxes of two triangles are along the axis that parts them most; 0 where they
    /// overlap.
    #[inline(always)]
    pub(in crate::kernel) fn box_gap(&self) -> DoubleLanes {
        let (a, b) = (&self.a, &self.b);
        let apart = (a.low() - b.high()).max(b.low() - a.high());
        apart.x.max(apart.y).max(apart.z).max(DoubleLanes::ZERO)
    }

    /// How far apart two triangles are along either one's normal or a unit direction, whichever parts them most; 0
    /// where none does.
    #[inline(always)]
    pub(in crate::kernel) fn gap_along_normals_and(&self, direction: DoubleVectorLanes) -> DoubleLanes {
        let (a, b) = (&self.a.corners, &self.b.corners);
        let origin = a[0];
        let own = [a[0] - origin, a[1] - origin, a[2] - origin];
        let other = [b[0] - origin, b[1] - origin, b[2] - origin];
        let along_own = gap_along(self.a.normal().normalized_or(DoubleVectorLanes::ZERO), &own, &other);
        let along_other = gap_along(self.b.normal().normalized_or(DoubleVectorLanes::ZERO), &own, &other);
        along_own.max(along_other).max(gap_along(direction, &own, &other)).max(DoubleLanes::ZERO)
    }
}

#[inline(always)]
fn gap_along(
    direction: DoubleVectorLanes,
    own: &[DoubleVectorLanes; 3],
    other: &[DoubleVectorLanes; 3],
) -> DoubleLanes {
    let (a, b, c) = (direction.dot(own[0]), direction.dot(own[1]), direction.dot(own[2]));
    let (p, q, r) = (direction.dot(other[0]), direction.dot(other[1]), direction.dot(other[2]));
    (p.min(q).min(r) - a.max(b).max(c)).max(a.min(b).min(c) - p.max(q).max(r))
}
