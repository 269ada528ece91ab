//! Rigid shapes: solids against parry in f64, and shapes made of triangles as surfaces.

use bevy_app::prelude::*;
use bevy_circumsphere::{RayHit, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::random::Random;
use glam::{DVec3, Quat, Vec3};
use parry3d::shape::SharedShape as Single;
use parry3d_f64::{
    math::Pose,
    query::Ray,
    shape::{Ball, Capsule, Cone, Cuboid, Cylinder, Shape},
};

use crate::world::{ALL, app, query, random_rotation, random_vector};

fn shape(app: &mut App, shape: SharedShape, transform: Transform) -> Entity {
    app.world_mut().spawn((RigidShape(shape), transform)).id()
}

#[test]
fn rays_and_points_at_solids_agree_with_parry() {
    let solids: [(SharedShape, Box<dyn Shape>); 5] = [
        (SharedShape::ball(0.7), Box::new(Ball::new(0.7_f32.into()))),
        (SharedShape::capsule_y(0.5, 0.4), Box::new(Capsule::new_y(0.5_f32.into(), 0.4_f32.into()))),
        (SharedShape::cuboid(0.3, 0.6, 0.9), Box::new(Cuboid::new(Vec3::new(0.3, 0.6, 0.9).as_dvec3()))),
        (SharedShape::cylinder(0.6, 0.5), Box::new(Cylinder::new(0.6_f32.into(), 0.5_f32.into()))),
        (SharedShape::cone(0.6, 0.7), Box::new(Cone::new(0.6_f32.into(), 0.7_f32.into()))),
    ];
    let mut random = Random::new(41);
    let (mut hits, mut misses, mut inside, mut stopped_short) = (0, 0, 0, 0);
    for (solid, reference) in solids {
        let mut app = app();
        let scale = 2.0;
        let rotation = random_rotation(&mut random);
        let translation = Vec3::new(3.0, -1.0, 2.0);
        let entity = shape(&mut app, solid, Transform { translation, rotation, scale: Vec3::splat(scale) });
        app.update();
        let rays: Vec<(Vec3, Vec3)> = (0..2_000)
            .map(|number| {
                let reach = if number % 4 == 0 { 0.5 } else { 4.0 };
                let origin = translation + random_vector(&mut random) * reach;
                (origin, translation + random_vector(&mut random) * 2.0 - origin)
            })
            .collect();
        let copy = rays.clone();
        let found: Vec<(Option<RayHit>, f32)> = query(&mut app, move |query| {
            copy.iter()
                .map(|&(origin, direction)| {
                    let closest = query.closest_point(origin, f32::INFINITY, &ALL).expect("it is there");
                    (query.cast_ray(origin, direction, f32::INFINITY, &ALL), closest.distance)
                })
                .collect()
        });
        let pose = Pose::from_parts(DVec3::ZERO, rotation.as_dquat().normalize());
        for ((origin, direction), (found, distance)) in rays.into_iter().zip(found) {
            let local = (origin.as_dvec3() - translation.as_dvec3()) / f64::from(scale);
            let ray = Ray::new(local, direction.as_dvec3() / f64::from(scale));
            let expected = reference.cast_ray_and_get_normal(&pose, &ray, 1.0e9, false);
            let projection = reference.project_point(&pose, local, false);
            let apart = projection.point.distance(local) * f64::from(scale);
            assert!((f64::from(distance).abs() - apart).abs() < 1.0e-5, "{distance} is not {apart}");
            assert!(apart < 1.0e-6 || (distance < 0.0) == projection.is_inside, "{distance}: {projection:?}");
            inside += usize::from(distance < 0.0);
            // A point on the surface, by parry.
            let gap = |time: f64| {
                let at = ray.point_at(time);
                reference.project_point(&pose, at, false).point.distance(at)
            };
            let Some(found) = found else {
                assert!(expected.is_none(), "misses {expected:?}");
                misses += 1;
                continue;
            };
            hits += 1;
            assert_eq!((found.entity, found.triangle, found.is_back_face), (entity, None, distance < 0.0));
            assert_eq!(found.normal.dot(direction) > 0.0, found.is_back_face, "{found:?}");
            assert!(gap(f64::from(found.distance)) < 1.0e-6, "{found:?} is not on the surface");
            let error = expected.map(|expected| f64::from(found.distance) - expected.time_of_impact);
            if error.is_none_or(|error| error.abs() * direction.as_dvec3().length() > 1.0e-4) {
                // From within a cylinder or a cone, parry may stop short of the surface or find nothing.
                let is_short = expected.is_none_or(|expected| gap(expected.time_of_impact) > 1.0e-6);
                assert!(distance < 0.0 && is_short, "{found:?} is not {expected:?}");
                stopped_short += 1;
            }
        }
    }
    assert!(hits > 3_000 && misses > 1_000 && inside > 500, "{hits} {misses} {inside}");
    // parry is only compared where it is right: at every ray that starts outside, and at some of the others.
    assert!(stopped_short < inside, "{stopped_short} of {inside}");
}

#[test]
fn half_spaces_compounds_and_mirrored_solids_are_hit() {
    let mut app = app();
    let ground = shape(&mut app, SharedShape::halfspace(Vec3::Y), Transform::from_xyz(0.0, -1.0, 0.0));
    let ball = Single::ball(0.5);
    let at = |x: f32| parry3d::math::Pose::from_translation(Vec3::new(x, 0.0, 0.0));
    let snowman = SharedShape::compound(vec![(at(0.0), ball.clone()), (at(0.6), ball)]);
    let compound = shape(&mut app, snowman, Transform::IDENTITY);
    let cone = Transform { scale: Vec3::new(-1.0, 1.0, 1.0), ..Transform::from_xyz(0.0, 10.0, 0.0) };
    let mirrored = shape(&mut app, SharedShape::cone(1.0, 0.5), cone);
    app.update();
    query(&mut app, move |query| {
        let down = query.cast_ray(Vec3::new(5.0, 3.0, 0.0), Vec3::NEG_Y * 2.0, 10.0, &ALL).expect("the ground");
        assert_eq!((down.entity, down.distance, down.normal, down.is_back_face), (ground, 2.0, Vec3::Y, false));
        // Through both balls, whose inner sides are no surface.
        let hits = query.ray_hits(Vec3::new(-3.0, 0.0, 0.0), Vec3::X, 10.0, &ALL);
        let ends: Vec<(Entity, f32, bool)> =
            hits.iter().map(|hit| (hit.entity, (hit.distance * 1.0e5).round() / 1.0e5, hit.is_back_face)).collect();
        assert_eq!(ends, [(compound, 2.5, false), (compound, 4.1, true)]);
        // A cone with its tip up, halfway down.
        let beside = query.cast_ray(Vec3::new(3.0, 10.0, 0.0), Vec3::NEG_X, 10.0, &ALL).expect("the cone");
        assert!((beside.distance - 2.75).abs() < 1.0e-5 && beside.normal.y > 0.2, "{beside:?}");
        assert_eq!(beside.entity, mirrored);
        let culled = ALL.culling_back_faces();
        assert_eq!(query.cast_ray(Vec3::new(0.3, 0.0, 0.0), Vec3::X, 10.0, &culled), None);
    });
}

#[test]
fn balls_and_boxes_meet_solids() {
    let mut app = app();
    let ground = shape(&mut app, SharedShape::halfspace(Vec3::Y), Transform::IDENTITY);
    let cube = shape(&mut app, SharedShape::cuboid(0.5, 0.5, 0.5), Transform::from_xyz(0.0, 3.0, 0.0));
    app.update();
    query(&mut app, move |query| {
        let hit = query.cast_ball(Vec3::new(0.0, 6.0, 0.0), 0.5, Vec3::NEG_Y, 10.0, &ALL).expect("the cube");
        assert_eq!((hit.entity, hit.distance, hit.normal), (cube, 2.0, Vec3::Y));
        let hit = query.cast_ball(Vec3::new(3.0, 6.0, 0.0), 0.5, Vec3::NEG_Y, 10.0, &ALL).expect("the ground");
        assert_eq!((hit.entity, hit.distance, hit.point), (ground, 5.5, Vec3::X * 3.0));
        let plank = SharedShape::cuboid(1.0, 0.25, 0.25);
        let turn = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
        let cast = |x: f32| query.cast_shape(&plank, Vec3::new(x, 6.0, 0.0), turn, Vec3::NEG_Y, 10.0, &ALL);
        let hit = cast(0.0).expect("it is a solid").expect("the cube");
        assert!(hit.entity == cube && (hit.distance - 1.5).abs() < 1.0e-5 && hit.normal.y > 0.99, "{hit:?}");
        let hit = cast(3.0).expect("it is a solid").expect("the ground");
        assert!(hit.entity == ground && (hit.distance - 5.0).abs() < 1.0e-5, "{hit:?}");
        let touched = |x: f32, y: f32| {
            let found = query.shape_intersections(&plank, Vec3::new(x, y, 0.0), Quat::IDENTITY, &ALL);
            found.expect("it is a solid").iter().map(|overlap| overlap.entity).collect::<Vec<_>>()
        };
        assert_eq!(touched(1.4, 3.0), [cube]);
        assert_eq!(touched(1.6, 3.0), []);
        assert_eq!(touched(0.0, 0.2), [ground]);
        // All of the small one is within the other.
        let small = SharedShape::ball(0.1);
        let found = query.shape_intersections(&small, Vec3::Y * 3.0, Quat::IDENTITY, &ALL).expect("it is a solid");
        assert_eq!(found.len(), 1);
        assert_eq!(query.ball_intersections(Vec3::Y * 3.0, 0.1, &ALL).len(), 1);
    });
}

#[test]
fn shapes_made_of_triangles_are_hit_like_surfaces() {
    let mut app = app();
    let field = parry3d::utils::Array2::new(3, 3, vec![0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    let entity = shape(&mut app, SharedShape::heightfield(field, Vec3::splat(2.0)), Transform::from_xyz(0.0, 1.0, 0.0));
    app.update();
    let hit = query(&mut app, |query| query.cast_ray(Vec3::Y * 5.0, Vec3::NEG_Y, 10.0, &ALL)).expect("it is below");
    assert_eq!((hit.entity, hit.distance), (entity, 2.0));
    assert!(hit.triangle.is_some());
}
