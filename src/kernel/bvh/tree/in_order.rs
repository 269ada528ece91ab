//! Visits items from near to far, for any measure of how far a box is.

use arrayvec::ArrayVec;
use fearless_simd::{f32x8, prelude::*};

use super::{BoxTree, Boxes, LEAF_WIDTH, Leaf, STACK, SetLanes};

/// Marks a leaf on the stack.
const IS_LEAF: u32 = 1 << 31;

/// A measure of how far boxes are.
pub(super) trait Probe {
    /// How far each of eight boxes is, and one bit for each that may be no farther than `end`.
    fn measure<S: Simd>(&self, simd: S, boxes: &Boxes, end: f32) -> (f32x8<S>, u32);

    /// The measure that nothing within a range exceeds.
    fn end(&self, range: f64) -> f32;
}

impl BoxTree {
    /// Calls `visit` with the items whose boxes may be within a range, those in nearer nodes first. `visit` may return a
    /// shorter range for what comes after.
    pub(super) fn visit_in_order(&self, probe: &impl Probe, range: f64, visit: &mut dyn FnMut(u32) -> Option<f64>) {
        dispatch!(simd => self.visit_in_lanes(simd, probe, range, visit));
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn visit_in_lanes<S: Simd>(
        &self,
        simd: S,
        probe: &impl Probe,
        range: f64,
        visit: &mut dyn FnMut(u32) -> Option<f64>,
    ) {
        let mut end = probe.end(range);
        let mut stack: ArrayVec<(f32, u32), STACK> = ArrayVec::new();
        stack.extend((!self.nodes.is_empty()).then_some((0.0, 0)));
        let mut measures = [0.0; LEAF_WIDTH];
        while let Some((measure, place)) = stack.pop() {
            if measure > end {
                continue;
            }
            if place & IS_LEAF != 0 {
                let Leaf { boxes, items, count, .. } = &self.leaves[(place & !IS_LEAF) as usize];
                let (far, within) = probe.measure(simd, boxes, end);
                far.store_slice(&mut measures);
                for lane in SetLanes(within & ((1 << count) - 1)) {
                    if measures[lane] <= end
                        && let Some(range) = visit(items[lane])
                    {
                        end = end.min(probe.end(range));
                    }
                }
                continue;
            }
            let node = &self.nodes[place as usize];
            let (far, within) = probe.measure(simd, &node.boxes, end);
            far.store_slice(&mut measures);
            let first = stack.len();
            for lane in SetLanes(within & ((1 << node.child_count) - 1)) {
                let mark = if node.leaf_children & (1 << lane) != 0 { IS_LEAF } else { 0 };
                stack.push((measures[lane], node.children[lane] | mark));
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
