//! Meshes whose vertices lie on a body that is known in closed form.

use bevy_circumsphere::geometry::SurfaceTopology;
use circumsphere_support::scenes::{Mesh, capsule, icosphere, torus};
use circumsphere_truth::{BodyShape, SmoothBody};
use glam::{DMat3, DVec3, Vec3};

/// The default of the plugin's settings.
pub const CREASE: f32 = 1.0;

/// A mesh and the body that it stands for.
pub struct BodyMesh {
    pub topology: SurfaceTopology,
    pub positions: Vec<Vec3>,
}

impl BodyMesh {
    pub fn new(body: SmoothBody, mesh: &Mesh) -> Self {
        let positions: Vec<Vec3> = mesh
            .positions
            .iter()
            .map(|position| (body.rotation * DVec3::from(position.map(f64::from)) + body.center).as_vec3())
            .collect();
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("the mesh is valid");
        Self { topology, positions }
    }

    pub fn edge(&self) -> f64 {
        self.topology.mean_edge_length(&self.positions)
    }
}

/// A mesh of a shape around the origin, with about 80 · 4^level triangles.
pub fn mesh_of(shape: BodyShape, level: u32) -> Mesh {
    let fine = 1usize << level;
    match shape {
        BodyShape::Ball(radius) => icosphere(level + 1, radius as f32),
        BodyShape::Ellipsoid(axes) => {
            let mut mesh = icosphere(level + 1, 1.0);
            for position in &mut mesh.positions {
                *position = (DVec3::from(position.map(f64::from)) * axes).to_array().map(|value| value as f32);
            }
            mesh
        }
        BodyShape::Torus(major, minor) => torus(major as f32, minor as f32, 8 * fine, 5 * fine),
        BodyShape::Capsule(radius, half) => capsule(radius as f32, half as f32, 6 * fine, 3 * fine, 2 * fine),
    }
}

pub fn rotation(seed: f64) -> DMat3 {
    DMat3::from_rotation_x(1.3 * seed) * DMat3::from_rotation_y(2.1 * seed) * DMat3::from_rotation_z(0.7 * seed)
}
