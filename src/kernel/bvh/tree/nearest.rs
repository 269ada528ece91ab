//! Finds the items whose boxes are within a distance of a point, nearest nodes first.

use fearless_simd::{f32x8, prelude::*};
use glam::DVec3;

use super::{BoxTree, Boxes, in_order::Probe};

/// The rounding error of a point in f32, relative to its largest coordinate.
const ROUNDING: f64 = f32::EPSILON as f64;

/// Squared distances have relative errors of some roundings.
const SLACK: f64 = 1.0 + 8.0 * f32::EPSILON as f64;

/// A point, rounded to f32 in both directions.
struct RoundedPoint {
    lower: [f32; 3],
    upper: [f32; 3],
}

impl RoundedPoint {
    fn new(point: DVec3) -> Self {
        let padding = ROUNDING * point.abs().max_element() + f64::from(f32::MIN_POSITIVE);
        Self { lower: (point - padding).as_vec3().to_array(), upper: (point + padding).as_vec3().to_array() }
    }
}

impl Probe for RoundedPoint {
    /// A lower bound of the squared distance of each box, except for the rounding error of the square.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn measure<S: Simd>(&self, simd: S, boxes: &Boxes, end: f32) -> (f32x8<S>, u32) {
        let zero = f32x8::splat(simd, 0.0);
        let mut squared = zero;
        for axis in 0..3 {
            let below = f32x8::from_slice(simd, &boxes.min[axis]) - self.upper[axis];
            let above = f32x8::splat(simd, self.lower[axis]) - f32x8::from_slice(simd, &boxes.max[axis]);
            let gap = below.max(above).max(zero);
            squared += gap * gap;
        }
        (squared, squared.simd_le(end).to_bitmask() as u32)
    }

    /// The square of a range, rounded up.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn end(&self, range: f64) -> f32 {
        (range * range * SLACK) as f32 + f32::MIN_POSITIVE
    }
}

impl BoxTree {
    /// Calls `visit` with items whose boxes may be within `range` of a point, those in nearer nodes first. `visit` may
    /// return a shorter range for what comes after. Misses no item within the range.
    pub fn nearest(&self, point: DVec3, range: f64, mut visit: impl FnMut(u32) -> Option<f64>) {
        self.visit_in_order(&RoundedPoint::new(point), range, &mut visit);
    }

    /// The item that is nearest to a point by the squared distances that `squared` returns, which are finite and no less
    /// than those of the boxes. Of several, the lowest. `None` if there are no items.
    pub fn nearest_item(&self, point: DVec3, mut squared: impl FnMut(u32) -> f64) -> Option<u32> {
        let mut nearest: Option<(f64, u32)> = None;
        self.nearest(point, f64::INFINITY, |item| {
            let found = (squared(item), item);
            if nearest.is_none_or(|nearest| found < nearest) {
                nearest = Some(found);
            }
            nearest.map(|(squared, _)| squared.sqrt())
        });
        nearest.map(|(_, item)| item)
    }
}
