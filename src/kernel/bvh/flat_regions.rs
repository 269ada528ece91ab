//! Regions of a surface so flat that nothing in one is within range of anything else in it, so that a traversal need
//! not compare their leaves with each other.
//!
//! A region cannot cross itself if all its normals lie in a cone of less than 90 degrees and its contour, seen along the
//! axis, does not cross itself (Volino and Magnenat-Thalmann 1994). But it may come as near to itself as it likes. That
//! too is excluded if, seen along the axis,
//!
//! - all altitudes of its triangles are longer than the range, and
//! - every vertex of the contour is farther than the range from every side of the contour that does not end there.
//!
//! **Proof.** Seen along the axis, all triangles are counter-clockwise. So each point is covered as often as the contour
//! winds around it, which is once or not at all, and the region is a planar straight-line graph. The least distance of a
//! vertex and an edge that does not end there is attained in a single face of the graph: what a connecting segment
//! crosses is nearer. If the face is a triangle, the distance is an altitude or a side, which is no shorter than one. If
//! it is outside, both are on the contour. Features without a common vertex are no nearer than that, and in space no
//! nearer than in the plane. Triangles that share a vertex are no candidates.
//!
//! A region is everything below a node of the tree. Its contour depends on the arrangement of the tree alone, and is
//! kept.

mod contour;
mod outline;

use std::ops::Range;

use glam::{DVec3, Vec3};

use self::{contour::Contour, outline::Outline};
use super::{
    leaf_triangles::LeafTriangles,
    tree::{BoxTree, Subtree},
};
use crate::kernel::{
    mesh::{bounds::Aabb, motion::Motion, topology::SurfaceTopology},
    simd::slab::{RANGE_SLACK, ROUNDING},
};

/// Regions are found with so much more range that they hold for this many ticks of the same motion, or at least two.
/// Else they cost more than they save.
const LIFE: f64 = 8.0;
const LEAST_LIFE: f64 = 2.0;

/// The largest range with which regions are found, in mean edges. The altitude of an equilateral triangle is 0.87.
const MOST_RANGE: f64 = 0.5;

/// The least share of leaves in regions that is worth the search. Affects time, never results.
const LEAST_SHARE: f64 = 0.25;

/// After n searches in a row that were not worth it, 2^n ticks pass before the next one. This is the largest n.
const MOST_PATIENCE: u32 = 6;

/// The flat regions of a surface, kept while it moves little.
#[derive(Clone, Debug, Default)]
pub struct FlatRegions {
    /// For each leaf, the first leaf from its own on with which it must be compared. Empty if nothing is known.
    search_from: Vec<u32>,
    /// Nothing in a region is within this of anything else in it.
    range: f64,
    arrangement: u64,
    /// The mean length of the edges when the tree was arranged.
    mean_edge: f64,
    /// For each node, once it has been needed in this arrangement.
    contours: Vec<Option<Contour>>,
    /// The leaf of each triangle.
    leaves: Vec<u32>,
    /// The sums of the normals in the leaves before each leaf, and in all of them.
    normals: Vec<DVec3>,
    outline: Outline,
    /// The number of searches in a row that were not worth it, and of ticks to wait.
    wasted: u32,
    waits: u32,
}

/// A surface at its current positions.
#[derive(Clone, Copy)]
pub struct TreeOfMesh<'a> {
    /// The tree over its triangles.
    pub tree: &'a BoxTree,
    /// The triangles in the leaves of the tree.
    pub triangles: &'a LeafTriangles,
    /// The mesh.
    pub topology: &'a SurfaceTopology,
    /// Its vertices.
    pub positions: &'a [Vec3],
}

impl FlatRegions {
    /// For each leaf, the first leaf from its own on with which it must be compared, for
    /// [`PairCull::search_from`](super::leaf_triangles::PairCull::search_from). Empty unless the regions hold for
    /// `range`.
    #[must_use]
    pub fn search_from(&self, range: f32) -> &[u32] {
        if f64::from(range) <= self.range { &self.search_from } else { &[] }
    }

    /// The number of leaves that are in a region with others.
    #[must_use]
    pub fn leaf_count(&self) -> usize {
        self.search_from.iter().zip(0..).filter(|&(&from, leaf)| from > leaf).count()
    }

    /// Visits the boxes of the regions in `tree`, over which they were found.
    pub fn visit(&self, tree: &BoxTree, mut visit: impl FnMut(&Aabb)) {
        tree.visit_subtrees(&mut |subtree| {
            let is_flat = self.search_from.get(subtree.leaves.start) == Some(&(subtree.leaves.end as u32));
            if is_flat {
                visit(subtree.bounds);
            }
            !is_flat
        });
    }

    /// Forgets the regions.
    pub fn clear(&mut self) {
        self.search_from.clear();
        self.range = 0.0;
    }

    /// Keeps the regions if they still hold for `range` after `motion`, the change of positions since they were found
    /// or kept. Finds them anew if not, unless that has not paid or the motion is unknown.
    pub fn update(&mut self, surface: &TreeOfMesh<'_>, range: f32, motion: &Motion) {
        let nearer = motion.relative(motion);
        self.range -= nearer;
        if self.arrangement == surface.tree.arrangement() && !self.search_from(range).is_empty() {
            return;
        }
        self.clear();
        if self.waits > 0 || nearer.is_infinite() {
            self.waits = self.waits.saturating_sub(1);
            return;
        }
        self.arrange(surface);
        let most = MOST_RANGE * self.mean_edge - f64::from(range);
        let slack = (LIFE * nearer).min(most);
        if slack >= LEAST_LIFE * nearer {
            self.find(surface, (f64::from(range) + slack) as f32);
        }
        let is_wasted = (self.leaf_count() as f64) < LEAST_SHARE * surface.tree.leaf_count() as f64;
        self.wasted = if is_wasted { (self.wasted + 1).min(MOST_PATIENCE) } else { 0 };
        self.waits = (1 << self.wasted) - 1;
        if is_wasted {
            self.clear();
        }
    }

    /// Finds the largest regions in which nothing is within `range`, 0 or more. The triangles in the leaves must be up
    /// to date.
    pub fn find(&mut self, surface: &TreeOfMesh<'_>, range: f32) {
        let &TreeOfMesh { tree, triangles, topology, positions } = surface;
        self.clear();
        let is_whole = |(vertex, &welded): (usize, &u32)| positions[vertex] == positions[welded as usize];
        if !range.is_finite() || topology.is_welded() && !topology.weld().iter().enumerate().all(is_whole) {
            return;
        }
        self.arrange(surface);
        self.normals.clear();
        self.normals.push(DVec3::ZERO);
        for leaf in 0..tree.leaf_count() {
            self.normals.push(self.normals[leaf] + triangles.sum_of_normals(leaf).as_dvec3());
        }
        self.search_from.extend(0..tree.leaf_count() as u32);
        self.range = f64::from(range);
        tree.visit_subtrees(&mut |subtree| {
            let is_flat = self.is_flat(surface, &subtree, range);
            if is_flat {
                self.search_from[subtree.leaves.clone()].fill(subtree.leaves.end as u32);
            }
            !is_flat
        });
    }

    /// Forgets the contours if the tree has been arranged anew.
    fn arrange(&mut self, &TreeOfMesh { tree, topology, positions, .. }: &TreeOfMesh<'_>) {
        if self.arrangement == tree.arrangement() && self.leaves.len() == tree.len() {
            return;
        }
        self.arrangement = tree.arrangement();
        self.mean_edge = topology.mean_edge_length(positions);
        self.contours.clear();
        self.leaves.clear();
        self.leaves.resize(tree.len(), 0);
        for leaf in 0..tree.leaf_count() {
            for &triangle in tree.leaf_items(leaf) {
                self.leaves[triangle as usize] = leaf as u32;
            }
        }
    }

    fn is_flat(&mut self, surface: &TreeOfMesh<'_>, subtree: &Subtree<'_>, range: f32) -> bool {
        let &TreeOfMesh { tree, triangles, topology, positions } = surface;
        let Range { start, end } = subtree.leaves;
        let Some(axis) = (self.normals[end] - self.normals[start]).try_normalize() else { return false };
        let extent = (subtree.bounds.max - subtree.bounds.min).element_sum();
        let range = range * RANGE_SLACK + extent * ROUNDING;
        if !subtree.leaves.clone().all(|leaf| triangles.has_longer_altitudes(leaf, axis.as_vec3(), range)) {
            return false;
        }
        if self.contours.len() <= subtree.node {
            self.contours.resize(subtree.node + 1, None);
        }
        let contour = self.contours[subtree.node]
            .get_or_insert_with(|| Contour::of(tree, topology, &self.leaves, &subtree.leaves));
        self.outline.is_clear(contour, positions, axis, f64::from(range))
    }
}
