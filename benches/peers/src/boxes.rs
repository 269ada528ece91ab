//! obvhs finds boxes for a ray, a point or a box; it has no traversal of a tree against itself. So every triangle asks with
//! its box, which is what the crate offers; and, since its nodes are public, a traversal in pairs over them, written here,
//! says what its trees are good for.

use std::time::Duration;

use circumsphere_support::recording::Recording;
use glam::{UVec2, Vec3A};
use obvhs::{
    Boundable, BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, builder::build_bvh2},
    cwbvh::{CwBvh, builder::build_cwbvh},
};

use super::{Counts, Peer, Row, timed};

/// A box to build a tree of.
struct Leaf(Aabb);

impl Boundable for Leaf {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// A tree of two children a node that is built once and refitted, and one of eight that is built anew in every tick.
pub struct Obvhs {
    triangles: Vec<[u32; 3]>,
    growth: f32,
    tree: Bvh2,
    leaves: Vec<Leaf>,
}

/// One triangle a leaf, so that leaves can be moved one by one.
fn settings() -> BvhBuildParams {
    BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::medium_build() }
}

impl Obvhs {
    pub fn new(recording: &Recording, growth: f32) -> Self {
        let mut peer =
            Self { triangles: recording.triangles.clone(), growth, tree: Bvh2::default(), leaves: Vec::new() };
        peer.measure_boxes(&recording.frames[1]);
        peer.tree = build_bvh2(&peer.leaves, settings(), &mut Duration::default());
        peer.tree.reorder_in_stack_traversal_order();
        peer.tree.update_primitives_to_nodes();
        peer
    }

    fn measure_boxes(&mut self, positions: &[[f32; 3]]) {
        let growth = self.growth;
        self.leaves.clear();
        self.leaves.extend(self.triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
            let low: [f32; 3] = std::array::from_fn(|axis| a[axis].min(b[axis]).min(c[axis]) - growth);
            let high: [f32; 3] = std::array::from_fn(|axis| a[axis].max(b[axis]).max(c[axis]) + growth);
            Leaf(Aabb::new(low.into(), high.into()))
        }));
    }

    fn refit(&mut self) {
        for (leaf, &node) in self.leaves.iter().zip(&self.tree.primitives_to_nodes) {
            self.tree.nodes[node as usize].set_aabb(leaf.0);
        }
        self.tree.refit_all();
    }

    fn count_by_box_queries(&self) -> u64 {
        let mut count = 0;
        for (number, leaf) in self.leaves.iter().enumerate() {
            self.tree.aabb_traverse(leaf.0, |tree, node| {
                let item = tree.primitive_indices[tree.nodes[node as usize].first_index as usize];
                count += u64::from(item as usize > number);
                true
            });
        }
        count
    }

    fn count_by_pairs_of_nodes(&self) -> u64 {
        let nodes = &self.tree.nodes;
        let mut count = 0;
        let mut crossings: Vec<[u32; 2]> = Vec::with_capacity(256);
        for node in nodes.iter().filter(|node| !node.is_leaf()) {
            crossings.push([node.first_index, node.first_index + 1]);
            while let Some([first, second]) = crossings.pop() {
                let (a, b) = (&nodes[first as usize], &nodes[second as usize]);
                if !a.aabb().intersect_aabb(b.aabb()) {
                    continue;
                }
                // The larger one is opened, unless it is a leaf.
                let opens_first = !a.is_leaf() && (b.is_leaf() || a.aabb().half_area() >= b.aabb().half_area());
                if a.is_leaf() && b.is_leaf() {
                    count += 1;
                } else if opens_first {
                    crossings.extend([[a.first_index, second], [a.first_index + 1, second]]);
                } else {
                    crossings.extend([[first, b.first_index], [first, b.first_index + 1]]);
                }
            }
        }
        count
    }

    /// Its boxes are rounded outward to eight bits, so every hit is compared with the triangle's own box.
    fn count_in_wide_tree(&self, tree: &CwBvh) -> u64 {
        let mut count = 0;
        let mut node;
        for (number, leaf) in self.leaves.iter().enumerate() {
            let mut state = tree.new_traversal(Vec3A::ONE);
            obvhs::traverse!(tree, node, state, node.intersect_aabb(&leaf.0, state.oct_inv4), {
                let item = tree.primitive_indices[state.primitive_id as usize] as usize;
                count += u64::from(item > number && self.leaves[item].0.intersect_aabb(&leaf.0));
            });
        }
        count
    }
}

impl Peer for Obvhs {
    fn name(&self) -> String {
        "obvhs".to_owned()
    }

    fn run(&mut self, before: &[[f32; 3]], now: &[[f32; 3]]) -> Vec<Row> {
        self.measure_boxes(before);
        self.refit();

        let (refit, ()) = timed(|| {
            self.measure_boxes(now);
            self.refit();
        });
        let (query, queried) = timed(|| self.count_by_box_queries());
        let (pairs, paired) = timed(|| self.count_by_pairs_of_nodes());
        let (build, tree) = timed(|| build_cwbvh(&self.leaves, settings(), &mut Duration::default()));
        let (wide, widely) = timed(|| self.count_in_wide_tree(&tree));
        let row = |what, is_whole, duration, count| Row {
            what,
            is_whole,
            duration,
            counts: Counts { box_pairs: count, contacts: None },
        };
        vec![
            row("Bvh2 update of leaves + refit", false, refit, None),
            row("Bvh2, a box query a triangle, counting", true, query, Some(queried)),
            row("Bvh2, our traversal in pairs over its nodes, counting", true, pairs, Some(paired)),
            row("CwBvh build", false, build, None),
            row("CwBvh, a box query a triangle, counting", true, wide, Some(widely)),
        ]
    }
}
