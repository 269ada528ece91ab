//! Finds the items whose boxes are within a distance of a point, nearest nodes first.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the dispatched instruction set")]

use arrayvec::ArrayVec;
use fearless_simd::{Level, dispatch, f32x8, prelude::*};
use glam::DVec3;

use super::{BoxTree, Boxes, LEAF_WIDTH, Leaf, STACK, SetLanes};

/// Marks a leaf on the stack.
const IS_LEAF: u32 = 1 << 31;

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

/// The square of a range, rounded up.
fn squared(range: f64) -> f32 {
    (range * range * SLACK) as f32 + f32::MIN_POSITIVE
}

impl Boxes {
    /// A lower bound of the squared distance of a point from each of eight boxes, except for the rounding error of the
    /// square, and one bit for each within a squared range.
    #[inline(always)]
    fn near_to<S: Simd>(&self, simd: S, point: &RoundedPoint, range: f32) -> (f32x8<S>, u32) {
        let zero = f32x8::splat(simd, 0.0);
        let mut squared = zero;
        for axis in 0..3 {
            let below = f32x8::from_slice(simd, &self.min[axis]) - point.upper[axis];
            let above = f32x8::splat(simd, point.lower[axis]) - f32x8::from_slice(simd, &self.max[axis]);
            let gap = below.max(above).max(zero);
            squared += gap * gap;
        }
        (squared, squared.simd_le(range).to_bitmask() as u32)
    }
}

impl BoxTree {
    /// Calls `visit` with items whose boxes may be within `range` of a point, those in nearer nodes first. `visit` may
    /// return a shorter range for what comes after. Misses no item within the range.
    pub fn nearest(&self, point: DVec3, range: f64, mut visit: impl FnMut(u32) -> Option<f64>) {
        self.nearest_with(&RoundedPoint::new(point), range, &mut visit);
    }

    /// Compiled once for each instruction set, not for each caller.
    fn nearest_with(&self, point: &RoundedPoint, range: f64, visit: &mut dyn FnMut(u32) -> Option<f64>) {
        dispatch!(Level::new(), simd => self.nearest_in_lanes(simd, point, range, visit));
    }

    #[inline(always)]
    fn nearest_in_lanes<S: Simd>(
        &self,
        simd: S,
        point: &RoundedPoint,
        range: f64,
        visit: &mut dyn FnMut(u32) -> Option<f64>,
    ) {
        let mut end = squared(range);
        let mut stack: ArrayVec<(f32, u32), STACK> = ArrayVec::new();
        stack.extend((!self.nodes.is_empty()).then_some((0.0, 0)));
        let mut distances = [0.0; LEAF_WIDTH];
        while let Some((distance, place)) = stack.pop() {
            if distance > end {
                continue;
            }
            if place & IS_LEAF != 0 {
                let Leaf { boxes, items, count, .. } = &self.leaves[(place & !IS_LEAF) as usize];
                let (near, within) = boxes.near_to(simd, point, end);
                near.store_slice(&mut distances);
                for lane in SetLanes(within & ((1 << count) - 1)) {
                    if distances[lane] <= end
                        && let Some(range) = visit(items[lane])
                    {
                        end = end.min(squared(range));
                    }
                }
                continue;
            }
            let node = &self.nodes[place as usize];
            let (near, within) = node.boxes.near_to(simd, point, end);
            near.store_slice(&mut distances);
            let first = stack.len();
            for lane in SetLanes(within & ((1 << node.child_count) - 1)) {
                let mark = if node.leaf_children & (1 << lane) != 0 { IS_LEAF } else { 0 };
                stack.push((distances[lane], node.children[lane] | mark));
                // The nearest child is on top.
                let mut place = stack.len() - 1;
                while place > first && stack[place - 1].0 < stack[place].0 {
                    stack.swap(place - 1, place);
                    place -= 1;
                }
            }
        }
    }
}
