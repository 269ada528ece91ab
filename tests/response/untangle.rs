//! Sheets that cross at the start, when their sides are unknown.

use std::f32::consts::FRAC_PI_2;

use bevy_circumsphere::{ContactStore, prelude::*, response::*};
use bevy_math::ops;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, grid, icosphere},
};
use glam::{Quat, Vec3};

use crate::harness::{Scene, ticks_in};

fn crossings(scene: &Scene) -> usize {
    let store = scene.app.world().resource::<ContactStore>();
    store.contacts().filter(|contact| contact.features.kind() == FeatureKind::EdgeFace).count()
}

#[test]
fn a_corner_that_pokes_through_a_sheet_comes_back() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let thickness = SurfaceThickness::World(0.004);
    let border = |vertex: u32| [vertex % 11, vertex / 11].iter().any(|&place| place == 0 || place == 10);
    let pins = (0..121).filter(|&vertex| border(vertex)).map(VertexId);
    let held = grid(10, 10, 0.5, 0.5, Diagonals::Alternating);
    scene.add_changed(&held, XpbdMaterial::CLOTH, |body| body.pinned(pins), thickness);
    // A sheet that stands on its corner. The corner is a few centimeters below the pinned sheet.
    let loose = grid(10, 10, 0.5, 0.5, Diagonals::Alternating)
        .rotate([0.0, 1.0, 0.0], 0.785)
        .rotate([0.0, 0.0, 1.0], 1.3)
        .translate([0.013, 0.31, 0.017]);
    scene.add(&loose, XpbdMaterial::CLOTH, thickness);
    scene.tick(1.0 / 60.0);
    assert!(crossings(&scene) > 3, "too few crossings at the start: {}", crossings(&scene));
    let mut clear = 0;
    for _ in 0..240 {
        scene.tick(1.0 / 60.0);
        clear = if crossings(&scene) == 0 { clear + 1 } else { 0 };
    }
    assert!(clear > 60, "{clear} ticks without a crossing, {} left", crossings(&scene));
}

#[test]
fn sheets_that_cross_in_their_middles_come_apart() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let sheet = grid(10, 10, 0.5, 0.5, Diagonals::Alternating);
    let upright = sheet.clone().rotate([1.0, 0.0, 0.0], 1.2).translate([0.013, 0.02, 0.017]);
    for mesh in [sheet, upright] {
        scene.add(&mesh, XpbdMaterial::CLOTH, (SelfCollision, SweptCollision));
    }
    scene.run(1);
    assert!(crossings(&scene) > 10, "too few crossings at the start: {}", crossings(&scene));
    scene.run(120);
    assert_eq!(crossings(&scene), 0);
}

#[test]
fn sheets_in_random_places_come_apart() {
    let mut random = Random::new(0x5eed);
    let rates = [30.0, 60.0, 120.0];
    let mut left = [const { Vec::new() }; 3];
    let mut began = 0;
    for round in 0..36 {
        let mut scene = Scene::new();
        scene.settings().gravity = Vec3::ZERO;
        let rate = rates[round % 3];
        for _ in 0..2 {
            let [turn, tilt, x, y, z] = std::array::from_fn(|_| random.signed_unit());
            let sheet = grid(8 + round % 5, 10, 0.5, 0.45, Diagonals::Alternating)
                .rotate([0.0, 0.6, 0.8], 3.0 * turn)
                .rotate([1.0, 0.0, 0.0], 3.0 * tilt)
                .translate([x, y, z].map(|place| 0.12 * place));
            scene.add(&sheet, XpbdMaterial::CLOTH, (SelfCollision, SweptCollision));
        }
        scene.tick(1.0 / rate);
        began += usize::from(crossings(&scene) > 0);
        (0..ticks_in(2.0, rate)).for_each(|_| scene.tick(1.0 / rate));
        if crossings(&scene) > 0 {
            left[round % 3].push(format!("{round} {rate} Hz: {}", crossings(&scene)));
        }
    }
    assert!(began > 24, "{began}");
    // With so few ticks, about one pair in ten does not find out of each other.
    let [at_30, others @ ..] = left;
    assert!(at_30.len() <= 3 && others.iter().all(Vec::is_empty), "{at_30:?}, {others:?}");
}

#[test]
fn what_a_wall_has_crushed_crosses_itself_no_longer() {
    let mut crossed = Vec::new();
    for rate in [30.0, 60.0, 120.0] {
        let mut most = 0;
        for speed in [20.0, 40.0, 80.0] {
            let mut scene = Scene::new();
            scene.settings().gravity = Vec3::ZERO;
            let wall = RigidShape(SharedShape::cuboid(2.0, 2.0, 0.1));
            scene.app.world_mut().spawn((wall, Transform::from_xyz(0.0, 0.0, -0.1)));
            let ball = icosphere(2, 0.1).translate([0.01, 0.02, 0.5]);
            let body = scene.add(&ball, XpbdMaterial::SOFT, (SelfCollision, SweptCollision));
            scene.body_mut(body).velocities.fill(Vec3::NEG_Z * speed);
            for _ in 0..ticks_in(1.0, rate) {
                scene.tick(1.0 / rate);
                most = most.max(crossings(&scene));
            }
            assert_eq!(crossings(&scene), 0, "{rate} Hz, {speed} m/s");
            let lowest = scene.positions(body).iter().map(|position| position.z).fold(1.0, f32::min);
            assert!(lowest > 0.0, "{rate} Hz, {speed} m/s: {lowest}");
        }
        println!("{rate} Hz: at most {most} pairs cross");
        crossed.push(most);
    }
    // At a high rate, contacts keep most of it apart.
    assert!(crossed.iter().filter(|&&most| most > 10).count() >= 2, "the body hardly ever crosses itself: {crossed:?}");
}

/// The contacts that say of their features that they have passed through each other.
fn passed(scene: &Scene) -> usize {
    scene.app.world().resource::<ContactStore>().contacts().filter(|contact| contact.distance < 0.0).count()
}

#[test]
fn a_cloth_that_has_come_back_through_the_ground_lies_still_on_it() {
    [0.0, 0.5].into_iter().for_each(lies_still);
}

/// `speed` is that of the cloth at the start, downward.
fn lies_still(speed: f32) {
    let mut scene = Scene::new();
    let thickness = SurfaceThickness::World(0.002);
    let mut ground = grid(60, 60, 1.5, 1.5, Diagonals::Alternating);
    for [x, y, z] in &mut ground.positions {
        *y = 0.06 * ops::sin(5.0 * *x) * ops::sin(6.0 * *z);
    }
    scene.add_obstacle(&ground, thickness);
    let cloth =
        grid(30, 30, 0.75, 0.75, Diagonals::Alternating).rotate([0.0, 1.0, 0.0], 0.3).translate([0.0, 0.1, 0.0]);
    // Without SweptCollision, some of its vertices are beyond the ground before anything is known of them.
    let cloth = scene.add(&cloth, XpbdMaterial::CLOTH, (thickness, SelfCollision));
    scene.body_mut(cloth).velocities.fill(Vec3::NEG_Y * speed);
    let (mut most_crossings, mut most_passed) = (0, 0);
    for _ in 0..20 {
        scene.run(1);
        most_crossings = most_crossings.max(crossings(&scene));
        most_passed = most_passed.max(passed(&scene));
    }
    assert!(most_crossings > 5 && most_passed > 5, "{most_crossings} crossings, {most_passed} contacts passed");
    scene.run(100);
    assert_eq!([crossings(&scene), passed(&scene)], [0, 0]);
    assert!(scene.fastest(cloth) < 0.05, "{} m/s", scene.fastest(cloth));
}

/// A cloth that self-collision alone does not keep apart: its halves strike each other at several meters per second, and
/// cross.
#[test]
fn a_cloth_that_crosses_itself_all_over_crumples_no_further() {
    let bar = (SharedShape::cylinder(1.0, 0.02), Transform::from_rotation(Quat::from_rotation_z(FRAC_PI_2)));
    let post = (SharedShape::cuboid(0.2, 0.5, 0.2), Transform::from_xyz(0.0, -0.5, 0.0));
    for ((shape, place), height, rate) in [(bar, 0.05, 60.0), (post, 1.0, 30.0)] {
        let mut scene = Scene::new();
        let cloth = grid(40, 40, 1.0, 1.0, Diagonals::Alternating).translate([0.0, height, 0.0]);
        let triangles = cloth.triangles.len();
        let cloth = scene.add(&cloth, XpbdMaterial::CLOTH, (SelfCollision, SurfaceThickness::World(0.004)));
        scene.app.world_mut().spawn((RigidShape(shape), place));
        let ground = SharedShape::halfspace(Vec3::Y);
        scene.app.world_mut().spawn((RigidShape(ground), Transform::from_xyz(0.0, -1.7, 0.0)));
        let mut most = 0;
        for _ in 0..ticks_in(2.5, rate) {
            scene.tick(1.0 / rate);
            most = most.max(crossings(&scene));
            let contacts = scene.diagnostics().contacts;
            assert!(contacts < 10 * triangles, "{rate} Hz: {contacts} contacts of {triangles} triangles");
        }
        assert!(most > 100, "{rate} Hz: only {most} pairs ever cross");
        let squares = scene.body(cloth).velocities.iter().map(|velocity| velocity.length_squared());
        let speed = (squares.sum::<f32>() / scene.positions(cloth).len() as f32).sqrt();
        assert!(speed < 0.6, "{rate} Hz: {speed} m/s, root mean square");
    }
}
