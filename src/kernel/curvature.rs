//! One curvature value per triangle, from its neighbors across shared edges, and the dihedral angles on the way.
//!
//! Two estimators: the signed edge curvature `β/d`, β the dihedral angle and `d` the distance of the unfolded
//! centroids across the edge; and the angle deficit of the dual mesh (centroids joined across edges), whose root over
//! the dual area is the mean curvature at valence three. First geometric stage of the sphere methods; `circumsphere`
//! reads what it writes.

use core::f32::consts::FRAC_PI_2;

use glam::Vec3;

use super::{ids::EdgeId, topology::SurfaceTopology};

/// How the curvature of a triangle is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CurvatureEstimator {
    /// The edge of largest `|β/d|`, signed: positive where the surface is convex seen from the side its normals point
    /// to. Holds on stretched meshes and at boundaries.
    #[default]
    SignedEdge,
    /// `sqrt(max(2π − Σα, 0) / A)` of the dual mesh at the triangle's centroid: the source paper's estimator, with
    /// the sum of the dual triangles' areas. At least 0. Needs all three neighbors: elsewhere the signed edge
    /// curvature stands in.
    DualAngleDeficit,
}

/// Curvatures and dihedral angles of a surface's triangles, and the buffers they are computed in.
#[derive(Clone, Debug, Default)]
pub struct Curvatures {
    /// Curvature of each triangle, in 1/length.
    pub curvatures: Vec<f32>,
    /// Dihedral angle across edge `k` of each triangle, in radians from −π to π: positive where convex, 0 at a
    /// boundary and next to a triangle without area.
    pub dihedrals: Vec<[f32; 3]>,
    /// How far the surface's normal turns away from each triangle's own before the next triangle takes over: the largest
    /// angle to a neighbor, in radians from 0 to π; at a boundary at least π/2, as a rim is met from any side.
    pub spreads: Vec<f32>,
    normals: Vec<Vec3>,
    doubled_areas: Vec<f32>,
    centroids: Vec<Vec3>,
    edge_dihedrals: Vec<f32>,
}

impl Curvatures {
    /// Measures the surface at the given positions.
    pub fn measure(&mut self, topology: &SurfaceTopology, positions: &[Vec3], estimator: CurvatureEstimator) {
        self.measure_triangles(topology, positions);
        self.measure_edges(topology, positions);
        self.curvatures.clear();
        self.dihedrals.clear();
        self.spreads.clear();
        for triangle in 0..topology.triangles().len() {
            let (dihedrals, edge_curvature) = self.signed_edge(topology, positions, triangle);
            self.dihedrals.push(dihedrals);
            let ends = topology.triangle_edges()[triangle]
                .iter()
                .any(|&edge| topology.triangles_of_edge(EdgeId(edge)).len() < 2);
            let turned = dihedrals.iter().fold(0.0, |most: f32, angle| most.max(angle.abs()));
            self.spreads.push(if ends { turned.max(FRAC_PI_2) } else { turned });
            self.curvatures.push(match estimator {
                CurvatureEstimator::SignedEdge => edge_curvature,
                CurvatureEstimator::DualAngleDeficit => {
                    self.dual_angle_deficit(topology, triangle).unwrap_or(edge_curvature)
                }
            });
        }
    }

    fn measure_triangles(&mut self, topology: &SurfaceTopology, positions: &[Vec3]) {
        self.normals.clear();
        self.doubled_areas.clear();
        self.centroids.clear();
        for corners in topology.triangles() {
            let [a, b, c] = corners.map(|vertex| positions[vertex as usize]);
            let (u, v) = (b - a, c - a);
            // Scaled first: the square of an area is of order length⁴ and leaves the range of f32 before lengths do.
            let extent = u.abs().max(v.abs()).max_element();
            let normal = if extent > 0.0 { (u / extent).cross(v / extent) } else { Vec3::ZERO };
            self.normals.push(normal.normalize_or_zero());
            self.doubled_areas.push(normal.length() * extent * extent);
            self.centroids.push(a + (u + v) / 3.0);
        }
    }

    fn measure_edges(&mut self, topology: &SurfaceTopology, positions: &[Vec3]) {
        self.edge_dihedrals.clear();
        for edge in 0..topology.edges().len() as u32 {
            let dihedral = match *topology.triangles_of_edge(EdgeId(edge)) {
                [first, second] => self.dihedral(topology, positions, edge, first, second),
                _ => 0.0,
            };
            self.edge_dihedrals.push(dihedral);
        }
    }

    /// Angle between two triangles across their edge, as `first` sees it.
    fn dihedral(&self, topology: &SurfaceTopology, positions: &[Vec3], edge: u32, first: u32, second: u32) -> f32 {
        let corners = topology.triangles()[first as usize];
        let Some(side) = (0..3).find(|&k| topology.triangle_edges()[first as usize][k] == edge) else { return 0.0 };
        let along =
            (positions[corners[(side + 1) % 3] as usize] - positions[corners[side] as usize]).normalize_or_zero();
        let same_direction = topology.runs_forward(first, edge) == topology.runs_forward(second, edge);
        let (normal, mut other) = (self.normals[first as usize], self.normals[second as usize]);
        if same_direction {
            other = -other;
        }
        if normal == Vec3::ZERO || other == Vec3::ZERO {
            return 0.0;
        }
        bevy_math::ops::atan2(normal.cross(other).dot(along), normal.dot(other))
    }

    /// The dihedral angles of a triangle, and the `β/d` of largest magnitude.
    fn signed_edge(&self, topology: &SurfaceTopology, positions: &[Vec3], triangle: usize) -> ([f32; 3], f32) {
        let mut dihedrals = [0.0; 3];
        let mut curvature: f32 = 0.0;
        let corners = topology.triangles()[triangle];
        for k in 0..3 {
            let edge = topology.triangle_edges()[triangle][k];
            let around = topology.triangles_of_edge(EdgeId(edge));
            let own = triangle as u32;
            let (dihedral, neighbor) = match *around {
                [first, second] => (self.edge_dihedrals[edge as usize], if first == own { second } else { first }),
                [_] | [] => continue,
                // Non-manifold: the neighbor that folds most.
                _ => around
                    .iter()
                    .filter(|&&other| other != own)
                    .map(|&other| (self.dihedral(topology, positions, edge, own, other), other))
                    .fold((0.0, own), |most, next| if next.0.abs() > f32::abs(most.0) { next } else { most }),
            };
            dihedrals[k] = dihedral;
            let length = positions[corners[k] as usize].distance(positions[corners[(k + 1) % 3] as usize]);
            let doubled_areas = self.doubled_areas[triangle] + self.doubled_areas[neighbor as usize];
            // (h_i + h_j) / 3 with h = doubled area / length.
            let distance = doubled_areas / (3.0 * length);
            if distance > 0.0 && distance.is_finite() {
                let edge_curvature = dihedral / distance;
                if edge_curvature.abs() > curvature.abs() {
                    curvature = edge_curvature;
                }
            }
        }
        (dihedrals, if curvature.is_finite() { curvature } else { f32::MAX })
    }

    /// `None` where the triangle has not exactly one neighbor across each edge, or the dual triangles have no area.
    fn dual_angle_deficit(&self, topology: &SurfaceTopology, triangle: usize) -> Option<f32> {
        let own = triangle as u32;
        let mut spokes = [Vec3::ZERO; 3];
        for k in 0..3 {
            let edge = EdgeId(topology.triangle_edges()[triangle][k]);
            let &[first, second] = topology.triangles_of_edge(edge) else { return None };
            let neighbor = if first == own { second } else { first };
            spokes[k] = self.centroids[neighbor as usize] - self.centroids[triangle];
        }
        let (mut angles, mut doubled_areas) = (0.0, 0.0);
        for k in 0..3 {
            let (u, v) = (spokes[k], spokes[(k + 1) % 3]);
            let doubled_area = u.cross(v).length();
            angles += bevy_math::ops::atan2(doubled_area, u.dot(v));
            doubled_areas += doubled_area;
        }
        let deficit = (core::f32::consts::TAU - angles).max(0.0);
        let curvature = bevy_math::ops::sqrt(2.0 * deficit / doubled_areas);
        curvature.is_finite().then_some(curvature)
    }
}
