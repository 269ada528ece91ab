//! A bounding volume tree over boxes, eight to a leaf and eight children to a node, in structure-of-arrays form.
//!
//! Built once over a surface's triangles, refitted every tick, traversed against itself, another tree or a box. A box is
//! compared with the eight of a node or leaf at once. The same tree holds triangles of a surface and surfaces of a world.
//! Split: three times at the median along the longest side of the centroids' bounds, into full leaves. A traversal goes
//! leaf by leaf of one tree, each on its own, so that it can be cut into parts anywhere.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]
#![expect(clippy::manual_map, reason = "closures are not reliably inlined")]

use std::ops::Range;

use arrayvec::ArrayVec;
use fearless_simd::{Level, dispatch, f32x8, mask32x8, prelude::*, u32x8};
use glam::Vec3;

use super::{
    bounds::Aabb,
    leaf_triangles::{LanePairs, PairCull},
};

/// Boxes to a leaf, and children to a node.
pub const LEAF_WIDTH: usize = 8;

/// Marks an unused lane of a leaf.
const NO_ITEM: u32 = u32::MAX;

/// A tree of 2²⁸ items is less than ten nodes deep, and of each level all but one child may wait.
const STACK: usize = 128;

/// Eight boxes side by side. Unused ones are not numbers, and overlap nothing.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Boxes {
    min: [[f32; LEAF_WIDTH]; 3],
    max: [[f32; LEAF_WIDTH]; 3],
}

impl Boxes {
    const UNUSED: Self = Self { min: [[f32::NAN; LEAF_WIDTH]; 3], max: [[f32::NAN; LEAF_WIDTH]; 3] };

    fn set(&mut self, lane: usize, bounds: &Aabb) {
        for axis in 0..3 {
            self.min[axis][lane] = bounds.min[axis];
            self.max[axis][lane] = bounds.max[axis];
        }
    }

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
        let [x, y, z] = &self.min;
        let begin = f32x8::from_slice(simd, x).simd_le(bounds.max.x)
            & f32x8::from_slice(simd, y).simd_le(bounds.max.y)
            & f32x8::from_slice(simd, z).simd_le(bounds.max.z);
        let [x, y, z] = &self.max;
        let end = f32x8::from_slice(simd, x).simd_ge(bounds.min.x)
            & f32x8::from_slice(simd, y).simd_ge(bounds.min.y)
            & f32x8::from_slice(simd, z).simd_ge(bounds.min.z);
        (begin & end).to_bitmask() as u32
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    boxes: Boxes,
    /// The box around all children.
    bounds: Aabb,
    /// Places of nodes, or of leaves where the bit in `leaf_children` is set.
    children: [u32; LEAF_WIDTH],
    /// The leaf after the last one below each child.
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

impl Leaf {
    fn new(items: impl Iterator<Item = u32>) -> Self {
        let mut leaf = Self { boxes: Boxes::UNUSED, bounds: Aabb::EMPTY, items: [NO_ITEM; LEAF_WIDTH], count: 0 };
        for (lane, item) in leaf.items.iter_mut().zip(items) {
            *lane = item;
            leaf.count += 1;
        }
        leaf
    }

    fn refit(&mut self, bounds: &[Aabb]) {
        let items = self.items;
        self.set_boxes(items[..self.count as usize].iter().map(|&item| &bounds[item as usize]));
    }

    #[inline(always)]
    fn set_boxes<'a>(&mut self, items: impl Iterator<Item = &'a Aabb>) {
        self.bounds = Aabb::EMPTY;
        for (lane, item) in items.enumerate() {
            self.boxes.set(lane, item);
            // A box that is empty or not a number overlaps nothing, and must not make a node that overlaps nothing.
            if item.min.cmple(item.max).all() {
                self.bounds = self.bounds.union(item);
            }
        }
    }
}

/// A bounding volume tree over a fixed number of items.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
    /// The root first, and children after their parents.
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    item_count: usize,
    /// Total area of the nodes' boxes relative to the root's when the tree was built.
    built_cost: f32,
    cost: f32,
}

impl BoxTree {
    /// Builds a tree over `bounds`, item `i` having the box `bounds[i]`.
    #[must_use]
    pub fn new(bounds: &[Aabb]) -> Self {
        let mut tree = Self::default();
        tree.rebuild(bounds);
        tree
    }

    /// Builds the tree anew over `bounds`.
    pub fn rebuild(&mut self, bounds: &[Aabb]) {
        self.nodes.clear();
        self.leaves.clear();
        self.item_count = bounds.len();
        if !bounds.is_empty() {
            let mut items: Vec<(Vec3, u32)> = bounds
                .iter()
                .enumerate()
                .map(|(item, bounds)| ((bounds.min + bounds.max) * 0.5, item as u32))
                .collect();
            self.build(&mut items);
            // A tree that is built anew has as many nodes and leaves as before.
            self.nodes.shrink_to_fit();
            self.leaves.shrink_to_fit();
        }
        self.refit(bounds);
        self.built_cost = self.cost;
    }

    /// Appends the node of some items and everything below.
    fn build(&mut self, items: &mut [(Vec3, u32)]) -> u32 {
        let place = self.nodes.len();
        self.nodes.push(Node {
            boxes: Boxes::UNUSED,
            bounds: Aabb::EMPTY,
            children: [0; LEAF_WIDTH],
            ends: [0; LEAF_WIDTH],
            leaf_children: 0,
            child_count: 0,
        });
        let mut parts: ArrayVec<&mut [(Vec3, u32)], LEAF_WIDTH> = ArrayVec::new();
        parts.push(items);
        for _ in 0..LEAF_WIDTH.ilog2() {
            parts = parts.into_iter().flat_map(halves).filter(|part| !part.is_empty()).collect();
        }
        for (lane, part) in parts.into_iter().enumerate() {
            let child = if part.len() <= LEAF_WIDTH {
                self.leaves.push(Leaf::new(part.iter().map(|&(_, item)| item)));
                self.nodes[place].leaf_children |= 1 << lane;
                self.leaves.len() as u32 - 1
            } else {
                self.build(part)
            };
            let end = self.leaves.len() as u32;
            let node = &mut self.nodes[place];
            node.children[lane] = child;
            node.ends[lane] = end;
            node.child_count += 1;
        }
        place as u32
    }

    /// Becomes a list of leaves over some items with their boxes, in their order: of a tree nothing but what
    /// [`pairs_of`](Self::pairs_of) goes through leaf by leaf. Nothing is found in it.
    pub fn collect_leaves(&mut self, items: &[(u32, Aabb)]) {
        self.nodes.clear();
        self.leaves.clear();
        self.item_count = items.len();
        for part in items.chunks(LEAF_WIDTH) {
            let mut leaf = Leaf::new(part.iter().map(|&(item, _)| item));
            leaf.set_boxes(part.iter().map(|(_, bounds)| bounds));
            self.leaves.push(leaf);
        }
    }

    /// Follows moved boxes without changing the tree's structure.
    ///
    /// # Panics
    /// If `bounds` has another length than the tree was built with.
    pub fn refit(&mut self, bounds: &[Aabb]) {
        assert_eq!(bounds.len(), self.item_count, "a tree is refitted with as many boxes as it was built with");
        let mut area = 0.0;
        for leaf in &mut self.leaves {
            leaf.refit(bounds);
            area += leaf.bounds.half_area();
        }
        // Children stand after their parent, so backwards every child is ready before its parent asks.
        for place in (0..self.nodes.len()).rev() {
            let Node { children, leaf_children, child_count, .. } = self.nodes[place];
            let mut whole = Aabb::EMPTY;
            for lane in 0..child_count as usize {
                let child = children[lane] as usize;
                let is_leaf = leaf_children & (1 << lane) != 0;
                let bounds = if is_leaf { self.leaves[child].bounds } else { self.nodes[child].bounds };
                whole = whole.union(&bounds);
                self.nodes[place].boxes.set(lane, &bounds);
            }
            area += whole.half_area();
            self.nodes[place].bounds = whole;
        }
        let whole = self.bounds().half_area();
        self.cost = if whole > 0.0 { area / whole } else { 0.0 };
    }

    /// How much larger the nodes are, relative to the whole, than when the tree was built. 1 after a build; a tree
    /// that has grown far beyond answers more slowly than a new one.
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

    /// How many items the tree holds.
    #[must_use]
    pub fn len(&self) -> usize {
        self.item_count
    }

    /// Whether the tree holds nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.item_count == 0
    }

    /// How many leaves there are: what [`self_pairs_of`](Self::self_pairs_of) and [`pairs_of`](Self::pairs_of) can be cut
    /// into.
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
    pub(super) fn leaf_bounds(&self, leaf: usize) -> &Aabb {
        &self.leaves[leaf].bounds
    }

    /// Calls `visit` with every item whose box overlaps `bounds`, in the tree's order.
    pub fn query(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        dispatch!(Level::new(), simd => {
            self.for_each_leaf(simd, bounds, 0, |place| {
                let leaf = &self.leaves[place];
                for_each_lane(leaf.boxes.overlapping(simd, bounds), |lane| visit(leaf.items[lane]));
            });
        });
    }

    /// Calls `visit` with the items of every leaf that `reaches` accepts the box of, and those of all nodes above it, in the
    /// tree's order. No box of an item is asked about.
    pub fn visit_where(&self, reaches: impl Fn(&Aabb) -> bool, mut visit: impl FnMut(&[u32])) {
        let mut stack: ArrayVec<u32, STACK> = ArrayVec::new();
        stack.extend((!self.nodes.is_empty()).then_some(0));
        while let Some(place) = stack.pop() {
            let node = &self.nodes[place as usize];
            let reached = (0..node.child_count as usize).filter(|&lane| reaches(&node.boxes.get(lane)));
            for lane in reached {
                if node.leaf_children & (1 << lane) == 0 {
                    stack.push(node.children[lane]);
                } else {
                    visit(self.leaf_items(node.children[lane] as usize));
                }
            }
        }
    }

    /// Calls `visit` with every leaf from `first` on whose box overlaps `bounds`, in order.
    #[inline(always)]
    fn for_each_leaf<S: Simd>(&self, simd: S, bounds: &Aabb, first: u32, mut visit: impl FnMut(usize)) {
        if self.nodes.is_empty() {
            return;
        }
        // Leaves of one node are visited together, before or after the subtrees beside them: the order is that of the
        // structure, the same in every traversal.
        let mut stack: ArrayVec<u32, STACK> = ArrayVec::new();
        stack.push(0);
        while let Some(place) = stack.pop() {
            let node = &self.nodes[place as usize];
            let hits = node.boxes.overlapping(simd, bounds);
            for_each_lane(hits & node.leaf_children, |lane| {
                if node.children[lane] >= first {
                    visit(node.children[lane] as usize);
                }
            });
            for_each_lane(hits & !node.leaf_children, |lane| {
                if node.ends[lane] > first {
                    stack.push(node.children[lane]);
                }
            });
        }
    }

    /// Appends every pair of items whose boxes overlap, lower item first, in the tree's order.
    pub fn self_pairs(&self, pairs: &mut Vec<[u32; 2]>) {
        self.self_pairs_of(0..self.leaf_count(), None, pairs);
    }

    /// The same for the pairs with one item in `leaves` and the other there or after, without those that `cull` drops.
    /// Returns how many there are without culling by slabs.
    pub fn self_pairs_of(&self, leaves: Range<usize>, cull: Option<&PairCull<'_>>, pairs: &mut Vec<[u32; 2]>) -> usize {
        dispatch!(Level::new(), simd => self.pairs_in_lanes::<true, _>(simd, leaves, self, cull, pairs))
    }

    /// Appends every pair of an item of this tree and one of `other` whose boxes overlap, in the trees' order.
    pub fn pairs_with(&self, other: &Self, pairs: &mut Vec<[u32; 2]>) {
        self.pairs_of(0..self.leaf_count(), other, None, pairs);
    }

    /// The same for the items in `leaves` of this tree, without those that `cull` drops. Returns how many there are
    /// without culling by slabs.
    pub fn pairs_of(
        &self,
        leaves: Range<usize>,
        other: &Self,
        cull: Option<&PairCull<'_>>,
        pairs: &mut Vec<[u32; 2]>,
    ) -> usize {
        dispatch!(Level::new(), simd => self.pairs_in_lanes::<false, _>(simd, leaves, other, cull, pairs))
    }

    /// Of a tree with itself (`SELF`) only the later leaves and lanes are asked, and the lower item comes first.
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
        let (mut hits, mut recent) = (LaneHits::new(), Recent::new());
        for place in leaves {
            let leaf = &self.leaves[place];
            let first = if SELF { place as u32 } else { 0 };
            other_tree.for_each_leaf(simd, &leaf.bounds, first, |other_place| {
                let other = &other_tree.leaves[other_place];
                let separation = match cull {
                    Some(cull) => Some(cull.between([place, other_place])),
                    None => None,
                };
                hits.count = 0;
                for_each_lane(leaf.boxes.overlapping(simd, &other.bounds), |lane| {
                    let later = if SELF && place == other_place { !0u32 << (lane + 1) } else { !0 };
                    let mut lanes = other.boxes.overlapping(simd, &leaf.boxes.get(lane)) & later;
                    if let Some(separation) = &separation
                        && lanes != 0
                    {
                        lanes &= !separation.neighbors(simd, lane);
                    }
                    hits.push(simd, lane, lanes);
                });
                count += hits.count;
                for (pairs_of_lanes, mut kept) in hits.groups() {
                    let lane_pairs = LanePairs::new(simd, pairs_of_lanes);
                    if let Some(separation) = &separation
                        && separation.has_slabs()
                    {
                        kept &= !separation.separated(simd, &lane_pairs, kept);
                    }
                    let [items, others] = lane_pairs.items(simd, &leaf.items, &other.items);
                    let (firsts, seconds) = if SELF { (items.min(others), items.max(others)) } else { (items, others) };
                    recent.push(simd, firsts, seconds, kept, pairs);
                }
            });
        }
        recent.flush(pairs);
        count
    }
}

/// Pairs of lanes of two leaves whose boxes overlap, side by side: slabs are asked of eight at a time, whichever lanes they
/// are of.
struct LaneHits {
    /// Eight times the lane of the first leaf, and the lane of the second.
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

    /// Eight pairs at a time, with a bit for each that there is.
    #[inline(always)]
    fn groups(&self) -> impl Iterator<Item = (&[u32; LEAF_WIDTH], u32)> {
        let groups = self.pairs[..self.count.div_ceil(LEAF_WIDTH)].iter().enumerate();
        groups.map(|(group, pairs)| {
            let left = self.count - group * LEAF_WIDTH;
            (pairs, if left < LEAF_WIDTH { (1 << left) - 1 } else { 0xff })
        })
    }
}

/// Pairs on their way to a list. Which of eight are kept is hard to foresee: so all are written, those that are kept
/// first, and the next ones over the others.
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

    #[inline(never)]
    fn flush(&mut self, list: &mut Vec<[u32; 2]>) {
        list.extend_from_slice(self.items[..2 * self.count].as_chunks().0);
        self.count = 0;
    }
}

/// Both halves of some items, the first of whole leaves, so that at most one leaf of the tree is not full; all of
/// them and nothing where one leaf holds them.
fn halves(items: &mut [(Vec3, u32)]) -> [&mut [(Vec3, u32)]; 2] {
    if items.len() <= LEAF_WIDTH {
        return [items, &mut []];
    }
    let spread = Aabb::from_points(items.iter().map(|&(center, _)| center));
    let size = spread.max - spread.min;
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    let middle = items.len().div_ceil(LEAF_WIDTH).div_ceil(2) * LEAF_WIDTH;
    items.select_nth_unstable_by(middle, |(center, item), (other_center, other_item)| {
        center[axis].total_cmp(&other_center[axis]).then(item.cmp(other_item))
    });
    items.split_at_mut(middle).into()
}

#[inline(always)]
fn for_each_lane(mut lanes: u32, mut visit: impl FnMut(usize)) {
    while lanes != 0 {
        visit(lanes.trailing_zeros() as usize);
        lanes &= lanes - 1;
    }
}
