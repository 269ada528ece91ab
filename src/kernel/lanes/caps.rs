//! Eight pairs of spheres side by side: enclosing balls, and caps with their cones.
//!
//! The same arithmetic in the same order as one pair at a time in `cone`, so that both agree to the last bit. Lanes whose
//! numbers leave the range that single precision is good for are pointed out, and left to that.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use super::{DoubleLanes, DoubleVectorLanes, Lanes, Mask, VectorLanes, WIDTH};
use crate::kernel::{
    circumsphere::LEAST_EXACT_SQUARE,
    cone::{BOUNDARY_SLACK, Cap},
};

impl Lanes {
    #[inline(always)]
    pub(in crate::kernel) fn at_least(self, other: Self) -> Mask {
        let mut mask = [0; WIDTH];
        for lane in 0..WIDTH {
            mask[lane] = if self.0[lane] >= other.0[lane] { u32::MAX } else { 0 };
        }
        Mask(mask)
    }

    #[inline(always)]
    pub(in crate::kernel) fn widened(self) -> DoubleLanes {
        let mut result = DoubleLanes::ZERO;
        for lane in 0..WIDTH {
            result.0[lane] = f64::from(self.0[lane]);
        }
        result
    }
}

impl Mask {
    /// Whether the condition holds anywhere.
    #[inline(always)]
    pub(in crate::kernel) fn any(self) -> bool {
        self.0.iter().fold(0, |any, lane| any | lane) != 0
    }
}

impl DoubleLanes {
    #[inline(always)]
    pub(in crate::kernel) fn rounded(self) -> Lanes {
        let mut result = Lanes::ZERO;
        for lane in 0..WIDTH {
            result.0[lane] = self.0[lane] as f32;
        }
        result
    }
}

impl VectorLanes {
    #[inline(always)]
    pub(in crate::kernel) fn widened(self) -> DoubleVectorLanes {
        DoubleVectorLanes { x: self.x.widened(), y: self.y.widened(), z: self.z.widened() }
    }

    #[inline(always)]
    pub(in crate::kernel) fn plus(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }

    /// Unlike a difference from zero it turns the sign of zeros too.
    #[inline(always)]
    pub(in crate::kernel) fn negated(self) -> Self {
        self.scaled(Lanes::splat(-1.0))
    }
}

/// One cap of each of eight pairs.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct CapLanes {
    pub(in crate::kernel) center: VectorLanes,
    pub(in crate::kernel) radius: Lanes,
    pub(in crate::kernel) height: Lanes,
    pub(in crate::kernel) axis: VectorLanes,
    pub(in crate::kernel) cosine: Lanes,
}

/// [`CapContact`](crate::kernel::cone::CapContact) of eight pairs.
pub(in crate::kernel) struct CapContactLanes {
    pub(in crate::kernel) point_a: VectorLanes,
    pub(in crate::kernel) point_b: VectorLanes,
    pub(in crate::kernel) direction: VectorLanes,
    pub(in crate::kernel) gap: Lanes,
}

impl CapLanes {
    /// The cap in one lane.
    pub(in crate::kernel) fn get(&self, lane: usize) -> Cap {
        Cap {
            center: self.center.get(lane),
            radius: self.radius.0[lane],
            height: self.height.0[lane],
            axis: self.axis.get(lane),
            cosine: self.cosine.0[lane],
        }
    }

    #[inline(always)]
    pub(in crate::kernel) fn in_plane_center(&self) -> VectorLanes {
        self.center.plus(self.axis.scaled(self.height))
    }

    /// [`Cap::facing`]
    #[inline(always)]
    pub(in crate::kernel) fn facing(&self, point: VectorLanes) -> Self {
        let in_plane = self.in_plane_center();
        let toward = (point - in_plane).dot(self.axis).at_least(Lanes::ZERO);
        let mirrored = in_plane.plus(self.axis.scaled(self.height));
        Self {
            center: VectorLanes::select(toward, self.center, mirrored),
            axis: VectorLanes::select(toward, self.axis, self.axis.negated()),
            ..*self
        }
    }

    /// [`spheres_overlap`](crate::kernel::cone::spheres_overlap)
    #[inline(always)]
    pub(in crate::kernel) fn overlap(&self, other: &Self, reach: Lanes) -> Mask {
        let between = self.center - other.center;
        let sum = self.radius + other.radius + reach;
        (sum * sum).at_least(between.dot(between))
    }

    /// [`cap_contact`](crate::kernel::cone::cap_contact), where the pair passes the cone test, and where only that can
    /// tell: the caps are concentric, or the distance of their centers is too long or too short to be squared.
    #[inline(always)]
    pub(in crate::kernel) fn contact(&self, other: &Self) -> (CapContactLanes, Mask, Mask) {
        let (a, b) = (self, other);
        let between = b.center - a.center;
        let squared = between.dot(between);
        let length = squared.sqrt();
        let concentric = Lanes::splat(f32::EPSILON) * (a.radius + b.radius);
        let ordinary = squared
            .at_least(Lanes::splat(LEAST_EXACT_SQUARE))
            .and(squared.is_finite())
            .and(length.greater_than(concentric));
        let direction = VectorLanes { x: between.x / length, y: between.y / length, z: between.z / length };
        let (toward_b, toward_a) = (direction.dot(a.axis), direction.dot(b.axis) * Lanes::splat(-1.0));
        let slack = Lanes::splat(BOUNDARY_SLACK);
        let outside_a = (a.cosine - slack).greater_than(toward_b);
        let outside_b = (b.cosine - slack).greater_than(toward_a);
        let (from_a, from_b) = (a.height_along(toward_b), b.height_along(toward_a));
        let contact = CapContactLanes {
            point_a: a.center.plus(direction.scaled(from_a)),
            point_b: b.center - direction.scaled(from_b),
            direction,
            gap: length - from_a - from_b,
        };
        (contact, outside_a.or(outside_b).not(), ordinary.not())
    }

    /// From the center to the triangle's plane, in a direction whose cosine with the axis is known.
    #[inline(always)]
    fn height_along(&self, toward: Lanes) -> Lanes {
        let distance = (self.height / toward.max(Lanes::splat(f32::MIN_POSITIVE))).min(self.radius);
        Lanes::select(self.height.greater_than(Lanes::ZERO), distance, Lanes::ZERO)
    }
}
