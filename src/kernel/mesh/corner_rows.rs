//! Everything that the exact stage reads of a triangle, as one row of contiguous memory.
//!
//! A triangle is in about a dozen pairs. Each pair needs its corners, which lie in as many places, and the numbers of
//! its vertices and edges. Written and read by the exact stage.

use std::hint::select_unpredictable;

use glam::{DVec3, Vec3};

use super::{
    ids::{EdgeId, TriangleId},
    surroundings::Surroundings,
    topology::SurfaceTopology,
};
use crate::kernel::simd::prefetch::{Prefetch, prefetch};

/// One triangle, in one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct CornerRow {
    /// By corner and axis, in the surface's own frame.
    pub(in crate::kernel) corners: [[f32; 3]; 3],
    /// The triangle's vertices and edges.
    parts: [u32; 6],
    pub(in crate::kernel) surroundings: Surroundings,
}

impl CornerRow {
    pub(in crate::kernel) const EMPTY: Self =
        Self { corners: [[0.0; 3]; 3], parts: [0; 6], surroundings: Surroundings::NONE };

    /// Builds the row of a triangle of a surface whose vertices are at `positions` in its own frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(topology: &SurfaceTopology, positions: &[Vec3], triangle: u32) -> Self {
        let vertices = topology.triangles()[triangle as usize];
        let ([a, b, c], [d, e, f]) = (vertices, topology.triangle_edges()[triangle as usize]);
        Self {
            corners: vertices.map(|vertex| positions[vertex as usize].to_array()),
            parts: [a, b, c, d, e, f],
            surroundings: topology.surroundings(TriangleId(triangle)),
        }
    }

    /// A corner in the surface's own frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn own_corner(&self, corner: usize) -> Vec3 {
        Vec3::from_array(self.corners[corner])
    }

    /// A corner in the surface's own frame, in f64.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn corner(&self, corner: usize) -> DVec3 {
        self.own_corner(corner).as_dvec3()
    }

    /// The corners of the first triangle around a feature. The feature is given by its local index, see
    /// [`Feature::of_part`](super::feature::Feature::of_part). Only for surfaces without welded vertices.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn first_around(&self, topology: &SurfaceTopology, part: usize) -> [u32; 3] {
        // Looks up both a vertex and an edge: a branch on which of them it is would be unpredictable.
        let [a, b, c, ..] = self.parts;
        let (corner, next) = (part % 3, (part + 1) % 3);
        let [x, y, z] = topology.first_around_vertex(self.parts[corner]);
        let along = [self.parts[corner], self.parts[next], topology.first_opposite(EdgeId(self.parts[3 + corner]))];
        let [is_vertex, is_edge] = [part < 3, part < 6];
        [
            select_unpredictable(is_vertex, x, select_unpredictable(is_edge, along[0], a)),
            select_unpredictable(is_vertex, y, select_unpredictable(is_edge, along[1], b)),
            select_unpredictable(is_vertex, z, select_unpredictable(is_edge, along[2], c)),
        ]
    }

    /// The number of a feature if no vertices are welded, see
    /// [`feature_number`](crate::kernel::contact::feature_number).
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn number(&self, triangle: u32, part: usize) -> u32 {
        select_unpredictable(part < 6, self.parts[part.min(5)], triangle)
    }
}

/// The rows of a surface's triangles.
#[derive(Clone, Debug, Default)]
pub struct CornerRows {
    rows: Vec<CornerRow>,
}

impl CornerRows {
    /// Resizes to the rows of `count` triangles, for [`fill`](Self::fill) to write.
    pub fn resize(&mut self, count: usize) -> &mut [CornerRow] {
        self.rows.resize(count, CornerRow::EMPTY);
        &mut self.rows
    }

    /// Writes the rows of the triangles from `first` on. The vertices are at `positions`, in the surface's own frame.
    pub fn fill(rows: &mut [CornerRow], first: u32, topology: &SurfaceTopology, positions: &[Vec3]) {
        for (triangle, row) in (first..).zip(rows) {
            *row = CornerRow::new(topology, positions, triangle);
        }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of(&self, triangle: u32) -> &CornerRow {
        &self.rows[triangle as usize]
    }
}

impl Prefetch for CornerRows {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn prefetch(&self, triangle: u32) {
        prefetch(&self.rows, triangle);
    }
}
