//! Finds the items whose boxes a ray meets, nearest first.
//!
//! Boxes are in f32, and rays in f64. A ray is clipped to the box of the tree in f64, so that what is rounded to f32 has
//! coordinates no larger than the tree's, however far away the ray starts. Everything is padded by more than the rounding
//! error: an item that the ray meets is never lost.

use fearless_simd::{f32x8, prelude::*};
use glam::DVec3;

use super::{Aabb, BoxTree, Boxes, in_order::Probe};

/// The rounding error of a position along a clipped ray, relative to the largest coordinate of the tree: half a unit in
/// the last place for its start, one for each of the two ends of its direction, and two for a direction that is changed
/// so as not to be 0. The rest is reserve.
const PADDING: f64 = 8.0 * f32::EPSILON as f64;

/// Distances along the ray have relative errors of three roundings. The rest is reserve.
const SLACK: f32 = 1.0 + 8.0 * f32::EPSILON;

/// The rounding error of positions along a ray in f64, relative to the coordinates of its start.
const DOUBLE_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A ray, or a box that moves along one.
#[derive(Clone, Copy, Debug)]
pub struct Sweep {
    /// Where it starts: for a box, its center.
    pub origin: DVec3,
    /// Its direction, of any length but 0.
    pub direction: DVec3,
    /// Half the sides of the box. Zero for a ray.
    pub half_extents: DVec3,
}

/// A ray clipped to the box of a tree. Its parameter begins at 0, and the largest component of its direction is 1.
struct ClippedRay {
    /// What the lower sides of boxes are measured from, and what the upper sides.
    lower: [f32; 3],
    upper: [f32; 3],
    inverse: [f32; 3],
    /// Where it begins and ends, in lengths of the direction.
    start: f64,
    exit: f64,
    /// Its parameter at one length of the direction.
    scale: f64,
}

impl ClippedRay {
    /// `None` if the ray does not meet the box within `range` lengths of its direction.
    fn new(sweep: &Sweep, bounds: &Aabb, range: f64) -> Option<Self> {
        let Sweep { origin, direction, half_extents } = *sweep;
        let (min, max) = (bounds.min.as_dvec3() - half_extents, bounds.max.as_dvec3() + half_extents);
        let largest = min.abs().max(max.abs()).max_element();
        let far_rounding = DOUBLE_ROUNDING * origin.abs().max_element();
        let padding = PADDING * largest + far_rounding + f64::from(f32::MIN_POSITIVE);
        let (mut start, mut exit) = (0.0_f64, range);
        for axis in 0..3 {
            let (low, high) = (min[axis] - padding - origin[axis], max[axis] + padding - origin[axis]);
            if direction[axis] == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (low, high) = (low / direction[axis], high / direction[axis]);
            start = start.max(low.min(high));
            exit = exit.min(low.max(high));
        }
        // Also if the box is empty.
        if !(start <= exit && start.is_finite()) {
            return None;
        }
        let begin = origin + direction * start;
        let scale = direction.abs().max_element();
        let mut ray = Self { lower: [0.0; 3], upper: [0.0; 3], inverse: [0.0; 3], start, exit, scale };
        for axis in 0..3 {
            let reach = half_extents[axis] + padding;
            ray.lower[axis] = (begin[axis] + reach) as f32;
            ray.upper[axis] = (begin[axis] - reach) as f32;
            let along = (direction[axis] / scale) as f32;
            ray.inverse[axis] = if along.abs() < f32::EPSILON { f32::EPSILON.copysign(along) } else { along }.recip();
        }
        Some(ray)
    }
}

impl Probe for ClippedRay {
    /// Where the ray enters each of eight boxes.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn measure<S: Simd>(&self, simd: S, boxes: &Boxes, end: f32) -> (f32x8<S>, u32) {
        let (mut near, mut far) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, end));
        for axis in 0..3 {
            let inverse = f32x8::splat(simd, self.inverse[axis]);
            let low = (f32x8::from_slice(simd, &boxes.min[axis]) - self.lower[axis]) * inverse;
            let high = (f32x8::from_slice(simd, &boxes.max[axis]) - self.upper[axis]) * inverse;
            near = near.max(low.min(high));
            far = far.min(low.max(high));
        }
        (near, near.simd_le(far * SLACK).to_bitmask() as u32)
    }

    /// The parameter at a distance in lengths of the direction, rounded up.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn end(&self, range: f64) -> f32 {
        let distance = range.min(self.exit);
        let rounding = DOUBLE_ROUNDING * (distance * self.scale).abs();
        ((distance - self.start) * self.scale + rounding) as f32 * SLACK * SLACK
    }
}

impl BoxTree {
    /// Calls `visit` with items whose boxes a ray, or a box that moves along it, may meet within `range` lengths of its
    /// direction, nodes that it enters early first. `visit` may return a shorter range for what comes after. Misses no
    /// item within the range.
    pub fn cast(&self, sweep: &Sweep, range: f64, mut visit: impl FnMut(u32) -> Option<f64>) {
        if let Some(ray) = ClippedRay::new(sweep, &self.bounds(), range) {
            self.visit_in_order(&ray, f64::INFINITY, &mut visit);
        }
    }
}
