//! The tree over the triangles of a surface.

use std::{sync::Arc, time::Duration};

use crate::{
    detection::state::bounds::TriangleBounds,
    kernel::{
        bvh::{leaf_triangles::LeafTriangles, tree::BoxTree},
        mesh::topology::SurfaceTopology,
    },
};

/// The tree over a surface's triangles, and the mesh that it was built for.
#[derive(Default)]
pub(in crate::detection) struct SurfaceTree {
    pub(in crate::detection) tree: BoxTree,
    pub(in crate::detection) triangles: LeafTriangles,
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
