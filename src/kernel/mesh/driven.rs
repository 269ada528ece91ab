//! A fine mesh that follows a coarse one: each vertex keeps its place on a triangle of the coarse mesh, and its height
//! over it along the smooth normal.
//!
//! After everything else in the flow: coarse positions come in, fine positions for the renderer go out.

use glam::{DMat3, DVec3, Vec3};
use parry3d::{query::PointQueryWithLocation, shape::TriMesh};

use super::{smooth_normal::CreaseAngle, topology::SurfaceTopology, vertex_normals::vertex_normals};

/// The most Newton steps that look for the place of a vertex. From a place next to the surface, five are enough.
const MOST_STEPS: usize = 16;

/// The place of a vertex is found if it is this near, relative to the triangle's edges and the height.
const FOUND: f64 = 1.0e-9;

/// The most by which the place of a vertex may be outside of its triangle, in weights. Farther out, small turns of the
/// triangle would move the vertex by much.
const MOST_OUTSIDE: f64 = 1.0;

/// Where a vertex is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Anchor {
    triangle: u32,
    /// Weights of the corners. They sum to 1. Outside of the triangle, some are negative.
    barycentric: [f32; 3],
    height: f32,
    /// Whether the height is along the normal of the face.
    is_flat: bool,
}

/// The places of all vertices of a fine mesh on a coarse one.
#[derive(Clone, Debug, Default)]
pub struct DrivenMap {
    anchors: Vec<Anchor>,
    normals: Vec<Vec3>,
}

impl DrivenMap {
    /// Finds the place of each point on the nearest triangle of a coarse mesh. Both are in one frame.
    #[must_use]
    pub fn new(topology: &SurfaceTopology, positions: &[Vec3], points: &[Vec3]) -> Self {
        let mut normals = Vec::new();
        smooth_normals(topology, positions, &mut normals);
        let triangles = topology.triangles();
        let anchors = match TriMesh::new(positions.to_vec(), triangles.to_vec()) {
            Ok(mesh) => {
                let place = |point: &Vec3| {
                    let (_, (triangle, location)) = mesh.project_local_point_and_get_location(*point, false);
                    let corners = triangles[triangle as usize].map(|corner| corner as usize);
                    let nearest = location.barycentric_coordinates().map(|weights| weights.map(f64::from));
                    let start = nearest.unwrap_or([1.0 / 3.0; 3]);
                    place(corners, positions, &normals, start, point.as_dvec3(), triangle)
                };
                points.iter().map(place).collect()
            }
            // A topology has at least one triangle.
            Err(_) => vec![Anchor::default(); points.len()],
        };
        Self { anchors, normals }
    }

    /// The number of vertices of the fine mesh.
    #[must_use]
    pub fn len(&self) -> usize {
        self.anchors.len()
    }

    /// Whether the fine mesh has no vertices.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.anchors.is_empty()
    }

    /// Computes the positions of the fine mesh.
    pub fn follow(&mut self, topology: &SurfaceTopology, positions: &[Vec3], points: &mut Vec<Vec3>) {
        smooth_normals(topology, positions, &mut self.normals);
        let normals = &self.normals;
        points.clear();
        points.extend(self.anchors.iter().map(|anchor| {
            let corners = topology.triangles()[anchor.triangle as usize].map(|corner| corner as usize);
            let height = f64::from(anchor.height);
            let face = if anchor.is_flat { face_normal(corners, positions) } else { DVec3::ZERO };
            let corner = |place: usize| {
                let normal = if anchor.is_flat { face } else { normals[corners[place]].as_dvec3() };
                f64::from(anchor.barycentric[place]) * (positions[corners[place]].as_dvec3() + height * normal)
            };
            (corner(0) + corner(1) + corner(2)).as_vec3()
        }));
    }
}

/// Normals without creases, so that what follows them does not tear.
fn smooth_normals(topology: &SurfaceTopology, positions: &[Vec3], normals: &mut Vec<Vec3>) {
    vertex_normals(topology, positions, CreaseAngle::new(core::f32::consts::PI), normals);
}

/// The unit normal of a triangle, or zero if it has no area.
fn face_normal(corners: [usize; 3], positions: &[Vec3]) -> DVec3 {
    let [a, b, c] = corners.map(|corner| positions[corner].as_dvec3());
    (b - a).cross(c - a).normalize_or_zero()
}

/// Finds weights w and a height h so that Σ wₖ (pₖ + h nₖ) is the point, by Newton's method.
fn place(
    corners: [usize; 3],
    positions: &[Vec3],
    normals: &[Vec3],
    start: [f64; 3],
    point: DVec3,
    triangle: u32,
) -> Anchor {
    let [origin, b, c] = corners.map(|corner| positions[corner].as_dvec3());
    let edges = [b - origin, c - origin];
    let face = face_normal(corners, positions);
    let anchor = |[u, v, height]: [f64; 3], is_flat: bool| Anchor {
        triangle,
        barycentric: [1.0 - u - v, u, v].map(|weight| weight as f32),
        height: height as f32,
        is_flat,
    };
    let size = edges[0].length() + edges[1].length() + point.distance(origin);
    let solve = |normals: [DVec3; 3]| {
        let bends = [normals[1] - normals[0], normals[2] - normals[0]];
        let normal_at = |u: f64, v: f64| normals[0] + u * bends[0] + v * bends[1];
        let [mut u, mut v] = [start[1], start[2]];
        let normal = normal_at(u, v);
        let apart = point - (origin + u * edges[0] + v * edges[1]);
        let mut height = apart.dot(normal) / normal.length_squared();
        for _ in 0..MOST_STEPS {
            let normal = normal_at(u, v);
            let error = origin + u * edges[0] + v * edges[1] + height * normal - point;
            let outside = (-u).max(-v).max(u + v - 1.0);
            if error.length() <= FOUND * size {
                return (outside <= MOST_OUTSIDE).then_some([u, v, height]);
            }
            let slopes = DMat3::from_cols(edges[0] + height * bends[0], edges[1] + height * bends[1], normal);
            let step = slopes.inverse() * error;
            if !step.is_finite() {
                return None;
            }
            (u, v, height) = (u - step.x, v - step.y, height - step.z);
        }
        None
    };
    let smooth = solve(corners.map(|corner| normals[corner].as_dvec3())).map(|place| anchor(place, false));
    // On a sharp bend, the smooth normals may reach no place over the triangle, but that of the face does.
    let flat = || solve([face; 3]).map(|place| anchor(place, true));
    smooth.or_else(flat).unwrap_or_else(|| anchor([start[1], start[2], 0.0], true))
}
