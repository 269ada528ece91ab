//! What balls, boxes, and solids overlap: against brute force, and against parry in f64.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    SurfaceOverlap,
    geometry::{Aabb, ShapeError},
    prelude::*,
};
use bevy_ecs::prelude::*;
use circumsphere_support::{random::Random, scenes::icosphere};
use glam::{DVec3, Quat, Vec3};
use parry3d_f64::{
    math::Pose,
    query::distance,
    shape::{Capsule, Cuboid, Cylinder, Shape, Triangle},
};

use crate::{
    truth::closest_on,
    world::{ALL, app, query, random_pose, random_rotation, random_vector, spawn, world_triangles},
};

fn numbers(found: &[SurfaceOverlap], entity: Entity) -> Vec<usize> {
    found
        .iter()
        .map(|overlap| {
            assert_eq!(overlap.entity, entity);
            overlap.triangle.expect("a surface has triangles").index()
        })
        .collect()
}

/// A ball in a random pose, and its triangles in the world.
fn scene(random: &mut Random) -> (App, Entity, Vec<[DVec3; 3]>) {
    let mut app = app();
    let pose = random_pose(random, Vec3::new(1.0, 2.0, 3.0));
    let entity = spawn(&mut app, &icosphere(3, 1.0), pose);
    app.update();
    let triangles = world_triangles(&app, entity);
    (app, entity, triangles)
}

/// Compares overlaps with signed gaps: below 0 a triangle overlaps. Gaps within `doubt` may go either way. Returns how many
/// do and how many do not.
fn compare(found: &[usize], gaps: impl Iterator<Item = f64>, doubt: f64) -> [usize; 2] {
    assert!(found.is_sorted_by(|one, other| one < other));
    let mut counts = [0; 2];
    for (triangle, gap) in gaps.enumerate() {
        if gap.abs() <= doubt {
            continue;
        }
        assert_eq!(found.binary_search(&triangle).is_ok(), gap < 0.0, "triangle {triangle}, gap {gap}");
        counts[usize::from(gap >= 0.0)] += 1;
    }
    counts
}

#[test]
fn balls_and_boxes_overlap_what_brute_force_says() {
    let mut random = Random::new(21);
    let (mut by_balls, mut by_boxes) = ([0; 2], [0; 2]);
    for _ in 0..20 {
        let (mut app, entity, triangles) = scene(&mut random);
        let center = Vec3::new(1.0, 2.0, 3.0) + random_vector(&mut random) * 1.2;
        let radius = 0.1 + 0.5 * random.unit() as f32;
        let half = random_vector(&mut random).abs() * 0.5;
        let aabb = Aabb { min: center - half, max: center + half };
        let (balls, boxes) = query(&mut app, move |query| {
            (query.ball_intersections(center, radius, &ALL), query.aabb_intersections(&aabb, &ALL))
        });
        let at = center.as_dvec3();
        let gaps = triangles.iter().map(|corners| closest_on(corners, at).distance(at) - f64::from(radius));
        let counts = compare(&numbers(&balls, entity), gaps, 1.0e-9);
        by_balls = [by_balls[0] + counts[0], by_balls[1] + counts[1]];
        let middle = (aabb.min.as_dvec3() + aabb.max.as_dvec3()) * 0.5;
        let cuboid = Cuboid::new(aabb.max.as_dvec3() - middle);
        let gaps = triangles.iter().map(|corners| gap(&Pose::from_translation(middle), &cuboid, corners));
        let counts = compare(&numbers(&boxes, entity), gaps, 1.0e-6);
        by_boxes = [by_boxes[0] + counts[0], by_boxes[1] + counts[1]];
    }
    assert!(by_balls[0] > 500 && by_balls[1] > 500, "{by_balls:?}");
    assert!(by_boxes[0] > 200 && by_boxes[1] > 500, "{by_boxes:?}");
}

/// By parry: the distance of a shape and a triangle, or -1 if they overlap.
fn gap(pose: &Pose, shape: &dyn Shape, corners: &[DVec3; 3]) -> f64 {
    let triangle = Triangle::new(corners[0], corners[1], corners[2]);
    let apart = distance(pose, shape, &Pose::IDENTITY, &triangle).expect("parry knows both").distance;
    if apart > 0.0 { apart } else { -1.0 }
}

#[test]
fn solids_overlap_what_parry_says() {
    let mut random = Random::new(22);
    let mut counts = [0; 2];
    for _ in 0..12 {
        let (mut app, entity, triangles) = scene(&mut random);
        let translation = Vec3::new(1.0, 2.0, 3.0) + random_vector(&mut random) * 1.2;
        let rotation = random_rotation(&mut random);
        let solids: [(SharedShape, Box<dyn Shape>); 3] = [
            (SharedShape::capsule_y(0.3, 0.2), Box::new(Capsule::new_y(0.3_f32.into(), 0.2_f32.into()))),
            (SharedShape::cuboid(0.3, 0.2, 0.5), Box::new(Cuboid::new(Vec3::new(0.3, 0.2, 0.5).as_dvec3()))),
            (SharedShape::cylinder(0.4, 0.25), Box::new(Cylinder::new(0.4_f32.into(), 0.25_f32.into()))),
        ];
        for (shape, reference) in solids {
            let found = query(&mut app, move |query| {
                query.shape_intersections(&shape, translation, rotation, &ALL).expect("it is a solid")
            });
            let turned = rotation.as_dquat().normalize();
            let pose = Pose::from_parts(translation.as_dvec3(), turned);
            let gaps = triangles.iter().map(|corners| gap(&pose, &*reference, corners));
            let all = compare(&numbers(&found, entity), gaps, 1.0e-5);
            counts = [counts[0] + all[0], counts[1] + all[1]];
        }
    }
    assert!(counts[0] > 300 && counts[1] > 1_000, "{counts:?}");
}

#[test]
fn what_is_no_solid_is_refused_and_what_is_no_number_finds_nothing() {
    let mut app = app();
    spawn(&mut app, &icosphere(2, 1.0), ());
    app.update();
    query(&mut app, |query| {
        let intersections =
            |shape: &SharedShape, at: Vec3, turn: Quat| query.shape_intersections(shape, at, turn, &ALL);
        let ball = SharedShape::ball(2.0);
        assert_eq!(intersections(&ball, Vec3::ZERO, Quat::IDENTITY).map(|found| found.len()), Ok(320));
        assert_eq!(intersections(&ball, Vec3::NAN, Quat::IDENTITY), Ok(Vec::new()));
        assert_eq!(intersections(&ball, Vec3::ZERO, Quat::NAN), Ok(Vec::new()));
        let plane = SharedShape::halfspace(Vec3::Y);
        assert_eq!(intersections(&plane, Vec3::ZERO, Quat::IDENTITY), Err(ShapeError::Unsupported));
        let negative = SharedShape::ball(-1.0);
        assert_eq!(intersections(&negative, Vec3::ZERO, Quat::IDENTITY), Err(ShapeError::Negative));
        assert_eq!(query.ball_intersections(Vec3::NAN, 1.0, &ALL), []);
        assert_eq!(query.ball_intersections(Vec3::ZERO, -1.0, &ALL), []);
        assert_eq!(query.aabb_intersections(&Aabb::EMPTY, &ALL), []);
    });
}
