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

use glam::{Vec3, Vec3A};

pub use self::unevenness::MOST_UNEVEN;
use self::{
    faces::{Face, compute_faces},
    normals::compute_normals,
    offsets::{Edges, compute_softness},
    selection::Selection,
};
use super::{
    bounds::{Aabb, bounds_on},
    fans::NONE,
    smooth_normal::CreaseAngle,
    topology::SurfaceTopology,
};
use crate::kernel::simd::{
    parallel::{LEAST_SHARE, PART, Parallel, Sequential},
    prefetch::{Prefetch, prefetch},
};

mod faces;
mod normals;
mod offsets;
mod selection;
mod unevenness;

/// An edge may move a point of its patch by at most this share of the least height of the triangles beside it. Long
/// triangles across a change of curvature would err badly otherwise.
const GUARD: f32 = 0.15;

/// Squared lengths whose fourth powers f32 can hold.
const SQUARES: std::ops::Range<f32> = 1.0e-8..1.0e8;

/// Between one edge's `c` and the largest distance of the patch from the triangle if all three edges have that `c`:
/// `Σ w_i w_j` is at most one third.
pub(in crate::kernel) const MOST_OF_EDGE: f32 = 1.0 / 3.0;

/// The offsets `c` of the edges of a triangle, as one row of contiguous memory. Edge `k` joins corners `k` and `k + 1`.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
pub(in crate::kernel) struct OffsetRow([[f32; 4]; 3]);

impl OffsetRow {
    /// The offset of an edge, and a number without meaning.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn offset(&self, edge: usize) -> &[f32; 4] {
        &self.0[edge]
    }
}

/// The curved edges of a surface, and the normals that they follow, computed where they are wanted.
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
    /// What is computed.
    known: Known,
}

/// Which items of each list are computed.
#[derive(Clone, Debug, Default)]
struct Known {
    triangles: Selection,
    edges: Selection,
    fans: Selection,
    softness: Selection,
    faces: Selection,
}

impl Known {
    fn forget(&mut self, topology: &SurfaceTopology) {
        let (triangles, edges) = (topology.triangles().len(), topology.edges().len());
        self.triangles.forget(triangles);
        self.edges.forget(edges);
        self.fans.forget(topology.fans().len());
        self.softness.forget(edges);
        self.faces.forget(triangles);
    }

    /// Selects all that the wanted triangles are computed from. Returns whether any are wanted.
    fn settle(&mut self, topology: &SurfaceTopology) -> bool {
        let Self { triangles, edges, fans, softness, faces } = self;
        let all_fans = topology.fans();
        if !triangles.settle() {
            return false;
        }
        if triangles.are_all() {
            for selection in [edges, fans, softness, faces] {
                selection.want_all();
                selection.settle();
            }
            return true;
        }
        for &triangle in triangles.next() {
            for edge in topology.triangle_edges()[triangle as usize] {
                edges.want(edge);
            }
        }
        edges.settle();
        for &edge in edges.next() {
            softness.want(edge);
            let slots = all_fans.edges()[edge as usize].slots;
            for slot in slots.into_iter().flatten().filter(|&slot| slot != NONE) {
                fans.want(all_fans.fan_of(slot));
            }
        }
        fans.settle();
        for &fan in fans.next() {
            for slot in &all_fans.slots()[all_fans.fan(fan as usize).0] {
                faces.want(slot.triangle);
                if slot.next_edge != NONE {
                    softness.want(slot.next_edge);
                }
            }
        }
        softness.settle();
        for &edge in softness.next() {
            let sides = all_fans.edges()[edge as usize].triangles;
            for triangle in sides.into_iter().filter(|&triangle| triangle != NONE) {
                faces.want(triangle);
            }
        }
        faces.settle();
        true
    }
}

impl CurvedEdges {
    /// Computes all edges of a surface. Positions must be finite.
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
        self.forget(topology);
        self.want_all();
        self.bend_on(parallel, topology, positions, crease);
    }

    /// Forgets everything about the edges of a surface, which has moved.
    fn forget(&mut self, topology: &SurfaceTopology) {
        let count = topology.triangles().len();
        self.known.forget(topology);
        self.rows.resize(count, OffsetRow::default());
        self.heights.resize(count, 0.0);
    }

    /// Begins anew for a surface that has moved. Writes boxes that contain every patch, whatever its edges are, grown by
    /// `growth`, into `bounds`, and returns the box around all of them. Boxes do not depend on which patches are wanted
    /// later, and neither do results that depend on boxes.
    pub fn begin_on(
        &mut self,
        parallel: &impl Parallel,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        growth: f32,
        bounds: &mut Vec<Aabb>,
    ) -> Aabb {
        self.forget(topology);
        let triangles = topology.triangles();
        let parts = triangles.chunks(PART).zip(self.heights.chunks_mut(PART));
        parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |(triangles, heights)| {
            for (corners, height) in triangles.iter().zip(heights) {
                let [a, b, c] = corners.map(|vertex| Vec3A::from(positions[vertex as usize]));
                *height = GUARD * (1.0 + 8.0 * f32::EPSILON) * height_bound(b - a, c - b, a - c);
            }
        });
        let heights = &self.heights;
        bounds_on(parallel, positions, triangles, |triangle| growth + heights[triangle], bounds)
    }

    /// Wants the patch of a triangle.
    pub fn want(&mut self, triangle: u32) {
        self.known.triangles.want(triangle);
    }

    /// Wants all patches.
    pub fn want_all(&mut self) {
        self.known.triangles.want_all();
    }

    /// Computes the wanted patches, at the positions of the [beginning](Self::begin_on).
    pub fn bend_on(
        &mut self,
        parallel: &impl Parallel,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        crease: CreaseAngle,
    ) {
        let Self { offsets, faces, softness, normals, rows, heights, known } = self;
        if !known.settle(topology) {
            return;
        }
        let (triangles, fans) = (topology.triangles(), topology.fans());
        compute_faces(parallel, &known.faces, positions, triangles, faces);
        compute_softness(parallel, &known.softness, fans.edges(), faces, crease, softness);
        compute_normals(parallel, &known.fans, fans, faces, softness, normals);
        Edges { topology, positions, faces, softness, normals, crease }.compute(parallel, &known.edges, offsets);
        let offsets = &*offsets;
        let parts = known.triangles.parts(heights).zip(known.triangles.parts(rows));
        parallel.run_tasks(parts, known.triangles.share(), |(mut heights, mut rows)| {
            for &triangle in rows.items {
                let own = topology.triangle_edges()[triangle as usize].map(|edge| offsets[edge as usize]);
                rows.of(triangle).0 = own.map(|offset| offset.extend(0.0).to_array());
                let [a, b, c] = own.map(Vec3::length_squared);
                *heights.of(triangle) = a.max(b).max(c).sqrt() * MOST_OF_EDGE * (1.0 + 4.0 * f32::EPSILON);
            }
        });
    }

    /// The offsets `c` of the edges of a triangle. Edge `k` joins corners `k` and `k + 1`.
    #[inline]
    pub(in crate::kernel) fn of_triangle(&self, triangle: u32) -> [Vec3; 3] {
        self.row(triangle).0.map(|offset| Vec3::from_slice(&offset))
    }

    /// The offsets of the edges of a triangle. Those of a flat one if they have not been wanted.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn row(&self, triangle: u32) -> &OffsetRow {
        static FLAT: OffsetRow = OffsetRow([[0.0; 4]; 3]);
        if self.knows(triangle) { &self.rows[triangle as usize] } else { &FLAT }
    }

    /// Whether the patch of a triangle has been computed.
    #[inline]
    #[must_use]
    pub fn knows(&self, triangle: u32) -> bool {
        self.known.triangles.knows(triangle)
    }

    /// For each welded edge, its `c`: the middle of the edge is a quarter of it away from the middle of the chord. Without
    /// meaning at triangles whose patches have not been computed.
    #[must_use]
    pub fn offsets(&self) -> &[Vec3] {
        &self.offsets
    }

    /// For each triangle, how far points of its patch may be from the points of the triangle with the same weights.
    #[inline]
    pub(crate) fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// The largest height of a patch: no point is farther than this from the point of its triangle with the same weights.
    #[must_use]
    pub fn largest(&self) -> f32 {
        self.heights.iter().copied().fold(0.0, f32::max)
    }
}

/// An upper bound of the least height of a triangle, given its edges.
#[inline]
fn height_bound(u: Vec3A, v: Vec3A, w: Vec3A) -> f32 {
    let squares = [u.length_squared(), v.length_squared(), w.length_squared()];
    let longest = squares[0].max(squares[1]).max(squares[2]);
    if SQUARES.contains(&longest) {
        let length = longest.sqrt();
        // The area of a needle is rounded by as much as that of a square over its length.
        return u.cross(v).length() / length + 8.0 * f32::EPSILON * length;
    }
    // No height is longer than an edge, and no edge longer than this.
    let longest = |edge: Vec3A| edge.abs().max_element() * 1.733;
    longest(u).min(longest(v)).min(longest(w))
}

impl Prefetch for CurvedEdges {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn prefetch(&self, triangle: u32) {
        prefetch(&self.rows, triangle);
    }
}
