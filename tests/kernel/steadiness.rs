//! When recipes are refreshed, and when they are not.

use bevy_circumsphere::kernel::spheres::circumsphere::RecipeSettings;
use circumsphere_support::scenes::{Diagonals, cuboid, grid, icosphere, saddle, torus};
use glam::{DQuat, DVec3, Vec3};

use crate::{
    common::Random,
    truth::{Spheres, independent, positions, random_rotation, triangle_with_angles},
};

fn settings(delta: f32) -> RecipeSettings {
    RecipeSettings { sphere_offset: 1.0, curvature_threshold: 1.0, refit_threshold: delta }
}

#[test]
fn rigid_motion_refreshes_no_recipe() {
    let mut random = Random::new(1);
    for mesh in [
        icosphere(4, 1.0),
        torus(1.0, 0.3, 40, 20),
        cuboid([1.0, 0.5, 0.2], 6),
        saddle(20, 1.0, 1.0),
        grid(20, 20, 1.0, 1.0, Diagonals::Alternating),
    ] {
        let rest = positions(&mesh);
        let mut spheres = Spheres::new(&rest, &mesh.triangles, settings(0.05));
        let (axis, drift) = (random.direction(), random.direction() * 0.1);
        for step in 1..=100 {
            let turn = DQuat::from_axis_angle(axis, 0.07 * f64::from(step));
            let moved: Vec<Vec3> =
                rest.iter().map(|point| (turn * point.as_dvec3() + drift * f64::from(step)).as_vec3()).collect();
            assert_eq!(spheres.update(&moved), 0, "step {step}");
        }
        // Recipes can be refreshed: a twist does it.
        let twisted: Vec<Vec3> = rest
            .iter()
            .map(|point| (DQuat::from_rotation_y(2.0 * f64::from(point.y + point.x)) * point.as_dvec3()).as_vec3())
            .collect();
        assert!(spheres.update(&twisted) * 2 > mesh.triangles.len());
    }
}

#[test]
fn a_stretch_beyond_delta_refreshes_exactly_the_stretched_triangles() {
    const DELTA: f64 = 0.05;
    let mut random = Random::new(2);
    let rest: Vec<[Vec3; 3]> =
        (0..3_000).map(|_| triangle_with_angles(&mut random, 1.0, 0.7, 1.0, DVec3::ZERO)).collect();
    let (positions, list) = independent(&rest);
    for delta_side in [1.0, -1.0] {
        let mut spheres = Spheres::new(&positions, &list, settings(DELTA as f32));
        let stretched: Vec<bool> = rest.iter().map(|_| random.below(3) == 0).collect();
        let moved: Vec<[Vec3; 3]> = rest
            .iter()
            .zip(&stretched)
            .map(|(corners, &beyond)| {
                // Stretches along one edge: its length changes by exactly this share, the others by less.
                let share = if beyond { 1.01 * DELTA } else { 0.99 * DELTA };
                let origin = corners[0].as_dvec3();
                let along = (corners[1].as_dvec3() - origin).normalize();
                corners.map(|corner| {
                    let offset = corner.as_dvec3() - origin;
                    (origin + offset + along * (offset.dot(along) * share * delta_side)).as_vec3()
                })
            })
            .collect();
        let (positions, _) = independent(&moved);
        let expected = stretched.iter().filter(|&&beyond| beyond).count();
        assert!(expected > 500 && expected < 1_500);
        assert_eq!(spheres.update(&positions), expected);
        let fresh = Spheres::new(&positions, &list, settings(DELTA as f32));
        for triangle in 0..list.len() {
            let same = spheres.offset.centers[triangle] == fresh.offset.centers[triangle];
            assert_eq!(same, stretched[triangle], "triangle {triangle}");
        }
        assert_eq!(spheres.update(&positions), 0, "the new shape is remembered");
    }
}

#[test]
fn a_fold_beyond_delta_refreshes_both_triangles_of_the_hinge() {
    let hinge =
        |angle: f64| [DVec3::ZERO, DVec3::Z, DVec3::X, DVec3::new(-angle.cos(), -angle.sin(), 0.0)].map(DVec3::as_vec3);
    let triangles = [[0, 1, 2], [1, 0, 3]];
    let mut spheres = Spheres::new(&hinge(0.2), &triangles, settings(0.3));
    assert_eq!(spheres.update(&hinge(0.49)), 0);
    assert_eq!(spheres.update(&hinge(-0.09)), 0);
    assert_eq!(spheres.update(&hinge(0.51)), 2);
    // Small steps add up relative to the shape at the last refresh.
    assert_eq!(spheres.update(&hinge(0.7)), 0);
    assert_eq!(spheres.update(&hinge(0.8)), 0);
    assert_eq!(spheres.update(&hinge(0.82)), 2);
}

#[test]
fn without_delta_every_recipe_is_refreshed_and_spheres_equal_new_ones() {
    let mut random = Random::new(3);
    let mesh = icosphere(2, 1.0);
    let rest = positions(&mesh);
    let mut spheres = Spheres::new(&rest, &mesh.triangles, settings(0.0));
    assert_eq!(spheres.update(&rest), mesh.triangles.len(), "even where nothing moved");
    let moved: Vec<Vec3> = rest.iter().map(|&point| point + (random.vector() * 0.1).as_vec3()).collect();
    assert_eq!(spheres.update(&moved), mesh.triangles.len());
    let fresh = Spheres::new(&moved, &mesh.triangles, settings(0.0));
    assert_eq!(spheres.offset.centers, fresh.offset.centers);
    assert_eq!(spheres.offset.radii, fresh.offset.radii);
    assert_eq!(spheres.cones.cosines, fresh.cones.cosines);
}

/// Nothing may jump between the tick that makes a recipe and the next one, including obtuse triangles.
#[test]
fn a_triangle_that_does_not_move_keeps_exactly_its_sphere() {
    let mut random = Random::new(4);
    let mut triangles = Vec::new();
    for index in 0..6_000 {
        let degrees = [60.0, 90.0, 120.0, 149.9, 150.1, 175.0][index % 6];
        let largest = f64::to_radians(degrees);
        let second = (std::f64::consts::PI - largest) * random.range(0.1, 0.5);
        let offset = if random.below(2) == 0 { DVec3::ZERO } else { random.vector() * 100.0 };
        triangles.push(triangle_with_angles(&mut random, largest, second, 1.0, offset));
    }
    triangles.push([Vec3::X; 3]);
    triangles.push([Vec3::X, Vec3::Y, Vec3::X]);
    let (positions, list) = independent(&triangles);
    for delta in [0.0, 0.7] {
        let mut spheres = Spheres::new(&positions, &list, settings(delta));
        let (first, first_cones) = (spheres.offset.clone(), spheres.cones.clone());
        for _ in 0..3 {
            let refreshed = spheres.update(&positions);
            assert_eq!(refreshed, if delta > 0.0 { 0 } else { list.len() });
            assert_eq!(spheres.offset.centers, first.centers);
            assert_eq!(spheres.offset.radii, first.radii);
            assert_eq!(spheres.offset.heights, first.heights);
            assert_eq!(spheres.cones.axes, first_cones.axes);
            assert_eq!(spheres.cones.cosines, first_cones.cosines);
        }
    }
}

#[test]
fn forgotten_recipes_are_made_anew() {
    let mesh = icosphere(1, 1.0);
    let rest = positions(&mesh);
    let mut spheres = Spheres::new(&rest, &mesh.triangles, settings(0.7));
    assert_eq!(spheres.update(&rest), 0);
    spheres.offset.forget();
    assert_eq!(spheres.update(&rest), mesh.triangles.len());
}

/// Stale recipes follow rigid motion exactly: the sphere of a rotated mesh is the rotated sphere.
#[test]
fn spheres_move_rigidly_with_their_mesh() {
    let mut random = Random::new(5);
    let mesh = torus(1.0, 0.3, 24, 12);
    let rest = positions(&mesh);
    let mut spheres = Spheres::new(&rest, &mesh.triangles, settings(0.7));
    let (first, first_radii) = (spheres.offset.centers.clone(), spheres.offset.radii.clone());
    for _ in 0..20 {
        let (turn, shift) = (random_rotation(&mut random), random.vector());
        let moved: Vec<Vec3> = rest.iter().map(|point| (turn * point.as_dvec3() + shift).as_vec3()).collect();
        assert_eq!(spheres.update(&moved), 0);
        for triangle in 0..mesh.triangles.len() {
            let expected = turn * first[triangle].as_dvec3() + shift;
            let found = spheres.offset.centers[triangle].as_dvec3();
            // Rounding of corners at coordinates of 2 tilts the normals of triangles of height 0.08 by 3e-6. Centers
            // are 0.2 below.
            assert!(found.distance(expected) <= 5.0e-6, "{found} {expected}");
            assert!((spheres.offset.radii[triangle] - first_radii[triangle]).abs() <= 5.0e-6);
        }
    }
}
