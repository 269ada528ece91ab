//! Finds what is nearest to a point: depth first, nearest children first, and nothing that is farther than the best.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{BoxTree, Boxes, LEAF_WIDTH, STACK};

/// A node or leaf that waits, with the squared distance of its box.
#[derive(Clone, Copy)]
struct Waiting {
    squared: f64,
    place: u32,
    is_leaf: bool,
}

impl BoxTree {
    /// Calls `visit` with the items near a point, and skips those whose boxes are farther from it than the smallest
    /// squared distance that `visit` has returned. `visit` returns infinity for items that do not count.
    ///
    /// Boxes at exactly that distance are not skipped, so that `visit` sees everything that is equally near.
    pub fn visit_nearest(&self, point: DVec3, mut visit: impl FnMut(u32) -> f64) {
        let mut stack: ArrayVec<Waiting, STACK> = ArrayVec::new();
        if !self.nodes.is_empty() {
            stack.push(Waiting { squared: 0.0, place: 0, is_leaf: false });
        }
        let mut best = f64::INFINITY;
        while let Some(Waiting { squared, place, is_leaf }) = stack.pop() {
            if squared > best {
                continue;
            }
            if is_leaf {
                let leaf = &self.leaves[place as usize];
                let squared = leaf.boxes.squared_distances(point);
                for lane in 0..leaf.count as usize {
                    if squared[lane] <= best {
                        best = best.min(visit(leaf.items[lane]));
                    }
                }
                continue;
            }
            let node = &self.nodes[place as usize];
            let squared = node.boxes.squared_distances(point);
            let mut near: ArrayVec<Waiting, LEAF_WIDTH> = (0..node.child_count as usize)
                .filter(|&lane| squared[lane] <= best)
                .map(|lane| Waiting {
                    squared: squared[lane],
                    place: node.children[lane],
                    is_leaf: node.leaf_children & (1 << lane) != 0,
                })
                .collect();
            // The nearest comes last, to be popped first. Equal ones keep an order.
            near.sort_unstable_by(|one, other| other.squared.total_cmp(&one.squared).then(other.place.cmp(&one.place)));
            stack.extend(near);
        }
    }
}

impl Boxes {
    /// Squared distances of the boxes from a point. NaN for unused lanes.
    fn squared_distances(&self, point: DVec3) -> [f64; LEAF_WIDTH] {
        let mut squared = [0.0; LEAF_WIDTH];
        for (axis, coordinate) in point.to_array().into_iter().enumerate() {
            for lane in 0..LEAF_WIDTH {
                let (min, max) = (f64::from(self.min[axis][lane]), f64::from(self.max[axis][lane]));
                // With NaN, `max` would return the other number.
                let beyond = if coordinate < min { min - coordinate } else { (coordinate - max).max(0.0) };
                squared[lane] += beyond * beyond;
            }
        }
        squared
    }
}
