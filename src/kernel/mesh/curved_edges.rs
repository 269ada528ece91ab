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

use fearless_simd::{Level, dispatch, f32x8, prelude::*};
use glam::{DVec3, Vec3};

use super::{
    bounds::Aabb,
    fans::{EdgeSides, Fans, NONE},
    smooth_normal::CreaseAngle,
    topology::SurfaceTopology,
};
use crate::kernel::simd::{
    lanes::{SetLanes, TriangleLanes, WIDTH, ZERO_AREA, first_lanes, transposed},
    parallel::{LEAST_SHARE, PART, Parallel, Sequential},
    prefetch::{Prefetch, prefetch},
};

/// An edge may move a point of its patch by at most this share of the least height of the triangles beside it. Long
/// triangles across a change of curvature would err badly otherwise.
const GUARD: f32 = 0.15;

/// Between one edge's `c` and the largest distance of the patch from the triangle if all three edges have that `c`:
/// `Σ w_i w_j` is at most one third.
pub(in crate::kernel) const MOST_OF_EDGE: f32 = 1.0 / 3.0;

/// Lengths whose squares are reliable in f32.
const RELIABLE: [f32; 2] = [1.0e-15, 1.0e15];

/// What is known about one triangle, as one row of contiguous memory.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
struct Face {
    /// Unit normal, or zero if it has no area.
    normal: Vec3,
    /// Weights of the normal at the three corners.
    weights: [f32; 3],
    /// The least height.
    height: f32,
    unused: f32,
}

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
    /// The normals at the corners of triangles, one for each slot of the fans. Zero where there is none.
    normals: Vec<Vec3>,
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
        let Self { offsets, faces, normals, rows, heights, largest } = self;
        let (triangles, fans) = (topology.triangles(), topology.fans());
        faces.resize(triangles.len(), Face::default());
        let parts = triangles.chunks(PART).zip(faces.chunks_mut(PART));
        parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |(triangles, faces)| {
            dispatch!(Level::new(), simd => write_faces(simd, positions, triangles, faces));
        });
        let faces = &*faces;
        normals.resize(fans.slots().len(), Vec3::ZERO);
        parallel.run_tasks(parts_of_fans(fans, normals), fans.len() / LEAST_SHARE, |(part, normals)| {
            let first = fans.fan(part.start).0.start;
            for fan in part {
                let (slots, closed) = fans.fan(fan);
                let own = slots.start - first..slots.end - first;
                write_normals(fans, slots, closed, faces, crease, &mut normals[own]);
            }
        });
        let edges = Edges { topology, positions, faces, normals, crease };
        offsets.resize(fans.edges().len(), Vec3::ZERO);
        let parts = fans.edges().chunks(PART).zip(offsets.chunks_mut(PART)).enumerate();
        parallel.run_tasks(parts, fans.edges().len() / LEAST_SHARE, |(part, (sides, offsets))| {
            for (place, (sides, offset)) in sides.iter().zip(offsets).enumerate() {
                *offset = edges.offset(sides, (part * PART + place) as u32);
            }
        });
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
        let parts = triangles.chunks(PART).zip(topology.triangle_edges().chunks(PART)).zip(bounds.chunks_mut(PART));
        parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |((triangles, edges), bounds)| {
            for ((corners, edges), bounds) in triangles.iter().zip(edges).zip(bounds) {
                let corners = corners.map(|vertex| positions[vertex as usize]);
                let bent = [0, 1, 2].map(|k| {
                    let middle = corners[k] * 0.5 + corners[(k + 1) % 3] * 0.5;
                    middle + self.offsets[edges[k] as usize] * 0.5
                });
                *bounds = Aabb::from_points(corners.into_iter().chain(bent)).grown(growth);
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

impl Face {
    /// In f64, for triangles that f32 is not enough for.
    #[cold]
    fn new([a, b, c]: [DVec3; 3]) -> Self {
        let sides = [b - a, c - b, a - c];
        let squares = sides.map(DVec3::length_squared);
        let cross = sides[0].cross(sides[1]);
        let doubled_area = cross.length();
        let longest = squares[0].max(squares[1]).max(squares[2]);
        let normal = cross / doubled_area;
        if !normal.is_finite() || longest <= 0.0 {
            return Self::default();
        }
        // The sine of the angle over the lengths of its two sides.
        let weight = |before: usize, after: usize| (doubled_area / (squares[before] * squares[after])) as f32;
        let weights = [weight(2, 0), weight(0, 1), weight(1, 2)];
        if !weights.iter().all(|weight| weight.is_finite()) {
            return Self::default();
        }
        let height = (doubled_area / longest.sqrt()) as f32;
        Self { normal: normal.as_vec3(), weights, height, unused: 0.0 }
    }
}

#[inline(always)]
fn write_faces<S: Simd>(simd: S, positions: &[Vec3], triangles: &[[u32; 3]], faces: &mut [Face]) {
    let zero = f32x8::splat(simd, 0.0);
    for (triangles, faces) in triangles.chunks(WIDTH).zip(faces.chunks_mut(WIDTH)) {
        let lanes = TriangleLanes::gather(simd, positions, triangles);
        let (lengths, _) = lanes.edge_lengths();
        let longest = lengths[0].max(lengths[1]).max(lengths[2]);
        let reliable = longest.simd_gt(RELIABLE[0]) & longest.simd_lt(RELIABLE[1]);
        let scale = f32x8::splat(simd, 1.0) / longest;
        let [first, second, third] =
            [lanes.edge(0).scaled(scale), lanes.edge(1).scaled(scale), lanes.edge(2).scaled(scale)];
        let cross = first.cross(second);
        let doubled_area = cross.dot(cross).sqrt();
        let exact = reliable & doubled_area.simd_gt(ZERO_AREA);
        let normal = cross.scaled(f32x8::splat(simd, 1.0) / doubled_area);
        let inverse = doubled_area * (scale * scale);
        let squares = [first.dot(first), second.dot(second), third.dot(third)];
        let weights = [
            inverse / (squares[2] * squares[0]),
            inverse / (squares[0] * squares[1]),
            inverse / (squares[1] * squares[2]),
        ];
        let rows = transposed([
            normal.x,
            normal.y,
            normal.z,
            weights[0],
            weights[1],
            weights[2],
            doubled_area * longest,
            zero,
        ]);
        for (face, row) in faces.iter_mut().zip(rows) {
            let [x, y, z, a, b, c, height, _] = row.into();
            *face = Face { normal: Vec3::new(x, y, z), weights: [a, b, c], height, unused: 0.0 };
        }
        let inexact = !(exact.to_bitmask() as u32) & first_lanes(triangles.len()) as u32;
        for lane in SetLanes(inexact) {
            faces[lane] = Face::new(triangles[lane].map(|vertex| positions[vertex as usize].as_dvec3()));
        }
    }
}

/// Consecutive parts of the fans, each with the normals of its slots.
fn parts_of_fans<'a>(
    fans: &'a Fans,
    normals: &'a mut [Vec3],
) -> impl Iterator<Item = (std::ops::Range<usize>, &'a mut [Vec3])> + Send {
    let mut rest = normals;
    (0..fans.len()).step_by(PART).map(move |first| {
        let part = first..(first + PART).min(fans.len());
        let count = fans.fan(part.end - 1).0.end - fans.fan(part.start).0.start;
        let (own, later) = std::mem::take(&mut rest).split_at_mut(count);
        rest = later;
        (part, own)
    })
}

/// Writes the normals of a fan's corners. Faces across a crease do not count, see [`CreaseAngle`].
#[inline]
fn write_normals(
    fans: &Fans,
    slots: std::ops::Range<usize>,
    closed: bool,
    faces: &[Face],
    crease: CreaseAngle,
    normals: &mut [Vec3],
) {
    let slots = &fans.slots()[slots];
    let face = |place: usize| &faces[slots[place].triangle as usize];
    let weighted = |place: usize| face(place).normal * face(place).weights[slots[place].corner as usize % 3];
    let chord = |place: usize, next: usize| f64::from(face(place).normal.distance_squared(face(next).normal));
    let count = slots.len();
    let (mut sum, mut largest) = (Vec3::ZERO, 0.0_f64);
    let mut before = if closed { count - 1 } else { 0 };
    for place in 0..count {
        sum += weighted(place);
        largest = largest.max(chord(before, place));
        before = place;
    }
    if crease.softness_of(largest) >= 1.0 {
        normals.fill(sum.normalize_or_zero());
        return;
    }
    for own in 0..count {
        let mut sum = weighted(own);
        // By how much each face counts: as much as the smoothest way there is smooth.
        let (mut forward, mut backward) = (1.0, 1.0);
        let mut shares = [0.0_f32; MOST_FACES];
        let spread = count.min(MOST_FACES);
        for step in 1..spread {
            let (next, last) = (own + step, own + step - 1);
            if closed || next < count {
                forward *= crease.softness_of(chord(last % count, next % count));
                let share = &mut shares[step];
                *share = share.max(forward as f32);
            } else {
                forward = 0.0;
            }
            let (next, last) = ((own + count - step % count) % count, (own + count + 1 - step) % count);
            if closed || step <= own {
                backward *= crease.softness_of(chord(last, next));
                let share = &mut shares[(count - step) % MOST_FACES];
                *share = share.max(backward as f32);
            } else {
                backward = 0.0;
            }
            if forward == 0.0 && backward == 0.0 {
                break;
            }
        }
        for (step, share) in shares.iter().enumerate().take(spread).skip(1) {
            if *share > 0.0 {
                sum += weighted((own + step) % count) * *share;
            }
        }
        normals[own] = sum.normalize_or_zero();
    }
}

/// What edges are computed from.
struct Edges<'a> {
    topology: &'a SurfaceTopology,
    positions: &'a [Vec3],
    faces: &'a [Face],
    normals: &'a [Vec3],
    crease: CreaseAngle,
}

/// The `c` of an edge by one of its triangles.
#[derive(Clone, Copy, Default)]
struct SideOffset {
    offset: Vec3,
    /// The sum of the normals at both ends.
    normal: Vec3,
    /// From 1 to 0: how well these normals agree with the face.
    fits: f32,
}

impl Edges<'_> {
    /// The `c` of an edge.
    #[inline]
    fn offset(&self, sides: &EdgeSides, edge: u32) -> Vec3 {
        let [first, second] = sides.triangles;
        if first == NONE {
            return Vec3::ZERO;
        }
        let along = self.positions[sides.ends[1] as usize] - self.positions[sides.ends[0] as usize];
        let face = &self.faces[first as usize];
        if second == NONE {
            let own = self.side(sides.slots[0], face, along);
            return guarded(own.offset * own.fits, face.height);
        }
        let other = &self.faces[second as usize];
        if face.normal == Vec3::ZERO || other.normal == Vec3::ZERO || self.are_apart(sides, edge) {
            return Vec3::ZERO;
        }
        let softness = self.crease.softness_of(f64::from(face.normal.distance_squared(other.normal))) as f32;
        let own = self.side(sides.slots[0], face, along);
        let height = face.height.min(other.height);
        if softness >= 1.0 {
            // Both sides have the same normals.
            let fits = own.fits * self.fits(sides.slots[1], other);
            return guarded(own.offset * fits, height);
        }
        let beyond = self.side(sides.slots[1], other, along);
        let smooth = (own.offset + beyond.offset) * 0.5;
        let sharp = on_crease([own.offset, beyond.offset], [own.normal, beyond.normal]);
        let offset = smooth * softness + sharp * (1.0 - softness);
        guarded(offset * own.fits.min(beyond.fits), height)
    }

    /// Whether vertices that were welded at an end of the edge have moved apart.
    #[inline]
    fn are_apart(&self, sides: &EdgeSides, edge: u32) -> bool {
        self.topology.is_welded() && {
            let other = sides.triangles[1] as usize;
            let edges = self.topology.triangle_edges()[other];
            let from = edges.iter().position(|&own| own == edge).unwrap_or_default();
            let corners = self.topology.triangles()[other];
            let ends = [corners[(from + 1) % 3], corners[from]];
            (0..2).any(|end| self.positions[ends[end] as usize] != self.positions[sides.ends[end] as usize])
        }
    }

    #[inline]
    fn side(&self, slots: [u32; 2], face: &Face, along: Vec3) -> SideOffset {
        let [start, end] = slots.map(|slot| self.normals[slot as usize]);
        let offset = (end * along.dot(end) - start * along.dot(start)) * 0.5;
        SideOffset { offset, normal: start + end, fits: self.fits(slots, face) }
    }

    /// From 1 to 0: how well the normals at both ends agree with a face.
    #[inline]
    fn fits(&self, slots: [u32; 2], face: &Face) -> f32 {
        let chords = slots.map(|slot| f64::from(self.normals[slot as usize].distance_squared(face.normal)));
        (self.crease.softness_of(chords[0]) * self.crease.softness_of(chords[1])) as f32
    }
}

/// An offset that is not longer than the guard allows.
#[inline]
fn guarded(offset: Vec3, height: f32) -> Vec3 {
    let limit = GUARD / MOST_OF_EDGE * height;
    let length = offset.length();
    if length <= limit {
        offset
    } else if length.is_finite() {
        offset * (limit / length)
    } else {
        Vec3::ZERO
    }
}

/// Around a vertex with a crease, faces farther away than this do not count.
const MOST_FACES: usize = 32;

/// The `c` of an edge between two curved surfaces: the shortest vector that rises over each of them like its own `c`.
/// By least squares where the two are nearly one, or turn back on themselves.
fn on_crease(offsets: [Vec3; 2], normals: [Vec3; 2]) -> Vec3 {
    /// Keeps nearly parallel normals solvable.
    const DAMPING: f32 = 1.0e-3;
    let [first, second] = normals.map(Vec3::normalize_or_zero);
    let heights = [offsets[0].dot(first), offsets[1].dot(second)];
    // The shortest solution is a sum of both normals.
    let cosine = first.dot(second);
    let own = 1.0 + DAMPING;
    let determinant = own * own - cosine * cosine;
    let shares = [
        (own * heights[0] - cosine * heights[1]) / determinant,
        (own * heights[1] - cosine * heights[0]) / determinant,
    ];
    first * shares[0] + second * shares[1]
}
