//! The curved edges of smooth surfaces: how far each edge of a mesh bends away from its chord.
//!
//! A mesh whose vertices lie on a smooth body stands for that body. Each triangle is covered by a quadratic patch
//! `q(w) = Σ w_k p_k + Σ w_i w_j c_ij` with barycentric weights `w`, where `c_ij` belongs to the edge from corner `i`
//! to corner `j`: `c_ij = ½ [((p_i − p_j)·n_i) n_i + ((p_j − p_i)·n_j) n_j]` with the unit normals of the body at both
//! vertices. The patch is exact to second order for every quadric with exact normals. (Phong tessellation, Boubekeur
//! and Alexa 2008, uses ¾ of the sum where exactness requires ½.) Because `c_ij` belongs to the edge, patches join
//! without gaps, whatever an edge was reduced to.
//!
//! Normals at vertices are those of [`smooth_normal`](super::smooth_normal), one for each corner, so that they end at
//! creases. Edges are chords where no smooth body can be told: at more than two triangles, beside triangles without
//! area, and where normals disagree with the faces by more than the crease angle.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the dispatched instruction set")]

use glam::{Vec3, Vec3A, Vec4};

pub use self::unevenness::MOST_UNEVEN;
use self::{
    faces::{Face, compute_faces},
    normals::compute_normals,
    offsets::{Edges, compute_softness},
};
use super::{bounds::Aabb, smooth_normal::CreaseAngle, topology::SurfaceTopology};
use crate::kernel::simd::{
    parallel::{LEAST_SHARE, PART, Parallel, Sequential},
    prefetch::{Prefetch, prefetch},
};

mod faces;
mod normals;
mod offsets;
mod unevenness;

/// Between one edge's `c` and the largest distance of the patch from the triangle if all three edges have that `c`:
/// `Σ w_i w_j` is at most one third.
pub(in crate::kernel) const MOST_OF_EDGE: f32 = 1.0 / 3.0;

/// The offsets `c` of the edges of a triangle, as one row of contiguous memory. Edge `k` joins corners `k` and `k + 1`.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
pub(in crate::kernel) struct OffsetRow([[f32; 4]; 3]);

impl OffsetRow {
    /// The offset of an edge, and a number without meaning.
    #[inline(always)]
    pub(in crate::kernel) fn offset(&self, edge: usize) -> &[f32; 4] {
        &self.0[edge]
    }
}

/// The curved edges of a surface, and the normals that they follow.
#[derive(Clone, Debug, Default)]
pub struct CurvedEdges {
    /// For each welded edge, its `c`.
    offsets: Vec<Vec3>,
    faces: Vec<Face>,
    /// How smooth each edge is.
    softness: Vec<f32>,
    /// The normals at the corners of triangles, one for each slot of the fans. Zero where there is none.
    normals: Vec<Vec3A>,
    /// The offsets of the edges of each triangle.
    rows: Vec<OffsetRow>,
    /// How far the patch of each triangle may be from it.
    heights: Vec<f32>,
    /// The largest of those.
    largest: f32,
}

impl CurvedEdges {
    /// Computes the edges of a surface. Positions must be finite.
    pub fn update(&mut self, topology: &SurfaceTopology, positions: &[Vec3], crease: CreaseAngle) {
        self.update_on(&Sequential, topology, positions, crease);
    }

    /// Like [`update`](Self::update), in tasks that `parallel` may distribute.
    pub fn update_on(
        &mut self,
        parallel: &impl Parallel,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        crease: CreaseAngle,
    ) {
        let Self { offsets, faces, softness, normals, rows, heights, largest } = self;
        let (triangles, fans) = (topology.triangles(), topology.fans());
        compute_faces(parallel, positions, triangles, faces);
        compute_softness(parallel, fans.edges(), faces, crease, softness);
        compute_normals(parallel, fans, faces, softness, normals);
        Edges { topology, positions, faces, softness, normals, crease }.compute(parallel, offsets);
        let offsets = &*offsets;
        heights.resize(triangles.len(), 0.0);
        rows.resize(triangles.len(), OffsetRow::default());
        let parts = topology.triangle_edges().chunks(PART).zip(heights.chunks_mut(PART)).zip(rows.chunks_mut(PART));
        parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |((edges, heights), rows)| {
            for ((edges, height), row) in edges.iter().zip(heights).zip(rows) {
                let own = edges.map(|edge| offsets[edge as usize]);
                row.0 = own.map(|offset| offset.extend(0.0).to_array());
                let [a, b, c] = own.map(Vec3::length_squared);
                *height = a.max(b).max(c).sqrt() * MOST_OF_EDGE * (1.0 + 4.0 * f32::EPSILON);
            }
        });
        *largest = heights.iter().copied().fold(0.0, f32::max);
    }

    /// The offsets `c` of the edges of a triangle. Edge `k` joins corners `k` and `k + 1`.
    #[inline]
    pub(in crate::kernel) fn of_triangle(&self, triangle: u32) -> [Vec3; 3] {
        self.row(triangle).0.map(|offset| Vec3::from_slice(&offset))
    }

    #[inline(always)]
    pub(in crate::kernel) fn row(&self, triangle: u32) -> &OffsetRow {
        &self.rows[triangle as usize]
    }

    /// For each welded edge, its `c`: the middle of the edge is a quarter of it away from the middle of the chord.
    #[must_use]
    pub fn offsets(&self) -> &[Vec3] {
        &self.offsets
    }

    /// For each triangle, how far points of its patch may be from the points of the triangle with the same weights.
    #[inline]
    pub(crate) fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// The largest height of a patch: no point is farther than this from the point of its triangle with the same
    /// weights.
    #[must_use]
    pub fn largest(&self) -> f32 {
        self.largest
    }

    /// Writes the box of every patch, grown by `growth`, into `bounds`, and returns the box around all of them. A patch
    /// is within the hull of its corners and of one more point for each edge.
    pub fn patch_bounds_on(
        &self,
        parallel: &impl Parallel,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        growth: f32,
        bounds: &mut Vec<Aabb>,
    ) -> Aabb {
        let triangles = topology.triangles();
        bounds.resize(triangles.len(), Aabb::EMPTY);
        let parts = triangles.chunks(PART).zip(bounds.chunks_mut(PART)).zip(self.rows.chunks(PART));
        parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |((triangles, bounds), rows)| {
            for ((corners, bounds), row) in triangles.iter().zip(bounds).zip(rows) {
                let [a, b, c] = corners.map(|vertex| Vec3A::from(positions[vertex as usize]));
                let [first, second, third] = row.0.map(|offset| Vec3A::from_vec4(Vec4::from_array(offset)));
                let (low, high) = (a.min(b).min(c), a.max(b).max(c));
                let bent = [a + b + first, b + c + second, c + a + third];
                let low = low.min(bent[0].min(bent[1]).min(bent[2]) * 0.5);
                let high = high.max(bent[0].max(bent[1]).max(bent[2]) * 0.5);
                *bounds = Aabb { min: low.into(), max: high.into() }.grown(growth);
            }
        });
        bounds.iter().fold(Aabb::EMPTY, |all, bounds| all.union(bounds))
    }
}

impl Prefetch for CurvedEdges {
    #[inline(always)]
    fn prefetch(&self, triangle: u32) {
        prefetch(&self.rows, triangle);
    }
}
