//! Refits a tree to its boxes: leaves first, then every node after its children.
//!
//! Everything below a child of the root is contiguous, and is a task of its own. The tasks are the same for any number
//! of threads, and so is every sum.

use fearless_simd::{f32x4, f32x8, prelude::*};
use glam::Vec3;

use super::{Aabb, BoxTree, Boxes, LEAF_WIDTH, Leaf, Node};
use crate::kernel::simd::{
    lanes::columns,
    parallel::{Parallel, Sequential},
    prefetch::prefetch,
};

/// With fewer items than this a second thread does not pay off.
const ITEMS_OF_ONE: usize = 8192;

/// How many leaves ahead to prefetch the boxes of items.
const LEAVES_AHEAD: usize = 4;

impl BoxTree {
    /// Refits the tree to changed boxes without changing its structure.
    ///
    /// # Panics
    /// If `bounds` has another length than the tree was built with.
    pub fn refit(&mut self, bounds: &[Aabb]) {
        self.refit_on(&Sequential, bounds);
    }

    /// Like [`refit`](Self::refit), in tasks that `parallel` may distribute.
    ///
    /// # Panics
    /// If `bounds` has another length than the tree was built with.
    pub fn refit_on(&mut self, parallel: &impl Parallel, bounds: &[Aabb]) {
        assert_eq!(bounds.len(), self.item_count, "a tree is refitted with as many boxes as it was built with");
        let Self { nodes, leaves, item_count, .. } = self;
        let mut area = 0.0;
        if let Some((root, nodes)) = nodes.split_first_mut() {
            let mut areas = [0.0; LEAF_WIDTH];
            parallel.run_tasks(subtrees(root, nodes, leaves, &mut areas), *item_count / ITEMS_OF_ONE, |subtree| {
                dispatch!(simd => subtree.refit(simd, bounds));
            });
            dispatch!(simd => root.refit(simd, [1, 0], nodes, leaves));
            area = areas.iter().sum::<f32>() + root.bounds.half_area();
        }
        let whole = self.bounds().half_area();
        self.cost = if whole > 0.0 { area / whole } else { 0.0 };
        if std::mem::take(&mut self.is_new) {
            self.built_cost = self.cost;
        }
    }
}

/// Everything below a child of the root.
struct Subtree<'a> {
    nodes: &'a mut [Node],
    leaves: &'a mut [Leaf],
    /// The indices of its first node and its first leaf in the tree.
    first: [usize; 2],
    /// Receives the total area of its nodes and leaves.
    area: &'a mut f32,
}

/// The subtrees below the root. `nodes` are the nodes after the root.
fn subtrees<'a>(
    root: &Node,
    mut nodes: &'a mut [Node],
    mut leaves: &'a mut [Leaf],
    areas: &'a mut [f32; LEAF_WIDTH],
) -> impl Iterator<Item = Subtree<'a>> + use<'a> {
    let Node { children, ends, leaf_children, child_count, .. } = *root;
    let is_leaf = move |lane: usize| leaf_children & (1 << lane) != 0;
    let mut first = [1, 0];
    areas.iter_mut().take(child_count as usize).enumerate().map(move |(lane, area)| {
        // Nodes are in the order of the children that they are below.
        let next = (lane + 1..child_count as usize).find(|&next| !is_leaf(next));
        let node_end =
            if is_leaf(lane) { first[0] } else { next.map_or(first[0] + nodes.len(), |next| children[next] as usize) };
        let (own_nodes, later_nodes) = std::mem::take(&mut nodes).split_at_mut(node_end - first[0]);
        let (own_leaves, later_leaves) = std::mem::take(&mut leaves).split_at_mut(ends[lane] as usize - first[1]);
        (nodes, leaves) = (later_nodes, later_leaves);
        let own_first = std::mem::replace(&mut first, [node_end, ends[lane] as usize]);
        Subtree { nodes: own_nodes, leaves: own_leaves, first: own_first, area }
    })
}

impl Subtree<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn refit<S: Simd>(self, simd: S, bounds: &[Aabb]) {
        let mut area = 0.0;
        for place in 0..self.leaves.len() {
            if let Some(later) = self.leaves.get(place + LEAVES_AHEAD) {
                for &item in &later.items {
                    prefetch(bounds, item);
                }
            }
            let leaf = &mut self.leaves[place];
            leaf.refit(simd, bounds);
            area += leaf.bounds.half_area();
        }
        // Children come after their parent, so in reverse order every child is ready before its parent needs it.
        for place in (0..self.nodes.len()).rev() {
            let (nodes, later) = self.nodes.split_at_mut(place + 1);
            let [first_node, first_leaf] = self.first;
            nodes[place].refit(simd, [first_node + place + 1, first_leaf], later, self.leaves);
            area += nodes[place].bounds.half_area();
        }
        *self.area = area;
    }
}

/// Used where there is no box. Overlaps nothing, and does not enlarge the box around all.
static NO_BOX: Aabb = Aabb { min: Vec3::NAN, max: Vec3::NAN };

impl Node {
    /// `nodes` and `leaves` contain the children, and `first` holds the indices of their first elements in the tree.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn refit<S: Simd>(&mut self, simd: S, first: [usize; 2], nodes: &[Node], leaves: &[Leaf]) {
        let mut boxes = [&NO_BOX; LEAF_WIDTH];
        for (lane, bounds) in boxes.iter_mut().enumerate().take(self.child_count as usize) {
            let child = self.children[lane] as usize;
            let is_leaf = self.leaf_children & (1 << lane) != 0;
            *bounds = if is_leaf { &leaves[child - first[1]].bounds } else { &nodes[child - first[0]].bounds };
        }
        self.bounds = self.boxes.set_all(simd, boxes);
    }
}

impl Leaf {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn refit<S: Simd>(&mut self, simd: S, bounds: &[Aabb]) {
        let mut boxes = [&NO_BOX; LEAF_WIDTH];
        for (own, &item) in boxes.iter_mut().zip(&self.items[..self.count as usize]) {
            *own = &bounds[item as usize];
        }
        self.bounds = self.boxes.set_all(simd, boxes);
    }

    /// Copies the boxes of the leaf's items.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn set_boxes<S: Simd>(&mut self, simd: S, items: &[(u32, Aabb)]) {
        let mut boxes = [&NO_BOX; LEAF_WIDTH];
        for (own, (_, bounds)) in boxes.iter_mut().zip(items) {
            *own = bounds;
        }
        self.bounds = self.boxes.set_all(simd, boxes);
    }
}

impl Boxes {
    /// Stores eight boxes. Returns the box around them, without those that are empty or NaN: such a box overlaps
    /// nothing, and must not result in a node that overlaps nothing.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn set_all<S: Simd>(&mut self, simd: S, boxes: [&Aabb; LEAF_WIDTH]) -> Aabb {
        let (mut heads, mut tails) = ([f32x4::splat(simd, 0.0); LEAF_WIDTH], [f32x4::splat(simd, 0.0); LEAF_WIDTH]);
        for lane in 0..LEAF_WIDTH {
            let Aabb { min, max } = boxes[lane];
            heads[lane] = f32x4::load_array(simd, [min.x, min.y, min.z, max.x]);
            tails[lane] = f32x4::load_array(simd, [min.z, max.x, max.y, max.z]);
        }
        let ([min_x, min_y, min_z, max_x], [_, _, max_y, max_z]) = (columns(heads), columns(tails));
        let (min, max) = ([min_x, min_y, min_z], [max_x, max_y, max_z]);
        let is_box = min_x.simd_le(max_x) & min_y.simd_le(max_y) & min_z.simd_le(max_z);
        let (highest, lowest) = (f32x8::splat(simd, f32::INFINITY), f32x8::splat(simd, f32::NEG_INFINITY));
        let mut around = Aabb::EMPTY;
        for axis in 0..3 {
            min[axis].store_slice(&mut self.min[axis]);
            max[axis].store_slice(&mut self.max[axis]);
            around.min[axis] = is_box.select(min[axis], highest).reduce_min();
            around.max[axis] = is_box.select(max[axis], lowest).reduce_max();
        }
        around
    }
}
