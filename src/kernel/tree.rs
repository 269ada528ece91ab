//! A bounding volume tree over boxes, with eight boxes to a leaf in structure-of-arrays form.
//!
//! Built once over a surface's triangles, refitted every tick, traversed against itself, another tree or a box. One
//! node box test decides about eight triangles, one leaf test compares a box with eight others lane by lane. The same
//! tree holds triangles of a surface and surfaces of a world. Split: at the median along the longest side of the
//! centroids' bounds, into full leaves.

use glam::Vec3;

use super::bounds::Aabb;

/// Boxes to a leaf.
pub const LEAF_WIDTH: usize = 8;

/// Marks an unused lane of a leaf.
const NO_ITEM: u32 = u32::MAX;

/// Below this depth of recursion every tree of 2²⁸ items ends; stacks are sized by it.
const STACK_RESERVE: usize = 128;

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Aabb,
    /// Inner node: the place of the second child; the first follows its parent. Leaf: the leaf's number.
    link: u32,
    is_leaf: bool,
}

#[derive(Clone, Copy, Debug)]
struct Leaf {
    min: [[f32; LEAF_WIDTH]; 3],
    max: [[f32; LEAF_WIDTH]; 3],
    items: [u32; LEAF_WIDTH],
    count: u32,
}

impl Leaf {
    fn new(items: &[u32]) -> Self {
        let mut leaf = Self {
            min: [[f32::INFINITY; LEAF_WIDTH]; 3],
            max: [[f32::NEG_INFINITY; LEAF_WIDTH]; 3],
            items: [NO_ITEM; LEAF_WIDTH],
            count: items.len() as u32,
        };
        leaf.items[..items.len()].copy_from_slice(items);
        leaf
    }

    fn refit(&mut self, bounds: &[Aabb]) -> Aabb {
        let mut whole = Aabb::EMPTY;
        for lane in 0..self.count as usize {
            let item = &bounds[self.items[lane] as usize];
            for axis in 0..3 {
                self.min[axis][lane] = item.min[axis];
                self.max[axis][lane] = item.max[axis];
            }
            // A box that is empty or not a number overlaps nothing, and must not make a node that overlaps nothing.
            if item.min.cmple(item.max).all() {
                whole = whole.union(item);
            }
        }
        whole
    }

    fn lane(&self, lane: usize) -> Aabb {
        let corner = |side: &[[f32; LEAF_WIDTH]; 3]| Vec3::new(side[0][lane], side[1][lane], side[2][lane]);
        Aabb { min: corner(&self.min), max: corner(&self.max) }
    }

    /// One bit for each lane that overlaps `bounds`.
    #[inline]
    fn overlapping_lanes(&self, bounds: &Aabb) -> u32 {
        let mut hits = [true; LEAF_WIDTH];
        for axis in 0..3 {
            let (low, high) = (bounds.min[axis], bounds.max[axis]);
            for lane in 0..LEAF_WIDTH {
                hits[lane] &= (self.min[axis][lane] <= high) & (self.max[axis][lane] >= low);
            }
        }
        // Unused lanes are empty, yet a box that reaches to infinity would overlap them.
        let used = (1u32 << self.count) - 1;
        hits.iter().enumerate().fold(0, |bits, (lane, &hit)| bits | (u32::from(hit) << lane)) & used
    }
}

/// A bounding volume tree over a fixed number of items.
#[derive(Clone, Debug, Default)]
pub struct BoxTree {
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
        }
        self.refit(bounds);
        self.built_cost = self.cost;
    }

    fn build(&mut self, items: &mut [(Vec3, u32)]) {
        let node = self.nodes.len();
        self.nodes.push(Node { bounds: Aabb::EMPTY, link: 0, is_leaf: items.len() <= LEAF_WIDTH });
        if items.len() <= LEAF_WIDTH {
            let mut lanes = [NO_ITEM; LEAF_WIDTH];
            for (lane, &(_, item)) in lanes.iter_mut().zip(items.iter()) {
                *lane = item;
            }
            self.nodes[node].link = self.leaves.len() as u32;
            self.leaves.push(Leaf::new(&lanes[..items.len()]));
            return;
        }
        let spread = Aabb::from_points(items.iter().map(|&(center, _)| center));
        let size = spread.max - spread.min;
        let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
        // Whole leaves to the left, so that at most one leaf of the tree is not full.
        let middle = items.len().div_ceil(LEAF_WIDTH).div_ceil(2) * LEAF_WIDTH;
        items.select_nth_unstable_by(middle, |(center, item), (other_center, other_item)| {
            center[axis].total_cmp(&other_center[axis]).then(item.cmp(other_item))
        });
        let (left, right) = items.split_at_mut(middle);
        self.build(left);
        self.nodes[node].link = self.nodes.len() as u32;
        self.build(right);
    }

    /// Takes over the structure of another tree, and keeps its own memory; [`refit`](Self::refit) is to follow.
    pub fn copy_structure(&mut self, other: &Self) {
        self.nodes.clone_from(&other.nodes);
        self.leaves.clone_from(&other.leaves);
        self.item_count = other.item_count;
        self.built_cost = other.built_cost;
        self.cost = other.cost;
    }

    /// Follows moved boxes without changing the tree's structure.
    ///
    /// # Panics
    /// If `bounds` has another length than the tree was built with.
    pub fn refit(&mut self, bounds: &[Aabb]) {
        assert_eq!(bounds.len(), self.item_count, "a tree is refitted with as many boxes as it was built with");
        let mut area = 0.0;
        // Children stand after their parent, so backwards every child is ready before its parent asks.
        for node in (0..self.nodes.len()).rev() {
            let Node { link, is_leaf, .. } = self.nodes[node];
            let bounds = if is_leaf {
                self.leaves[link as usize].refit(bounds)
            } else {
                self.nodes[node + 1].bounds.union(&self.nodes[link as usize].bounds)
            };
            area += bounds.half_area();
            self.nodes[node].bounds = bounds;
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

    /// Calls `visit` with the level (0 is the root) and the box of every node, parents before their children.
    pub fn for_each_node(&self, mut visit: impl FnMut(u32, &Aabb)) {
        let mut levels = vec![0; self.nodes.len()];
        for (place, node) in self.nodes.iter().enumerate() {
            visit(levels[place], &node.bounds);
            if !node.is_leaf {
                for child in [place + 1, node.link as usize] {
                    levels[child] = levels[place] + 1;
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

    /// Calls `visit` with every item whose box overlaps `bounds`, in the tree's order.
    pub fn query(&self, bounds: &Aabb, mut visit: impl FnMut(u32)) {
        let mut stack = Vec::with_capacity(STACK_RESERVE);
        if !self.nodes.is_empty() {
            stack.push(0u32);
        }
        while let Some(place) = stack.pop() {
            let node = &self.nodes[place as usize];
            if !node.bounds.overlaps(bounds) {
                continue;
            }
            if node.is_leaf {
                let leaf = &self.leaves[node.link as usize];
                for_each_lane(leaf.overlapping_lanes(bounds), |lane| visit(leaf.items[lane]));
            } else {
                stack.extend([node.link, place + 1]);
            }
        }
    }

    /// Appends every pair of items whose boxes overlap, lower item first, in the tree's order.
    pub fn self_pairs(&self, pairs: &mut Vec<[u32; 2]>) {
        self.self_pairs_where(|_| true, pairs);
    }

    /// The same for the pairs that pass `keep`; the others take no memory.
    pub fn self_pairs_where(&self, keep: impl Fn([u32; 2]) -> bool, pairs: &mut Vec<[u32; 2]>) {
        let mut visit = |first: u32, second: u32| {
            let pair = [first.min(second), first.max(second)];
            if keep(pair) {
                pairs.push(pair);
            }
        };
        let mut crossings = Vec::with_capacity(STACK_RESERVE);
        for (place, node) in self.nodes.iter().enumerate() {
            if node.is_leaf {
                let leaf = &self.leaves[node.link as usize];
                for lane in 0..leaf.count as usize {
                    let later = leaf.overlapping_lanes(&leaf.lane(lane)) & (!0u32 << (lane + 1));
                    for_each_lane(later, |other| visit(leaf.items[lane], leaf.items[other]));
                }
            } else {
                crossings.push([place as u32 + 1, node.link]);
                self.cross(self, &mut crossings, &mut visit);
            }
        }
    }

    /// Appends every pair of an item of this tree and one of `other` whose boxes overlap, in the trees' order.
    pub fn pairs_with(&self, other: &Self, pairs: &mut Vec<[u32; 2]>) {
        if self.nodes.is_empty() || other.nodes.is_empty() {
            return;
        }
        self.cross(other, &mut vec![[0, 0]], &mut |first, second| pairs.push([first, second]));
    }

    fn cross(&self, other: &Self, crossings: &mut Vec<[u32; 2]>, visit: &mut impl FnMut(u32, u32)) {
        while let Some([first, second]) = crossings.pop() {
            let (a, b) = (&self.nodes[first as usize], &other.nodes[second as usize]);
            if !a.bounds.overlaps(&b.bounds) {
                continue;
            }
            match (a.is_leaf, b.is_leaf) {
                (true, true) => {
                    let (leaf, other_leaf) = (&self.leaves[a.link as usize], &other.leaves[b.link as usize]);
                    for_each_lane(leaf.overlapping_lanes(&b.bounds), |lane| {
                        for_each_lane(other_leaf.overlapping_lanes(&leaf.lane(lane)), |other_lane| {
                            visit(leaf.items[lane], other_leaf.items[other_lane]);
                        });
                    });
                }
                (false, true) => crossings.extend([[a.link, second], [first + 1, second]]),
                (true, false) => crossings.extend([[first, b.link], [first, second + 1]]),
                (false, false) => {
                    if a.bounds.half_area() >= b.bounds.half_area() {
                        crossings.extend([[a.link, second], [first + 1, second]]);
                    } else {
                        crossings.extend([[first, b.link], [first, second + 1]]);
                    }
                }
            }
        }
    }
}

#[inline]
fn for_each_lane(mut lanes: u32, mut visit: impl FnMut(usize)) {
    while lanes != 0 {
        visit(lanes.trailing_zeros() as usize);
        lanes &= lanes - 1;
    }
}
