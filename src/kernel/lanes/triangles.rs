//! Eight triangles of one surface side by side: their edges, and the frame of the longest one.
//!
//! What curvature and spheres are made from. The same arithmetic in the same order as one triangle at a time in
//! `circumsphere`, so that both agree to the last bit. Triangles without area, and lengths whose squares leave the range that
//! single precision is good for, are pointed out and left to that.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use glam::Vec3;

use super::{Lanes, Mask, VectorLanes, WIDTH};
use crate::kernel::circumsphere::{LEAST_EXACT_SQUARE, RADIUS_SLACK, ZERO_AREA};

/// The inverse of a length is finite where the length is more than 2^-128, a quarter of the least normal number.
const LEAST_LENGTH: f32 = 0.25 * f32::MIN_POSITIVE;

impl Lanes {
    // Of a comparison with infinity the compiler makes a question about bits, lane by lane.
    #[expect(clippy::eq_op, reason = "infinities and what is no number are no number apart from themselves")]
    #[inline(always)]
    pub(in crate::kernel) fn is_finite(self) -> Mask {
        Self::splat(1.0).greater_than(self - self)
    }
}

/// Where squares are exact enough to have their roots taken.
#[inline(always)]
fn is_exact(squared: Lanes) -> Mask {
    squared.at_least(Lanes::splat(LEAST_EXACT_SQUARE)).and(squared.is_finite())
}

/// The corners of eight triangles.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct TriangleLanes(pub(in crate::kernel) [VectorLanes; 3]);

impl TriangleLanes {
    pub(in crate::kernel) const EMPTY: Self = Self([VectorLanes::ZERO; 3]);

    // Kept apart for the same reason as the gathering of pairs.
    #[inline(never)]
    pub(in crate::kernel) fn gather(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) {
        for (lane, corners) in triangles.iter().enumerate().take(WIDTH) {
            for k in 0..3 {
                self.0[k].set(lane, positions[corners[k] as usize]);
            }
        }
    }

    #[inline(always)]
    pub(in crate::kernel) fn relative_to(&self, origin: VectorLanes) -> Self {
        Self([self.0[0] - origin, self.0[1] - origin, self.0[2] - origin])
    }

    /// Edge `k` joins the corners `k` and `k + 1`.
    #[inline(always)]
    pub(in crate::kernel) fn edge(&self, k: usize) -> VectorLanes {
        self.0[(k + 1) % 3] - self.0[k]
    }

    /// The lengths of the edges, and where they are exact.
    #[inline(always)]
    pub(in crate::kernel) fn edge_lengths(&self) -> ([Lanes; 3], Mask) {
        let mut lengths = [Lanes::ZERO; 3];
        let mut exact = Mask([u32::MAX; WIDTH]);
        for k in 0..3 {
            let edge = self.edge(k);
            let squared = edge.dot(edge);
            exact = exact.and(is_exact(squared));
            lengths[k] = squared.sqrt();
        }
        (lengths, exact)
    }

    /// Distance of the farthest corner from a point, and where it is exact.
    #[inline(always)]
    pub(in crate::kernel) fn farthest_corner(&self, center: VectorLanes) -> (Lanes, Mask) {
        let mut farthest = Lanes::ZERO;
        for k in 0..3 {
            let away = self.0[k] - center;
            farthest = farthest.max(away.dot(away));
        }
        (farthest.sqrt(), is_exact(farthest))
    }

    /// The radius of a ball around a point that contains the triangle, and where it is exact.
    #[inline(always)]
    pub(in crate::kernel) fn containing_radius(&self, center: VectorLanes) -> (Lanes, Mask) {
        let (farthest, exact) = self.farthest_corner(center);
        ((farthest * Lanes::splat(RADIUS_SLACK)).min(Lanes::splat(f32::MAX)), exact)
    }
}

/// One edge of each of eight triangles: which of the two masks holds, else the first.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct EdgeChoice {
    second: Mask,
    third: Mask,
}

impl EdgeChoice {
    /// The longest edges; of edges of the same length the first.
    #[inline(always)]
    pub(in crate::kernel) fn longest(lengths: &[Lanes; 3]) -> Self {
        let second = lengths[1].greater_than(lengths[0]);
        let third = lengths[2].greater_than(Lanes::select(second, lengths[1], lengths[0]));
        Self { second: second.and(third.not()), third }
    }

    /// The edges of these numbers.
    #[inline(always)]
    pub(in crate::kernel) fn numbered(numbers: &Lanes) -> Self {
        Self {
            second: numbers.at_least(Lanes::splat(1.0)).and(Lanes::splat(1.0).at_least(*numbers)),
            third: numbers.at_least(Lanes::splat(2.0)),
        }
    }

    #[inline(always)]
    pub(in crate::kernel) fn numbers(&self) -> Lanes {
        Lanes::select(self.third, Lanes::splat(2.0), Lanes::select(self.second, Lanes::splat(1.0), Lanes::ZERO))
    }

    #[inline(always)]
    fn of(&self, [first, second, third]: [&VectorLanes; 3]) -> VectorLanes {
        VectorLanes::select(self.third, *third, VectorLanes::select(self.second, *second, *first))
    }
}

/// [`LongestEdgeFrame`](crate::kernel::circumsphere) of eight triangles.
pub(in crate::kernel) struct FrameLanes {
    pub(in crate::kernel) midpoint: VectorLanes,
    pub(in crate::kernel) half_length: Lanes,
    pub(in crate::kernel) normal: VectorLanes,
    pub(in crate::kernel) inward: VectorLanes,
    pub(in crate::kernel) cotangent: Lanes,
    /// Where the triangle has an area and its lengths are exact.
    pub(in crate::kernel) exact: Mask,
}

impl FrameLanes {
    #[inline(always)]
    pub(in crate::kernel) fn new(triangles: &TriangleLanes, edge: EdgeChoice) -> Self {
        let [a, b, c] = &triangles.0;
        let (from, to, apex) = (edge.of([a, b, c]), edge.of([b, c, a]), edge.of([c, a, b]));
        let along = to - from;
        let squared = along.dot(along);
        let length = squared.sqrt();
        let scale = length.recip();
        let (u, v) = ((from - apex).scaled(scale), (to - apex).scaled(scale));
        let cross = u.cross(v);
        let doubled_area = cross.dot(cross).sqrt();
        let normal = cross.over(doubled_area);
        let (inward, has_inward) = normal.cross(along.scaled(scale)).normalized();
        let exact = is_exact(squared)
            .and(is_exact(cross.dot(cross)))
            .and(doubled_area.greater_than(Lanes::splat(ZERO_AREA)))
            .and(has_inward);
        Self {
            midpoint: from.plus(along.scaled(Lanes::splat(0.5))),
            half_length: Lanes::splat(0.5) * length,
            normal,
            inward,
            cotangent: u.dot(v) / doubled_area,
            exact,
        }
    }

    #[inline(always)]
    pub(in crate::kernel) fn point_across(&self, halves: Lanes) -> VectorLanes {
        let across = (halves * self.half_length).min(Lanes::splat(f32::MAX));
        self.midpoint.plus(self.inward.scaled(across))
    }
}

impl VectorLanes {
    #[inline(always)]
    pub(in crate::kernel) fn over(self, divisor: Lanes) -> Self {
        Self { x: self.x / divisor, y: self.y / divisor, z: self.z / divisor }
    }

    /// Of unit length, or zero where that cannot be told; and where it can.
    #[inline(always)]
    pub(in crate::kernel) fn normalized(self) -> (Self, Mask) {
        let length = self.dot(self).sqrt();
        let has_length = length.greater_than(Lanes::splat(LEAST_LENGTH)).and(length.is_finite());
        (Self::select(has_length, self.scaled(length.recip()), Self::ZERO), has_length)
    }
}
