//! Scenes of any size with about the same number of contacts per triangle at every size.

use bevy_circumsphere::Sidedness;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, crumpled_sheet, grid, icosphere, torus},
};
use glam::{DQuat, DVec3, Vec3};

use super::super::SHEET_PHASE;

/// Bodies, each with its own mesh.
pub struct Scene {
    pub bodies: Vec<Body>,
    pub meets_itself: bool,
    pub sidedness: Sidedness,
}

/// A mesh that alternates between two states.
pub struct Body {
    pub triangles: Vec<[u32; 3]>,
    pub states: [State; 2],
}

pub struct State {
    pub positions: Vec<Vec3>,
    pub pose: Transform,
}

impl Scene {
    pub fn triangles(&self) -> usize {
        self.bodies.iter().map(|body| body.triangles.len()).sum()
    }

    /// `count` bodies in a lattice at distances of `spacing`. Each has its own rotation and is displaced by at most
    /// `jitter`.
    fn lattice(count: usize, mesh: &Mesh, spacing: f32, jitter: f32) -> Self {
        // Make the lattice as close to a cube as the count allows, because bodies on the outside have fewer contacts
        // than those inside.
        let nearest = |side: &usize| side.pow(3).abs_diff(count);
        let side = (1..=count).min_by_key(nearest).unwrap_or(1);
        let mut random = Random::new(count as u64);
        let bodies = (0..count)
            .map(|number| {
                let place = [number % side, number / side % side, number / (side * side)];
                let place = Vec3::from_array(place.map(|cell| cell as f32 * spacing));
                let mut vector = || Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
                let place = place + jitter * vector();
                let axis = (vector().as_dvec3() + DVec3::new(0.0, 0.0, 1.5)).normalize();
                let step = 0.02 * spacing * vector();
                let turn = 3.0 * f64::from(vector().x);
                let state = |number: usize| State {
                    positions: swelling(mesh, 0.02 * number as f32),
                    pose: Transform::from_translation(place + step * number as f32)
                        .with_rotation(DQuat::from_axis_angle(axis, turn + 0.02 * number as f64).as_quat()),
                };
                Body { triangles: mesh.triangles.clone(), states: [state(0), state(1)] }
            })
            .collect();
        Self { bodies, meets_itself: false, sidedness: Sidedness::Auto }
    }
}

impl Body {
    /// A body with two states of one mesh, in world space.
    fn of(states: [Mesh; 2]) -> Self {
        let triangles = states[0].triangles.clone();
        let state = |mesh: Mesh| State {
            positions: mesh.positions.into_iter().map(Vec3::from_array).collect(),
            pose: Transform::IDENTITY,
        };
        Self { triangles, states: states.map(state) }
    }
}

/// The positions of a mesh, scaled by a factor that varies from place to place.
fn swelling(mesh: &Mesh, share: f32) -> Vec<Vec3> {
    mesh.positions
        .iter()
        .map(|&position| {
            let position = Vec3::from_array(position);
            position * (1.0 + share * position.x * position.z)
        })
        .collect()
}

/// A sheet that folds over and passes through itself. Its edges have the same length at every size.
pub fn crumpled(triangles: usize) -> Scene {
    let sheet = Body::of([0.0, SHEET_PHASE].map(|phase| crumpled_sheet(triangles, phase)));
    Scene { bodies: vec![sheet], meets_itself: true, sidedness: Sidedness::TwoSided }
}

/// A tilted sheet, and a triangle within its box but far from its triangles.
pub fn lone(triangles: usize) -> Scene {
    let side = (triangles / 2).isqrt().max(1);
    let sheet = grid(side, side, side as f32, side as f32, Diagonals::Alternating).rotate([0.0, 0.0, 1.0], 0.8);
    let top = sheet.positions.iter().fold(0.0_f32, |top, position| top.max(position[1]));
    let triangle = Mesh { positions: vec![[-0.5; 3], [0.5, -0.5, 0.0], [0.0, 0.5, 0.5]], triangles: vec![[0, 1, 2]] };
    let triangle = triangle.translate([-0.5 * top, 0.5 * top, 0.0]);
    let body = |mesh: Mesh| Body::of([mesh.clone(), mesh.translate([0.5, 0.25, 0.5])]);
    Scene { bodies: vec![body(sheet), body(triangle)], meets_itself: false, sidedness: Sidedness::TwoSided }
}

/// Balls of 320 triangles that do not touch.
pub fn apart(bodies: usize) -> Scene {
    Scene::lattice(bodies, &icosphere(2, 0.5), 1.4, 0.1)
}

/// Tori of 1,000 triangles with almost no hole. Each is in contact with most of its neighbors.
pub fn piled(bodies: usize) -> Scene {
    Scene::lattice(bodies, &torus(0.3, 0.25, 25, 20), 0.85, 0.1)
}
