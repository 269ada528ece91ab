//! Moves the carriers of walls to the middle.
//!
//! A vertex goes to where the middle surfaces of all walls around it meet: below each thin face at it, by the depth of
//! that wall. So walls that meet in an L, T, or X have a common edge there, whichever of their sides carry the sheet, and
//! the gap that the foot of a rib leaves in the face of its plate is closed.

use glam::{DMat3, DVec3};

use super::{
    body::{Body, Facets},
    depths::{CornerDepths, Depth, corner_angle},
    pairing::Pairing,
    segments::{NO_SEGMENT, Segments},
    walls::{Role, Walls},
};

/// Directions in which the faces around a vertex say little, relative to the best known one, are left alone: two faces
/// that meet at less than about 20° are one.
const LEAST_EIGENVALUE: f64 = 0.03;

/// Faces of a rim hold its vertices in their planes with this weight relative to the faces of walls.
const RIM_WEIGHT: f64 = 0.25;

/// Faces within this cosine of the plane of the wall's normal are a rim.
const RIM_COSINE: f64 = 0.5;

/// No vertex moves farther than this many depths where walls meet.
pub(super) const FARTHEST_MOVE: f64 = 3.0;

/// The same within one smooth face: at its creases, which are less than twice 40°.
pub(super) const FARTHEST_SMOOTH_MOVE: f64 = 1.3;

/// A vertex that would move farther than this many depths, and miss the planes by more than [`MOST_MISS`] nevertheless,
/// only moves along their main normal: its planes have no common point, but noise.
const NEAR_MOVE: f64 = 1.2;

/// See [`NEAR_MOVE`], in depths.
const MOST_MISS: f64 = 0.15;

/// Rotations until a symmetric matrix is diagonal.
const JACOBI_SWEEPS: usize = 12;

/// A mesh of one layer, with half the thickness at each vertex.
#[derive(Clone, Debug, Default)]
pub(super) struct Sheet {
    pub(super) points: Vec<DVec3>,
    pub(super) halves: Vec<f64>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// The wall of each triangle.
    pub(super) walls: Vec<u32>,
    /// The triangle of the body that each triangle was.
    pub(super) faces: Vec<u32>,
    /// The vertex of the body that each vertex was, twice, or the two between which it was added.
    pub(super) origins: Vec<[u32; 2]>,
}

/// A plane in which a vertex is wanted: `normal` · move = −`depth`.
#[derive(Clone, Copy)]
pub(super) struct Constraint {
    pub(super) normal: DVec3,
    pub(super) depth: f64,
    pub(super) weight: f64,
}

impl Sheet {
    pub(super) fn new(
        body: &Body,
        pairing: &Pairing,
        segments: &Segments,
        depths: &CornerDepths,
        walls: &Walls,
    ) -> Self {
        let vertex_count = body.points.len();
        let mut constraints: Vec<Vec<Constraint>> = vec![Vec::new(); vertex_count];
        let mut facing = vec![DVec3::ZERO; vertex_count];
        let mut farthest = vec![FARTHEST_SMOOTH_MOVE; vertex_count];
        let mut first_segment = vec![NO_SEGMENT; vertex_count];
        // Walls that are left hold the vertices of their neighbors where they were.
        for (triangle, role) in walls.intended.iter().enumerate() {
            if *role == Role::Rest {
                continue;
            }
            let middle = middle_normal(body, pairing, triangle);
            let tilt = middle.dot(body.normals[triangle]);
            for (k, vertex) in body.vertices(triangle).into_iter().enumerate() {
                let weight = angle_at(body, triangle, k);
                let depth = tilt * depths.of(triangle)[k].depth;
                constraints[vertex].push(Constraint { normal: middle, depth, weight });
                let first = &mut first_segment[vertex];
                match *first {
                    NO_SEGMENT => *first = segments.of[triangle],
                    segment if segment != segments.of[triangle] => farthest[vertex] = FARTHEST_MOVE,
                    _ => {}
                }
                if *role == Role::Carrier {
                    facing[vertex] += body.normals[triangle] * weight;
                }
            }
        }
        for (triangle, role) in walls.intended.iter().enumerate() {
            let normal = body.normals[triangle];
            if *role != Role::Rest || segments.of[triangle] != NO_SEGMENT || normal == DVec3::ZERO {
                continue;
            }
            for (k, vertex) in body.vertices(triangle).into_iter().enumerate() {
                if facing[vertex].normalize_or_zero().dot(normal).abs() < RIM_COSINE {
                    let weight = RIM_WEIGHT * angle_at(body, triangle, k);
                    constraints[vertex].push(Constraint { normal, depth: 0.0, weight });
                }
            }
        }
        let mut sheet = Self::default();
        let mut moved = vec![None; vertex_count];
        let mut corners: Vec<(usize, u32, usize, usize, Depth)> = Vec::new();
        for (triangle, role) in walls.roles.iter().enumerate() {
            if *role == Role::Carrier {
                let wall = walls.of_segment[segments.of[triangle] as usize];
                let place = sheet.triangles.len();
                sheet.triangles.push([0; 3]);
                sheet.walls.push(wall);
                sheet.faces.push(triangle as u32);
                for (k, vertex) in body.vertices(triangle).into_iter().enumerate() {
                    corners.push((vertex, wall, place, k, depths.of(triangle)[k]));
                }
            }
        }
        corners.sort_by_key(|&(vertex, wall, place, k, _)| (vertex, wall, place, k));
        for around in corners.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let vertex = around[0].0;
            let point = *moved[vertex]
                .get_or_insert_with(|| body.points[vertex] + meet(&constraints[vertex], farthest[vertex]));
            let half = around.iter().map(|corner| corner.4.half).sum::<f64>() / around.len() as f64;
            for &(_, _, place, k, _) in around {
                sheet.triangles[place][k] = sheet.points.len() as u32;
            }
            sheet.points.push(point);
            sheet.halves.push(half);
            sheet.origins.push([vertex as u32; 2]);
        }
        sheet
    }

    pub(super) fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|vertex| self.points[vertex as usize])
    }

    /// Its triangles, to search.
    pub(super) fn facets(&self) -> Facets {
        Facets::new((0..self.triangles.len()).map(|triangle| self.corners(triangle)).collect())
    }
}

/// The normal of the middle surface below a triangle. It differs from that of the triangle where the thickness varies.
fn middle_normal(body: &Body, pairing: &Pairing, triangle: usize) -> DVec3 {
    let opposites = pairing.of(triangle).iter().filter_map(|sample| sample.opposite);
    let opposite: DVec3 = opposites.map(|opposite| body.normals[opposite.triangle as usize]).sum();
    let normal = body.normals[triangle];
    (normal - opposite.normalize_or_zero()).normalize_or(normal)
}

fn angle_at(body: &Body, triangle: usize, k: usize) -> f64 {
    let corners = &body.facets.corners[triangle];
    corner_angle(corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k])
}

/// The shortest move that goes to all planes, as nearly as possible, no farther than `farthest` times the largest depth.
pub(super) fn meet(constraints: &[Constraint], farthest: f64) -> DVec3 {
    let mut matrix = DMat3::ZERO;
    let mut goal = DVec3::ZERO;
    for &Constraint { normal, depth, weight } in constraints {
        matrix += DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z) * weight;
        goal -= normal * (depth * weight);
    }
    let (values, vectors) = eigen(matrix);
    let largest = values.max_element();
    let along = |k: usize| vectors.col(k) * (vectors.col(k).dot(goal) / values[k]);
    let moved: DVec3 = (0..3).filter(|&k| values[k] > LEAST_EIGENVALUE * largest).map(along).sum();
    let deepest = constraints.iter().map(|constraint| constraint.depth).fold(0.0, f64::max);
    if moved.length() > NEAR_MOVE * deepest && miss(constraints, moved) > MOST_MISS * deepest {
        let main = (0..3).find(|&k| values[k] == largest).filter(|_| largest > 0.0);
        return main.map_or(DVec3::ZERO, along).clamp_length_max(NEAR_MOVE * deepest);
    }
    moved.clamp_length_max(farthest * deepest)
}

/// By how much a move misses the planes: the root of the mean square.
fn miss(constraints: &[Constraint], moved: DVec3) -> f64 {
    let (sum, weights) = constraints.iter().fold((0.0, 0.0), |(sum, weights), constraint| {
        let off = constraint.normal.dot(moved) + constraint.depth;
        (sum + constraint.weight * off * off, weights + constraint.weight)
    });
    if weights > 0.0 { (sum / weights).sqrt() } else { 0.0 }
}

/// Eigenvalues and eigenvectors of a symmetric matrix (Jacobi 1846).
fn eigen(mut matrix: DMat3) -> (DVec3, DMat3) {
    let mut vectors = DMat3::IDENTITY;
    for _ in 0..JACOBI_SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = matrix.col(q)[p];
            if off == 0.0 {
                continue;
            }
            let ratio = (matrix.col(q)[q] - matrix.col(p)[p]) / (2.0 * off);
            let tangent = ratio.signum() / (ratio.abs() + (ratio * ratio + 1.0).sqrt());
            let cosine = (tangent * tangent + 1.0).sqrt().recip();
            let sine = tangent * cosine;
            let mut rotation = DMat3::IDENTITY;
            rotation.col_mut(p)[p] = cosine;
            rotation.col_mut(q)[q] = cosine;
            rotation.col_mut(q)[p] = sine;
            rotation.col_mut(p)[q] = -sine;
            matrix = rotation.transpose() * matrix * rotation;
            vectors *= rotation;
        }
    }
    (DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z), vectors)
}
