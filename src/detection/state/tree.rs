//! The tree over the triangles of a surface.

use core::time::Duration;
use std::sync::Arc;

use crate::{
    detection::state::bounds::TriangleBounds,
    kernel::{
        bvh::{flat_regions::FlatRegions, leaf_triangles::LeafTriangles, tree::BoxTree},
        mesh::{bounds::Aabb, topology::SurfaceTopology},
    },
};

/// The tree over a surface's triangles, and the mesh that it was built for.
#[derive(Default)]
pub(in crate::detection) struct SurfaceTree {
    pub(in crate::detection) tree: BoxTree,
    pub(in crate::detection) triangles: LeafTriangles,
    /// Where a traversal against itself may leave out leaves.
    pub(in crate::detection) flat_regions: FlatRegions,
    /// The version of the boxes at which they were last found or kept.
    pub(in crate::detection) regions_version: u64,
    /// The version of the boxes that the triangles in the leaves were last updated to.
    pub(in crate::detection) triangles_version: u64,
    /// The tree's arrangement when the vertices of those triangles were last stored.
    pub(in crate::detection) named_arrangement: u64,
    pub(in crate::detection) topology: Option<Arc<SurfaceTopology>>,
    /// The version of the boxes that the tree was last refitted to.
    pub(in crate::detection) version: u64,
    /// What was done to it in this detection.
    pub(in crate::detection) outcome: Outcome,
}

impl SurfaceTree {
    /// The tree over the surface's boxes, in the surface's own frame.
    pub(in crate::detection) fn tree(&self) -> &BoxTree {
        &self.tree
    }

    /// For each leaf, the first leaf from its own on with which a traversal against the surface itself must compare it,
    /// for pairs within `range`. Empty if all must be compared.
    pub(in crate::detection) fn search_from(&self, range: f32) -> &[u32] {
        if self.regions_version == self.version { self.flat_regions.search_from(range) } else { &[] }
    }

    /// Visits the boxes of the regions that such a traversal leaves out in this tick.
    pub(in crate::detection) fn visit_flat_regions(&self, visit: impl FnMut(&Aabb)) {
        if self.regions_version == self.version {
            self.flat_regions.visit(&self.tree, visit);
        }
    }

    /// Whether the tree matches the surface's current boxes.
    pub(in crate::detection) fn matches_boxes(&self, bounds: &TriangleBounds) -> bool {
        self.version == bounds.version() && self.tree.len() == bounds.triangle_count()
    }
}

/// What was done to a surface's tree.
#[derive(Clone, Copy, Default)]
pub(in crate::detection) struct Outcome {
    pub(in crate::detection) is_rebuilt: bool,
    pub(in crate::detection) first_build: Duration,
}
