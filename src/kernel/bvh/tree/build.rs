//! Builds trees, at once or in one slice per tick.
//!
//! Items are split three times per node, at the median along the longest side of the bounds of their centers, into full
//! leaves. The number of items alone therefore determines the nodes and leaves, and a rebuild only reorders the items.
//! It can run in slices while the old tree remains in use.

use std::ops::Range;

use glam::Vec3;

use super::{Aabb, BoxTree, Boxes, LEAF_WIDTH, Leaf, NO_ITEM, Node};

/// How many times one slice of a rebuild passes over all items. A whole build takes about fourteen passes for a mesh of
/// 100,000. A slice adds less than half of the time that such a mesh takes when it touches hardly anything.
const ROUNDS_OF_SLICE: usize = 2;

/// Items on their way to their leaves.
#[derive(Clone, Debug)]
pub(super) struct Arrangement {
    /// The center of each box, and its item.
    items: Vec<(Vec3, u32)>,
    /// The ranges that are still to be split.
    pending: Vec<Range<usize>>,
}

impl Arrangement {
    fn new(bounds: &[Aabb]) -> Self {
        let center = |bounds: &Aabb| (bounds.min + bounds.max) * 0.5;
        let items: Vec<(Vec3, u32)> = bounds.iter().map(center).zip(0..).collect();
        let pending = std::iter::once(0..items.len()).collect();
        Self { items, pending }
    }

    /// Splits until at least `items` items have been processed, repeated ones included, or nothing is left to split.
    /// Returns whether nothing is left.
    fn advance(&mut self, items: usize) -> bool {
        let mut gone_through = 0;
        while gone_through < items {
            let Some(range) = self.pending.pop() else { return true };
            if range.len() > LEAF_WIDTH {
                gone_through += range.len();
                let middle = range.start + first_half(range.len());
                split(&mut self.items[range.clone()], middle - range.start);
                self.pending.extend([middle..range.end, range.start..middle]);
            }
        }
        self.pending.is_empty()
    }
}

/// The number of items in the first of two halves. Whole leaves, so that at most one leaf of the tree is not full. All
/// items if they fit into one leaf.
fn first_half(count: usize) -> usize {
    if count <= LEAF_WIDTH { count } else { count.div_ceil(LEAF_WIDTH).div_ceil(2) * LEAF_WIDTH }
}

/// Partitions items at `middle` along the longest side of their bounds.
fn split(items: &mut [(Vec3, u32)], middle: usize) {
    let spread = Aabb::from_points(items.iter().map(|&(center, _)| center));
    let size = spread.max - spread.min;
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    items.select_nth_unstable_by(middle, |(center, item), (other_center, other_item)| {
        center[axis].total_cmp(&other_center[axis]).then(item.cmp(other_item))
    });
}

impl BoxTree {
    /// Builds a tree over `bounds`. Item `i` has the box `bounds[i]`.
    #[must_use]
    pub fn new(bounds: &[Aabb]) -> Self {
        let mut tree = Self::default();
        tree.rebuild(bounds);
        tree
    }

    /// Rebuilds the tree over `bounds`.
    pub fn rebuild(&mut self, bounds: &[Aabb]) {
        if self.item_count != bounds.len() || self.nodes.is_empty() {
            self.item_count = bounds.len();
            self.nodes.clear();
            self.leaves.clear();
            if !bounds.is_empty() {
                self.add_node(bounds.len());
            }
            self.nodes.shrink_to_fit();
            self.leaves.shrink_to_fit();
        }
        let mut arrangement = Arrangement::new(bounds);
        arrangement.advance(usize::MAX);
        self.rebuild = None;
        self.place_items(&arrangement);
        self.refit(bounds);
    }

    /// Begins an incremental rebuild over the current boxes.
    ///
    /// # Panics
    /// If `bounds` has another length than the tree was built with.
    pub fn begin_rebuild(&mut self, bounds: &[Aabb]) {
        assert_eq!(bounds.len(), self.item_count, "a tree is built anew over as many boxes as it was built with");
        self.rebuild = Some(Arrangement::new(bounds));
    }

    /// Whether an incremental rebuild is in progress.
    #[must_use]
    pub fn is_rebuilding(&self) -> bool {
        self.rebuild.is_some()
    }

    /// Cancels the incremental rebuild, if there is one.
    pub fn break_off_rebuilding(&mut self) {
        self.rebuild = None;
    }

    /// Continues the incremental rebuild by one slice. All slices take about the same time. Returns whether the rebuild
    /// is complete: the tree must then be refitted before it is queried again. Until then it can be refitted and
    /// queried as before.
    pub fn go_on_rebuilding(&mut self) -> bool {
        let slice = ROUNDS_OF_SLICE * self.item_count;
        let Some(mut arrangement) = self.rebuild.take_if(|arrangement| arrangement.advance(slice)) else {
            return false;
        };
        arrangement.pending = Vec::new();
        self.place_items(&arrangement);
        true
    }

    fn place_items(&mut self, arrangement: &Arrangement) {
        for (leaf, items) in self.leaves.iter_mut().zip(arrangement.items.chunks(LEAF_WIDTH)) {
            *leaf = Leaf::new(items.iter().map(|&(_, item)| item));
        }
        self.is_new = true;
        self.arrangement += 1;
    }

    /// Appends a node for `count` items and everything below it, all without items.
    fn add_node(&mut self, count: usize) -> u32 {
        let place = self.nodes.len();
        self.nodes.push(Node {
            boxes: Boxes::UNUSED,
            bounds: Aabb::EMPTY,
            children: [0; LEAF_WIDTH],
            ends: [0; LEAF_WIDTH],
            leaf_children: 0,
            child_count: 0,
        });
        let mut counts = [0; LEAF_WIDTH];
        counts[0] = count;
        let mut part = LEAF_WIDTH;
        while part > 1 {
            for first in (0..LEAF_WIDTH).step_by(part) {
                let (whole, half) = (counts[first], first_half(counts[first]));
                (counts[first], counts[first + part / 2]) = (half, whole - half);
            }
            part /= 2;
        }
        for (lane, count) in counts.into_iter().filter(|&count| count > 0).enumerate() {
            let child = if count <= LEAF_WIDTH {
                self.leaves.push(Leaf::new(std::iter::empty()));
                self.nodes[place].leaf_children |= 1 << lane;
                self.leaves.len() as u32 - 1
            } else {
                self.add_node(count)
            };
            let end = self.leaves.len() as u32;
            let node = &mut self.nodes[place];
            node.children[lane] = child;
            node.ends[lane] = end;
            node.child_count += 1;
        }
        place as u32
    }

    /// Becomes a list of leaves over items with their boxes, in their order: only what [`pairs_of`](Self::pairs_of)
    /// visits leaf by leaf. Queries find nothing in it.
    pub fn collect_leaves(&mut self, items: &[(u32, Aabb)]) {
        self.nodes.clear();
        self.leaves.clear();
        self.item_count = items.len();
        dispatch!(simd => {
            for part in items.chunks(LEAF_WIDTH) {
                let mut leaf = Leaf::new(part.iter().map(|&(item, _)| item));
                leaf.set_boxes(simd, part);
                self.leaves.push(leaf);
            }
        });
    }
}

impl Leaf {
    fn new(items: impl Iterator<Item = u32>) -> Self {
        let mut leaf = Self { boxes: Boxes::UNUSED, bounds: Aabb::EMPTY, items: [NO_ITEM; LEAF_WIDTH], count: 0 };
        for (lane, item) in leaf.items.iter_mut().zip(items) {
            *lane = item;
            leaf.count += 1;
        }
        leaf
    }
}
