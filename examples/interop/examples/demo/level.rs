//! The ground: a meadow with a platform that a ramp leads up to and steps lead down from, all one triangle mesh.

use std::f32::consts::TAU;

use avian3d::prelude::*;
use bevy::{
    asset::RenderAssetUsages,
    math::ops,
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
};
use bevy_circumsphere::response::SurfaceFriction;

use crate::game::Look;

/// Half the width of the meadow, in meters.
const MEADOW: f32 = 24.0;

/// Height of the platform, and how far it and the steps reach along x, in meters.
const PLATFORM: f32 = 0.42;
const ALONG_X: [f32; 2] = [1.0, 4.0];

/// Where the ramp, the platform, and each step begin along z, and where the last step ends.
const RAMP: f32 = -2.3;
const TOP: f32 = -0.7;
const STEPS: [f32; 3] = [0.6, 0.92, 1.24];

/// Half axes of the path, an ellipse around the origin, along x and z, in meters.
const PATH: [f32; 2] = [2.7, 2.1];

/// The height of the ground at a place.
fn height(x: f32, z: f32) -> f32 {
    if !(ALONG_X[0]..ALONG_X[1]).contains(&x) {
        return 0.0;
    }
    let step = |number: usize| PLATFORM * (1.0 - number as f32 / STEPS.len() as f32);
    match z {
        z if z < RAMP => 0.0,
        z if z < TOP => PLATFORM * (z - RAMP) / (TOP - RAMP),
        z if z < STEPS[0] => PLATFORM,
        z if z < STEPS[1] => step(1),
        z if z < STEPS[2] => step(2),
        _ => 0.0,
    }
}

/// The place at an angle of the path, and its change with the angle.
pub fn path(angle: f32) -> (Vec3, Vec3) {
    let ground = |angle: f32| {
        let (sine, cosine) = ops::sin_cos(angle);
        Vec3::new(PATH[0] * cosine, 0.0, PATH[1] * sine)
    };
    // Half a step of the legs ahead and behind: a person does not jump up a step.
    let heights = (-6..=6).map(|offset| {
        let at = ground(angle + offset as f32 * 0.02);
        height(at.x, at.z)
    });
    let place = ground(angle).with_y(heights.sum::<f32>() / 13.0);
    (place, ground(angle + 0.25 * TAU))
}

/// Triangles without common vertices, so that their edges are drawn sharp.
#[derive(Default)]
struct Faces(Vec<Vec3>);

impl Faces {
    fn quad(&mut self, [a, b, c, d]: [Vec3; 4]) {
        self.0.extend([a, b, c, a, c, d]);
    }

    /// The mesh, with a color for each face.
    fn mesh(&self, color: impl Fn(Vec3, Vec3) -> Vec3) -> Mesh {
        let mut normals = Vec::with_capacity(self.0.len());
        let mut colors = Vec::with_capacity(self.0.len());
        for corners in self.0.as_chunks::<3>().0 {
            let [a, b, c] = *corners;
            let normal = (b - a).cross(c - a).normalize_or_zero();
            normals.extend([normal; 3]);
            let color = color((a + b + c) / 3.0, normal).extend(1.0);
            colors.extend([color.to_array(); 3]);
        }
        Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, self.0.clone())
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
            .with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, colors)
            .with_inserted_indices(Indices::U32((0..self.0.len() as u32).collect()))
    }

    fn collider(&self) -> Collider {
        let triangles = (0..self.0.len() as u32).collect::<Vec<_>>().as_chunks::<3>().0.to_vec();
        Collider::trimesh_with_config(self.0.clone(), triangles, TrimeshFlags::MERGE_DUPLICATE_VERTICES)
    }
}

/// The meadow, in squares.
fn meadow() -> Faces {
    let mut faces = Faces::default();
    let count = 48;
    let at = |place: i32| MEADOW * (2.0 * place as f32 / count as f32 - 1.0);
    for column in 0..count {
        for row in 0..count {
            let (x, z) = ([at(column), at(column + 1)], [at(row), at(row + 1)]);
            faces.quad([(0, 0), (0, 1), (1, 1), (1, 0)].map(|(i, j)| Vec3::new(x[i], 0.0, z[j])));
        }
    }
    faces
}

/// The ramp, the platform, and the steps, with their sides.
fn stairs() -> Faces {
    let mut faces = Faces::default();
    let mut outline = vec![[RAMP, 0.0], [TOP, PLATFORM]];
    for (number, &z) in STEPS.iter().enumerate() {
        let below = PLATFORM * (1.0 - (number + 1) as f32 / STEPS.len() as f32);
        outline.extend([[z, outline[outline.len() - 1][1]], [z, below]]);
    }
    let [left, right] = ALONG_X;
    for ends in outline.windows(2) {
        let [from, to] = [ends[0], ends[1]];
        let at = |x: f32, [z, y]: [f32; 2]| Vec3::new(x, y, z);
        faces.quad([at(left, from), at(left, to), at(right, to), at(right, from)]);
        // The sides below what lies level or slopes.
        if to[0] > from[0] {
            let foot = |x: f32, [z, _]: [f32; 2]| Vec3::new(x, 0.0, z);
            faces.quad([at(right, from), at(right, to), foot(right, to), foot(right, from)]);
            faces.quad([foot(left, from), foot(left, to), at(left, to), at(left, from)]);
        }
    }
    faces
}

pub fn plugin(app: &mut App) {
    app.add_systems(Startup, spawn);
}

fn spawn(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>) {
    let grass = |center: Vec3, _: Vec3| {
        let is_even = (center.x.floor() + center.z.floor()).rem_euclid(2.0) == 0.0;
        Vec3::new(0.13, 0.2, 0.075) * if is_even { 1.0 } else { 0.9 }
    };
    let stone = |_: Vec3, normal: Vec3| Vec3::new(0.36, 0.32, 0.27) * if normal.y > 0.5 { 1.0 } else { 0.8 };
    let parts: [(Faces, Look, &dyn Fn(Vec3, Vec3) -> Vec3); 2] =
        [(meadow(), Look::Ground, &grass), (stairs(), Look::Stone, &stone)];
    for (faces, look, color) in parts {
        commands.spawn((
            look,
            Mesh3d(meshes.add(faces.mesh(color))),
            RigidBody::Static,
            faces.collider(),
            SurfaceFriction::default(),
            Transform::default(),
        ));
    }
}
