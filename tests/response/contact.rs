//! Contacts and friction against closed forms.

use bevy_circumsphere::{ContactStore, prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, cuboid, grid, icosphere};
use glam::{Quat, Vec3};

use crate::harness::{Scene, TICK, mean};

/// Slides a flat sheet down a slope of a quarter turn less 63.4 degrees, `tan = 1/2`. Returns the distance after a
/// second.
fn slide(friction: f32, obstacle_is_shape: bool) -> f64 {
    let mut scene = Scene::new();
    let friction = SurfaceFriction { static_coefficient: friction, dynamic_coefficient: friction };
    let downhill = Vec3::new(0.8_f32.sqrt(), -0.2_f32.sqrt(), 0.0);
    let angle = 0.5_f64.atan() as f32;
    if obstacle_is_shape {
        let up = Quat::from_rotation_z(-angle) * Vec3::Y;
        scene.app.world_mut().spawn((RigidShape(SharedShape::halfspace(up)), friction));
    } else {
        let slope = grid(12, 12, 12.0, 12.0, Diagonals::Alternating).rotate([0.0, 0.0, 1.0], -angle);
        scene.add_obstacle(&slope, (friction, SurfaceThickness::World(0.005)));
    }
    let distance = if obstacle_is_shape { 0.005 } else { 0.01 };
    let sheet = grid(4, 4, 0.4, 0.4, Diagonals::Alternating).translate([0.0, distance, 0.03]);
    let sheet = sheet.rotate([0.0, 0.0, 1.0], -angle);
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
    let body = scene.add(&sheet, material, (friction, SurfaceThickness::World(0.005)));
    let before = mean(scene.positions(body));
    scene.run(60);
    (mean(scene.positions(body)) - before).dot(downhill.as_dvec3())
}

#[test]
fn a_sheet_slides_as_the_dynamic_friction_says_and_rests_where_the_static_one_holds() {
    let (sine, cosine) = (0.2_f64.sqrt(), 0.8_f64.sqrt());
    for is_shape in [true, false] {
        for friction in [0.0, 0.2, 0.4] {
            let slid = slide(friction as f32, is_shape);
            let expected = 0.5 * 9.81 * (sine - friction * cosine);
            // One step of 600 more or less, and the motion from facet to facet.
            assert!((slid - expected).abs() < 0.02 * 0.5 * 9.81 * sine, "{is_shape} {friction}: {slid} {expected}");
        }
        let held = slide(0.6, is_shape);
        assert!(held.abs() < 1e-3, "{is_shape}: {held}");
    }
}

#[test]
fn a_sheet_rests_at_the_contact_distance() {
    for mesh_floor in [false, true] {
        let mut scene = Scene::new();
        let expected = if mesh_floor {
            scene.add_obstacle(&grid(5, 5, 2.0, 2.0, Diagonals::Uniform), SurfaceThickness::World(0.003));
            0.01
        } else {
            scene.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
            0.007
        };
        let sheet = grid(8, 8, 0.5, 0.5, Diagonals::Alternating).translate([0.011, 0.05, 0.017]);
        let body = scene.add(&sheet, XpbdMaterial::CLOTH, SurfaceThickness::World(0.007));
        scene.run(120);
        for position in scene.positions(body) {
            assert!((position.y - expected).abs() < 2e-4, "{mesh_floor} {position}");
        }
    }
}

#[test]
fn two_bodies_that_meet_keep_their_momentum_and_stick_together() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::SOFT };
    let thickness = SurfaceThickness::World(0.004);
    let [left, right] = [-1.0_f32, 1.0].map(|side| {
        let ball = icosphere(2, 0.1).translate([0.13 * side, 0.0, 0.011 * side]);
        scene.add_changed(&ball, material, |body| body.moving(Vec3::NEG_X * 0.5 * side), thickness)
    });
    let momentum = |scene: &Scene| mean(&scene.body(left).velocities) + mean(&scene.body(right).velocities);
    assert!(momentum(&scene).length() < 1e-7);
    let mut met = 0;
    for _ in 0..60 {
        scene.tick(TICK);
        met += usize::from(scene.diagnostics().pressing > 0);
    }
    assert!(met > 0);
    // Both balls are equal, so equal mean velocities mean equal momenta, except that masses differ from vertex to
    // vertex. For the mean over vertices, this makes a few percent of the exchanged momentum.
    assert!(momentum(&scene).length() < 0.02, "{}", momentum(&scene));
    let gap = mean(scene.positions(right)).x - mean(scene.positions(left)).x;
    assert!(gap > 0.15, "they have passed through each other: {gap}");
}

#[test]
fn a_driven_surface_pushes_a_cloth_along() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let plate =
        scene.add_obstacle(&cuboid([0.3, 0.02, 0.3], 3), (SurfaceThickness::World(0.005), Transform::default()));
    let sheet = grid(10, 10, 0.4, 0.4, Diagonals::Alternating).translate([0.0, 0.05, 0.0]);
    let body = scene.add(&sheet, XpbdMaterial::CLOTH, SurfaceThickness::World(0.005));
    for tick in 0..60 {
        // 0.3 m per second is half the contact distance per tick.
        let height = 0.3 * (tick + 1) as f32 / 60.0;
        scene.app.world_mut().get_mut::<Transform>(plate).unwrap().translation.y = height;
        scene.tick(TICK);
        for position in scene.positions(body) {
            assert!(position.y > height + 0.02, "tick {tick}: {position} is in the plate at {height}");
        }
    }
}

#[test]
fn every_method_carries_a_sheet() {
    for method in ContactMethod::ALL {
        let mut scene = Scene::new();
        scene.add_obstacle(&icosphere(3, 0.2), method);
        let sheet = grid(12, 12, 0.5, 0.5, Diagonals::Alternating).translate([0.01, 0.23, 0.02]);
        let body = scene.add(&sheet, XpbdMaterial::CLOTH, (method, SurfaceThickness::World(0.003)));
        scene.run(60);
        let middle = scene.positions(body)[6 * 13 + 6];
        assert!(middle.is_finite() && middle.y > 0.19, "{method:?}: {middle}");
    }
}

/// Each body looks ahead as far as it moves itself, and the game's setting keeps its value.
#[test]
fn margins_follow_the_motion_of_each_body_and_leave_the_setting_alone() {
    let edge = 0.1;
    let near = |margin: f32| {
        let mut scene = Scene::new();
        scene.app.world_mut().resource_mut::<CircumsphereSettings>().margin = margin;
        let floor = scene.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y))).id();
        let sheet =
            |x: f32| grid(4, 4, 4.0 * edge, 4.0 * edge, Diagonals::Alternating).translate([x, 0.005 + 0.4 * edge, 0.0]);
        let [slow, fast] =
            [0.0, 2.0].map(|x| scene.add(&sheet(x), XpbdMaterial::CLOTH, SurfaceThickness::World(0.005)));
        scene.body_mut(fast).velocities.fill(Vec3::NEG_Y * 2.0);
        scene.tick(TICK);
        assert_eq!(scene.app.world().resource::<CircumsphereSettings>().margin, margin);
        let count = |body: Entity| {
            let pairs = scene.app.world().resource::<ContactStore>().pairs().iter();
            let pairs = pairs.filter(|pair| [pair.a.entity(), pair.b.entity()] == [body, floor]);
            let separations =
                pairs.flat_map(|pair| pair.contacts.iter().map(|contact| contact.distance - pair.contact_distance));
            separations.inspect(|separation| assert!(*separation > 0.0, "{separation}")).count()
        };
        [count(slow), count(fast)]
    };
    // The mean edge of the grid, including diagonals, is 1.14 times its sides. The fast body looks ahead by half of
    // that. The slow one and the floor look ahead by five sixteenths on average.
    let [slow, fast] = near(0.0);
    assert!(slow == 0 && fast == 25, "{slow} {fast}");
    // The setting is a lower bound.
    assert_eq!(near(2.0 * edge), [25, 25]);
}
