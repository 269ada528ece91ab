//! All that the exact stage asks of a triangle, one row a triangle: what is side by side in memory is read at once.
//!
//! A triangle is in a dozen pairs, and each pair needs its corners, which lie in as many places, and the names of its
//! vertices and edges. Written and read by the exact stage.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use glam::{DVec3, Vec3};

use super::{
    exact::Feature,
    ids::{EdgeId, TriangleId},
    prefetch::{Prefetch, prefetch},
    surroundings::Surroundings,
    topology::SurfaceTopology,
};

/// One triangle, in a line of the cache.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct CornerRow {
    /// In the surface's own frame, axis by axis.
    pub(super) corners: [[f32; 3]; 3],
    vertices: [u32; 3],
    edges: [u32; 3],
    pub(super) surroundings: Surroundings,
}

impl CornerRow {
    pub(super) const EMPTY: Self =
        Self { corners: [[0.0; 3]; 3], vertices: [0; 3], edges: [0; 3], surroundings: Surroundings::NONE };

    /// The row of a triangle of a surface whose vertices are, in its own frame, at `positions`.
    #[inline(always)]
    pub(super) fn new(topology: &SurfaceTopology, positions: &[Vec3], triangle: u32) -> Self {
        let vertices = topology.triangles()[triangle as usize];
        Self {
            corners: vertices.map(|vertex| positions[vertex as usize].to_array()),
            vertices,
            edges: topology.triangle_edges()[triangle as usize],
            surroundings: topology.surroundings(TriangleId(triangle)),
        }
    }

    /// A corner in the surface's own frame.
    #[inline(always)]
    pub(super) fn corner(&self, corner: usize) -> DVec3 {
        Vec3::from_array(self.corners[corner]).as_dvec3()
    }

    /// The corners of the first triangle around a part, given by its number as in [`Feature::of_part`], where no vertices are
    /// welded.
    #[inline(always)]
    pub(super) fn first_around(&self, topology: &SurfaceTopology, part: usize) -> [u32; 3] {
        match part {
            0..3 => topology.first_around_vertex(self.vertices[part]),
            3..6 => {
                let edge = part - 3;
                let opposite = topology.first_opposite(EdgeId(self.edges[edge]));
                [self.vertices[edge], self.vertices[(edge + 1) % 3], opposite]
            }
            _ => self.vertices,
        }
    }

    /// The number of a feature where no vertices are welded, see [`feature_number`](super::contact::feature_number).
    #[inline(always)]
    pub(super) fn number(&self, triangle: u32, feature: Feature) -> u32 {
        match feature {
            Feature::Vertex(corner) => self.vertices[corner as usize],
            Feature::Edge(edge) => self.edges[edge as usize],
            Feature::Face => triangle,
        }
    }
}

/// The rows of a surface's triangles.
#[derive(Clone, Debug, Default)]
pub struct CornerRows {
    rows: Vec<CornerRow>,
}

impl CornerRows {
    /// Room for the rows of so many triangles, to be [filled](Self::fill).
    pub fn resize(&mut self, count: usize) -> &mut [CornerRow] {
        self.rows.resize(count, CornerRow::EMPTY);
        &mut self.rows
    }

    /// Writes the rows of the triangles from `first` on, of which the vertices are at `positions` in the surface's own frame.
    pub fn fill(rows: &mut [CornerRow], first: u32, topology: &SurfaceTopology, positions: &[Vec3]) {
        for (triangle, row) in (first..).zip(rows) {
            *row = CornerRow::new(topology, positions, triangle);
        }
    }

    #[inline(always)]
    pub(super) fn of(&self, triangle: u32) -> &CornerRow {
        &self.rows[triangle as usize]
    }
}

impl Prefetch for CornerRows {
    #[inline(always)]
    fn prefetch(&self, triangle: u32) {
        prefetch(&self.rows, triangle);
    }
}
