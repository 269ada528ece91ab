//! The mesh whose triangles the leaves of a tree hold.

use glam::Vec3;

use crate::kernel::mesh::topology::SurfaceTopology;

/// The triangles that leaves hold.
#[derive(Clone, Copy)]
pub struct LeafMesh<'a> {
    /// The mesh.
    pub topology: &'a SurfaceTopology,
    /// Its vertices.
    pub positions: &'a [Vec3],
    /// How far the patch of each triangle may be from it. Empty if the surface is flat.
    pub heights: &'a [f32],
    /// Multiplies the heights, because the positions have been transformed.
    pub scale: f32,
}

impl<'a> LeafMesh<'a> {
    /// A flat surface.
    #[must_use]
    pub fn flat(topology: &'a SurfaceTopology, positions: &'a [Vec3]) -> Self {
        Self { topology, positions, heights: &[], scale: 1.0 }
    }

    /// The largest height of some triangles.
    #[inline]
    pub(super) fn height(&self, triangles: &[u32]) -> f32 {
        if self.heights.is_empty() {
            return 0.0;
        }
        triangles.iter().map(|&triangle| self.heights[triangle as usize]).fold(0.0, f32::max) * self.scale
    }
}
