//! A tree follows its boxes: leaves first, then every node after its children.
//!
//! What is below each child of the root stands together, and is a task of its own. Those are the same for any number of
//! threads, and so is every sum.

use super::{Aabb, BoxTree, LEAF_WIDTH, Leaf, Node};
use crate::kernel::share::{OneByOne, Share};

/// Fewer items than these are not worth a second thread.
const ITEMS_OF_ONE: usize = 8192;

impl BoxTree {
    /// Follows moved boxes without changing the tree's structure.
    ///
    /// # Panics
    /// If `bounds` has another length than the tree was built with.
    pub fn refit(&mut self, bounds: &[Aabb]) {
        self.refit_on(&OneByOne, bounds);
    }

    /// The same in tasks that may be shared.
    ///
    /// # Panics
    /// If `bounds` has another length than the tree was built with.
    pub fn refit_on(&mut self, share: &impl Share, bounds: &[Aabb]) {
        assert_eq!(bounds.len(), self.item_count, "a tree is refitted with as many boxes as it was built with");
        let Self { nodes, leaves, item_count, .. } = self;
        let mut area = 0.0;
        if let Some((root, nodes)) = nodes.split_first_mut() {
            let mut areas = [0.0; LEAF_WIDTH];
            share.hand_out(subtrees(root, nodes, leaves, &mut areas), *item_count / ITEMS_OF_ONE, |subtree| {
                subtree.refit(bounds);
            });
            root.refit([1, 0], nodes, leaves);
            area = areas.iter().sum::<f32>() + root.bounds.half_area();
        }
        let whole = self.bounds().half_area();
        self.cost = if whole > 0.0 { area / whole } else { 0.0 };
        if std::mem::take(&mut self.is_new) {
            self.built_cost = self.cost;
        }
    }
}

/// What is below a child of the root.
struct Subtree<'a> {
    nodes: &'a mut [Node],
    leaves: &'a mut [Leaf],
    /// The places of the first node and the first leaf in the tree.
    first: [usize; 2],
    /// The sum over nodes and leaves is left here.
    area: &'a mut f32,
}

/// The subtrees below the root, of which `nodes` are those after it.
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
        // Nodes come in the order of the children that they are below.
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
    fn refit(self, bounds: &[Aabb]) {
        let mut area = 0.0;
        for leaf in &mut *self.leaves {
            leaf.refit(bounds);
            area += leaf.bounds.half_area();
        }
        // Children stand after their parent, so backwards every child is ready before its parent asks.
        for place in (0..self.nodes.len()).rev() {
            let (nodes, later) = self.nodes.split_at_mut(place + 1);
            let [first_node, first_leaf] = self.first;
            nodes[place].refit([first_node + place + 1, first_leaf], later, self.leaves);
            area += nodes[place].bounds.half_area();
        }
        *self.area = area;
    }
}

impl Node {
    /// `nodes` and `leaves` hold its children; `first` are the places of the first ones in the tree.
    fn refit(&mut self, first: [usize; 2], nodes: &[Node], leaves: &[Leaf]) {
        self.bounds = Aabb::EMPTY;
        for lane in 0..self.child_count as usize {
            let child = self.children[lane] as usize;
            let is_leaf = self.leaf_children & (1 << lane) != 0;
            let bounds = if is_leaf { leaves[child - first[1]].bounds } else { nodes[child - first[0]].bounds };
            self.bounds = self.bounds.union(&bounds);
            self.boxes.set(lane, &bounds);
        }
    }
}

impl Leaf {
    fn refit(&mut self, bounds: &[Aabb]) {
        let items = self.items;
        self.set_boxes(items[..self.count as usize].iter().map(|&item| &bounds[item as usize]));
    }

    #[expect(clippy::inline_always, reason = "a leaf is fitted in one loop")]
    #[inline(always)]
    pub(super) fn set_boxes<'a>(&mut self, items: impl Iterator<Item = &'a Aabb>) {
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
