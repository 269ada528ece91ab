//! Finds the leaves of a tree that are near a box, or near each of many leaves.

use fearless_simd::{f32x8, mask32x8, prelude::*, u32x8};

use super::{Aabb, BoxTree, LEAF_WIDTH, LEAVES_TOGETHER, Leaf, Node, STACK, corners, overlapping};

/// Finds the leaves of a tree whose boxes overlap another box, some at a time. The leaves of a node come together,
/// before the subtrees beside them. The order depends on the structure only, and is the same in every traversal.
pub(super) struct LeafSearch {
    /// The stack of nodes, with space to write eight children where only some are kept.
    nodes: [u32; STACK + LEAF_WIDTH],
    node_count: usize,
    leaves: [u32; Self::ROOM + LEAF_WIDTH],
    leaf_count: usize,
}

impl LeafSearch {
    const ROOM: usize = 56;

    pub(super) fn new() -> Self {
        Self { nodes: [0; STACK + LEAF_WIDTH], node_count: 0, leaves: [0; Self::ROOM + LEAF_WIDTH], leaf_count: 0 }
    }

    /// Starts a search.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn begin(&mut self, tree: &BoxTree) {
        self.node_count = usize::from(!tree.nodes.is_empty());
        self.nodes[0] = 0;
    }

    /// Pops a node from the stack, and pushes the child nodes that overlap `bounds` and have leaves from `first` on.
    /// Returns the node, the indices of all its children, and a bit for each leaf among them that is at `first` or
    /// later and overlaps `bounds`.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn visit<'a, S: Simd>(
        &mut self,
        simd: S,
        tree: &'a BoxTree,
        bounds: &Aabb,
        first: u32,
    ) -> (&'a Node, u32x8<S>, u32) {
        self.node_count -= 1;
        let node = &tree.nodes[self.nodes[self.node_count] as usize];
        let hits = node.boxes.overlapping(simd, bounds);
        let children = u32x8::from_slice(simd, &node.children);
        let is_later = children.simd_ge(first).to_bitmask() as u32;
        let has_later = u32x8::from_slice(simd, &node.ends).simd_gt(first).to_bitmask() as u32;
        // Which of eight children are kept is unpredictable, so all are written, the kept ones first, and the next ones
        // overwrite the rest.
        let nodes = hits & !node.leaf_children & has_later;
        let room = &mut self.nodes[self.node_count..][..LEAF_WIDTH];
        children.compress(mask32x8::from_bitmask(simd, u64::from(nodes))).store_slice(room);
        self.node_count += nodes.count_ones() as usize;
        (node, children, hits & node.leaf_children & is_later)
    }

    /// Finds the next leaves from `first` on whose boxes overlap `bounds`. Returns whether there are any.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn go_on<S: Simd>(&mut self, simd: S, tree: &BoxTree, bounds: &Aabb, first: u32) -> bool {
        self.leaf_count = 0;
        while self.node_count > 0 && self.leaf_count < Self::ROOM {
            let (_, children, leaves) = self.visit(simd, tree, bounds, first);
            self.add(simd, children, leaves);
        }
        self.leaf_count > 0
    }

    /// Adds the leaves whose bits are set in `meant`, out of eight.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn add<S: Simd>(&mut self, simd: S, places: u32x8<S>, meant: u32) {
        let room = &mut self.leaves[self.leaf_count..][..LEAF_WIDTH];
        places.compress(mask32x8::from_bitmask(simd, u64::from(meant))).store_slice(room);
        self.leaf_count += meant.count_ones() as usize;
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn found(&self) -> &[u32] {
        &self.leaves[..self.leaf_count]
    }
}

/// Finds the leaves near each of many consecutive leaves. Groups of leaves share one search: what is near a leaf is among
/// what is near its group, in the same order, unless the group has more leaves near it than fit.
pub(super) struct NearbyLeaves {
    search: LeafSearch,
    /// The leaves that are near the group, and their boxes.
    places: [u32; Self::ROOM + LEAF_WIDTH],
    min: [[f32; Self::ROOM + LEAF_WIDTH]; 3],
    max: [[f32; Self::ROOM + LEAF_WIDTH]; 3],
    count: usize,
    /// Whether these are all of them.
    is_complete: bool,
    /// Index among them at which the search continues.
    next: usize,
}

impl NearbyLeaves {
    const ROOM: usize = 256;

    pub(super) fn new() -> Self {
        Self {
            search: LeafSearch::new(),
            places: [0; Self::ROOM + LEAF_WIDTH],
            min: [[0.0; Self::ROOM + LEAF_WIDTH]; 3],
            max: [[0.0; Self::ROOM + LEAF_WIDTH]; 3],
            count: 0,
            is_complete: false,
            next: 0,
        }
    }

    /// Starts a search for the neighbors of the next leaf, after `passed` of the `leaves` are done. Boxes are grown by
    /// `skin`.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn begin<S: Simd>(
        &mut self,
        simd: S,
        tree: &BoxTree,
        leaves: &[Leaf],
        passed: usize,
        skin: f32,
        first: u32,
    ) {
        if passed.is_multiple_of(LEAVES_TOGETHER) {
            let group = &leaves[passed..leaves.len().min(passed + LEAVES_TOGETHER)];
            let mut bounds = Aabb::EMPTY;
            for leaf in group {
                bounds = bounds.union(&leaf.bounds);
            }
            // Grown only now: an empty box does not grow, and would become NaN.
            self.look_around(simd, tree, &bounds.grown(skin), first);
        }
        self.search.begin(tree);
        self.next = 0;
    }

    /// Finds all leaves from `first` on whose boxes overlap `bounds`, if they fit.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn look_around<S: Simd>(&mut self, simd: S, tree: &BoxTree, bounds: &Aabb, first: u32) {
        self.search.begin(tree);
        self.count = 0;
        while self.search.node_count > 0 {
            let (node, children, leaves) = self.search.visit(simd, tree, bounds, first);
            if leaves == 0 {
                continue;
            }
            if self.count + leaves.count_ones() as usize > Self::ROOM {
                self.is_complete = false;
                return;
            }
            let (mask, room) = (mask32x8::from_bitmask(simd, u64::from(leaves)), self.count..self.count + LEAF_WIDTH);
            children.compress(mask).store_slice(&mut self.places[room.clone()]);
            for axis in 0..3 {
                let min = f32x8::from_slice(simd, &node.boxes.min[axis]);
                min.compress(mask).store_slice(&mut self.min[axis][room.clone()]);
                let max = f32x8::from_slice(simd, &node.boxes.max[axis]);
                max.compress(mask).store_slice(&mut self.max[axis][room.clone()]);
            }
            self.count += leaves.count_ones() as usize;
        }
        self.is_complete = true;
    }

    /// Finds the next leaves from `first` on whose boxes overlap `bounds`. Returns whether there are any.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn go_on<S: Simd>(&mut self, simd: S, tree: &BoxTree, bounds: &Aabb, first: u32) -> bool {
        if !self.is_complete {
            return self.search.go_on(simd, tree, bounds, first);
        }
        self.search.leaf_count = 0;
        while self.next < self.count && self.search.leaf_count < LeafSearch::ROOM {
            let left = self.count - self.next;
            let places = u32x8::from_slice(simd, &self.places[self.next..self.next + LEAF_WIDTH]);
            let there = if left < LEAF_WIDTH { (1 << left) - 1 } else { 0xff };
            let is_later = places.simd_ge(first).to_bitmask() as u32;
            let (min, max) = (corners(simd, &self.min, self.next), corners(simd, &self.max, self.next));
            let hits = overlapping(min, max, bounds);
            let hits = hits & there & is_later;
            self.search.add(simd, places, hits);
            self.next += LEAF_WIDTH;
        }
        self.search.leaf_count > 0
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn found(&self) -> &[u32] {
        self.search.found()
    }
}
