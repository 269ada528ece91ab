//! Tests eight pairs of caps at a time: whether their spheres overlap, and where they are in contact.
//!
//! The operations have the same order as those for one pair at a time in `cone`, so both agree to the last bit. Lanes
//! that leave the reliable range of f32 are flagged and left to that code.

use fearless_simd::{f32x8, mask32x8, prelude::*};

use super::cone::{BOUNDARY_SLACK, Cap};
use crate::kernel::simd::lanes::{LEAST_EXACT_SQUARE, VectorLanes};

/// One cap of each of eight pairs.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct CapLanes<S: Simd> {
    pub(in crate::kernel) center: VectorLanes<S>,
    pub(in crate::kernel) radius: f32x8<S>,
    pub(in crate::kernel) height: f32x8<S>,
    pub(in crate::kernel) axis: VectorLanes<S>,
    pub(in crate::kernel) cosine: f32x8<S>,
}

/// [`CapContact`](crate::kernel::spheres::cone::CapContact) of eight pairs.
pub(in crate::kernel) struct CapContactLanes<S: Simd> {
    pub(in crate::kernel) point_a: VectorLanes<S>,
    pub(in crate::kernel) point_b: VectorLanes<S>,
    pub(in crate::kernel) direction: VectorLanes<S>,
    pub(in crate::kernel) gap: f32x8<S>,
}

impl<S: Simd> CapLanes<S> {
    /// The cap in one lane.
    pub(in crate::kernel) fn get(&self, lane: usize) -> Cap {
        Cap {
            center: self.center.stored().get(lane),
            radius: self.radius[lane],
            height: self.height[lane],
            axis: self.axis.stored().get(lane),
            cosine: self.cosine[lane],
        }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn in_plane_center(&self) -> VectorLanes<S> {
        self.center.plus(self.axis.scaled(self.height))
    }

    /// [`Cap::facing`]
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn facing(&self, point: VectorLanes<S>) -> Self {
        let in_plane = self.in_plane_center();
        let toward = (point - in_plane).dot(self.axis).simd_ge(0.0);
        let mirrored = in_plane.plus(self.axis.scaled(self.height));
        Self {
            center: VectorLanes::select(toward, self.center, mirrored),
            axis: VectorLanes::select(toward, self.axis, self.axis.negated()),
            ..*self
        }
    }

    /// [`spheres_overlap`](crate::kernel::spheres::cone::spheres_overlap)
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn overlap(&self, other: &Self, reach: f32) -> mask32x8<S> {
        let between = self.center - other.center;
        let sum = self.radius + other.radius + reach;
        (sum * sum).simd_ge(between.dot(between))
    }

    /// [`cap_contact`](crate::kernel::spheres::cone::cap_contact), the lanes that pass the cone test, and the lanes
    /// that only the other code can decide: the caps are concentric, or the distance of their centers is too large or
    /// too small to be squared.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn contact(&self, other: &Self) -> (CapContactLanes<S>, mask32x8<S>, mask32x8<S>) {
        let (a, b) = (self, other);
        let between = b.center - a.center;
        let squared = between.dot(between);
        let length = squared.sqrt();
        let concentric = (a.radius + b.radius) * f32::EPSILON;
        let ordinary = squared.simd_ge(LEAST_EXACT_SQUARE) & squared.is_finite() & length.simd_gt(concentric);
        let direction = between.over(length);
        let (toward_b, toward_a) = (direction.dot(a.axis), -direction.dot(b.axis));
        let outside_a = (a.cosine - BOUNDARY_SLACK).simd_gt(toward_b);
        let outside_b = (b.cosine - BOUNDARY_SLACK).simd_gt(toward_a);
        let (from_a, from_b) = (a.height_along(toward_b), b.height_along(toward_a));
        let contact = CapContactLanes {
            point_a: a.center.plus(direction.scaled(from_a)),
            point_b: b.center - direction.scaled(from_b),
            direction,
            gap: length - from_a - from_b,
        };
        (contact, !(outside_a | outside_b), !ordinary)
    }

    /// Distance from the center to the triangle's plane, in a direction with a known cosine to the axis.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn height_along(&self, toward: f32x8<S>) -> f32x8<S> {
        let distance = (self.height / toward.max(f32::MIN_POSITIVE)).min(self.radius);
        self.height.simd_gt(0.0).select(distance, f32x8::splat(self.height.simd, 0.0))
    }
}
