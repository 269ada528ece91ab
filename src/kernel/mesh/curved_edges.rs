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

use glam::{DVec3, Vec3};

use super::{
    bounds::Aabb,
    feature::Feature,
    ids::{EdgeId, VertexId},
    smooth_normal::{CreaseAngle, SurfacePlace, corner_normal},
    topology::SurfaceTopology,
};
use crate::kernel::simd::parallel::{LEAST_SHARE, PART, Parallel, Sequential};

/// An edge may move a point of its patch by at most this share of the least height of the triangles beside it. Long
/// triangles across a change of curvature would err badly otherwise.
const GUARD: f64 = 0.15;

/// Between one edge's `c` and the largest distance of the patch from the triangle if all three edges have that `c`:
/// `Σ w_i w_j` is at most one third.
const MOST_OF_EDGE: f64 = 1.0 / 3.0;

/// What is known about one triangle.
#[derive(Clone, Copy, Debug, Default)]
struct Face {
    /// Unit normal, or zero if it has no area.
    normal: Vec3,
    /// Weights of the normal at the three corners.
    weights: [f32; 3],
    /// The least height.
    height: f32,
}

/// The curved edges of a surface, and the normals that they follow.
#[derive(Clone, Debug, Default)]
pub struct CurvedEdges {
    /// For each welded edge, its `c`.
    offsets: Vec<Vec3>,
    faces: Vec<Face>,
    /// For each edge, 1 if it belongs to one curved surface, 0 if it is a crease, and less than 0 if it has more than
    /// two triangles or two that do not fit together.
    softness: Vec<f32>,
    /// For each welded vertex, the normal that all its corners share. Zero if they do not share any.
    vertex_normals: Vec<Vec3>,
    /// The largest distance of a patch from its triangle.
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
        let Self { offsets, faces, softness, vertex_normals, largest } = self;
        let (triangles, edge_count) = (topology.triangles(), topology.edges().len());
        faces.resize(triangles.len(), Face::default());
        let parts = triangles.chunks(PART).zip(faces.chunks_mut(PART));
        parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |(triangles, faces)| {
            for (corners, face) in triangles.iter().zip(faces) {
                *face = Face::new(corners.map(|vertex| positions[vertex as usize].as_dvec3()));
            }
        });
        let faces = &*faces;
        softness.resize(edge_count, 0.0);
        parallel.run_tasks(softness.chunks_mut(PART).enumerate(), edge_count / LEAST_SHARE, |(part, softness)| {
            for (place, softness) in softness.iter_mut().enumerate() {
                *softness = edge_softness(topology, positions, faces, (part * PART + place) as u32, crease);
            }
        });
        let softness = &*softness;
        vertex_normals.resize(topology.vertex_count(), Vec3::ZERO);
        let parts = vertex_normals.chunks_mut(PART).enumerate();
        parallel.run_tasks(parts, topology.vertex_count() / LEAST_SHARE, |(part, normals)| {
            for (place, normal) in normals.iter_mut().enumerate() {
                *normal = shared_normal(topology, faces, softness, (part * PART + place) as u32);
            }
        });
        let corners = Corners { topology, positions, faces, vertex_normals, crease };
        offsets.resize(edge_count, Vec3::ZERO);
        let parts = offsets.chunks_mut(PART).zip(softness.chunks(PART)).enumerate();
        parallel.run_tasks(parts, edge_count / LEAST_SHARE, |(part, (offsets, softness))| {
            for (place, (offset, softness)) in offsets.iter_mut().zip(softness).enumerate() {
                *offset = corners.edge_offset((part * PART + place) as u32, *softness);
            }
        });
        let squared = offsets.iter().map(|offset| offset.length_squared()).fold(0.0, f32::max);
        *largest = squared.sqrt() * MOST_OF_EDGE as f32 * (1.0 + 4.0 * f32::EPSILON);
    }

    /// The offsets `c` of the edges of a triangle. Edge `k` joins corners `k` and `k + 1`.
    #[inline]
    pub(in crate::kernel) fn of_triangle(&self, topology: &SurfaceTopology, triangle: u32) -> [Vec3; 3] {
        topology.triangle_edges()[triangle as usize].map(|edge| self.offsets[edge as usize])
    }

    /// For each welded edge, its `c`: the middle of the edge is a quarter of it away from the middle of the chord.
    #[must_use]
    pub fn offsets(&self) -> &[Vec3] {
        &self.offsets
    }

    /// No point of a patch is farther than this from the point of its triangle with the same weights.
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

    /// Whether a patch may be left over an edge: whether both triangles belong to one curved surface.
    #[inline]
    pub(in crate::kernel) fn is_soft(&self, edge: u32) -> bool {
        self.softness[edge as usize] > 0.0
    }
}

impl Face {
    fn new([a, b, c]: [DVec3; 3]) -> Self {
        let sides = [b - a, c - b, a - c];
        let squares = sides.map(DVec3::length_squared);
        let cross = sides[0].cross(sides[1]);
        let doubled_area = cross.length();
        let longest = squares[0].max(squares[1]).max(squares[2]);
        let normal = cross / doubled_area;
        // Without area, or so small that f64 cannot tell.
        if !normal.is_finite() || longest <= 0.0 {
            return Self::default();
        }
        // The sine of the angle over the lengths of its two sides.
        let weight = |before: usize, after: usize| (doubled_area / (squares[before] * squares[after])) as f32;
        let weights = [weight(2, 0), weight(0, 1), weight(1, 2)];
        if !weights.iter().all(|weight| weight.is_finite()) {
            return Self::default();
        }
        Self { normal: normal.as_vec3(), weights, height: (doubled_area / longest.sqrt()) as f32 }
    }
}

/// The softness of an edge, see [`CurvedEdges`]. Boundaries are soft.
fn edge_softness(
    topology: &SurfaceTopology,
    positions: &[Vec3],
    faces: &[Face],
    edge: u32,
    crease: CreaseAngle,
) -> f32 {
    match *topology.triangles_of_edge(EdgeId(edge)) {
        [first, second] => {
            let is_turned = topology.runs_forward(first, edge) == topology.runs_forward(second, edge);
            let is_apart = topology.is_welded() && {
                let [own, other] = [first, second].map(|triangle| ends_of(topology, triangle, edge));
                (0..2).any(|end| positions[own[end] as usize] != positions[other[end] as usize])
            };
            let [first, second] = [first, second].map(|triangle| faces[triangle as usize].normal);
            if is_turned || is_apart || first == Vec3::ZERO || second == Vec3::ZERO {
                return -1.0;
            }
            crease.softness(first.as_dvec3(), second.as_dvec3()) as f32
        }
        [_] => 1.0,
        _ => -1.0,
    }
}

/// The vertices of a triangle at both ends of an edge, in the caller's numbering, in the order of the edge.
fn ends_of(topology: &SurfaceTopology, triangle: u32, edge: u32) -> [u32; 2] {
    let side = side_of(topology, triangle, edge);
    let corners = topology.triangles()[triangle as usize];
    let ends = [corners[side], corners[(side + 1) % 3]];
    if topology.runs_forward(triangle, edge) { ends } else { [ends[1], ends[0]] }
}

/// The local index of an edge in a triangle.
fn side_of(topology: &SurfaceTopology, triangle: u32, edge: u32) -> usize {
    topology.triangle_edges()[triangle as usize].iter().position(|&own| own == edge).unwrap_or_default()
}

/// The normal of all corners at a vertex, if all its edges are soft. Otherwise zero.
fn shared_normal(topology: &SurfaceTopology, faces: &[Face], softness: &[f32], vertex: u32) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for &triangle in topology.triangles_of_vertex(VertexId(vertex)) {
        let corners = topology.welded_triangles()[triangle as usize];
        let Some(corner) = corners.iter().position(|&welded| welded == vertex) else { continue };
        let edges = topology.triangle_edges()[triangle as usize];
        let both = [edges[corner], edges[(corner + 2) % 3]].map(|edge| softness[edge as usize]);
        if both[0] < 1.0 || both[1] < 1.0 {
            return Vec3::ZERO;
        }
        let face = &faces[triangle as usize];
        sum += face.normal * face.weights[corner];
    }
    sum.normalize_or_zero()
}

/// What the normals at corners are computed from.
struct Corners<'a> {
    topology: &'a SurfaceTopology,
    positions: &'a [Vec3],
    faces: &'a [Face],
    vertex_normals: &'a [Vec3],
    crease: CreaseAngle,
}

impl Corners<'_> {
    /// The normal at a corner of a triangle, on the side of the triangle's own normal. Zero if there is none.
    fn normal(&self, triangle: u32, corner: usize) -> DVec3 {
        let vertex = self.topology.welded_triangles()[triangle as usize][corner];
        let shared = self.vertex_normals[vertex as usize];
        if shared != Vec3::ZERO {
            return shared.as_dvec3();
        }
        let place = SurfacePlace {
            topology: self.topology,
            positions: self.positions,
            triangle,
            feature: Feature::Face,
            one_sided: false,
            barycentric: [1.0 / 3.0; 3],
        };
        corner_normal(&place, corner, self.crease).unwrap_or(DVec3::ZERO)
    }

    /// The `c` of an edge, from both sides.
    fn edge_offset(&self, edge: u32, softness: f32) -> Vec3 {
        if softness < 0.0 {
            return Vec3::ZERO;
        }
        let triangles = self.topology.triangles_of_edge(EdgeId(edge));
        let sides = triangles.iter().map(|&triangle| self.side_offset(triangle, edge));
        let height = triangles.iter().map(|&triangle| self.faces[triangle as usize].height).fold(f32::MAX, f32::min);
        let mut offset = DVec3::ZERO;
        let mut fits = 1.0_f64;
        let mut known: [Option<(DVec3, DVec3)>; 2] = [None; 2];
        for (place, side) in sides.enumerate() {
            let Some(side) = side else { return Vec3::ZERO };
            fits = fits.min(side.fits);
            known[place] = Some((side.offset, side.normal));
        }
        match known {
            [Some((first, _)), None] => offset = first,
            [Some((first, normal)), Some((second, other))] => {
                let smooth = (first + second) * 0.5;
                offset = smooth;
                if softness < 1.0 {
                    let softness = f64::from(softness);
                    offset = smooth * softness + on_crease([first, second], [normal, other]) * (1.0 - softness);
                }
            }
            _ => {}
        }
        offset *= fits;
        let limit = GUARD / MOST_OF_EDGE * f64::from(height);
        let length = offset.length();
        if !length.is_finite() {
            return Vec3::ZERO;
        }
        if length > limit {
            offset *= limit / length;
        }
        offset.as_vec3()
    }

    /// The `c` of an edge by the normals of one of its triangles. `None` if the triangle has no normals there.
    fn side_offset(&self, triangle: u32, edge: u32) -> Option<SideOffset> {
        let from = side_of(self.topology, triangle, edge);
        let to = (from + 1) % 3;
        let corners = self.topology.triangles()[triangle as usize];
        let [start, end] = [from, to].map(|corner| self.positions[corners[corner] as usize].as_dvec3());
        let normals = [self.normal(triangle, from), self.normal(triangle, to)];
        let face = self.faces[triangle as usize].normal.as_dvec3();
        if normals.contains(&DVec3::ZERO) || face == DVec3::ZERO {
            return None;
        }
        let along = end - start;
        let offset = (normals[1] * along.dot(normals[1]) - normals[0] * along.dot(normals[0])) * 0.5;
        let fits = self.crease.softness(normals[0], face) * self.crease.softness(normals[1], face);
        Some(SideOffset { offset, normal: (normals[0] + normals[1]).normalize_or_zero(), fits })
    }
}

/// The `c` of an edge by one of its triangles.
struct SideOffset {
    offset: DVec3,
    /// The mean of the normals at both ends.
    normal: DVec3,
    /// From 1 to 0: how well these normals agree with the face.
    fits: f64,
}

/// The `c` of an edge between two curved surfaces: the shortest vector that rises over each of them like its own `c`.
/// By least squares where the two are nearly one, or turn back on themselves.
fn on_crease(offsets: [DVec3; 2], [first, second]: [DVec3; 2]) -> DVec3 {
    /// Keeps nearly parallel normals solvable.
    const DAMPING: f64 = 1.0e-3;
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
