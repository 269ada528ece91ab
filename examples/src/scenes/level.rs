//! A typical game level: cloths, a flag, and soft balls on ground made of every kind of rigid shape, with moving
//! platforms and a fast ball.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{
    Diagonals, LEVEL_CELLS, LEVEL_HALF_WIDTH, Mesh, cuboid, grid, icosphere, level_ball, level_ferry, level_ground,
    level_heights, level_lift,
};
use glam::{Quat, Vec3};
use parry3d::{math::Pose, utils::Array2};

use super::{Scene, Stage, Variation};
use crate::headless::recording::Recorder;

/// Number of stairs. Each is 0.3 m deep and 0.15 m high.
const STEPS: u8 = 4;

/// The level with everything above its ground.
pub fn level(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    add_ground(&mut stage);
    let lift = stage.add_shape("lift", SharedShape::cuboid(0.5, 0.05, 0.5), place(level_lift(0.0), 0.0));
    let ferry = trimesh(&cuboid([0.5, 0.05, 0.5], 3));
    let (middle, angle) = level_ferry(0.0);
    let ferry = stage.add_shape("ferry", ferry, place(middle, angle));
    let speed = variation.ball_speed;
    let ball = stage.add_shape("ball", SharedShape::ball(0.12), place(level_ball(0.0, speed), 0.0));

    let cells = variation.extent.pick(8, 20);
    let sheet =
        |at: [f32; 3]| grid(cells, cells, 0.7, 0.7, Diagonals::Alternating).rotate([0.0, 1.0, 0.0], 0.3).translate(at);
    // Above the mesh, the height field, both, the stairs, the slab, the lift, and the ferry.
    let places: [[f32; 3]; 7] = [
        [-1.8, 0.8, -2.2],
        [1.5, 0.8, -0.2],
        [0.05, 1.2, 2.2],
        [1.5, 1.6, -1.6],
        [-1.0, 1.6, -0.6],
        [1.8, 1.1, 1.5],
        [-1.8, 1.2, 1.8],
    ];
    for at in places {
        stage.add_body("cloth", &sheet(at), XpbdMaterial::CLOTH, |body| body, SelfCollision);
    }
    for [x, y, z] in places {
        let ball = icosphere(variation.extent.pick(1, 2), 0.1).translate([x + 0.05, y + 0.4, z - 0.03]);
        stage.add_body("soft ball", &ball, XpbdMaterial::SOFT, |body| body, ());
    }
    // Upright in the path of the ball, pinned along its upper edge.
    let flag = grid(cells, cells, 0.8, 0.8, Diagonals::Alternating)
        .rotate([1.0, 0.0, 0.0], std::f32::consts::FRAC_PI_2)
        .translate([0.0, 1.3, -0.5]);
    let upper = (0..).zip(&flag.positions).filter(|(_, at)| at[1] > 1.699).map(|(vertex, _)| VertexId(vertex));
    let upper: Vec<VertexId> = upper.collect();
    stage.add_body("flag", &flag, XpbdMaterial::CLOTH, |body| body.pinned(upper), SelfCollision);
    Scene::new(stage, 240).judged().animated(move |stage, time| {
        stage.place(lift, place(level_lift(time), 0.0));
        let (middle, angle) = level_ferry(time);
        stage.place(ferry, place(middle, angle));
        stage.place(ball, place(level_ball(time, speed), 0.0));
    })
}

fn add_ground(stage: &mut Stage) {
    stage.add_shape("mesh", trimesh(&level_ground()), Transform::IDENTITY);
    let heights = level_heights();
    let [columns, rows] = LEVEL_CELLS.map(|cells| cells + 1);
    // Columns of the array run along x, and the numbers run down the columns.
    let by_column = (0..columns).flat_map(|column| heights.iter().map(move |row| row[column])).collect();
    let scale = Vec3::new(LEVEL_HALF_WIDTH, 1.0, 2.0 * LEVEL_HALF_WIDTH);
    let field = SharedShape::heightfield(Array2::new(rows, columns, by_column), scale);
    stage.add_shape("height field", field, Transform::from_xyz(0.5 * LEVEL_HALF_WIDTH, 0.0, 0.0));
    let steps = (0..STEPS).map(f32::from).map(|step| {
        let height = 0.15 * (f32::from(STEPS) - step);
        let middle = Vec3::new(0.0, 0.5 * height, 0.3 * step);
        (Pose::from_translation(middle), SharedShape::cuboid(0.5, 0.5 * height, 0.15))
    });
    stage.add_shape("stairs", SharedShape::compound(steps.collect()), Transform::from_xyz(1.5, -0.1, -2.0));
    stage.add_shape("slab", SharedShape::cuboid(0.6, 0.02, 0.6), Transform::from_xyz(-1.0, 0.7, -0.6));
    // Far below, to catch what falls off the border of the level.
    stage.add_shape("abyss", SharedShape::halfspace(Vec3::Y), Transform::from_xyz(0.0, -20.0, 0.0));
}

fn trimesh(mesh: &Mesh) -> SharedShape {
    let positions = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
    SharedShape::trimesh(positions, mesh.triangles.clone()).expect("scene meshes are valid")
}

fn place(middle: [f32; 3], angle: f32) -> Transform {
    Transform::from_translation(Vec3::from(middle)).with_rotation(Quat::from_rotation_y(angle))
}
