//! Triangles against rigid shapes, compared with closed forms, the f64 reference, and parry in f64.

use bevy_circumsphere::kernel::{
    exact::{
        PairProximity,
        rigid_shape::{ShapeError, ShapeGeometry, ShapeProximity},
    },
    mesh::feature::Feature,
};
use circumsphere_truth::{point_segment, point_triangle, triangle_distance};
use glam::{DVec3, Vec3};
use parry3d::shape::SharedShape;
use parry3d_f64::{
    math::Pose as ParryPose,
    query,
    shape::{ConvexPolyhedron, Cuboid, Triangle},
};

use crate::{
    common::Random,
    truth::{exact, random_rotation},
};

/// f64 distances between f32 inputs of length about 1. parry's search stops at 5e-8 for a pair of unit size.
const TOLERANCE: f64 = 1.0e-9;
const PARRY_TOLERANCE: f64 = 1.0e-6;

/// Facets of a hull of f32 points about 1 long, found in f32, may be off by some units in the last place.
const HULL_SLACK: f64 = 1.0e-5;

pub fn examine(shape: &ShapeGeometry, triangle: &[DVec3; 3], range: f64) -> (f64, Vec<ShapeProximity>) {
    let (mut scratch, mut found) = (PairProximity::default(), Vec::new());
    let least = shape.examine(triangle, range, &mut scratch, &mut found);
    assert_eq!(least, found.iter().map(|proximity| proximity.distance).fold(f64::INFINITY, f64::min));
    (least, found)
}

pub fn at(triangle: &[DVec3; 3], weights: [f64; 3]) -> DVec3 {
    triangle[0] * weights[0] + triangle[1] * weights[1] + triangle[2] * weights[2]
}

/// A triangle of any size, including needles and points, about `reach` from the origin, in stored precision.
pub fn random_triangle(random: &mut Random, reach: f64) -> [DVec3; 3] {
    let size = random.power_of_ten(-2.0, 0.7);
    let center = random.direction() * reach * random.range(0.0, 2.0);
    let mut corners = [random.vector(), random.vector(), random.vector()];
    match random.below(8) {
        0 => corners[2] = corners[0].lerp(corners[1], random.unit()) + random.vector() * 1.0e-5,
        1 => corners[2] = corners[1] + random.vector() * 1.0e-5,
        2 => corners[1] = corners[0],
        _ => {}
    }
    exact(corners.map(|corner| (corner * size + center).as_vec3()))
}

/// Asserts what holds for every proximity: weights on the feature, a unit normal, and points at the distance.
pub fn assert_well_formed(triangle: &[DVec3; 3], proximity: &ShapeProximity) {
    let weights = proximity.barycentric;
    assert!(weights.iter().all(|weight| (-1.0e-12..=1.0 + 1.0e-12).contains(weight)), "{proximity:?}");
    assert!((weights.iter().sum::<f64>() - 1.0).abs() <= 1.0e-12, "{proximity:?}");
    match proximity.feature {
        Feature::Vertex(corner) => assert_eq!(weights[corner as usize], 1.0),
        Feature::Edge(edge) => assert_eq!(weights[(edge as usize + 2) % 3], 0.0),
        Feature::Face => {}
    }
    assert!((proximity.normal.length() - 1.0).abs() <= 1.0e-9, "{proximity:?}");
    let apart = at(triangle, weights) - proximity.shape_point;
    assert!((apart.length() - proximity.distance.abs()).abs() <= 1.0e-7, "{proximity:?} {triangle:?}");
    assert!(apart.distance(proximity.normal * proximity.distance) <= 1.0e-7, "{proximity:?} {triangle:?}");
}

#[test]
fn a_ball_has_the_distance_of_its_center_less_its_radius() {
    let mut random = Random::new(1);
    let (mut near, mut inside, mut beyond, mut through) = (0, 0, 0, 0);
    for _ in 0..60_000 {
        let radius = random.range(0.1, 1.5) as f32;
        let shape = ShapeGeometry::new(&SharedShape::ball(radius)).expect("a ball");
        let mut triangle = random_triangle(&mut random, 1.5);
        if random.below(20) == 0 {
            // Exactly through the center.
            triangle = [triangle[0], -triangle[0], triangle[2]];
        }
        let range = random.power_of_ten(-2.0, 0.0);
        let (least, found) = examine(&shape, &triangle, range);
        let closest = point_triangle(DVec3::ZERO, &triangle);
        let expected = closest.distance - f64::from(radius);
        if expected > range + TOLERANCE {
            assert!(found.is_empty() && least == f64::INFINITY, "{found:?}");
            beyond += 1;
            continue;
        }
        if expected > range - TOLERANCE {
            continue;
        }
        assert!((least - expected).abs() <= TOLERANCE, "{least} {expected} {triangle:?} {radius}");
        for proximity in &found {
            assert_well_formed(&triangle, proximity);
            assert!((proximity.shape_point.length() - f64::from(radius)).abs() <= TOLERANCE, "on the surface");
        }
        if closest.distance > 1.0e-3 {
            let nearest = found.iter().min_by(|a, b| a.distance.total_cmp(&b.distance)).expect("found");
            let outward = closest.point / closest.distance;
            assert!(nearest.normal.distance(outward) <= 1.0e-5, "{nearest:?} {outward}");
        } else {
            through += 1;
        }
        if expected < 0.0 {
            inside += 1;
        } else {
            near += 1;
        }
    }
    println!("ball: {near} near, {inside} inside of which {through} through the center, {beyond} beyond");
    assert!(near > 1_000 && inside > 5_000 && beyond > 5_000 && through > 100);
}

#[test]
fn a_capsule_has_the_distance_of_its_segment_less_its_radius() {
    let mut random = Random::new(2);
    let (mut near, mut inside, mut beyond, mut through, mut sides) = (0, 0, 0, 0, 0);
    for index in 0..60_000 {
        let radius = random.range(0.05, 0.8) as f32;
        let (start, end) = if index % 3 == 0 {
            let half = random.range(0.1, 1.0) as f32;
            (Vec3::Y * -half, Vec3::Y * half)
        } else {
            (random.vector().as_vec3(), random.vector().as_vec3())
        };
        let shape = ShapeGeometry::new(&SharedShape::capsule(start, end, radius)).expect("a capsule");
        let (start, end) = (start.as_dvec3(), end.as_dvec3());
        let mut triangle = random_triangle(&mut random, 1.5);
        if index % 4 == 0 {
            // One corner towards the side of the capsule, the others away from it.
            let foot = start.lerp(end, random.range(0.1, 0.9));
            let out = (end - start).cross(random.direction()).normalize();
            let tip = foot + out * (f64::from(radius) + random.range(-0.1, 0.1));
            let spread = (end - start).normalize() * random.range(0.1, 1.0);
            let rise = out * random.range(0.5, 2.0);
            triangle =
                exact([tip, tip + rise + spread, tip + rise - spread + random.vector() * 0.1].map(DVec3::as_vec3));
        }
        let range = random.power_of_ten(-2.0, 0.0);
        let (least, found) = examine(&shape, &triangle, range);
        let distance = triangle_distance(&triangle, &[start, end, end]);
        let expected = distance - f64::from(radius);
        if expected > range + TOLERANCE {
            assert!(found.is_empty() && least == f64::INFINITY, "{found:?}");
            beyond += 1;
            continue;
        }
        if expected > range - TOLERANCE {
            continue;
        }
        assert!((least - expected).abs() <= TOLERANCE, "{least} {expected} {triangle:?} {start} {end} {radius}");
        for proximity in &found {
            assert_well_formed(&triangle, proximity);
            let from_axis = point_segment(proximity.shape_point, start, end).distance;
            // Where the triangle crosses the axis, the way out is the triangle's normal, which need not be
            // perpendicular to the axis.
            let on_axis = proximity.distance <= -f64::from(radius) + TOLERANCE;
            assert!(on_axis || (from_axis - f64::from(radius)).abs() <= 1.0e-7, "{proximity:?}");
            sides += usize::from(matches!(proximity.feature, Feature::Vertex(_)) && proximity.shape_feature == 2);
        }
        if distance <= TOLERANCE {
            through += 1;
        } else if expected < 0.0 {
            inside += 1;
        } else {
            near += 1;
        }
    }
    println!("capsule: {near} near, {inside} inside, {through} through the axis, {beyond} beyond; {sides} vertex–side");
    assert!(near > 1_000 && inside > 5_000 && beyond > 5_000 && through > 300 && sides > 1_000);
}

#[test]
fn a_half_space_has_the_depth_of_each_vertex() {
    let mut random = Random::new(3);
    let mut counted = 0;
    for _ in 0..20_000 {
        let normal = random.direction().as_vec3();
        let shape = ShapeGeometry::new(&SharedShape::halfspace(normal)).expect("a half-space");
        let unit = normal.as_dvec3().normalize();
        let triangle = random_triangle(&mut random, 1.0);
        let range = random.power_of_ten(-2.0, 0.0);
        let (least, found) = examine(&shape, &triangle, range);
        let heights = triangle.map(|corner| corner.dot(unit));
        let expected = heights.iter().copied().filter(|height| *height <= range).fold(f64::INFINITY, f64::min);
        assert!(least == expected || (least - expected).abs() <= 1.0e-14, "{least} {expected}");
        assert_eq!(found.len(), heights.iter().filter(|height| **height <= range).count());
        for proximity in &found {
            assert_well_formed(&triangle, proximity);
            assert!(proximity.shape_point.dot(unit).abs() <= 1.0e-12 && proximity.normal.distance(unit) <= 1.0e-12);
            let Feature::Vertex(corner) = proximity.feature else { panic!("{proximity:?}") };
            assert!((heights[corner as usize] - proximity.distance).abs() <= 1.0e-14);
            counted += 1;
        }
    }
    assert!(counted > 10_000);
}

/// Signed distance of a point from the surface of a box centered at the origin, negative inside.
fn signed_box_distance(point: DVec3, half: DVec3) -> f64 {
    let beyond = point.abs() - half;
    beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
}

#[derive(Default)]
struct PolytopeTally {
    apart: usize,
    beyond: usize,
    vertices_inside: usize,
    cutting: usize,
}

/// Checks one triangle against a convex polyhedron. `signed` is the distance from its surface, negative inside. `parry`
/// is the distance that parry finds, 0 where they meet. `slack` is the error of the polyhedron's planes.
fn check_polytope(
    shape: &ShapeGeometry,
    triangle: &[DVec3; 3],
    range: f64,
    signed: impl Fn(DVec3) -> f64,
    parry: f64,
    slack: f64,
    tally: &mut PolytopeTally,
) {
    let (least, found) = examine(shape, triangle, range);
    let tolerance = PARRY_TOLERANCE.max(slack);
    let depths = triangle.map(&signed);
    let deepest = depths.iter().copied().fold(f64::INFINITY, f64::min);
    let told = || format!("{least} parry {parry} depths {depths:?} range {range} {triangle:?}\n{found:?}");
    for proximity in &found {
        assert_well_formed(triangle, proximity);
        assert!(
            signed(proximity.shape_point).abs() <= slack,
            "on the surface: {proximity:?} {} {}",
            signed(proximity.shape_point),
            told()
        );
        let own = signed(at(triangle, proximity.barycentric));
        if own.abs() > slack {
            assert_eq!(proximity.distance < 0.0, own < 0.0, "negative inside: {proximity:?} {own} {}", told());
            // The normal points out of the shape: a step along it from the surface ends outside.
            let outside = signed(proximity.shape_point + proximity.normal * 1.0e-3);
            assert!(outside >= -slack, "{proximity:?} {outside} {}", told());
        }
    }
    if deepest < -slack {
        assert!(least <= deepest + slack, "as deep as the deepest vertex: {}", told());
        for (vertex, &depth) in depths.iter().enumerate() {
            if depth < -slack {
                let own: Vec<_> = found.iter().filter(|p| p.feature == Feature::Vertex(vertex as u8)).collect();
                assert_eq!(own.len(), 1, "{}", told());
                assert!((own[0].distance - depth).abs() <= slack, "{}", told());
                assert!(!own[0].crossing);
            }
        }
        tally.vertices_inside += 1;
    } else if parry > range + tolerance {
        assert!(found.is_empty() && least == f64::INFINITY, "{}", told());
        tally.beyond += 1;
    } else if parry > tolerance {
        if parry < range - tolerance {
            assert!((least - parry).abs() <= tolerance, "{}", told());
            tally.apart += 1;
        }
    } else if deepest > slack {
        // The triangle cuts the solid although all its corners are outside. A distance of 0 from parry may be a near
        // miss.
        assert!(least <= tolerance, "{}", told());
        if least <= 0.0 {
            tally.cutting += 1;
            assert!(found.iter().any(|proximity| proximity.crossing), "{}", told());
        }
    }
}

#[test]
fn a_cuboid_has_the_distance_that_parry_and_its_planes_say() {
    let mut random = Random::new(4);
    let mut tally = PolytopeTally::default();
    for _ in 0..30_000 {
        let half =
            Vec3::new(random.range(0.1, 1.0) as f32, random.range(0.1, 1.0) as f32, random.range(0.1, 1.0) as f32);
        let shape = ShapeGeometry::new(&SharedShape::cuboid(half.x, half.y, half.z)).expect("a box");
        let half = half.as_dvec3();
        let triangle = random_triangle(&mut random, 1.0);
        let range = random.power_of_ten(-2.0, 0.0);
        let parry = query::distance(
            &ParryPose::identity(),
            &Triangle::new(triangle[0], triangle[1], triangle[2]),
            &ParryPose::identity(),
            &Cuboid::new(half),
        )
        .expect("supported")
        .distance;
        check_polytope(&shape, &triangle, range, |p| signed_box_distance(p, half), parry, 1.0e-7, &mut tally);
    }
    let PolytopeTally { apart, beyond, vertices_inside, cutting } = tally;
    println!("box: {apart} apart, {beyond} beyond, {vertices_inside} with vertices inside, {cutting} cutting through");
    assert!(apart > 1_000 && beyond > 1_000 && vertices_inside > 3_000 && cutting > 1_000);
}

/// The facets of the hull of points in general position, facing outward: every three points with no other beyond.
pub fn hull_facets(points: &[DVec3]) -> Vec<[DVec3; 3]> {
    let mut facets = Vec::new();
    for (i, &a) in points.iter().enumerate() {
        for (j, &b) in points.iter().enumerate().skip(i + 1) {
            for &c in &points[j + 1..] {
                let normal = (b - a).cross(c - a);
                let heights = || points.iter().map(|&point| normal.dot(point - a));
                // f64 rounding of three products of lengths up to 2.
                if heights().all(|height| height <= 1.0e-14) {
                    facets.push([a, b, c]);
                } else if heights().all(|height| height >= -1.0e-14) {
                    facets.push([a, c, b]);
                }
            }
        }
    }
    facets
}

#[test]
fn a_convex_hull_has_the_distance_that_parry_says() {
    let mut random = Random::new(5);
    let mut tally = PolytopeTally::default();
    for _ in 0..100 {
        let count = 6 + random.below(20);
        let points: Vec<Vec3> = (0..count).map(|_| (random.direction() * random.range(0.5, 1.0)).as_vec3()).collect();
        let shared = SharedShape::convex_hull(&points).expect("the points span a volume");
        let shape = ShapeGeometry::new(&shared).expect("a convex polyhedron");
        let stored: Vec<DVec3> =
            shared.as_convex_polyhedron().expect("it is one").points().iter().map(|point| point.as_dvec3()).collect();
        let polyhedron = ConvexPolyhedron::from_convex_hull(&stored).expect("the points span a volume");
        let facets = hull_facets(&stored);
        let signed = |point: DVec3| {
            let height =
                |facet: &[DVec3; 3]| (facet[1] - facet[0]).cross(facet[2] - facet[0]).normalize().dot(point - facet[0]);
            let highest = facets.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
            let nearest =
                facets.iter().map(|facet| point_triangle(point, facet).distance).fold(f64::INFINITY, f64::min);
            if highest <= 0.0 { -nearest } else { nearest }
        };
        for _ in 0..100 {
            let triangle = random_triangle(&mut random, 1.0);
            let range = random.power_of_ten(-2.0, 0.0);
            let parry = query::distance(
                &ParryPose::identity(),
                &Triangle::new(triangle[0], triangle[1], triangle[2]),
                &ParryPose::identity(),
                &polyhedron,
            )
            .expect("supported")
            .distance;
            check_polytope(&shape, &triangle, range, signed, parry, HULL_SLACK, &mut tally);
        }
    }
    let PolytopeTally { apart, beyond, vertices_inside, cutting } = tally;
    println!("hull: {apart} apart, {beyond} beyond, {vertices_inside} with vertices inside, {cutting} cutting through");
    assert!(apart > 300 && beyond > 300 && vertices_inside > 500 && cutting > 100);
}

#[test]
fn a_deep_vertex_leaves_through_the_nearest_face() {
    let shape = ShapeGeometry::new(&SharedShape::cuboid(1.0, 2.0, 3.0)).expect("a box");
    let triangle = [DVec3::new(0.25, 0.1, -0.3), DVec3::new(9.0, 0.0, 0.0), DVec3::new(9.0, 1.0, 0.0)];
    let (least, found) = examine(&shape, &triangle, 0.0);
    assert_eq!(least, -0.75);
    let deep = found.iter().find(|proximity| proximity.feature == Feature::Vertex(0)).expect("it is inside");
    assert_eq!((deep.normal, deep.distance, deep.crossing), (DVec3::X, -0.75, false));
    assert_eq!(deep.shape_point, DVec3::new(1.0, 0.1, -0.3));
}

#[test]
fn a_triangle_larger_than_the_box_that_slices_it_is_crossing() {
    let shape = ShapeGeometry::new(&SharedShape::cuboid(0.5, 0.5, 0.5)).expect("a box");
    let mut random = Random::new(6);
    for _ in 0..2_000 {
        let turn = random_rotation(&mut random);
        let height = random.range(-0.45, 0.45);
        let triangle =
            [DVec3::new(-30.0, -20.0, height), DVec3::new(30.0, -20.0, height), DVec3::new(0.0, 40.0, height)]
                .map(|corner| (turn * corner).as_vec3().as_dvec3());
        for range in [0.0, 0.05] {
            let (least, found) = examine(&shape, &triangle, range);
            assert!(least <= 0.0 && least >= -range - TOLERANCE, "{least}");
            let crossings = found.iter().filter(|proximity| proximity.crossing).count();
            // A plane through a box cuts at least three of its edges.
            assert!(crossings >= 3, "{crossings}");
            for proximity in &found {
                assert_well_formed(&triangle, proximity);
                assert!(signed_box_distance(proximity.shape_point, DVec3::splat(0.5)).abs() <= 1.0e-9);
                assert_eq!(proximity.feature == Feature::Face, proximity.crossing || range > 0.0);
            }
        }
    }
}

#[test]
fn a_box_corner_through_a_triangle_is_a_crossing_and_its_depth_is_that_of_the_corner() {
    let shape = ShapeGeometry::new(&SharedShape::cuboid(0.5, 0.5, 0.5)).expect("a box");
    let out = DVec3::ONE.normalize();
    for depth in [0.01, 0.05, 0.2] {
        // The plane across the diagonal, `depth` below the corner.
        let center = DVec3::splat(0.5) - out * depth;
        let (u, v) = (out.any_orthonormal_vector(), out.cross(out.any_orthonormal_vector()));
        let triangle = [center + u * 9.0, center - u * 5.0 + v * 9.0, center - u * 5.0 - v * 9.0];
        let (least, found) = examine(&shape, &triangle, 0.25);
        assert!((least + depth).abs() <= 1.0e-12, "{least}");
        let deepest = found.iter().min_by(|a, b| a.distance.total_cmp(&b.distance)).expect("found");
        assert!(deepest.normal.distance(out) <= 1.0e-9 && deepest.shape_point.distance(DVec3::splat(0.5)) <= 1.0e-12);
        assert!(found.iter().filter(|proximity| proximity.crossing).count() >= 3);
    }
}

#[test]
fn shapes_that_cannot_be_tested_are_refused() {
    for shape in [
        SharedShape::ball(f32::NAN),
        SharedShape::ball(f32::INFINITY),
        SharedShape::capsule(Vec3::ZERO, Vec3::NAN, 1.0),
        SharedShape::cuboid(1.0, f32::INFINITY, 1.0),
    ] {
        assert!(matches!(ShapeGeometry::new(&shape), Err(ShapeError::NonFinite)));
    }
    for shape in [
        SharedShape::ball(-0.5),
        SharedShape::capsule(Vec3::ZERO, Vec3::X, -1.0),
        SharedShape::cuboid(1.0, -0.5, 1.0),
        SharedShape::round_cuboid(1.0, 1.0, 1.0, -0.1),
    ] {
        assert!(matches!(ShapeGeometry::new(&shape), Err(ShapeError::Negative)));
    }
    assert!(matches!(ShapeGeometry::new(&SharedShape::halfspace(Vec3::ZERO)), Err(ShapeError::NoNormal)));
    for shape in [SharedShape::ball(0.0), SharedShape::cuboid(1.0, 0.0, 1.0)] {
        assert!(ShapeGeometry::new(&shape).is_ok(), "points and plates are valid shapes");
    }
}

#[test]
fn bounds_contain_the_shape() {
    let half = ShapeGeometry::new(&SharedShape::halfspace(Vec3::Y)).expect("a half-space");
    assert!(half.bounds().is_none());
    let capsule = ShapeGeometry::new(&SharedShape::capsule(Vec3::X, -Vec3::Y, 0.5)).expect("a capsule");
    let bounds = capsule.bounds().expect("finite");
    for (found, expected) in [(bounds.min, Vec3::new(-0.5, -1.5, -0.5)), (bounds.max, Vec3::new(1.5, 0.5, 0.5))] {
        assert!(found.distance(expected) < 1.0e-5, "{found}");
    }
    assert!(bounds.min.cmple(Vec3::new(-0.5, -1.5, -0.5)).all() && bounds.max.cmpge(Vec3::new(1.5, 0.5, 0.5)).all());
    let cuboid = ShapeGeometry::new(&SharedShape::cuboid(1.0, 2.0, 3.0)).expect("a box").bounds().expect("finite");
    assert_eq!((cuboid.min, cuboid.max), (Vec3::new(-1.0, -2.0, -3.0), Vec3::new(1.0, 2.0, 3.0)));
}
