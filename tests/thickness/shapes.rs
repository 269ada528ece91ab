//! Detection against rigid shapes.

use bevy_circumsphere::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Mesh, triangle_soup},
};
use glam::{DVec3, Quat};

use super::{
    truth::{Thick, least},
    world::{Body, app, store, vector},
};

const ROUNDING: f64 = 2.0e-6;

/// A convex shape by what it is made of: the triangles of its boundary, or one thick segment or point.
fn shapes() -> Vec<(&'static str, SharedShape, Vec<Thick>)> {
    let half = DVec3::new(0.3, 0.2, 0.25);
    let corner = |bits: u32| {
        DVec3::from_array([0, 1, 2].map(|axis| if bits >> axis & 1 == 0 { -half[axis] } else { half[axis] }))
    };
    let faces: [[u32; 4]; 6] = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let boundary = faces.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
    let cuboid = boundary.map(|triangle| Thick { corners: triangle.map(corner), thickness: [0.0; 3] }).collect();
    let ends = [DVec3::new(0.0, -0.25, 0.0), DVec3::new(0.0, 0.25, 0.0)];
    vec![
        ("ball", SharedShape::ball(0.3), vec![Thick::point(DVec3::ZERO, f64::from(0.3_f32))]),
        ("capsule", SharedShape::capsule_y(0.25, 0.15), vec![Thick::segment(ends, f64::from(0.15_f32))]),
        ("cuboid", SharedShape::cuboid(0.3, 0.2, 0.25), cuboid),
    ]
}

/// Triangles in the frame of a shape at a pose.
fn seen_from(body: &Body, pose: &Transform) -> Vec<Thick> {
    let rotation = pose.rotation.as_dquat().normalize().inverse();
    let own = |corner: DVec3| rotation * (corner - pose.translation.as_dvec3());
    body.thick().into_iter().map(|thick| Thick { corners: thick.corners.map(own), ..thick }).collect()
}

#[test]
fn triangles_touch_rigid_shapes_where_their_balls_do() {
    let mut counts = [0; 2];
    for (seed, (name, shape, parts)) in (20..).zip(shapes()) {
        let mut random = Random::new(seed);
        let body = Body::random(triangle_soup(250, seed), 0.3, Transform::IDENTITY, &mut random);
        let pose = Transform::from_xyz(0.4, 0.5, 0.45).with_rotation(Quat::from_scaled_axis(vector(&mut random, 2.0)));
        let mut app = app();
        body.spawn(&mut app, ());
        app.world_mut().spawn((RigidShape(shape), pose));
        app.update();
        let touching: Vec<u32> = store(&app).touching().map(|pair| pair.triangle_a).collect();
        for (number, thick) in (0..).zip(seen_from(&body, &pose)) {
            let bound = |by: f64| {
                let thicker = Thick { thickness: thick.thickness.map(|own| own + by), ..thick };
                let bounds = parts.iter().map(|part| least(thicker, *part, 0.0, true));
                bounds.fold([f64::INFINITY; 2], |[low, high], own| [low.min(own.least), high.min(own.most)])
            };
            // A triangle inside a cuboid does not meet its boundary.
            let is_inside = name == "cuboid"
                && thick.corners.iter().any(|corner| corner.abs().cmple(DVec3::new(0.3, 0.2, 0.25)).all());
            let found = touching.contains(&number);
            if is_inside || bound(-ROUNDING)[1] <= 0.0 {
                assert!(found, "{name}: {number} is missed");
                counts[0] += 1;
            } else if bound(ROUNDING)[0] > 0.0 {
                assert!(!found, "{name}: {number} does not touch");
                counts[1] += 1;
            }
        }
    }
    assert!(counts[0] > 50 && counts[1] > 50, "{counts:?}");
}

#[test]
fn a_slope_is_nearest_beside_the_closest_point() {
    // A triangle at height 9 over the middle of a ball. Its thickness is 6.5 over the middle, and grows along x by 0.6 per
    // unit. Of the height, √(1 − 0.6²) = 0.8 counts, 6.75 beside the middle: the ball touches from a radius of
    // 9 × 0.8 − 6.5 = 0.7 on. At the closest point, it would touch from 2.5 on.
    let corners = [[-10.0, 9.0, -10.0], [-10.0, 9.0, 10.0], [10.0, 9.0, 0.0]];
    let thickness = corners.iter().map(|[x, ..]| 6.5 + 0.6 * x).collect();
    let mesh = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]] };
    let body = Body { mesh, thickness, transform: Transform::IDENTITY };
    for (radius, expected) in [(0.699_f32, false), (0.701, true)] {
        let mut app = app();
        body.spawn(&mut app, ());
        app.world_mut().spawn((RigidShape(SharedShape::ball(radius)), Transform::IDENTITY));
        app.update();
        assert_eq!(store(&app).touching_count() == 1, expected, "{radius}");
    }
}
