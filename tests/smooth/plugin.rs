//! `SurfaceShape` in the plugin: poses, mixed pairs, threads, reuse, and changes while the game runs.

use std::collections::HashSet;

use bevy_app::{App, Update};
use bevy_circumsphere::{ContactStore, geometry::CompactContact, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::icosphere;
use glam::{Quat, Vec3};

/// The gap between two balls of radius 1.
const GAP: f32 = 0.02;

fn ball(level: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mesh = icosphere(level, 1.0);
    (mesh.positions.into_iter().map(Vec3::from_array).collect(), mesh.triangles)
}

/// Two balls of 1280 and 320 triangles, a little apart, in a direction in which no vertices face each other.
fn balls(shapes: [SurfaceShape; 2], settings: CircumsphereSettings, scale: f32) -> (App, [Entity; 2]) {
    let (mut app, entities) = spawned(shapes, settings, scale);
    app.update();
    (app, entities)
}

/// The same before the first tick.
fn spawned(shapes: [SurfaceShape; 2], settings: CircumsphereSettings, scale: f32) -> (App, [Entity; 2]) {
    let mut app = App::new();
    app.insert_resource(settings);
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let direction = Vec3::new(0.6, 0.35, 0.2).normalize();
    let poses = [
        Transform::from_rotation(Quat::from_rotation_y(0.4)).with_scale(Vec3::splat(scale)),
        Transform::from_translation(direction * (2.0 + GAP) * scale)
            .with_rotation(Quat::from_rotation_x(1.1))
            .with_scale(Vec3::splat(scale)),
    ];
    let entities = [0, 1].map(|side| {
        let (positions, triangles) = ball(3 - side as u32);
        let surface = DeformableSurface::from_mesh(&positions, &triangles).expect("a ball is a mesh");
        app.world_mut().spawn((surface, poses[side], SurfaceThickness::World(0.1 * scale), shapes[side])).id()
    });
    (app, entities)
}

fn contacts(app: &App) -> Vec<CompactContact> {
    app.world().resource::<ContactStore>().contacts().copied().collect()
}

fn least(app: &App) -> f32 {
    contacts(app).iter().map(|contact| contact.distance).fold(f32::INFINITY, f32::min)
}

#[test]
fn smooth_balls_are_as_far_apart_as_balls() {
    use SurfaceShape::{Flat, Smooth};
    let error = |shapes| (least(&balls(shapes, CircumsphereSettings::default(), 1.0).0) - GAP).abs();
    let (flat, smooth) = (error([Flat, Flat]), error([Smooth, Smooth]));
    assert!(smooth < 0.1 * flat && smooth < 2.0e-3, "{smooth} {flat}");
    // Each side alone takes its own part of the error away.
    let mixed = [error([Smooth, Flat]), error([Flat, Smooth])];
    assert!(mixed.iter().all(|&error| error < flat && error > smooth), "{mixed:?} {flat}");
    assert!((mixed[0] + mixed[1] - flat).abs() < 0.1 * flat, "{mixed:?} {flat}");
}

#[test]
fn scale_does_not_matter() {
    for scale in [1.0e-3, 50.0] {
        let smooth = [SurfaceShape::Smooth; 2];
        let (app, _) = balls(smooth, CircumsphereSettings::default(), scale);
        let error = (least(&app) / scale - GAP).abs();
        assert!(error < 2.0e-3, "{scale}: {error}");
    }
}

#[test]
fn threads_and_reuse_do_not_matter() {
    let smooth = [SurfaceShape::Smooth; 2];
    let settings = |threads, memory| CircumsphereSettings { threads, memory, ..Default::default() };
    let expected = contacts(&balls(smooth, settings(1, true), 1.0).0);
    assert!(expected.len() > 10);
    for (threads, memory) in [(0, true), (2, false), (1, false)] {
        assert_eq!(contacts(&balls(smooth, settings(threads, memory), 1.0).0), expected);
    }
    // A second tick in which nothing moves.
    let (mut app, _) = balls(smooth, settings(1, true), 1.0);
    app.update();
    assert_eq!(contacts(&app), expected);
}

#[test]
fn the_shape_and_the_creases_can_change() {
    let (mut app, entities) = balls([SurfaceShape::Flat; 2], CircumsphereSettings::default(), 1.0);
    let flat = contacts(&app);
    for entity in entities {
        app.world_mut().entity_mut(entity).insert(SurfaceShape::Smooth);
    }
    app.update();
    let smooth = contacts(&app);
    let expected = balls([SurfaceShape::Smooth; 2], CircumsphereSettings::default(), 1.0).0;
    assert_eq!(smooth, contacts(&expected));
    // If every edge is a crease, the patches are flat.
    app.world_mut().resource_mut::<CircumsphereSettings>().crease_angle = 0.0;
    app.update();
    assert_eq!(contacts(&app), flat);
    for entity in entities {
        app.world_mut().entity_mut(entity).insert(SurfaceShape::Flat);
    }
    app.update();
    assert_eq!(contacts(&app), flat);
}

#[test]
fn contacts_lie_on_the_balls_and_point_from_the_first_to_the_second() {
    let (mut app, [first, second]) = balls([SurfaceShape::Smooth; 2], CircumsphereSettings::default(), 1.0);
    let center = app.world().get::<Transform>(second).expect("it has a pose").translation;
    let mut count = 0;
    let mut check = move |contacts: SurfaceContacts| {
        for contact in contacts.between(first, second) {
            let (a, b) = contact.points();
            assert!((a.length() - 1.0).abs() < 2.0e-3 && (b.distance(center) - 1.0).abs() < 6.0e-3);
            assert!((b - a).dot(contact.normal()) > 0.0);
            assert!(((b - a).length() - contact.distance()).abs() < 1.0e-5);
            count += 1;
        }
        count
    };
    let count = bevy_ecs::system::RunSystemOnce::run_system_once(app.world_mut(), move |contacts: SurfaceContacts| {
        check(contacts)
    });
    assert!(count.expect("the system runs") > 10);
}

#[test]
fn enclosing_balls_miss_no_pair_of_patches() {
    let touching = |method: ContactMethod, shape: SurfaceShape| {
        let (mut app, entities) = balls([shape; 2], CircumsphereSettings::default(), 1.0);
        for entity in entities {
            app.world_mut().entity_mut(entity).insert((method, SurfaceThickness::World(GAP)));
        }
        app.update();
        let store = app.world().resource::<ContactStore>();
        store.touching().map(|pair| (pair.triangle_a, pair.triangle_b)).collect::<HashSet<_>>()
    };
    let exact = touching(ContactMethod::Exact, SurfaceShape::Smooth);
    let by_balls = touching(ContactMethod::BoundingSphere, SurfaceShape::Smooth);
    let flat = touching(ContactMethod::BoundingSphere, SurfaceShape::Flat);
    assert!(exact.len() > 10 && exact.is_subset(&by_balls), "{} {}", exact.len(), by_balls.len());
    assert!(by_balls.len() > flat.len(), "{} {}", by_balls.len(), flat.len());
}

/// A smooth ball whose positions never change is turned, so that each tick wants other patches.
#[test]
fn patches_that_are_wanted_later_are_those_of_a_fresh_surface() {
    use SurfaceShape::{Flat, Smooth};
    for shapes in [[Smooth, Smooth], [Smooth, Flat], [Flat, Smooth]] {
        let settings = CircumsphereSettings::default();
        let (mut app, entities) = balls(shapes, settings, 1.0);
        let mut seen = HashSet::new();
        for turn in 0..12 {
            // Apart in every third tick.
            let direction = Quat::from_rotation_z(0.6 * turn as f32) * Vec3::new(0.6, 0.35, 0.2).normalize();
            let distance = if turn % 3 == 2 { 3.0 } else { 2.0 + GAP };
            let pose =
                Transform::from_translation(direction * distance).with_rotation(Quat::from_rotation_x(turn as f32));
            let place = |app: &mut App, entity: Entity| {
                *app.world_mut().get_mut::<Transform>(entity).expect("it has a pose") = pose;
                app.update();
            };
            place(&mut app, entities[1]);
            let (mut fresh, [_, second]) = spawned(shapes, settings, 1.0);
            place(&mut fresh, second);
            let (own, expected) = (contacts(&app), contacts(&fresh));
            assert_eq!(own, expected, "turn {turn}");
            assert_eq!(own.is_empty(), turn % 3 == 2);
            seen.extend(own.iter().map(|contact| (contact.triangle_a, contact.triangle_b)));
        }
        assert!(seen.len() > 100, "{}", seen.len());
    }
}

/// The same for every method, and for balls inside each other, whatever was near before.
#[test]
fn contacts_do_not_depend_on_what_was_near_before() {
    for method in ContactMethod::ALL {
        for depth in [-GAP, 0.3] {
            let moved = |app: &mut App, entity: Entity| {
                let direction = Vec3::new(0.5, 0.7, 0.2).normalize();
                let pose = Transform::from_translation(direction * (2.0 - depth));
                *app.world_mut().get_mut::<Transform>(entity).expect("it has a pose") = pose;
                app.update();
            };
            let spawn = || {
                let shapes = [SurfaceShape::Smooth; 2];
                let (mut app, entities) = spawned(shapes, CircumsphereSettings::default(), 1.0);
                for entity in entities {
                    app.world_mut().entity_mut(entity).insert((method, Sidedness::OneSided));
                }
                (app, entities)
            };
            let (mut app, [_, second]) = spawn();
            // Elsewhere first.
            app.update();
            moved(&mut app, second);
            let (mut fresh, [_, second]) = spawn();
            moved(&mut fresh, second);
            let (own, expected) = (contacts(&app), contacts(&fresh));
            assert!(own == expected && own.len() > 3, "{method:?} {depth}: {} {}", own.len(), expected.len());
        }
    }
}
