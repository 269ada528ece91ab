//! Values that no game uses: nothing panics, and contacts are finite or the body is quarantined with a reason.

use std::panic::{AssertUnwindSafe, catch_unwind};

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use glam::{Quat, Vec3};

use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid};

use crate::{
    shape_kinds::shapes,
    world::{THIN, all, app, at, insert, points, spawn, status, surface, write_positions},
};

/// Small meshes, because at a tiny scale all triangles touch.
fn sheet() -> Mesh {
    grid(3, 3, 4.0, 4.0, Diagonals::Uniform)
}

fn ball() -> Mesh {
    cuboid([0.5, 0.4, 0.3], 1)
}

fn extreme_poses() -> Vec<Transform> {
    let scales = [1.0e-38, 1.0e-20, -1.0e-20, 1.0, 1.0e10, 1.0e20, 1.0e30, 5.0e37, f32::MAX];
    let places = [0.0, 1.0e10, 1.0e20, 3.0e37, 7.9e37, 1.0e38];
    let turn = Quat::from_rotation_x(0.7);
    let mut poses = Vec::new();
    for scale in scales {
        for place in places {
            let still = Transform::from_scale(Vec3::splat(scale)).with_translation(Vec3::new(place, -place, 0.0));
            poses.extend([still, still.with_rotation(turn)]);
        }
    }
    poses
}

/// Runs a tick. Returns the number of contacts, or a description of the failure.
fn tick(app: &mut App, bodies: &[Entity]) -> Result<usize, String> {
    catch_unwind(AssertUnwindSafe(|| app.update())).map_err(|_| "a panic".to_owned())?;
    for &body in bodies {
        match status(app, body) {
            SurfaceStatus::Active => {}
            SurfaceStatus::Quarantined(reason) => {
                if reason.to_string().is_empty() {
                    return Err("no reason".to_owned());
                }
            }
            other => return Err(format!("{other:?}")),
        }
    }
    let contacts = all(app);
    for contact in &contacts {
        let (a, b) = contact.points;
        let is_finite = a.is_finite() && b.is_finite() && contact.distance.is_finite();
        if !is_finite || (contact.normal.length() - 1.0).abs() >= 1.0e-5 {
            return Err(format!("{contact:?}"));
        }
    }
    Ok(contacts.len())
}

/// Panics with a list of everything that was wrong.
#[track_caller]
fn assert_none(wrong: &[String]) {
    let first = &wrong[..wrong.len().min(12)];
    assert!(wrong.is_empty(), "{} failures: {first:#.600?}", wrong.len());
}

#[test]
fn shapes_at_extreme_poses_are_tested_or_set_aside() {
    let (mut wrong, mut seen) = (Vec::new(), 0);
    for (name, shape) in shapes(1.0) {
        for pose in extreme_poses() {
            let mut app = app();
            // `near` stands in the world. `beside` has the pose of the shape.
            let near = spawn(&mut app, &ball(), (THIN, SweptCollision, at(0.1, 0.2, 0.3)));
            let beside = spawn(&mut app, &sheet(), (SurfaceThickness::default(), pose));
            let shape = app.world_mut().spawn((RigidShape(shape.clone()), pose)).id();
            let bodies = [near, beside, shape];
            for round in 0_u8..3 {
                insert(&mut app, near, at(0.1, 0.2 + 0.01 * f32::from(round), 0.3));
                match tick(&mut app, &bodies) {
                    Ok(count) => seen += count,
                    Err(what) => {
                        wrong.push(format!("{name} {pose:?}: {what}"));
                        break;
                    }
                }
            }
        }
    }
    assert_none(&wrong);
    assert!(seen > 1_000, "{seen}");
}

#[test]
fn a_vertex_far_away_does_no_harm() {
    let (mut wrong, mut seen) = (Vec::new(), 0);
    for (name, shape) in shapes(1.0) {
        for far in [1.0e15, 1.0e20, 1.0e38, f32::MAX] {
            for far in [Vec3::X * far, Vec3::splat(-far), Vec3::new(0.0, far, 1.0)] {
                let mut app = app();
                let shape = app.world_mut().spawn((RigidShape(shape.clone()), at(0.1, 0.6, 0.2))).id();
                let sheet = spawn(&mut app, &sheet(), (THIN, SelfCollision, SweptCollision));
                let other = spawn(&mut app, &ball(), (THIN, at(0.3, 0.4, 0.1)));
                let mut positions = points(&self::sheet());
                let bodies = [shape, sheet, other];
                let mut report = |tick: Result<usize, String>| match tick {
                    Ok(count) => seen += count,
                    Err(what) => wrong.push(format!("{name} {far}: {what}")),
                };
                report(tick(&mut app, &bodies));
                positions[7] = far;
                write_positions(&mut app, sheet, &positions);
                report(tick(&mut app, &bodies));
                insert(&mut app, shape, at(0.1, 0.4, 0.2));
                report(tick(&mut app, &bodies));
            }
        }
    }
    assert_none(&wrong);
    assert!(seen > 1_000, "{seen}");
}

#[test]
fn shapes_of_extreme_sizes_are_tested_or_set_aside() {
    let (mut wrong, mut seen, mut refused, mut built) = (Vec::new(), 0, 0, 0);
    for size in [1.0e-45, 1.0e-38, 1.0e-30, 1.0e-20, 1.0e10, 1.0e15, 1.0e20, 1.0e30, 1.0e38] {
        // parry itself panics if it cannot build a shape.
        let Ok(shapes) = catch_unwind(|| shapes(size)) else { continue };
        for (name, shape) in shapes {
            built += 1;
            for place in [0.0, 0.3, size] {
                let mut app = app();
                let near = spawn(&mut app, &ball(), (THIN, SweptCollision, at(0.1, 0.2, 0.3)));
                let large = ball().scale(size);
                let beside = app.world_mut().spawn((surface(&large), SurfaceThickness::default())).id();
                let shape = app.world_mut().spawn((RigidShape(shape.clone()), at(place, 0.0, 0.0))).id();
                for round in 0_u8..2 {
                    insert(&mut app, near, at(0.1, 0.2 + 0.01 * f32::from(round), 0.3));
                    match tick(&mut app, &[near, beside, shape]) {
                        Ok(count) => seen += count,
                        Err(what) => {
                            wrong.push(format!("{name} of {size:e} at {place:e}: {what}"));
                            break;
                        }
                    }
                }
                refused += usize::from(status(&app, shape) != SurfaceStatus::Active);
            }
        }
    }
    println!("{built} shapes, {refused} worlds without theirs, {seen} contacts");
    assert_none(&wrong);
    assert!(seen > 1_000 && built > 50, "{seen} {built}");
}

#[test]
fn surfaces_at_extreme_poses_are_tested_or_set_aside() {
    let (mut wrong, mut seen) = (Vec::new(), 0);
    for method in ContactMethod::ALL {
        for pose in extreme_poses() {
            for extra in [0.0, 0.05] {
                let mut app = app();
                let thickness = SurfaceThickness::MeanEdges(extra);
                let first = spawn(&mut app, &ball(), (thickness, method, pose, SweptCollision, SelfCollision));
                let second = spawn(&mut app, &sheet(), (thickness, method, pose, SweptCollision));
                let third = spawn(&mut app, &ball(), (THIN, method, at(0.1, 0.2, 0.3)));
                let bodies = [first, second, third];
                for _ in 0..2 {
                    match tick(&mut app, &bodies) {
                        Ok(count) => seen += count,
                        Err(what) => {
                            wrong.push(format!("{method:?} {pose:?} {extra}: {what}"));
                            break;
                        }
                    }
                    let moved = pose.with_translation(pose.translation * 1.000_1 + Vec3::X * 0.01);
                    insert(&mut app, first, moved);
                }
            }
        }
    }
    assert_none(&wrong);
    assert!(seen > 1_000, "{seen}");
}

#[test]
fn a_chain_of_tiny_parents_is_tested_or_set_aside() {
    let mut wrong = Vec::new();
    for scale in [1.0e-38, 1.0e-20, 1.0e20, 1.0e38] {
        for depth in 1..12 {
            let mut app = app();
            let mut parent = app.world_mut().spawn(Transform::from_scale(Vec3::splat(scale))).id();
            for _ in 1..depth {
                parent = app.world_mut().spawn((Transform::from_scale(Vec3::splat(scale)), ChildOf(parent))).id();
            }
            let child = spawn(&mut app, &ball(), (SurfaceThickness::default(), ChildOf(parent)));
            let twin = spawn(&mut app, &sheet(), (SurfaceThickness::default(), ChildOf(parent)));
            let shape = app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), ChildOf(parent))).id();
            let near = spawn(&mut app, &ball(), (THIN, SweptCollision, at(0.1, 0.2, 0.3)));
            for _ in 0..2 {
                if let Err(what) = tick(&mut app, &[child, twin, shape, near]) {
                    wrong.push(format!("{depth} parents of {scale:e}: {what}"));
                }
            }
        }
    }
    assert_none(&wrong);
}

#[test]
fn what_is_out_of_range_is_set_aside_with_a_reason_and_comes_back() {
    let [tiny, huge] = [1.0e-31, 1.0e38].map(|scale| Transform::from_scale(Vec3::splat(scale)));
    let cube = SharedShape::trimesh(points(&ball()), ball().triangles).expect("the mesh has triangles");
    for shape in [None, Some(SharedShape::ball(0.5)), Some(cube), Some(SharedShape::halfspace(Vec3::Y))] {
        let is_endless = shape.as_ref().is_some_and(|shape| shape.as_halfspace().is_some());
        let mut app = app();
        let floor = spawn(&mut app, &sheet(), THIN);
        let body = match shape {
            Some(shape) => app.world_mut().spawn((RigidShape(shape), at(0.1, 0.41, 0.2))).id(),
            None => spawn(&mut app, &ball(), (THIN, at(0.1, 0.41, 0.2))),
        };
        for (pose, reason) in [
            (tiny, QuarantineReason::TinyScale),
            (huge, QuarantineReason::OutOfRange),
            (at(0.0, 8.1e37, 0.0), QuarantineReason::OutOfRange),
        ] {
            for _ in 0..2 {
                insert(&mut app, body, at(0.1, if is_endless { 0.01 } else { 0.42 }, 0.2));
                app.update();
                assert_eq!(status(&app, body), SurfaceStatus::Active);
                assert!(!all(&mut app).is_empty());
                insert(&mut app, body, pose);
                for _ in 0..2 {
                    app.update();
                    // A half-space is the same at any scale.
                    let expected = if is_endless && pose == huge {
                        SurfaceStatus::Active
                    } else {
                        SurfaceStatus::Quarantined(reason.clone())
                    };
                    assert_eq!(status(&app, body), expected, "{pose:?}");
                }
                assert_eq!(status(&app, floor), SurfaceStatus::Active);
            }
        }
    }
    // The same holds for a vertex, in the tick in which it is written and in later ones.
    let mut app = app();
    let body = spawn(&mut app, &sheet(), THIN);
    for far in [1.0e37, 1.0e38, 1.0e20, f32::MAX, 0.0] {
        let mut positions = points(&sheet());
        positions[7].y = far;
        write_positions(&mut app, body, &positions);
        for _ in 0..3 {
            app.update();
            let is_out = status(&app, body) == SurfaceStatus::Quarantined(QuarantineReason::OutOfRange);
            assert!(is_out == (far > 8.0e37) && (is_out || status(&app, body) == SurfaceStatus::Active), "{far}");
        }
    }
}
