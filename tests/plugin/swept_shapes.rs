//! A surface that passes through a rigid shape between two ticks, or a shape that passes through a surface: closed
//! forms for shapes of every kind.

use bevy_app::prelude::*;
use bevy_circumsphere::{detection::SweptImpacts, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use glam::{Quat, Vec3};
use parry3d::{math::Pose, shape::SharedShape};

use crate::{
    swept::{all, first},
    world::{THIN, app, assert_near_vector, at, insert, sheet, spawn},
};

/// Rotations and radii are rounded to f32, and paths are a few units long.
const EARLY: f64 = 1.0e-6;

/// Shapes around the origin, and how high they reach.
fn shapes() -> Vec<(&'static str, SharedShape, f64)> {
    let two = [(-0.4, 0.2), (0.4, 0.1)]
        .map(|(x, half)| (Pose::from_translation(Vec3::X * x), SharedShape::cuboid(0.1, half, 0.1)));
    let corners =
        [Vec3::new(-0.3, -0.2, 0.1), Vec3::new(0.2, 0.35, 0.0), Vec3::new(0.3, -0.1, 0.3), Vec3::new(0.0, -0.1, -0.3)];
    vec![
        ("ball", SharedShape::ball(0.3), 0.3),
        ("capsule", SharedShape::capsule_x(0.2, 0.25), 0.25),
        ("cuboid", SharedShape::cuboid(0.3, 0.2, 0.1), 0.2),
        ("round cuboid", SharedShape::round_cuboid(0.3, 0.2, 0.1, 0.05), 0.25),
        ("cylinder", SharedShape::cylinder(0.4, 0.1), 0.4),
        ("cone", SharedShape::cone(0.35, 0.2), 0.35),
        ("convex polyhedron", SharedShape::convex_hull(&corners).expect("four corners span a hull"), 0.35),
        ("compound", SharedShape::compound(two.to_vec()), 0.2),
        ("half-space", SharedShape::halfspace(Vec3::Y), 0.0),
        (
            "triangle mesh",
            SharedShape::trimesh(corners.to_vec(), vec![[0, 1, 2], [0, 3, 1]]).expect("the mesh is valid"),
            0.35,
        ),
        ("triangle", SharedShape::triangle(corners[0], corners[1], corners[2]), 0.35),
        ("polyline", SharedShape::polyline(corners.to_vec(), None), 0.35),
    ]
}

fn is_made_of_triangles(name: &str) -> bool {
    ["triangle mesh", "triangle", "polyline"].contains(&name)
}

/// A swept sheet and a shape, after the tick in which both were new.
fn scene(shape: &SharedShape, sheet_at: Transform, shape_at: Transform) -> (App, Entity, Entity) {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), (THIN, sheet_at, SweptCollision));
    let shape = app.world_mut().spawn((RigidShape(shape.clone()), shape_at)).id();
    app.update();
    assert_eq!(all(&mut app), [], "nothing has moved yet");
    (app, sheet, shape)
}

#[test]
fn a_sheet_that_falls_onto_a_shape_meets_it_at_its_top() {
    for (name, shape, top) in shapes() {
        let (mut app, sheet, shape) = scene(&shape, at(0.0, 1.0, 0.0), Transform::IDENTITY);
        insert(&mut app, sheet, at(0.0, -2.0, 0.0));
        app.update();
        let expected = (1.0 - top) / 3.0;
        let seen = first(&mut app, sheet, shape).unwrap_or_else(|| panic!("{name}: it fell through undetected"));
        assert!((seen.time - expected).abs() < EARLY, "{name}: {} instead of {expected}", seen.time);
        assert_near_vector(seen.normal, Vec3::NEG_Y, 1.0e-5, name);
        assert_eq!((seen.cause, seen.b), (ImpactCause::Reached, shape), "{name}");
        let formula = !is_made_of_triangles(name);
        assert_eq!(seen.triangles.1.is_none(), formula, "{name}");
        assert_eq!(seen.stencil.iter().all(|entry| entry.entity == sheet), formula, "{name}: {:?}", seen.stencil);
        let share: f32 = seen.stencil.iter().filter(|entry| entry.entity == sheet).map(|entry| entry.weight).sum();
        assert!((share + 1.0).abs() < 1.0e-6, "{name}: {share}");
        // Read from the shape's side.
        let other = first(&mut app, shape, sheet).expect("the impact can be read from both sides");
        assert_eq!((other.normal, other.triangles.0), (-seen.normal, seen.triangles.1), "{name}");
    }
}

#[test]
fn a_shape_that_the_game_moves_meets_a_resting_sheet_on_its_way() {
    for (name, shape, top) in shapes() {
        let turn = Quat::from_rotation_y(0.7);
        let place = |height| at(0.1, height, 0.2).with_rotation(turn);
        let (mut app, sheet, shape) = scene(&shape, Transform::IDENTITY, place(-1.0));
        insert(&mut app, shape, place(3.0));
        app.update();
        let expected = (1.0 - top) / 4.0;
        let seen = first(&mut app, sheet, shape).unwrap_or_else(|| panic!("{name}: it went through undetected"));
        assert!((seen.time - expected).abs() < EARLY, "{name}: {} instead of {expected}", seen.time);
        assert_near_vector(seen.normal, Vec3::NEG_Y, 1.0e-5, name);
        app.update();
        assert_eq!(all(&mut app), [], "{name}: impacts are of one tick");
    }
}

#[test]
fn what_flies_along_with_a_shape_does_not_meet_it() {
    for (name, shape, top) in shapes() {
        let (mut app, sheet, shape) = scene(&shape, at(0.0, 0.5 + top as f32, 0.0), Transform::IDENTITY);
        for step in 1..4 {
            let down = Vec3::new(1.0, -3.0, 0.5) * step as f32;
            insert(&mut app, sheet, Transform::from_translation(down + Vec3::Y * (0.5 + top as f32)));
            insert(&mut app, shape, Transform::from_translation(down));
            app.update();
            assert_eq!(all(&mut app), [], "{name}");
        }
    }
}

#[test]
fn a_shape_is_swept_where_one_of_both_sides_asks() {
    for asks in [[false, false], [true, false], [false, true]] {
        for (name, shape, _) in shapes() {
            let mut app = app();
            let sheet = spawn(&mut app, &sheet(), THIN);
            let shape = app.world_mut().spawn((RigidShape(shape), at(0.0, 2.0, 0.0))).id();
            for (entity, _) in [sheet, shape].into_iter().zip(asks).filter(|(_, asks)| *asks) {
                insert(&mut app, entity, SweptCollision);
            }
            app.update();
            insert(&mut app, shape, at(0.0, -2.0, 0.0));
            app.update();
            assert_eq!(first(&mut app, sheet, shape).is_some(), asks != [false, false], "{name} {asks:?}");
        }
    }
}

#[test]
fn a_jump_a_new_shape_and_a_pause_are_no_way_of_a_shape() {
    for (name, shape, _) in shapes() {
        let (mut app, sheet, entity) = scene(&shape, Transform::IDENTITY, at(0.0, 2.0, 0.0));
        let moved = |app: &mut App, height: f32| {
            insert(app, entity, at(0.0, height, 0.0));
            app.update();
            first(app, sheet, entity).is_some()
        };
        assert!(moved(&mut app, -2.0), "{name}");
        insert(&mut app, entity, Teleported);
        assert!(!moved(&mut app, 2.0), "{name}: a jump");
        assert!(moved(&mut app, -2.0), "{name}: swept from where it jumped to");
        insert(&mut app, entity, SurfaceDisabled);
        app.update();
        app.world_mut().entity_mut(entity).remove::<SurfaceDisabled>();
        assert!(!moved(&mut app, 2.0), "{name}: a pause");
        insert(&mut app, entity, RigidShape(SharedShape::ball(0.2)));
        assert!(!moved(&mut app, -2.0), "{name}: another shape");
        assert!(moved(&mut app, 2.0), "{name}");
        insert(&mut app, entity, SurfaceLayers { memberships: 2, filters: 2 });
        assert!(!moved(&mut app, -2.0), "{name}: other layers");
    }
}

#[test]
fn all_parts_of_a_compound_are_one_pair() {
    let parts = [-0.8, 0.0, 0.9].map(|x| (Pose::from_translation(Vec3::X * x), SharedShape::ball(0.2 + 0.1 * x)));
    let (mut app, sheet, shape) = scene(&SharedShape::compound(parts.to_vec()), at(0.0, 1.0, 0.0), Transform::IDENTITY);
    insert(&mut app, sheet, at(0.0, -1.0, 0.0));
    app.update();
    let pairs = &app.world().resource::<SweptImpacts>().pairs;
    assert_eq!(pairs.len(), 1);
    let numbers: Vec<u32> = pairs[0].impacts.iter().map(|impact| impact.part_b).collect();
    assert!(numbers.is_sorted() && [0, 1, 2].iter().all(|part| numbers.contains(part)), "{numbers:?}");
    let seen = first(&mut app, sheet, shape).expect("the bodies meet");
    assert!((seen.time - (1.0 - 0.29) / 2.0).abs() < EARLY, "the largest ball first: {}", seen.time);
}

#[test]
fn a_tilted_half_space_far_from_the_origin_is_met_in_time() {
    let normal = Vec3::new(0.3, 0.9, -0.2).normalize();
    let offset = Vec3::new(300.0, -200.0, 500.0);
    let (mut app, sheet, shape) = scene(
        &SharedShape::halfspace(normal),
        Transform::from_translation(offset + Vec3::Y * 5.0),
        Transform::from_translation(offset),
    );
    insert(&mut app, sheet, Transform::from_translation(offset - Vec3::Y * 5.0));
    app.update();
    // The lowest corner of the sheet along the normal.
    let reach = f64::from(2.0 * (normal.x.abs() + normal.z.abs()));
    let expected = (5.0 - reach / f64::from(normal.y)) / 10.0;
    let seen = first(&mut app, sheet, shape).expect("the bodies meet");
    assert!(seen.time < expected + EARLY && seen.time > expected - 1.0e-5, "{} instead of {expected}", seen.time);
}
