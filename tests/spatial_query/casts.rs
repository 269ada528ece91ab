//! What moving balls and solids meet first, against parry in f64.

use bevy_circumsphere::ShapeHit;
use bevy_circumsphere::prelude::*;
use circumsphere_support::{random::Random, scenes::icosphere};
use glam::{DVec3, Quat, Vec3};
use parry3d_f64::{
    math::Pose,
    query::{ShapeCastOptions, cast_shapes, distance},
    shape::{Ball, Capsule, Cuboid, Shape, Triangle},
};

use crate::world::{ALL, app, query, random_pose, random_rotation, random_vector, spawn, world_triangles};

/// The first hit of all triangles, by parry.
fn first(triangles: &[[DVec3; 3]], pose: &Pose, shape: &dyn Shape, direction: DVec3) -> f64 {
    let options = ShapeCastOptions { max_time_of_impact: 4.0, ..ShapeCastOptions::default() };
    triangles
        .iter()
        .filter_map(|&[a, b, c]| {
            let triangle = Triangle::new(a, b, c);
            let hit = cast_shapes(pose, direction, shape, &Pose::IDENTITY, DVec3::ZERO, &triangle, options);
            hit.expect("parry knows both").map(|hit| hit.time_of_impact)
        })
        .fold(f64::INFINITY, f64::min)
}

/// How far a shape is from all triangles after it has moved.
fn gap(triangles: &[[DVec3; 3]], pose: &Pose, shape: &dyn Shape) -> f64 {
    triangles
        .iter()
        .map(|&[a, b, c]| {
            distance(pose, shape, &Pose::IDENTITY, &Triangle::new(a, b, c)).expect("parry knows both").distance
        })
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn balls_and_solids_stop_where_parry_says() {
    let mut random = Random::new(31);
    let (mut hits, mut misses) = (0, 0);
    for _ in 0..6 {
        let mut app = app();
        let center = Vec3::new(1.0, 2.0, 3.0);
        let entity = spawn(&mut app, &icosphere(2, 1.0), random_pose(&mut random, center));
        app.update();
        let triangles = world_triangles(&app, entity);
        for number in 0..60 {
            let translation = center + random_vector(&mut random).normalize() * 5.0;
            let target = center + random_vector(&mut random) * 2.0;
            let direction = (target - translation) * (0.5 + random.unit() as f32);
            let rotation = if number % 3 == 0 { Quat::IDENTITY } else { random_rotation(&mut random) };
            let (shape, reference): (SharedShape, Box<dyn Shape>) = match number % 3 {
                0 => (SharedShape::ball(0.3), Box::new(Ball::new(0.3_f32.into()))),
                1 => (SharedShape::capsule_y(0.3, 0.2), Box::new(Capsule::new_y(0.3_f32.into(), 0.2_f32.into()))),
                _ => (SharedShape::cuboid(0.3, 0.2, 0.5), Box::new(Cuboid::new(Vec3::new(0.3, 0.2, 0.5).as_dvec3()))),
            };
            let found: Option<ShapeHit> = query(&mut app, move |query| {
                query.cast_shape(&shape, translation, rotation, direction, 4.0, &ALL).expect("it is a solid")
            });
            let way = direction.as_dvec3();
            let turned = rotation.as_dquat().normalize();
            let at = |distance: f64| Pose::from_parts(translation.as_dvec3() + way * distance, turned);
            let expected = first(&triangles, &at(0.0), &*reference, way);
            let Some(found) = found else {
                // parry stops a little before it touches.
                assert!(expected > 4.0 || gap(&triangles, &at(expected), &*reference) > -1.0e-3, "misses {expected}");
                misses += 1;
                continue;
            };
            hits += 1;
            let distance = f64::from(found.distance);
            // It touches there, and not before. Distances are rounded to f32.
            let rounding = 2.0 * f64::from(f32::EPSILON) * distance * way.length();
            assert!(gap(&triangles, &at(distance), &*reference) < 1.0e-6 + rounding, "{found:?} does not touch");
            for share in [0.25, 0.5, 0.75, 0.9, 0.99, 0.999] {
                assert!(gap(&triangles, &at(distance * share), &*reference) > 0.0, "{found:?} has touched before");
            }
            assert!((found.normal.length() - 1.0).abs() < 1.0e-5, "{found:?}");
            assert!(found.normal.dot(direction) < 0.0, "{found:?}");
            let corners = triangles[found.triangle.expect("a surface has triangles").index()];
            let nearest = crate::truth::closest_on(&corners, found.point.as_dvec3());
            assert!(nearest.distance(found.point.as_dvec3()) < 1.0e-4, "{found:?} is not on its triangle");
        }
    }
    assert!(hits > 100 && misses > 20, "{hits} {misses}");
}

#[test]
fn what_overlaps_at_the_start_is_hit_at_once() {
    let mut app = app();
    spawn(&mut app, &icosphere(2, 1.0), ());
    app.update();
    query(&mut app, |query| {
        let inside = query.cast_ball(Vec3::X, 0.25, Vec3::X, 5.0, &ALL).expect("it overlaps");
        assert_eq!((inside.distance, inside.normal), (0.0, Vec3::NEG_X));
        let cube = SharedShape::cuboid(0.2, 0.2, 0.2);
        let inside = query.cast_shape(&cube, Vec3::X, Quat::IDENTITY, Vec3::X, 5.0, &ALL).expect("it is a solid");
        assert_eq!(inside.map(|hit| (hit.distance, hit.normal)), Some((0.0, Vec3::NEG_X)));
        // From within to the far side of the surface.
        let out = query.cast_ball(Vec3::ZERO, 0.25, Vec3::Y, 5.0, &ALL).expect("it is closed");
        assert!((out.distance - 0.75).abs() < 0.02 && out.normal.y < -0.9, "{out:?}");
        assert_eq!(query.cast_ball(Vec3::ZERO, 0.25, Vec3::ZERO, 5.0, &ALL), None);
        assert_eq!(query.cast_ball(Vec3::ZERO, 0.25, Vec3::Y, 0.5, &ALL), None);
        assert_eq!(query.cast_ball(Vec3::ZERO, f32::NAN, Vec3::Y, 5.0, &ALL), None);
    });
}
