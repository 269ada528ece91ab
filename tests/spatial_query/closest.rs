//! Closest points, against brute force in f64.

use bevy_circumsphere::{ClosestPoint, prelude::*};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, grid, icosphere},
};
use glam::{DVec3, Vec3};

use crate::{
    truth::closest_on,
    world::{ALL, app, query, random_pose, random_vector, spawn, wavy, world_triangles, write_positions},
};

#[test]
fn closest_points_are_those_of_brute_force_in_all_poses() {
    let mesh = icosphere(3, 1.0);
    let mut random = Random::new(11);
    let (mut found_count, mut missed, mut inside) = (0, 0, 0);
    for tick in 0..8 {
        let mut app = app();
        let translation = random_vector(&mut random) * if tick % 2 == 0 { 1.0 } else { 1.0e4 };
        let transform = if tick == 0 { Transform::IDENTITY } else { random_pose(&mut random, translation) };
        let entity = spawn(&mut app, &mesh, transform);
        write_positions(&mut app, entity, wavy(&mesh, f64::from(tick)));
        app.update();
        let triangles = world_triangles(&app, entity);
        let size = transform.scale.x.abs();
        let points: Vec<(Vec3, f32)> = (0..1_000)
            .map(|number| {
                let point = transform.translation + random_vector(&mut random) * 2.0 * size;
                (point, if number % 3 == 0 { 0.4 * size } else { f32::INFINITY })
            })
            .collect();
        let copy = points.clone();
        let found: Vec<Option<ClosestPoint>> = query(&mut app, move |query| {
            copy.iter().map(|&(point, range)| query.closest_point(point, range, &ALL)).collect()
        });
        for ((point, range), found) in points.into_iter().zip(found) {
            let at = point.as_dvec3();
            let least = triangles.iter().map(|corners| closest_on(corners, at).distance(at)).fold(f64::MAX, f64::min);
            // Coordinates in f32, and poses that are composed in f64.
            let tolerance = 4.0 * f64::from(f32::EPSILON) * least + 1.0e-10 * f64::from(transform.translation.length());
            let Some(found) = found else {
                assert!(least > f64::from(range) - tolerance, "{point} is {least} away");
                missed += 1;
                continue;
            };
            assert!((f64::from(found.distance).abs() - least).abs() <= tolerance, "{found:?}, {least}");
            let corners = triangles[found.triangle.expect("a surface has triangles").index()];
            let on_triangle: DVec3 =
                corners.iter().zip(found.barycentric).map(|(corner, weight)| *corner * f64::from(weight)).sum();
            let rounding = 1.0e-6 * f64::from(transform.translation.length() + 2.0);
            assert!(on_triangle.distance(found.point.as_dvec3()) < rounding, "{found:?}");
            // The ball is star-shaped: waves are flatter than that.
            let radius = (at - transform.translation.as_dvec3()).length() / f64::from(size);
            if !(0.7..1.3).contains(&radius) {
                assert_eq!(found.distance < 0.0, radius < 1.0, "{point}: {found:?}");
            }
            inside += usize::from(found.distance < 0.0);
            found_count += 1;
        }
    }
    assert!(found_count > 5_000 && missed > 500 && inside > 500, "{found_count} {missed} {inside}");
}

#[test]
fn sheets_have_no_inside_and_closed_surfaces_only_if_they_are_one_sided() {
    let mut app = app();
    spawn(&mut app, &grid(4, 4, 2.0, 2.0, Diagonals::Uniform), ());
    spawn(&mut app, &icosphere(2, 0.5), (Transform::from_xyz(10.0, 0.0, 0.0), Sidedness::TwoSided));
    spawn(&mut app, &icosphere(2, 0.5), Transform::from_xyz(20.0, 0.0, 0.0));
    app.update();
    let distances = query(&mut app, |query| {
        [Vec3::new(0.1, 0.25, 0.3), Vec3::new(0.1, -0.25, 0.3), Vec3::X * 10.0, Vec3::X * 20.0]
            .map(|point| query.closest_point(point, f32::INFINITY, &ALL).expect("something is near").distance)
    });
    assert_eq!(distances[..2], [0.25, 0.25]);
    assert!(distances[2] > 0.4 && distances[3] < -0.4, "{distances:?}");
}

#[test]
fn at_equal_distances_the_lowest_triangle_of_the_first_surface_wins() {
    let mut app = app();
    let sheet = grid(2, 2, 2.0, 2.0, Diagonals::Uniform);
    let last = spawn(&mut app, &sheet, SurfaceOrder(2));
    let first = spawn(&mut app, &sheet, SurfaceOrder(1));
    app.update();
    let (closest, hit) = query(&mut app, |query| {
        let above = Vec3::Y;
        (query.closest_point(above, 5.0, &ALL), query.cast_ray(above, -above, 5.0, &ALL))
    });
    let triangles = world_triangles(&app, first);
    let at_center = |corners: &&[DVec3; 3]| corners.iter().any(|corner| corner.length() < 1.0e-6);
    let lowest = triangles.iter().position(|corners| at_center(&corners)).expect("a vertex is in the middle");
    let (closest, hit) = (closest.expect("it is near"), hit.expect("it is hit"));
    assert_eq!((closest.entity, closest.triangle), (first, Some(TriangleId(lowest as u32))));
    assert_eq!((hit.entity, hit.triangle, hit.distance), (first, Some(TriangleId(lowest as u32)), 1.0));
    let hits = query(&mut app, |query| query.ray_hits(Vec3::new(0.3, 1.0, 0.1), Vec3::NEG_Y, 5.0, &ALL));
    assert_eq!(hits.iter().map(|hit| hit.entity).collect::<Vec<_>>(), [first, last]);
}
