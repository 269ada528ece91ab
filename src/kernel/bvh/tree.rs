//! A bounding volume hierarchy over boxes, with eight boxes per leaf and eight children per node, in
//! structure-of-arrays form.
//!
//! Built once over a surface's triangles, refitted every tick, and traversed against itself, another tree, or a box. A
//! box is compared with all eight boxes of a node or leaf at once. The same tree holds the triangles of a surface and
//! the surfaces of a world. A traversal visits the leaves of one tree independently of each other, so it can be split
//! anywhere. Submodules build and refit the tree.

mod bounded;
mod pairs;

use std::ops::Range;

use arrayvec::ArrayVec;
use fearless_simd::{f32x8, prelude::*};
use glam::Vec3;

use self::{build::Arrangement, search::LeafSearch};
use super::moved_triangles::Reach;
use crate::kernel::{
    mesh::bounds::Aabb,
    simd::lanes::{SetLanes, VectorLanes},
};

mod build;
mod in_order;
mod nearest;
mod ray;
mod refit;
mod search;

pub use self::ray::Sweep;

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

    #[cfg_attr(not(unoptimized), inline(always))]
    fn get(&self, lane: usize) -> Aabb {
        let (min, max) = (&self.min, &self.max);
        Aabb {
            min: Vec3::new(min[0][lane], min[1][lane], min[2][lane]),
            max: Vec3::new(max[0][lane], max[1][lane], max[2][lane]),
        }
    }

    /// One bit for each box that overlaps `bounds`.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn overlapping<S: Simd>(&self, simd: S, bounds: &Aabb) -> u32 {
        overlapping(corners(simd, &self.min, 0), corners(simd, &self.max, 0), bounds)
    }
}

impl Boxes {
    /// One bit for each box that reaches the target of `reach` in the target's frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn reaching<S: Simd>(&self, simd: S, reach: &Reach) -> u32 {
        reach.reached_by(simd, corners(simd, &self.min, 0), corners(simd, &self.max, 0))
    }
}

/// One bit for each of eight boxes that overlaps `bounds`.
#[cfg_attr(not(unoptimized), inline(always))]
fn overlapping<S: Simd>(min: VectorLanes<S>, max: VectorLanes<S>, bounds: &Aabb) -> u32 {
    let begin = min.x.simd_le(bounds.max.x) & min.y.simd_le(bounds.max.y) & min.z.simd_le(bounds.max.z);
    let end = max.x.simd_ge(bounds.min.x) & max.y.simd_ge(bounds.min.y) & max.z.simd_ge(bounds.min.z);
    (begin & end).to_bitmask() as u32
}

/// The lower or the upper corners of eight boxes, from index `first` on.
#[cfg_attr(not(unoptimized), inline(always))]
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

/// Everything below a node.
pub(super) struct Subtree<'a> {
    pub(super) node: usize,
    pub(super) leaves: Range<usize>,
    /// The box around it.
    pub(super) bounds: &'a Aabb,
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

    /// Visits what is below each node, starting with the root. `visit` returns whether to go on with its children.
    pub(super) fn visit_subtrees(&self, visit: &mut dyn FnMut(Subtree<'_>) -> bool) {
        let mut open: ArrayVec<(u32, Range<usize>), STACK> = ArrayVec::new();
        open.extend((!self.nodes.is_empty()).then_some((0, 0..self.leaves.len())));
        while let Some((place, leaves)) = open.pop() {
            let node = &self.nodes[place as usize];
            let mut start = leaves.start;
            if !visit(Subtree { node: place as usize, leaves, bounds: &node.bounds }) {
                continue;
            }
            for lane in 0..node.child_count as usize {
                let own = start..node.ends[lane] as usize;
                start = own.end;
                if node.leaf_children & (1 << lane) == 0 {
                    open.push((node.children[lane], own));
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
    ///
    /// # Panics
    /// If there is no such leaf.
    #[must_use]
    pub fn leaf_items(&self, leaf: usize) -> &[u32] {
        let Leaf { items, count, .. } = &self.leaves[leaf];
        &items[..*count as usize]
    }

    /// The box around the items of a leaf.
    ///
    /// # Panics
    /// If there is no such leaf.
    #[must_use]
    pub fn leaf_bounds(&self, leaf: usize) -> &Aabb {
        &self.leaves[leaf].bounds
    }

    /// Appends the leaves whose boxes overlap `bounds`, in tree order.
    pub(in crate::kernel) fn leaves_within(&self, bounds: &Aabb, leaves: &mut Vec<u32>) {
        dispatch!(simd => {
            let mut search = LeafSearch::new();
            search.begin(self);
            while search.go_on(simd, self, bounds, 0) {
                leaves.extend_from_slice(search.found());
            }
        });
    }

    /// Calls `visit` with every item whose box overlaps `bounds`, in tree order.
    pub fn query(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        dispatch!(simd => {
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
            let reached = dispatch!(simd => node.boxes.reaching(simd, reach));
            for lane in SetLanes(reached & ((1 << node.child_count) - 1)) {
                if node.leaf_children & (1 << lane) == 0 {
                    stack.push(node.children[lane]);
                } else {
                    visit(self.leaf_items(node.children[lane] as usize));
                }
            }
        }
    }
}
