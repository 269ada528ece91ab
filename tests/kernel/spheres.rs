//! Circumcenters, enclosing balls, and offset spheres of single triangles.

use bevy_circumsphere::kernel::spheres::{
    circumsphere::{
        Ball, RecipeSettings, circumcenter, curvature_factor, enclosing_ball, enclosing_balls, in_plane_center,
    },
    cone::SafetyCones,
};
use glam::{DVec3, Vec3};

use crate::{
    common::Random,
    truth::{
        ROUNDING, Spheres, bounded_center, circumcircle, exact, independent, largest_angle, largest_coordinate,
        longest_edge, triangle_with_angles,
    },
};

/// The largest angle up to which the in-plane center is the circumcenter.
const CLAMP_ANGLE: f64 = 150.0;

/// A center is a dozen f32 operations away from a corner, with an error of half a unit in the last place each.
const OPERATIONS: f64 = 12.0;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    Any,
    /// Smallest angle of 0.01 degrees, largest about 90.
    Needle,
    /// Largest angle between 90 and 150 degrees.
    Obtuse,
    /// Largest angle between 150 and 179.9 degrees.
    Cap,
}

fn random_triangle(random: &mut Random, shape: Shape, longest: f64, offset: DVec3) -> [Vec3; 3] {
    let (first, second) = match shape {
        Shape::Any => {
            let first = random.range(5.0, 140.0);
            (first, random.range(5.0, 175.0 - first))
        }
        Shape::Needle => (0.01, random.range(89.0, 91.0)),
        Shape::Obtuse => {
            let largest = random.range(91.0, 149.0);
            (largest, (180.0 - largest) * random.range(0.1, 0.9))
        }
        Shape::Cap => {
            let largest = 180.0 - random.power_of_ten(-1.0, 30f64.log10());
            (largest, (180.0 - largest) * random.range(0.1, 0.9))
        }
    };
    triangle_with_angles(random, first.to_radians(), second.to_radians(), longest, offset)
}

/// Whether a triangle may count as one without area. The kernel's limit is a doubled area of 1e-6 squared lengths.
fn is_segment(corners: &[DVec3; 3]) -> bool {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() <= 2.0e-6 * longest_edge(corners).powi(2)
}

/// Triangles of every shape and size, near the origin and far from it.
fn assorted(random: &mut Random, shapes: &[Shape], count: usize) -> Vec<[Vec3; 3]> {
    (0..count)
        .map(|index| {
            let longest = random.power_of_ten(-3.0, 3.0);
            let offset = match index / shapes.len() % 3 {
                0 => DVec3::ZERO,
                1 => random.vector() * 10.0 * longest,
                _ => random.vector() * 1.0e4 * longest,
            };
            random_triangle(random, shapes[index % shapes.len()], longest, offset)
        })
        .collect()
}

/// A fresh sphere. Far from the origin, rounding changes the triangle, so the angle is that of the stored corners.
struct Fresh {
    corners: [DVec3; 3],
    center: DVec3,
    radius: f64,
    angle: f64,
    apex: usize,
    is_segment: bool,
    /// How far rounding may move a corner off the sphere.
    tolerance: f64,
}

fn fresh_spheres(triangles: &[[Vec3; 3]], phi: f32) -> Vec<Fresh> {
    let (positions, list) = independent(triangles);
    let settings = RecipeSettings { sphere_offset: phi, curvature_threshold: 1.0, refit_threshold: 0.5 };
    let spheres = Spheres::new(&positions, &list, settings);
    assert!(spheres.curvatures.curvatures.iter().all(|&curvature| curvature == 0.0), "the triangles have no neighbors");
    triangles
        .iter()
        .enumerate()
        .map(|(index, &corners)| {
            let corners = exact(corners);
            let (angle, apex) = largest_angle(&corners);
            let center = spheres.offset.centers[index].as_dvec3();
            let radius = f64::from(spheres.offset.radii[index]);
            // The normal is a cross product: the error of its direction is the rounding divided by the sine of the
            // angle. The center is also rounded at the size of its own coordinates, and moves by up to √3 roundings,
            // away from one corner and towards another.
            let coordinate = largest_coordinate(&[center, corners[0], corners[1], corners[2]]);
            let tolerance = OPERATIONS * ROUNDING * radius / angle.sin() + 4.0 * ROUNDING * coordinate;
            Fresh { corners, center, radius, angle, apex, is_segment: is_segment(&corners), tolerance }
        })
        .collect()
}

#[test]
fn a_fresh_sphere_passes_through_the_three_vertices() {
    let mut random = Random::new(1);
    let triangles = assorted(&mut random, &[Shape::Any, Shape::Needle, Shape::Obtuse], 9_000);
    let (mut checked, mut worst) = (0, 0f64);
    for phi in [0.0, 1.0, 2.0, 5.0] {
        for fresh in fresh_spheres(&triangles, phi) {
            if fresh.angle.to_degrees() > CLAMP_ANGLE || fresh.is_segment {
                continue;
            }
            for corner in fresh.corners {
                let error = (corner.distance(fresh.center) - fresh.radius).abs();
                assert!(error <= fresh.tolerance, "{error:e} {:e} {:?}", fresh.tolerance, fresh.corners);
                worst = worst.max(error / fresh.tolerance);
            }
            let expected = (1.0 + f64::from(phi).powi(2)).sqrt() * circumcircle(&fresh.corners).1;
            let error = (fresh.radius - expected).abs();
            // The circumradius of a cap varies with the square of the sine of its angle.
            let tolerance = (1.0 + f64::from(phi)) * fresh.tolerance / fresh.angle.sin();
            assert!(error <= tolerance, "{error:e} {tolerance:e} {:?}", fresh.corners);
            checked += 1;
        }
    }
    println!("{checked} spheres through three vertices, at most {worst:.2} of the tolerance");
    assert!(checked > 30_000);
}

#[test]
fn a_fresh_clamped_sphere_passes_through_the_longest_edge_and_contains_the_third_vertex() {
    let mut random = Random::new(2);
    let triangles = assorted(&mut random, &[Shape::Cap], 6_000);
    let (mut checked, mut well_inside) = (0, 0);
    for phi in [0.0, 1.0, 5.0] {
        for fresh in fresh_spheres(&triangles, phi) {
            if fresh.angle.to_degrees() <= CLAMP_ANGLE || 180.0 - fresh.angle.to_degrees() < 0.01 {
                continue;
            }
            for corner in [(fresh.apex + 1) % 3, (fresh.apex + 2) % 3] {
                let error = (fresh.corners[corner].distance(fresh.center) - fresh.radius).abs();
                assert!(error <= fresh.tolerance, "{error:e} {:e} {:?}", fresh.tolerance, fresh.corners);
            }
            let third = fresh.corners[fresh.apex].distance(fresh.center);
            assert!(third <= fresh.radius, "{:?}", fresh.corners);
            well_inside += usize::from(third < fresh.radius - fresh.tolerance);
            // Unclamped, the radius would grow with the circumradius. Clamped, it is that of 150 degrees.
            let expected = (1.0 + f64::from(phi).powi(2)).sqrt() * longest_edge(&fresh.corners);
            assert!((fresh.radius - expected).abs() <= (1.0 + f64::from(phi)) * fresh.tolerance);
            checked += 1;
        }
    }
    println!("{checked} clamped spheres, the third vertex well inside {well_inside}");
    assert!(checked > 12_000 && well_inside * 10 > checked * 8);
}

#[test]
fn on_flat_ground_the_cone_is_as_wide_as_phi_says() {
    let mut random = Random::new(3);
    let triangles: Vec<_> = (0..300).map(|_| random_triangle(&mut random, Shape::Any, 1.0, DVec3::ZERO)).collect();
    let (positions, list) = independent(&triangles);
    for phi in [0.0f32, 0.5, 1.0, 2.0, 5.0] {
        let spheres = Spheres::new(
            &positions,
            &list,
            RecipeSettings { sphere_offset: phi, curvature_threshold: 1.0, refit_threshold: 0.5 },
        );
        let expected = f64::from(phi) / (1.0 + f64::from(phi).powi(2)).sqrt();
        for (triangle, &cosine) in spheres.cones.cosines.iter().enumerate() {
            // The errors of radius and height are the roundings of an in-plane distance each.
            assert!((f64::from(cosine) - expected).abs() <= 2.0 * OPERATIONS * ROUNDING, "{cosine} {expected}");
            let [a, b, c] = exact(triangles[triangle]);
            let normal = (b - a).cross(c - a).normalize();
            assert!(spheres.cones.axes[triangle].as_dvec3().distance(normal) <= 1.0e-5);
        }
    }
}

/// Random corners, so triangles of every shape and size, including slivers and triangles without area.
fn deformed(random: &mut Random) -> [Vec3; 3] {
    let size = random.power_of_ten(-3.0, 3.0);
    let offset = if random.below(2) == 0 { DVec3::ZERO } else { random.vector() * 1.0e3 };
    let mut corners = [random.vector(), random.vector(), random.vector()];
    match random.below(5) {
        0 => {
            corners[2] = corners[0].lerp(corners[1], random.unit()) + random.vector() * random.power_of_ten(-9.0, -1.0);
        }
        1 => corners[2] = corners[1] + random.vector() * random.power_of_ten(-9.0, -1.0),
        2 if random.below(4) == 0 => corners[random.below(3)] = corners[random.below(3)],
        _ => {}
    }
    corners.map(|corner| (corner * size + offset).as_vec3())
}

/// The largest distance of an in-plane center from a corner, in longest edges. The center is within √3 halves of *some*
/// edge from the middle of that edge, and no corner is farther from that middle than the longest edge.
const STALE_RADIUS: f64 = 0.866_025_5 + 1.0;

#[test]
fn every_ball_contains_its_triangle_however_stale_its_recipe() {
    const TRIANGLES: usize = 2_000;
    const DEFORMATIONS: usize = 20;
    let (mut checked, mut thin) = (0, 0);
    let mut largest = 0f64;
    for phi in [0.0f32, 1.0, 5.0] {
        let mut random = Random::new(4);
        let settings = RecipeSettings { sphere_offset: phi, curvature_threshold: 1.0, refit_threshold: f32::INFINITY };
        let start: Vec<_> = assorted(&mut random, &[Shape::Any, Shape::Needle, Shape::Obtuse, Shape::Cap], TRIANGLES);
        let (positions, list) = independent(&start);
        let mut spheres = Spheres::new(&positions, &list, settings);
        for _ in 0..DEFORMATIONS {
            let triangles: Vec<_> = (0..TRIANGLES).map(|_| deformed(&mut random)).collect();
            let (positions, _) = independent(&triangles);
            assert_eq!(spheres.update(&positions), 0, "every recipe has to be stale");
            for (triangle, corners) in triangles.iter().enumerate() {
                let corners = exact(*corners);
                let center = spheres.offset.centers[triangle].as_dvec3();
                let radius = f64::from(spheres.offset.radii[triangle]);
                // No tolerance, because radii are enlarged by more than their rounding.
                for corner in corners {
                    assert!(corner.distance(center) <= radius, "{:e} {corners:?}", corner.distance(center) / radius);
                }
                let longest = longest_edge(&corners);
                // The center is rounded at its own coordinates, and the center of a larger sphere is farther out.
                let rounding = OPERATIONS * ROUNDING * (largest_coordinate(&corners) + radius);
                let allowed = (1.0 + f64::from(phi).powi(2)).sqrt() * STALE_RADIUS * longest + rounding;
                assert!(radius <= allowed, "{radius} {allowed} {corners:?}");
                if phi == 0.0 && longest > 0.0 {
                    largest = largest.max(radius / longest);
                }
                thin += usize::from(longest > 0.0 && largest_angle(&corners).0 > 3.1);
                checked += 1;
            }
        }
    }
    println!("{checked} stale balls, {thin} about slivers, the largest {largest:.2} longest edges");
    assert!(checked >= 100_000 && thin > 1_000);
}

#[test]
fn the_smallest_ball_contains_its_triangle_and_is_the_smallest() {
    let mut random = Random::new(5);
    let (mut checked, mut acute, mut obtuse) = (0, 0, 0);
    let mut triangles: Vec<_> = (0..90_000).map(|_| deformed(&mut random)).collect();
    triangles.extend(assorted(&mut random, &[Shape::Any, Shape::Needle, Shape::Obtuse, Shape::Cap], 30_000));
    let (positions, list) = independent(&triangles);
    let mut balls = Vec::new();
    enclosing_balls(&positions, &list, &mut balls);
    assert_eq!(balls.len(), triangles.len());
    for (&stored, ball) in triangles.iter().zip(&balls) {
        assert_eq!(*ball, enclosing_ball(stored));
        let corners = exact(stored);
        let (center, radius) = (ball.center.as_dvec3(), f64::from(ball.radius));
        for corner in corners {
            assert!(corner.distance(center) <= radius, "{:e} {corners:?}", corner.distance(center) / radius);
        }
        let longest = longest_edge(&corners);
        let (angle, _) = largest_angle(&corners);
        let rounding = OPERATIONS * ROUNDING * (largest_coordinate(&corners) + longest);
        if angle >= std::f64::consts::FRAC_PI_2 || is_segment(&corners) {
            // Of two long edges with equal f32 lengths, the shorter may be chosen. The angle there is below a right
            // angle by the rounding of the lengths over the shortest edge.
            let shortest = (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(f64::INFINITY, f64::min);
            let doubt = if shortest > 0.0 { (4.0 * ROUNDING * longest / shortest).min(0.2) } else { 0.0 };
            let allowed = 0.5 * longest * (1.0 + 0.5 * doubt * doubt) + rounding;
            assert!(radius <= allowed, "{radius} {allowed} {corners:?}");
            obtuse += 1;
        } else {
            let expected = circumcircle(&corners).1;
            assert!((radius - expected).abs() <= rounding, "{radius} {expected} {rounding:e} {corners:?}");
            acute += 1;
        }
        checked += 1;
    }
    println!("{checked} smallest balls: {acute} acute, {obtuse} not");
    assert!(acute > 10_000 && obtuse > 10_000);
}

/// The worst error of the circumcenter relative to the circumradius, with a bound for each shape.
#[test]
fn the_circumcenter_agrees_with_f64() {
    let mut random = Random::new(6);
    let kinds: [(&str, f64, f64); 5] = [
        ("acute", 60.0, 70.0),
        ("right", 90.0, 45.0),
        ("obtuse", 120.0, 25.0),
        ("needle", 0.01, 89.9),
        ("cap", 179.98, 0.01),
    ];
    for (name, first, second) in kinds {
        let (mut worst, mut checked) = (0f64, 0);
        for _ in 0..5_000 {
            let longest = random.power_of_ten(-6.0, 6.0);
            let stored = triangle_with_angles(
                &mut random,
                f64::to_radians(first),
                f64::to_radians(second),
                longest,
                DVec3::ZERO,
            );
            let corners = exact(stored);
            let (center, radius) = circumcircle(&corners);
            let (vertex, offset, found_radius) = circumcenter(stored).expect("the triangle has an area");
            assert_eq!(vertex, largest_angle_by_length(&corners), "relative to the corner of the largest angle");
            let error = (corners[vertex] + offset.as_dvec3()).distance(center) / radius;
            worst = worst.max(error).max((f64::from(found_radius) / radius - 1.0).abs());
            checked += 1;
        }
        println!("{name}: {checked} circumcenters, worst error {worst:.1e} of the circumradius");
        // A dozen operations with an error of half a unit in the last place each. The normal is divided by the sine of
        // its angle: 7e-7 for all except the cap, whose sine is 3.5e-4.
        let angle = f64::to_radians(first.max(second).max(180.0 - first - second));
        let bound = OPERATIONS * ROUNDING / angle.sin();
        assert!(worst <= bound, "{name}: {worst:e}");
        assert!(checked == 5_000);
    }
}

/// The corner opposite the longest edge by f32 lengths, the first if several are equal.
fn largest_angle_by_length(corners: &[DVec3; 3]) -> usize {
    let lengths = [0, 1, 2].map(|k| corners[k].as_vec3().distance(corners[(k + 1) % 3].as_vec3()));
    let longest = (0..3).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best });
    (longest + 2) % 3
}

/// A triangle with the given largest angle, on a longest edge from −1 to 1. `skew` moves the apex along the arc.
fn on_unit_edge(angle: f64, skew: f64) -> [Vec3; 3] {
    // By the inscribed angle theorem, all apexes with the same angle lie on one arc.
    let (center, radius) = (angle.tan().recip(), angle.sin().recip());
    let direction = std::f64::consts::FRAC_PI_2 + skew * (std::f64::consts::PI - angle) * 0.5;
    let apex = DVec3::new(radius * direction.cos(), center + radius * direction.sin(), 0.0);
    [DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0), apex].map(DVec3::as_vec3)
}

#[test]
fn the_in_plane_center_is_continuous_across_the_right_angle_and_the_clamp() {
    const STEP: f64 = 1.0e-3;
    // The center lies cot γ below the edge, whose half length is 1. The slope 1/sin² γ is at most 4 up to 150 degrees.
    const SLOPE: f64 = 4.0;
    for (from, to) in [(88.0f64, 92.0f64), (145.0, 155.0), (89.9, 150.1)] {
        for skew in [0.0, 0.3, -0.8] {
            let mut previous: Option<Ball> = None;
            let (mut steps, mut moved) = (0, 0f64);
            let mut angle = from.to_radians();
            while angle <= to.to_radians() {
                let stored = on_unit_edge(angle, skew);
                let ball = in_plane_center(stored);
                let (center, _) = bounded_center(&exact(stored));
                assert!(ball.center.as_dvec3().distance(center) <= 1.0e-5, "{angle} {ball:?} {center}");
                if let Some(previous) = previous {
                    let change = ball.center.distance(previous.center);
                    // Plus twice the rounding of a center.
                    assert!(f64::from(change) <= SLOPE * STEP * 1.01 + 1.0e-5, "{angle} {change}");
                    assert!(f64::from((ball.radius - previous.radius).abs()) <= SLOPE * STEP * 1.01 + 1.0e-5);
                    moved += f64::from(change);
                }
                previous = Some(ball);
                angle += STEP;
                steps += 1;
            }
            assert!(steps > 60 && moved > 0.05, "{steps} {moved}");
        }
    }
}

#[test]
fn a_triangle_without_area_has_the_ball_of_a_segment_or_a_point() {
    let mut random = Random::new(7);
    let settings = RecipeSettings { sphere_offset: 1.0, curvature_threshold: 1.0, refit_threshold: 0.5 };
    for _ in 0..2_000 {
        // Whole steps are collinear in stored precision, too.
        let (start, step) = (random.grid_point(8).as_vec3(), random.grid_point(8).as_vec3());
        let mut corners = match random.below(4) {
            0 => [start; 3],
            1 => [start, start, start + step],
            2 => [start, start + step, start + step * 2.0],
            _ => [start, start + step, start - step * 3.0],
        };
        corners.rotate_left(random.below(3));
        let scale = 2f32.powi(random.whole(-20, 20));
        let corners = corners.map(|corner| corner * scale);
        let truth = exact(corners);
        let longest = longest_edge(&truth);
        let low = truth.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = truth.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        // The middle of collinear points is the middle of their box.
        let middle = (low + high) * 0.5;
        let rounding = OPERATIONS * ROUNDING * (longest + largest_coordinate(&truth));
        assert!(circumcenter(corners).is_none());
        for ball in [in_plane_center(corners), enclosing_ball(corners)] {
            assert!(ball.center.as_dvec3().distance(middle) <= rounding, "{corners:?} {ball:?}");
            assert!((f64::from(ball.radius) - 0.5 * longest).abs() <= rounding, "{corners:?} {ball:?}");
        }
        let (positions, list) = independent(&[corners]);
        let spheres = Spheres::new(&positions, &list, settings);
        assert!(spheres.offset.centers[0].as_dvec3().distance(middle) <= rounding);
        assert!((f64::from(spheres.offset.radii[0]) - 0.5 * longest).abs() <= rounding);
        assert_eq!(spheres.cones.cosines[0], SafetyCones::EVERYWHERE);
        assert_eq!(spheres.cones.axes[0], Vec3::ZERO);
    }
}

#[test]
fn a_triangle_that_loses_its_area_keeps_its_last_normal() {
    let flat = [Vec3::ZERO, Vec3::X, Vec3::Z];
    let (positions, list) = independent(&[flat]);
    for delta in [0.0, 0.5, f32::MAX] {
        let mut spheres = Spheres::new(
            &positions,
            &list,
            RecipeSettings { sphere_offset: 1.0, curvature_threshold: 1.0, refit_threshold: delta },
        );
        let normal = spheres.cones.axes[0];
        assert_eq!(normal, -Vec3::Y);
        spheres.update(&[Vec3::ZERO, Vec3::X, Vec3::X * 0.25]);
        assert_eq!(spheres.cones.axes[0], normal);
        assert_eq!(spheres.cones.cosines[0], SafetyCones::EVERYWHERE);
        assert_eq!(spheres.offset.heights[0], 0.0);
        spheres.update(&[Vec3::ZERO, Vec3::X, -Vec3::Z]);
        assert_eq!(spheres.cones.axes[0], -normal);
        assert!(spheres.cones.cosines[0] > 0.5);
    }
}

#[test]
fn no_length_gives_what_is_not_a_number() {
    let mut random = Random::new(8);
    let mut checked = 0;
    // From the smallest subnormal f32 to the largest size at which the circumsphere of a right triangle fits. Squares
    // of lengths fit only from 2^-63 to 2^62.
    for exponent in -149..=124 {
        for _ in 0..40 {
            let scale = 2f64.powi(exponent);
            let shape = if random.below(2) == 0 {
                [random.vector(), random.vector(), random.vector()]
            } else {
                [random.grid_point(2), random.grid_point(2), random.grid_point(2)]
            };
            let corners = shape.map(|corner| (corner * scale).as_vec3());
            let truth = exact(corners);
            let (positions, list) = independent(&[corners]);
            let spheres = Spheres::new(
                &positions,
                &list,
                RecipeSettings { sphere_offset: 1.0, curvature_threshold: 1.0, refit_threshold: 0.5 },
            );
            let offset = Ball { center: spheres.offset.centers[0], radius: spheres.offset.radii[0] };
            for ball in [in_plane_center(corners), enclosing_ball(corners), offset] {
                assert!(ball.center.is_finite() && ball.radius.is_finite(), "2^{exponent} {corners:?} {ball:?}");
                // Every rounding of a coordinate or length loses up to half of the smallest subnormal.
                let lost = 2f64.powi(-146);
                for corner in truth {
                    let distance = corner.distance(ball.center.as_dvec3());
                    assert!(distance <= f64::from(ball.radius) * (1.0 + 1e-6) + lost, "2^{exponent} {corners:?}");
                }
                assert!(
                    f64::from(ball.radius) <= 1.5 * STALE_RADIUS * longest_edge(&truth) + lost,
                    "2^{exponent} {corners:?} {ball:?}"
                );
                checked += 1;
            }
            assert!(spheres.cones.axes[0].is_finite() && spheres.cones.cosines[0].is_finite());
            assert!(spheres.curvatures.curvatures[0].is_finite());
            if let Some((_, offset, radius)) = circumcenter(corners) {
                assert!(offset.is_finite() && radius.is_finite());
            }
        }
    }
    assert!(checked > 20_000);
}

/// Far from the origin, rounding moved the center of a small triangle by more than its height. The height then exceeded
/// the radius, and the cone contained no directions.
#[test]
fn a_cone_holds_its_own_axis_however_far_from_the_origin() {
    let corners = [(1.835_516_3, 6_817.493), (1.835_188_9, 6_817.493), (1.834_938_5, 6_817.492_7)];
    let positions = corners.map(|(x, z)| Vec3::new(x, -13_371.445, z));
    for phi in [1.0, 1.0e3, 1.0e6] {
        let settings = RecipeSettings { sphere_offset: phi, curvature_threshold: 1.0, refit_threshold: 0.5 };
        let spheres = Spheres::new(&positions, &[[0, 1, 2]], settings);
        let cosine = spheres.cones.cosines[0];
        assert!(cosine > 0.0 && cosine <= 1.0, "{cosine} at {phi}");
    }
}

/// Found by the fuzz target `spheres`: differences of coordinates, heights, and the lengths of edges that used to be
/// the longest leave the range of f32 before the coordinates do.
#[test]
fn spheres_at_the_end_of_f32_are_numbers() {
    let settings = RecipeSettings { sphere_offset: 1.0e6, curvature_threshold: 0.1, refit_threshold: f32::MAX };
    let [apex, low, high] = [Vec3::new(1.0e-7, 1.0e-7, 0.0), Vec3::Z * -1.916_326_7e38, Vec3::Z * 1.486_496_9e38];
    let huge = [Vec3::Z * 6.805_535e32, Vec3::new(3.898_142e30, 6.461_619e27, 0.0), Vec3::Z * 1.611_793e25];
    let wide = [Vec3::Z * -1.741_652_1e38, Vec3::new(-2.658_455_5e36, 2.69e-43, 0.0), Vec3::ZERO];
    let spread = [Vec3::X * f32::MIN, Vec3::Y * f32::MAX, Vec3::new(f32::MAX, f32::MIN, f32::MAX)];
    let diagonal =
        [Vec3::ZERO, Vec3::new(-1.834_334_6e38, 3.396_151_4e38, 3.396_151_4e38), Vec3::splat(3.396_151_4e38)];
    let longer = Vec3::new(0.0, 3.396_151_4e38, 3.396_151_4e38);
    let longer = [longer, Vec3::new(1.170_884_5e-38, 9.1835e-41, 0.0), Vec3::new(-2.596_148_4e33, -1.0e34, -1.0e34)];
    for corners in [[high, low, apex], huge, wide, spread, diagonal, longer] {
        let [a, b, c] = corners;
        let mut spheres = Spheres::new(&corners, &[[0, 1, 2]], settings);
        // These recipes become stale, because other edges are the longest now.
        for positions in [[a, b, c], [b, c, a], [c, a, b], [a * 1.0e-30, b, c]] {
            spheres.update(&positions);
            let offset = Ball { center: spheres.offset.centers[0], radius: spheres.offset.radii[0] };
            for ball in [in_plane_center(positions), enclosing_ball(positions), offset] {
                assert!(!ball.center.is_nan() && ball.radius > 0.0, "{ball:?} of {positions:?}");
            }
            if let Some((_, offset, radius)) = circumcenter(positions) {
                assert!(!offset.is_nan() && radius > 0.0, "{offset} {radius} {positions:?}");
            }
            assert!(spheres.offset.heights[0] >= 0.0, "{positions:?}");
            let (axis, cosine) = (spheres.cones.axes[0], spheres.cones.cosines[0]);
            assert!(axis.is_finite() && (-1.0..=1.0).contains(&cosine), "{axis} {cosine} {positions:?}");
        }
    }
}

#[test]
fn the_curvature_factor_is_the_cubic_hermite_step() {
    for step in 0..=40 {
        let t = f64::from(step) / 20.0;
        for (curvature, radius, threshold) in [(t, 1.0, 1.0), (-t, 1.0, 1.0), (t / 3.0, 6.0, 2.0), (t * 2.0, 0.25, 0.5)]
        {
            let clamped = t.min(1.0);
            let expected = 1.0 - 3.0 * clamped.powi(2) + 2.0 * clamped.powi(3);
            let found = f64::from(curvature_factor(curvature as f32, radius, threshold));
            assert!((found - expected).abs() <= OPERATIONS * ROUNDING, "{t} {found} {expected}");
        }
    }
    assert_eq!(curvature_factor(0.0, 0.0, 1.0), 1.0);
    assert_eq!(curvature_factor(f32::MAX, f32::MAX, 1.0), 0.0);
}
