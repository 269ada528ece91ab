//! Bodies that start inside a solid are led out within a second and do not fly apart.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, cuboid, grid, icosphere},
};
use glam::Vec3;

use crate::{
    harness::{Scene, TICK, ticks_in},
    truth::{Closed, doubles},
};

/// How the solid is represented.
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
            fastest = fastest.max(scene.fastest(body));
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

/// Solids around a place, with a body inside.
struct Start {
    /// Centers and half sizes of boxes. The ground is below y = 0.
    boxes: Vec<[Vec3; 2]>,
    mesh: Mesh,
    material: XpbdMaterial,
}

fn start(kind: usize, random: &mut Random) -> Start {
    let mut vector = || Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
    let turned = |mesh: Mesh, by: Vec3| mesh.rotate([0.0, 0.6, 0.8], 3.0 * by.x).rotate([1.0, 0.0, 0.0], by.y);
    let (boxes, mesh, material, at) = match kind {
        // On the ground.
        0 => {
            let half = Vec3::new(0.3, 0.25, 0.3) + 0.1 * vector();
            let center = Vec3::Y * half.y;
            let at = center + 0.6 * half * vector();
            (vec![[center, half]], icosphere(2, 0.08), XpbdMaterial::SOFT, at.max(Vec3::new(-1.0, 0.2, -1.0)))
        }
        // Two boxes that overlap.
        1 => {
            let second = Vec3::new(0.15, 0.2, 0.1 * vector().x);
            let boxes = vec![[Vec3::new(-0.1, 0.2, 0.0), Vec3::splat(0.2)], [second, Vec3::splat(0.2)]];
            (boxes, icosphere(2, 0.06), XpbdMaterial::SOFT, Vec3::Y * 0.2 + 0.1 * vector() * Vec3::new(1.0, 0.5, 0.5))
        }
        // Beside a wall.
        2 => {
            let wall = [Vec3::new(0.75, 1.0, 0.0), Vec3::new(0.5, 1.0, 1.0)];
            let boxes = vec![[Vec3::Y * 0.25, Vec3::splat(0.25)], wall];
            (boxes, icosphere(2, 0.08), XpbdMaterial::SOFT, Vec3::new(0.15, 0.2, 0.0) + 0.05 * vector())
        }
        _ => {
            let at = Vec3::Y * 0.3 + 0.1 * vector();
            let sheet = grid(8, 8, 0.3, 0.3, Diagonals::Alternating).rotate([1.0, 0.0, 0.0], 0.3 * vector().x);
            (vec![[Vec3::Y * 0.3, Vec3::splat(0.3)]], sheet, XpbdMaterial::CLOTH, at)
        }
    };
    Start { boxes, mesh: turned(mesh, vector() * 0.3).translate(at.to_array()), material }
}

#[test]
fn what_begins_in_blocks_among_others_comes_out_to_where_there_is_room() {
    let mut random = Random::new(0x0b10_c5ed);
    let mut failures = Vec::new();
    let mut began_inside = 0;
    for round in 0..36 {
        let Start { boxes, mesh, material } = start(round % 4, &mut random);
        let kind = [As::Shape, As::Surface, As::Hull][round / 4 % 3];
        let rate = [30.0, 60.0, 120.0][round / 12];
        let mut scene = Scene::new();
        let ground = [Vec3::Y * -0.5, Vec3::new(3.0, 0.5, 3.0)];
        for [center, half] in boxes.iter().chain([&ground]) {
            add_solid(&mut scene, &cuboid(half.to_array(), 3).translate(center.to_array()), kind);
        }
        let body = scene.add(&mesh, material, (SelfCollision, SweptCollision));
        let depth = |position: Vec3| {
            let depth = |[center, half]: &[Vec3; 2]| (*half - (position - *center).abs()).min_element();
            boxes.iter().chain([&ground]).map(depth).fold(f32::NEG_INFINITY, f32::max)
        };
        let inside = |scene: &Scene| scene.positions(body).iter().filter(|&&position| depth(position) > 1e-3).count();
        began_inside += inside(&scene);
        let mut fastest = 0.0_f32;
        for _ in 0..ticks_in(1.0, rate) {
            scene.tick(1.0 / rate);
            fastest = fastest.max(scene.fastest(body));
        }
        if inside(&scene) > 0 || fastest > 12.0 {
            failures.push(format!("{round} {kind:?} {rate} Hz: {} inside, fastest {fastest}", inside(&scene)));
        }
    }
    assert!(began_inside > 3000, "{began_inside}");
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn a_ball_that_appears_in_a_cloth_on_a_block_lifts_it() {
    let mut random = Random::new(0xba11);
    for (round, rate) in [30.0, 60.0, 120.0].into_iter().cycle().take(12).enumerate() {
        let kind = [As::Shape, As::Surface, As::Hull][round / 3 % 3];
        let mut scene = Scene::new();
        add_solid(&mut scene, &cuboid([0.5, 0.1, 0.5], 3), kind);
        let sheet = grid(12, 12, 0.8, 0.8, Diagonals::Alternating).translate([0.0, 0.15, 0.0]);
        let body = scene.add(&sheet, XpbdMaterial::CLOTH, (SelfCollision, SweptCollision));
        (0..ticks_in(0.5, rate)).for_each(|_| scene.tick(1.0 / rate));
        let radius = 0.12 + 0.04 * random.signed_unit();
        let [x, y, z] = std::array::from_fn(|_| random.signed_unit());
        let center = Vec3::new(0.2 * x, 0.1 + radius * (0.1 + 0.4 * y), 0.2 * z);
        let at = Transform::from_translation(center);
        scene.app.world_mut().spawn((RigidShape(SharedShape::ball(radius)), at));
        let inside = |scene: &Scene| {
            let is_inside = |position: &&Vec3| position.distance(center) < radius - 1e-3;
            scene.positions(body).iter().filter(is_inside).count()
        };
        assert!(inside(&scene) > 2, "{round}: hardly any vertex is inside at the start");
        (0..ticks_in(1.0, rate)).for_each(|_| scene.tick(1.0 / rate));
        assert_eq!(inside(&scene), 0, "{round} {kind:?} {rate} Hz");
        let lowest = scene.positions(body).iter().filter(|position| position.x.abs().max(position.z.abs()) < 0.45);
        assert!(lowest.map(|position| position.y).fold(1.0, f32::min) > 0.1 - 1e-3, "{round} {kind:?} {rate} Hz");
    }
}

#[test]
fn soft_balls_in_one_place_part() {
    let mut random = Random::new(0x50f7);
    for round in 0..9 {
        let mut scene = Scene::new();
        scene.settings().gravity = Vec3::ZERO;
        let rate = [30.0, 60.0, 120.0][round % 3];
        let mut some = || std::array::from_fn(|_| 0.05 * random.signed_unit());
        let balls: Vec<Mesh> = (0..2 + round % 2).map(|_| icosphere(2, 0.1).translate(some())).collect();
        let bodies: Vec<Entity> =
            balls.iter().map(|ball| scene.add(ball, XpbdMaterial::SOFT, (SelfCollision, SweptCollision))).collect();
        (0..ticks_in(1.0, rate)).for_each(|_| scene.tick(1.0 / rate));
        for (one, ball) in bodies.iter().zip(&balls) {
            let closed = Closed::new(doubles(scene.positions(*one)), ball.triangles.clone());
            for other in bodies.iter().filter(|other| *other != one) {
                let inside = doubles(scene.positions(*other)).into_iter().filter(|&point| closed.contains(point));
                assert_eq!(inside.count(), 0, "{round}");
            }
        }
    }
}
