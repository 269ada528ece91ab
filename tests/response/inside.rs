//! What begins inside a solid is led out within a second, and does not fly apart.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, cuboid, grid, icosphere},
};
use glam::Vec3;

use crate::{
    harness::{Scene, TICK},
    truth::{Closed, doubles},
};

/// How the solid is given to the engine.
#[derive(Clone, Copy, Debug)]
enum As {
    Shape,
    Surface,
    Hull,
}

fn add_solid(scene: &mut Scene, mesh: &Mesh, kind: As) {
    let corners: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
    match kind {
        As::Surface => {
            scene.add_obstacle(mesh, ());
        }
        As::Shape => {
            let shape = SharedShape::trimesh(corners, mesh.triangles.clone()).unwrap();
            scene.app.world_mut().spawn((RigidShape(shape), Transform::default()));
        }
        As::Hull => {
            let shape = SharedShape::convex_hull(&corners).unwrap();
            scene.app.world_mut().spawn((RigidShape(shape), Transform::default()));
        }
    }
}

#[test]
fn what_begins_inside_a_solid_is_outside_after_a_second() {
    let mut random = Random::new(0x1751_de00);
    let mut failures = Vec::new();
    let mut began_inside = 0;
    for round in 0..24 {
        let solid = cuboid([0.5, 0.25, 0.4], 3);
        let kind = [As::Shape, As::Surface, As::Hull][round % 3];
        let mut place =
            || Vec3::new(0.3 * random.signed_unit(), 0.15 * random.signed_unit(), 0.2 * random.signed_unit());
        let offset = place();
        let turn = 3.0 * place().x;
        let is_cloth = round % 2 == 0;
        let mesh = if is_cloth { grid(8, 8, 0.15, 0.15, Diagonals::Alternating) } else { icosphere(2, 0.05) };
        let mesh = mesh.rotate([0.0, 0.6, 0.8], turn).translate(offset.to_array());
        let mut scene = Scene::new();
        scene.settings().gravity = Vec3::ZERO;
        add_solid(&mut scene, &solid, kind);
        let material = if is_cloth { XpbdMaterial::CLOTH } else { XpbdMaterial::SOFT };
        let body = scene.add(&mesh, material, (SelfCollision, SweptCollision));
        let corners: Vec<Vec3> = solid.positions.iter().map(|&position| Vec3::from(position)).collect();
        let closed = Closed::new(doubles(&corners), solid.triangles.clone());
        let inside =
            |scene: &Scene| doubles(scene.positions(body)).into_iter().filter(|&point| closed.contains(point)).count();
        began_inside += inside(&scene);
        let mut fastest = 0.0_f32;
        for _ in 0..60 {
            scene.tick(TICK);
            let speeds = scene.body(body).velocities.iter().map(|velocity| velocity.length());
            fastest = speeds.fold(fastest, f32::max);
        }
        let (inside, center) =
            (inside(&scene), scene.positions(body).iter().sum::<Vec3>() / mesh.positions.len() as f32);
        let spread = scene.positions(body).iter().map(|position| position.distance(center)).fold(0.0, f32::max);
        if inside > 0 || spread > 0.2 || fastest > 10.0 {
            failures.push(format!(
                "{round} {kind:?} cloth {is_cloth}: {inside} inside, spread {spread}, fastest {fastest}"
            ));
        }
    }
    assert!(began_inside > 1000, "{began_inside}");
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn a_cloth_spawned_in_the_ground_comes_up_and_lies_on_it() {
    for kind in [As::Shape, As::Surface] {
        let ground = cuboid([2.0, 0.5, 2.0], 4);
        let sheet =
            grid(12, 12, 1.0, 1.0, Diagonals::Alternating).rotate([0.0, 0.0, 1.0], 0.05).translate([0.01, 0.3, 0.02]);
        let mut scene = Scene::new();
        add_solid(&mut scene, &ground, kind);
        let body = scene.add(&sheet, XpbdMaterial::CLOTH, (SelfCollision, SweptCollision));
        scene.run(120);
        let lowest = scene.positions(body).iter().map(|position| position.y).fold(f32::INFINITY, f32::min);
        let highest = scene.positions(body).iter().map(|position| position.y).fold(f32::NEG_INFINITY, f32::max);
        assert!(lowest > 0.5 && highest < 0.6, "{kind:?}: {lowest} {highest}");
    }
}

#[test]
fn what_begins_in_a_block_on_the_ground_comes_out_above_it() {
    let mut scene = Scene::new();
    let block = Transform::from_xyz(0.0, 0.3, 0.0);
    scene.app.world_mut().spawn((RigidShape(SharedShape::cuboid(0.3, 0.3, 0.3)), block));
    scene.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
    let ball = icosphere(2, 0.1).translate([0.0, 0.3, 0.0]);
    let ball = scene.add(&ball, XpbdMaterial::SOFT, SweptCollision);
    scene.run(60);
    let is_inside = |position: &&Vec3| (**position - Vec3::Y * 0.3).abs().max_element() < 0.3 - 1e-4;
    let inside = scene.positions(ball).iter().filter(is_inside).count();
    assert_eq!(inside, 0);
}

#[test]
fn a_soft_ball_that_begins_in_another_comes_out() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let ball = icosphere(2, 0.1);
    let bodies = [[0.0; 3], [0.02, 0.006, 0.002]]
        .map(|at| scene.add(&ball.clone().translate(at), XpbdMaterial::SOFT, (SelfCollision, SweptCollision)));
    scene.run(120);
    let [one, other] = bodies.map(|body| doubles(scene.positions(body)));
    let closed = Closed::new(one, ball.triangles);
    assert_eq!(other.iter().filter(|&&position| closed.contains(position)).count(), 0);
}
