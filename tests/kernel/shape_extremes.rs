//! Rigid shapes with values that no game uses, and exact touches: no panics, and normals always have unit length.

use crate::{
    common::Random,
    shapes::{assert_well_formed, examine},
};
use bevy_circumsphere::kernel::exact::{
    PairProximity,
    rigid_shape::{ShapeError, ShapeGeometry},
};
use glam::{DVec3, Vec3};
use parry3d::{math::Pose, shape::SharedShape};

fn shapes(size: f32) -> Vec<(&'static str, SharedShape)> {
    let half = 0.5 * size;
    let corners = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|corner| corner * size);
    let mut shapes = vec![
        ("ball", SharedShape::ball(size)),
        ("capsule", SharedShape::capsule_y(size, half)),
        ("capsule without radius", SharedShape::capsule_y(size, 0.0)),
        ("point", SharedShape::ball(0.0)),
        ("cuboid", SharedShape::cuboid(size, half, size)),
        ("plate", SharedShape::cuboid(size, 0.0, size)),
        ("rod", SharedShape::cuboid(size, 0.0, 0.0)),
        ("cylinder", SharedShape::cylinder(size, half)),
        ("disc", SharedShape::cylinder(0.0, half)),
        ("needle", SharedShape::cylinder(size, 0.0)),
        ("cone", SharedShape::cone(size, half)),
        ("flat cone", SharedShape::cone(0.0, half)),
        ("rounded cuboid", SharedShape::round_cuboid(size, half, size, half)),
        ("rounded cylinder", SharedShape::round_cylinder(size, half, half)),
        ("rounded cone", SharedShape::round_cone(size, half, half)),
        ("half-space", SharedShape::halfspace(Vec3::Y)),
    ];
    shapes.extend(SharedShape::convex_hull(&corners).map(|hull| ("hull", hull)));
    let parts = vec![
        (Pose::from_translation(Vec3::X * half), SharedShape::cuboid(size, half, size)),
        (Pose::from_translation(Vec3::NEG_X * half), SharedShape::cylinder(size, half)),
        (Pose::IDENTITY, SharedShape::ball(half)),
    ];
    shapes.push(("compound", SharedShape::compound(parts)));
    shapes
}

#[test]
fn exact_touches_have_unit_normals() {
    let mut random = Random::new(71);
    let mut counted = 0;
    for (name, shared) in shapes(1.0) {
        let shape = ShapeGeometry::new(&shared).expect(name);
        // Points on axes, edges, corners, centers, and rims. Triangles end there, pass through, or have no area.
        let places = [0.0, 0.5, -0.5, 1.0, -1.0, 0.25];
        for _ in 0..4_000 {
            let mut place = || DVec3::new(places[random.below(6)], places[random.below(6)], places[random.below(6)]);
            let (a, b, c) = (place(), place(), place());
            let triangle = match random.below(5) {
                0 => [a; 3],
                1 => [a, b, b],
                2 => [a, b, a.lerp(b, 0.5)],
                3 => [a, b, a + (b - a) * 0.5 + c * 1.0e-14],
                _ => [a, b, c],
            };
            for range in [0.0, 0.1] {
                let (_, found) = examine(&shape, &triangle, range);
                for proximity in &found {
                    assert!((proximity.normal.length() - 1.0).abs() < 1.0e-9, "{name} {proximity:?} {triangle:?}");
                    assert_well_formed(&triangle, proximity);
                    counted += 1;
                }
            }
        }
    }
    assert!(counted > 50_000, "{counted}");
}

#[test]
fn extreme_values_give_finite_contacts_or_none() {
    let mut random = Random::new(72);
    let sizes = [1.0, 1.0e-20, 1.0e-38, 1.0e-45, 1.0e10, 1.0e15, 1.0e20, f32::MAX, f32::INFINITY, f32::NAN];
    let (mut prepared, mut refused, mut counted) = (0, 0, 0);
    for size in sizes {
        // parry itself panics on a compound whose parts it cannot sort.
        let build = || shapes(size);
        let Ok(shapes) = std::panic::catch_unwind(build) else { continue };
        for (name, shared) in shapes {
            let shape = match ShapeGeometry::new(&shared) {
                Ok(shape) => shape,
                Err(error) => {
                    assert!(!(1.0e-20..=1.0e10).contains(&size), "{name} {size} {error}");
                    assert!(
                        size < 1.0 || matches!(error, ShapeError::TooLarge | ShapeError::NonFinite) || size.is_nan()
                    );
                    refused += 1;
                    continue;
                }
            };
            prepared += 1;
            let bounds = shape.bounds();
            assert!(bounds.is_none_or(|bounds| bounds.min.is_finite() && bounds.max.is_finite()), "{name} {size}");
            for _ in 0..300 {
                let triangle = [0, 1, 2].map(|_| {
                    let scale =
                        [1.0e-40, 1.0e-20, 1.0, 1.0e15, 1.0e20, 1.0e38, 1.0e58, f64::from(size)][random.below(8)];
                    if random.below(100) == 0 { DVec3::NAN } else { random.vector() * scale }
                });
                let (mut scratch, mut found) = (PairProximity::default(), Vec::new());
                for range in [0.0, 1.0, 1.0e18, 1.0e30] {
                    let least = shape.examine(&triangle, range, &mut scratch, &mut found);
                    assert!(!least.is_nan(), "{name} {size} {triangle:?}");
                }
                for proximity in &found {
                    assert!(
                        proximity.distance.is_finite() && proximity.shape_point.is_finite(),
                        "{name} {proximity:?}"
                    );
                    assert!(
                        (proximity.normal.length() - 1.0).abs() < 1.0e-9,
                        "{name} {size} {proximity:?} {triangle:?}"
                    );
                    counted += 1;
                }
            }
        }
    }
    println!("{prepared} prepared, {refused} refused, {counted} contacts");
    assert!(prepared > 50 && refused > 30 && counted > 5_000);
}

#[test]
fn hulls_of_points_that_are_nearly_in_one_place_plane_or_line_do_not_panic() {
    let mut random = Random::new(73);
    let mut made = 0;
    for _ in 0..3_000 {
        let squash = DVec3::new(1.0, random.power_of_ten(-9.0, 0.0), random.power_of_ten(-9.0, 0.0));
        let scale = random.power_of_ten(-20.0, 14.0);
        let count = 4 + random.below(12);
        let points: Vec<Vec3> = (0..count).map(|_| (random.vector() * squash * scale).as_vec3()).collect();
        let Ok(Some(hull)) = std::panic::catch_unwind(|| SharedShape::convex_hull(&points)) else { continue };
        let Ok(shape) = ShapeGeometry::new(&hull) else { continue };
        made += 1;
        for _ in 0..5 {
            let triangle = [0, 1, 2].map(|_| random.vector() * squash * scale);
            let (mut scratch, mut found) = (PairProximity::default(), Vec::new());
            shape.examine(&triangle, 0.1 * scale, &mut scratch, &mut found);
            for proximity in &found {
                assert!((proximity.normal.length() - 1.0).abs() < 1.0e-9, "{proximity:?} {triangle:?}");
            }
        }
    }
    assert!(made > 1_000, "{made}");
}
