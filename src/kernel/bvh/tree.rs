//! A bounding volume hierarchy over boxes, with eight boxes per leaf and eight children per node, in
//! structure-of-arrays form.
//!
//! Built once over a surface's triangles, refitted every tick, and traversed against itself, another tree, or a box. A
//! box is compared with all eight boxes of a node or leaf at once. The same tree holds the triangles of a surface and
//! the surfaces of a world. A traversal visits the leaves of one tree independently of each other, so it can be split
//! anywhere. Submodules build and refit the tree.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the dispatched instruction set")]

mod bounded;

use std::ops::Range;

use arrayvec::ArrayVec;
use fearless_simd::{Level, dispatch, f32x8, mask32x8, prelude::*, u32x8};
use glam::Vec3;

use self::{
    build::Arrangement,
    search::{LeafSearch, NeighborSearch},
};
use super::{
    leaf_triangles::{ClosePairs, Groups, LanePairs, Neighbors, PairCull},
    moved_triangles::Reach,
};
use crate::kernel::{
    mesh::bounds::Aabb,
    simd::{
        lanes::{SetLanes, VectorLanes},
        prefetch::prefetch,
    },
};

mod build;
mod refit;
mod search;

/// Boxes per leaf, and children per node.
pub const LEAF_WIDTH: usize = 8;

/// How many leaves search for their neighbors together.
pub(crate) const LEAVES_TOGETHER: usize = 8;

/// Marks an unused lane of a leaf.
const NO_ITEM: u32 = u32::MAX;

/// Capacity of a traversal stack. A tree of 2²⁸ items is less than ten nodes deep, and on each level all children but
/// one may wait.
const STACK: usize = 128;

/// Eight boxes side by side. Unused ones are NaN, and overlap nothing.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Boxes {
    min: [[f32; LEAF_WIDTH]; 3],
    max: [[f32; LEAF_WIDTH]; 3],
}

impl Boxes {
    const UNUSED: Self = Self { min: [[f32::NAN; LEAF_WIDTH]; 3], max: [[f32::NAN; LEAF_WIDTH]; 3] };

    #[inline(always)]
    fn get(&self, lane: usize) -> Aabb {
        let (min, max) = (&self.min, &self.max);
        Aabb {
            min: Vec3::new(min[0][lane], min[1][lane], min[2][lane]),
            max: Vec3::new(max[0][lane], max[1][lane], max[2][lane]),
        }
    }

    /// One bit for each box that overlaps `bounds`.
    #[inline(always)]
    fn overlapping<S: Simd>(&self, simd: S, bounds: &Aabb) -> u32 {
        overlapping(corners(simd, &self.min, 0), corners(simd, &self.max, 0), bounds)
    }
}

impl Boxes {
    /// One bit for each box that reaches the target of `reach` in the target's frame.
    #[inline(always)]
    fn reaching<S: Simd>(&self, simd: S, reach: &Reach) -> u32 {
        reach.reached_by(simd, corners(simd, &self.min, 0), corners(simd, &self.max, 0))
    }
}

/// One bit for each of eight boxes that overlaps `bounds`.
#[inline(always)]
fn overlapping<S: Simd>(min: VectorLanes<S>, max: VectorLanes<S>, bounds: &Aabb) -> u32 {
    let begin = min.x.simd_le(bounds.max.x) & min.y.simd_le(bounds.max.y) & min.z.simd_le(bounds.max.z);
    let end = max.x.simd_ge(bounds.min.x) & max.y.simd_ge(bounds.min.y) & max.z.simd_ge(bounds.min.z);
    (begin & end).to_bitmask() as u32
}

/// The lower or the upper corners of eight boxes, from index `first` on.
#[inline(always)]
fn corners<S: Simd, const COUNT: usize>(simd: S, [x, y, z]: &[[f32; COUNT]; 3], first: usize) -> VectorLanes<S> {
    let end = first + LEAF_WIDTH;
    VectorLanes {
        x: f32x8::from_slice(simd, &x[first..end]),
        y: f32x8::from_slice(simd, &y[first..end]),
        z: f32x8::from_slice(simd, &z[first..end]),
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    boxes: Boxes,
    /// The box around all children.
    bounds: Aabb,
    /// Indices of nodes, or of leaves where the bit in `leaf_children` is set.
    children: [u32; LEAF_WIDTH],
    /// For each child, the index after the last leaf below it.
    ends: [u32; LEAF_WIDTH],
    leaf_children: u32,
    child_count: u32,
}

#[derive(Clone, Copy, Debug)]
struct Leaf {
    boxes: Boxes,
    bounds: Aabb,
    items: [u32; LEAF_WIDTH],
    count: u32,
}

/// A bounding volume hierarchy over a fixed number of items.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    /// The root first, and children after their parents.
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    item_count: usize,
    /// Total area of the boxes of all nodes and leaves, relative to the root's, when the tree was built.
    built_cost: f32,
    cost: f32,
    /// Whether items have moved to other leaves since the boxes were fitted.
    is_new: bool,
    /// How many times items have moved to other leaves.
    arrangement: u64,
    rebuild: Option<Arrangement>,
}

impl BoxTree {
    /// How much larger the boxes of the nodes are than when the tree was built, relative to the root's. 1 after a
    /// build. A tree that has grown far beyond that is slower to traverse than a new one.
    #[must_use]
    pub fn decay(&self) -> f32 {
        if self.built_cost > 0.0 { self.cost / self.built_cost } else { 1.0 }
    }

    /// The box around everything.
    #[must_use]
    pub fn bounds(&self) -> Aabb {
        self.nodes.first().map_or(Aabb::EMPTY, |root| root.bounds)
    }

    /// Calls `visit` with the level (0 is the root) and the box of every node and leaf, parents before their children.
    pub fn for_each_node(&self, mut visit: impl FnMut(u32, &Aabb)) {
        let mut levels = vec![0; self.nodes.len()];
        for (place, node) in self.nodes.iter().enumerate() {
            visit(levels[place], &node.bounds);
            for lane in 0..node.child_count as usize {
                let child = node.children[lane] as usize;
                if node.leaf_children & (1 << lane) == 0 {
                    levels[child] = levels[place] + 1;
                } else {
                    visit(levels[place] + 1, &self.leaves[child].bounds);
                }
            }
        }
    }

    /// The number of items.
    #[must_use]
    pub fn len(&self) -> usize {
        self.item_count
    }

    /// How many times items have moved to other leaves. 0 for a tree that has never been built.
    pub(crate) fn arrangement(&self) -> u64 {
        self.arrangement
    }

    /// Whether the tree has no items.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.item_count == 0
    }

    /// The number of leaves, into which [`self_pairs_of`](Self::self_pairs_of) and [`pairs_of`](Self::pairs_of) can be
    /// split.
    #[must_use]
    pub fn leaf_count(&self) -> usize {
        self.leaves.len()
    }

    /// The items of a leaf.
    pub(crate) fn leaf_items(&self, leaf: usize) -> &[u32] {
        let Leaf { items, count, .. } = &self.leaves[leaf];
        &items[..*count as usize]
    }

    /// The box around the items of a leaf.
    pub(in crate::kernel) fn leaf_bounds(&self, leaf: usize) -> &Aabb {
        &self.leaves[leaf].bounds
    }

    /// Appends the leaves whose boxes overlap `bounds`, in tree order.
    pub(in crate::kernel) fn leaves_within(&self, bounds: &Aabb, leaves: &mut Vec<u32>) {
        dispatch!(Level::new(), simd => {
            let mut search = LeafSearch::new();
            search.begin(self);
            while search.go_on(simd, self, bounds, 0) {
                leaves.extend_from_slice(search.found());
            }
        });
    }

    /// Calls `visit` with every item whose box overlaps `bounds`, in tree order.
    pub fn query(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        dispatch!(Level::new(), simd => {
            let mut search = LeafSearch::new();
            search.begin(self);
            while search.go_on(simd, self, bounds, 0) {
                for &place in search.found() {
                    let leaf = &self.leaves[place as usize];
                    for lane in SetLanes(leaf.boxes.overlapping(simd, bounds)) {
                        visit(leaf.items[lane]);
                    }
                }
            }
        });
    }

    /// Calls `visit` with the items of every leaf that reaches a box in another frame, in tree order. Does not test the
    /// boxes of the items.
    pub fn visit_reaching(&self, reach: &Reach, mut visit: impl FnMut(&[u32])) {
        let mut stack: ArrayVec<u32, STACK> = ArrayVec::new();
        stack.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(place) = stack.pop() {
            let node = &self.nodes[place as usize];
            let reached = dispatch!(Level::new(), simd => node.boxes.reaching(simd, reach));
            for lane in SetLanes(reached & ((1 << node.child_count) - 1)) {
                if node.leaf_children & (1 << lane) == 0 {
                    stack.push(node.children[lane]);
                } else {
                    visit(self.leaf_items(node.children[lane] as usize));
                }
            }
        }
    }

    /// Appends every pair of items whose boxes overlap, lower item first, in tree order.
    pub fn self_pairs(&self, pairs: &mut Vec<[u32; 2]>) {
        self.self_pairs_of(0..self.leaf_count(), None, pairs);
    }

    /// Like [`self_pairs`](Self::self_pairs), for pairs with one item in `leaves` and the other in the same leaf or a
    /// later one, without the pairs that `cull` drops. Returns the number of pairs before slabs drop any.
    pub fn self_pairs_of(&self, leaves: Range<usize>, cull: Option<&PairCull<'_>>, pairs: &mut Vec<[u32; 2]>) -> usize {
        dispatch!(Level::new(), simd => self.pairs_in_lanes::<true, _>(simd, leaves, self, cull, pairs))
    }

    /// Appends every pair of an item in `leaves` of this tree and an item of `other` whose boxes overlap, in tree
    /// order, without the pairs that `cull` drops. Returns the number of pairs before slabs drop any.
    pub fn pairs_of(
        &self,
        leaves: Range<usize>,
        other: &Self,
        cull: Option<&PairCull<'_>>,
        pairs: &mut Vec<[u32; 2]>,
    ) -> usize {
        dispatch!(Level::new(), simd => self.pairs_in_lanes::<false, _>(simd, leaves, other, cull, pairs))
    }

    /// For a tree against itself (`SELF`), only later leaves and lanes are tested, and the lower item comes first.
    #[inline(always)]
    fn pairs_in_lanes<const SELF: bool, S: Simd>(
        &self,
        simd: S,
        leaves: Range<usize>,
        other_tree: &Self,
        cull: Option<&PairCull<'_>>,
        pairs: &mut Vec<[u32; 2]>,
    ) -> usize {
        let mut count = 0;
        let (mut hits, mut close, mut recent) = (LaneHits::new(), ClosePairs::new(), Recent::new());
        let looks_closer = cull.is_some_and(|cull| !cull.planes_only);
        let mut search = NeighborSearch::new();
        let own = &self.leaves[leaves.clone()];
        for (passed, leaf) in own.iter().enumerate() {
            let place = leaves.start + passed;
            let first = if SELF { place as u32 } else { 0 };
            search.begin(simd, other_tree, own, passed, 0.0, first);
            while search.go_on(simd, other_tree, &leaf.bounds, first) {
                for &other_place in search.found() {
                    let other_place = other_place as usize;
                    let other = &other_tree.leaves[other_place];
                    let neighbors = match cull {
                        Some(cull) => cull.neighbors_between([place, other_place]),
                        None => Neighbors::NONE,
                    };
                    hits.count = 0;
                    for lane in SetLanes(leaf.boxes.overlapping(simd, &other.bounds)) {
                        let later = if SELF && place == other_place { !0u32 << (lane + 1) } else { !0 };
                        let lanes = other.boxes.overlapping(simd, &leaf.boxes.get(lane)) & later;
                        hits.push(simd, lane, lanes & !neighbors.of_lane(simd, lane));
                    }
                    if hits.count == 0 {
                        continue;
                    }
                    count += hits.count;
                    let separation = match cull {
                        Some(cull) if cull.has_slabs() => Some(cull.between([place, other_place])),
                        _ => None,
                    };
                    for (pairs_of_lanes, mut kept) in hits.groups() {
                        let lane_pairs = LanePairs::new(simd, pairs_of_lanes);
                        let [items, others] = lane_pairs.items(simd, &leaf.items, &other.items);
                        let (firsts, seconds) =
                            if SELF { (items.min(others), items.max(others)) } else { (items, others) };
                        if let Some(separation) = &separation {
                            let corners = separation.corners(simd, &lane_pairs);
                            kept &= !separation.separated(simd, &lane_pairs, &corners);
                            if looks_closer {
                                if close.push(simd, separation, &corners, [firsts, seconds], kept) {
                                    recent.take(&mut close, Groups::Complete, pairs);
                                }
                                continue;
                            }
                        }
                        recent.push(simd, firsts, seconds, kept, pairs);
                    }
                }
            }
        }
        recent.take(&mut close, Groups::All, pairs);
        recent.flush(pairs);
        count
    }
}

/// Pairs of lanes of two leaves whose boxes overlap, packed so that slabs can test eight at a time.
struct LaneHits {
    /// Eight times the lane of the first leaf, plus the lane of the second.
    pairs: [[u32; LEAF_WIDTH]; LEAF_WIDTH + 1],
    count: usize,
}

impl LaneHits {
    #[inline(always)]
    fn new() -> Self {
        Self { pairs: [[0; LEAF_WIDTH]; LEAF_WIDTH + 1], count: 0 }
    }

    #[inline(always)]
    fn push<S: Simd>(&mut self, simd: S, lane: usize, lanes: u32) {
        const LANES: [u32; LEAF_WIDTH] = [0, 1, 2, 3, 4, 5, 6, 7];
        let mask = mask32x8::from_bitmask(simd, u64::from(lanes));
        let pairs = (u32x8::from_slice(simd, &LANES) + (LEAF_WIDTH * lane) as u32).compress(mask);
        pairs.store_slice(&mut self.pairs.as_flattened_mut()[self.count..][..LEAF_WIDTH]);
        self.count += lanes.count_ones() as usize;
    }

    /// Groups of eight pairs, with a bit for each pair that exists.
    #[inline(always)]
    fn groups(&self) -> impl Iterator<Item = (&[u32; LEAF_WIDTH], u32)> {
        let groups = self.pairs[..self.count.div_ceil(LEAF_WIDTH)].iter().enumerate();
        groups.map(|(group, pairs)| {
            let left = self.count - group * LEAF_WIDTH;
            (pairs, if left < LEAF_WIDTH { (1 << left) - 1 } else { 0xff })
        })
    }
}

/// A buffer of pairs on their way to a list. Which of eight pairs are kept is unpredictable, so all are written, the
/// kept ones first, and the next ones overwrite the rest.
struct Recent {
    items: [u32; 2 * Self::ROOM],
    count: usize,
}

impl Recent {
    const ROOM: usize = 256;

    fn new() -> Self {
        Self { items: [0; 2 * Self::ROOM], count: 0 }
    }

    #[inline(always)]
    fn push<S: Simd>(&mut self, simd: S, firsts: u32x8<S>, seconds: u32x8<S>, kept: u32, list: &mut Vec<[u32; 2]>) {
        if self.count > Self::ROOM - LEAF_WIDTH {
            self.flush(list);
        }
        let mask = mask32x8::from_bitmask(simd, u64::from(kept));
        let (low, high) = firsts.compress(mask).interleave(seconds.compress(mask));
        let room = &mut self.items[2 * self.count..][..2 * LEAF_WIDTH];
        low.store_slice(&mut room[..LEAF_WIDTH]);
        high.store_slice(&mut room[LEAF_WIDTH..]);
        self.count += kept.count_ones() as usize;
    }

    /// Takes the pairs that no gap separates, of complete groups or of all.
    #[inline(never)]
    fn take(&mut self, close: &mut ClosePairs, groups: Groups, list: &mut Vec<[u32; 2]>) {
        dispatch!(Level::new(), simd => {
            for group in 0..close.count_of(groups) {
                let ([firsts, seconds], kept) = close.group(simd, group);
                self.push(simd, firsts, seconds, kept, list);
            }
        });
        close.forget(groups);
    }

    #[inline(never)]
    fn flush(&mut self, list: &mut Vec<[u32; 2]>) {
        list.extend_from_slice(self.items[..2 * self.count].as_chunks().0);
        self.count = 0;
        let room = list.spare_capacity_mut();
        for place in (0..Self::ROOM as u32).step_by(8) {
            prefetch(room, place);
        }
    }
}
