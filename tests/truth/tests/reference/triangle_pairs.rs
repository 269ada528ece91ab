//! The f64 reference for one pair of triangles against closed forms, a duality certificate, and parry3d-f64.

use crate::common::{CATEGORIES, Random, Triangle, hard_pair};
use circumsphere_truth::{
    ClosestFeatures, ClosestKind, TriangleSide, closest_features, point_segment, point_triangle, segment_segment,
    triangle_distance, triangles_cross,
};
use glam::DVec3;
use parry3d_f64::math::Pose;
use parry3d_f64::query;
use parry3d_f64::shape::Triangle as ParryTriangle;
use std::time::Instant;

/// Error of a distance relative to the pair's extent: a dozen operations with half a unit in the last place each.
const ROUNDING: f64 = 4e-15;

/// How far apart the certificate's two bounds may be. For a pair of unit size, the direction between two points at
/// distance d is known to 1e-16 / d, and the projections move by as much. So neither that direction nor that of nearly
/// parallel edges is more accurate than about sqrt(1e-16).
const CERTIFICATE_TOLERANCE: f64 = 1e-8;

/// parry stops its search when its bounds agree to the square root of ten machine epsilons, 4.7e-8, of the distance. A
/// pair of unit size is at most 2·√3 apart.
const PARRY_TOLERANCE: f64 = 1.7e-7;

/// Pairs compared with parry: 200,000 unless `CIRCUMSPHERE_PAIRS` is set.
fn pair_count() -> usize {
    std::env::var("CIRCUMSPHERE_PAIRS").map_or(200_000, |text| text.parse().expect("CIRCUMSPHERE_PAIRS is a number"))
}

/// Seed of the pairs compared with parry: 20260731 unless `CIRCUMSPHERE_SEED` is set.
fn seed() -> u64 {
    std::env::var("CIRCUMSPHERE_SEED").map_or(20_260_731, |text| text.parse().expect("CIRCUMSPHERE_SEED is a number"))
}

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn extent(a: &Triangle, b: &Triangle) -> f64 {
    a.iter().chain(b).map(|p| (*p - a[0]).abs().max_element()).fold(0.0, f64::max)
}

/// Moves a pair to its first vertex and scales it to unit size.
fn normalised(a: &Triangle, b: &Triangle) -> (Triangle, Triangle) {
    let (origin, extent) = (a[0], extent(a, b));
    let unit = if extent > 0.0 { extent } else { 1.0 };
    let local = |p: DVec3| (p - origin) / unit;
    (a.map(local), b.map(local))
}

fn at(triangle: &Triangle, weights: [f64; 3]) -> DVec3 {
    triangle[0] * weights[0] + triangle[1] * weights[1] + triangle[2] * weights[2]
}

/// Bounds of the distance of two triangles that do not depend on how the features were found. The explicit points of
/// the reported barycentric weights bound it from above, and the gap between the triangles' projections on any
/// direction bounds it from below. The directions are those of the points, and of each feature pair of the two
/// triangles.
fn certified_bounds(a: &Triangle, b: &Triangle, features: &ClosestFeatures) -> (f64, f64) {
    let (point_a, point_b) = (at(a, features.barycentric_a), at(b, features.barycentric_b));
    let gap = |direction: DVec3| {
        let unit = direction.normalize_or_zero();
        // Offsets from one corner, so that equal projections cancel.
        let shadow = |t: &Triangle| t.map(|p| (p - a[0]).dot(unit));
        let (of_a, of_b) = (shadow(a), shadow(b));
        let low = |s: [f64; 3]| s.into_iter().fold(f64::INFINITY, f64::min);
        let high = |s: [f64; 3]| s.into_iter().fold(f64::NEG_INFINITY, f64::max);
        (low(of_b) - high(of_a)).max(low(of_a) - high(of_b))
    };
    let edges = |t: &Triangle| [t[1] - t[0], t[2] - t[1], t[0] - t[2]];
    let mut directions = vec![point_b - point_a];
    directions.extend([edges(a)[0].cross(edges(a)[1]), edges(b)[0].cross(edges(b)[1])]);
    for edge_a in edges(a) {
        for edge_b in edges(b) {
            directions.push(edge_a.cross(edge_b));
        }
    }
    let lower = directions.into_iter().map(gap).fold(0.0, f64::max);
    (lower, point_a.distance(point_b))
}

#[derive(Default, Clone)]
struct Tally {
    compared: usize,
    crossing: usize,
    apart: usize,
    parry_distance_wrong: usize,
    parry_too_large: usize,
    parry_too_small: usize,
    parry_crossing_wrong: usize,
    worst_parry_error: f64,
    worst_certificate_gap: f64,
}

#[test]
fn agrees_with_parry_and_with_its_own_certificate() {
    let seed = seed();
    let count = pair_count();
    let started = Instant::now();
    let mut random = Random::new(seed);
    let mut tallies = vec![Tally::default(); CATEGORIES.len()];
    let mut worst_agreeing_error = 0f64;
    let pose = Pose::identity();
    for index in 0..count {
        let category = index % CATEGORIES.len();
        let tally = &mut tallies[category];
        let (a, b) = hard_pair(&mut random, category);
        let features = closest_features(&a, &b);
        let crossing = triangles_cross(&a, &b);
        let size = extent(&a, &b);
        let unit = if size > 0.0 { size } else { 1.0 };
        let distance = features.distance / unit;
        let named = || format!("pair {index} ({}): {a:?} {b:?} {features:?}", CATEGORIES[category]);
        tally.compared += 1;
        if crossing {
            tally.crossing += 1;
        } else {
            tally.apart += 1;
        }

        assert_eq!(crossing, features.kind == ClosestKind::Crossing, "{}", named());
        assert_eq!(crossing, triangles_cross(&b, &a), "{}", named());
        assert!(!crossing || features.distance == 0.0, "{}", named());
        for weights in [features.barycentric_a, features.barycentric_b] {
            assert!(weights.iter().all(|w| *w >= 0.0), "{}", named());
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14, "{}", named());
        }
        let swapped = triangle_distance(&b, &a) / unit;
        assert!((swapped - distance).abs() <= ROUNDING, "{swapped} {}", named());

        // The certificate does not need parry: its two bounds enclose the distance.
        let (local_a, local_b) = normalised(&a, &b);
        let (lower, upper) = certified_bounds(&local_a, &local_b, &features);
        assert!(upper >= distance - ROUNDING && upper <= distance + ROUNDING, "{lower} {upper} {}", named());
        assert!(lower <= distance + ROUNDING, "{lower} {upper} {}", named());
        tally.worst_certificate_gap = tally.worst_certificate_gap.max(upper - lower);
        assert!(upper - lower <= CERTIFICATE_TOLERANCE, "{lower} {upper} {}", named());

        let parry_a = ParryTriangle::new(local_a[0], local_a[1], local_a[2]);
        let parry_b = ParryTriangle::new(local_b[0], local_b[1], local_b[2]);
        let parry_distance =
            query::distance(&pose, &parry_a, &pose, &parry_b).expect("triangles are supported").distance;
        let error = (parry_distance - distance).abs();
        tally.worst_parry_error = tally.worst_parry_error.max(error);
        if error > PARRY_TOLERANCE {
            // A distance above that of two explicit points, or below the gap of two projections, refutes parry.
            let too_large = parry_distance > upper + PARRY_TOLERANCE;
            let too_small = parry_distance < lower - PARRY_TOLERANCE * 0.5;
            assert!(too_large || too_small, "parry {parry_distance}, bounds {lower} {upper}, {}", named());
            tally.parry_distance_wrong += 1;
            tally.parry_too_large += usize::from(too_large);
            tally.parry_too_small += usize::from(too_small);
        } else {
            worst_agreeing_error = worst_agreeing_error.max(error);
        }

        let parry_crossing =
            query::intersection_test(&pose, &parry_a, &pose, &parry_b).expect("triangles are supported").intersecting;
        if parry_crossing != crossing && distance > PARRY_TOLERANCE {
            assert!(lower > PARRY_TOLERANCE * 0.5, "{lower} {upper} {}", named());
            tally.parry_crossing_wrong += 1;
        } else if parry_crossing != crossing && crossing {
            // Signs decide exactly, and a common point is known.
            assert!(upper <= ROUNDING, "{upper} {}", named());
            tally.parry_crossing_wrong += 1;
        }
    }

    println!("{count} pairs, seed {seed}, {:.1} s", started.elapsed().as_secs_f64());
    println!(
        "{:<24}{:>9}{:>9}{:>9}{:>12}{:>10}{:>10}{:>12}{:>12}{:>14}",
        "category",
        "pairs",
        "crossing",
        "apart",
        "parry wrong",
        "too large",
        "too small",
        "wrong yes/no",
        "worst parry",
        "certificate"
    );
    for (name, t) in CATEGORIES.iter().zip(&tallies) {
        println!(
            "{name:<24}{:>9}{:>9}{:>9}{:>12}{:>10}{:>10}{:>12}{:>12.1e}{:>14.1e}",
            t.compared,
            t.crossing,
            t.apart,
            t.parry_distance_wrong,
            t.parry_too_large,
            t.parry_too_small,
            t.parry_crossing_wrong,
            t.worst_parry_error,
            t.worst_certificate_gap
        );
    }
    println!(
        "largest difference from parry where parry is not refuted: {worst_agreeing_error:.1e} of the pair's extent"
    );

    let total = |field: fn(&Tally) -> usize| tallies.iter().map(field).sum::<usize>();
    assert_eq!(total(|t| t.compared), count);
    assert!(total(|t| t.crossing) * 10 > count, "crossing pairs were compared");
    assert!(total(|t| t.apart) * 10 > count * 3, "pairs apart were compared");
    assert!(total(|t| t.parry_distance_wrong) * 100 < count, "parry agrees almost everywhere");
}

fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found:e}, expected {expected:e}");
}

/// Lengths from the smallest to the largest f32, by powers of two, which do not round.
const SCALES: [i32; 9] = [-120, -60, -20, -10, 0, 10, 20, 60, 126];

#[test]
fn parallel_triangles_are_apart_by_their_gap() {
    for exponent in SCALES {
        let unit = 2f64.powi(exponent);
        for gap in [1.0, 0.125, 1e-3, 1e-6] {
            let a = [v(0., 0., 0.), v(1., 0., 0.), v(0., 1., 0.)].map(|p| p * unit);
            let b = a.map(|p| p + v(0., 0., gap * unit));
            assert_near(triangle_distance(&a, &b) / unit, gap, ROUNDING);
            assert!(!triangles_cross(&a, &b));
        }
    }
}

#[test]
fn edge_over_edge_is_an_edge_pair_at_the_middle_of_both() {
    for exponent in SCALES {
        let unit = 2f64.powi(exponent);
        let a = [v(-1., 0., 0.), v(1., 0., 0.), v(0., 0., -3.)].map(|p| p * unit);
        let b = [v(0., 5., 4.), v(0., -1., 0.25), v(0., 1., 0.25)].map(|p| p * unit);
        let features = closest_features(&a, &b);
        assert_eq!(features.kind, ClosestKind::EdgeEdge { edge_a: 0, edge_b: 1 });
        assert_near(features.distance / unit, 0.25, ROUNDING);
        assert_eq!(features.barycentric_a, [0.5, 0.5, 0.0]);
        assert_eq!(features.barycentric_b, [0.0, 0.5, 0.5]);
        assert!(features.point_a.distance(v(0., 0., 0.) * unit) <= ROUNDING * unit);
        assert!(features.point_b.distance(v(0., 0., 0.25) * unit) <= ROUNDING * unit);
    }
}

#[test]
fn vertex_over_face_names_the_vertex_and_its_owner() {
    for exponent in SCALES {
        let unit = 2f64.powi(exponent);
        let face = [v(0., 0., 0.), v(4., 0., 0.), v(0., 4., 0.)].map(|p| p * unit);
        let above = [v(1., 1., 3.), v(1., 2., 3.), v(1., 1., 0.5)].map(|p| p * unit);
        let features = closest_features(&face, &above);
        let expected = ClosestKind::VertexFace { vertex_of: TriangleSide::B, vertex: 2 };
        assert_eq!(features.kind, expected);
        assert_near(features.distance / unit, 0.5, ROUNDING);
        for (weight, expected) in features.barycentric_a.into_iter().zip([0.5, 0.25, 0.25]) {
            assert_near(weight, expected, ROUNDING);
        }
        assert_eq!(features.barycentric_b, [0.0, 0.0, 1.0]);
        let features = closest_features(&above, &face);
        let expected = ClosestKind::VertexFace { vertex_of: TriangleSide::A, vertex: 2 };
        assert_eq!(features.kind, expected);
    }
}

#[test]
fn triangles_piercing_mid_face_cross_though_no_features_are_near() {
    for exponent in SCALES {
        let unit = 2f64.powi(exponent);
        let a = [v(-30., -20., 0.), v(30., -20., 0.), v(0., 40., 0.)].map(|p| p * unit);
        let b = [v(-1., 0., -30.), v(1., 0., -30.), v(0., 0., 60.)].map(|p| p * unit);
        let features = closest_features(&a, &b);
        assert_eq!(features.kind, ClosestKind::Crossing);
        assert_eq!(features.distance, 0.0);
        let point = features.point_a / unit;
        assert!(point.distance(features.point_b / unit) <= 100.0 * ROUNDING);
        // On both planes, z = 0 and y = 0, and between the piercing edges of b.
        assert!(point.y.abs() <= 1e-12 && point.z.abs() <= 1e-12 && point.x.abs() <= 0.7, "{point}");
        // No vertex is closer than about 20 to a face, and no edge to an edge.
        let near = (0..3)
            .flat_map(|i| (0..3).map(move |j| (i, j)))
            .map(|(i, j)| segment_segment(a[i], a[(i + 1) % 3], b[j], b[(j + 1) % 3]).distance)
            .chain((0..3).flat_map(|k| [point_triangle(a[k], &b).distance, point_triangle(b[k], &a).distance]))
            .fold(f64::INFINITY, f64::min);
        assert!(near / unit > 9.0, "{}", near / unit);
    }
}

/// A vertex on a face crosses it. Moved off by one unit in the last place, it does not. No tolerance could tell the two
/// apart.
#[test]
fn crossing_is_decided_to_the_last_bit() {
    let face = [v(0.1, 0.2, 0.3), v(0.9, 0.25, 0.3), v(0.4, 0.75, 0.3)];
    let resting = [v(0.5, 0.5, 0.3), v(0.5, 0.5, 1.0), v(0.25, 0.5, 1.0)];
    let mut lifted = resting;
    lifted[0].z = lifted[0].z.next_up();
    let mut sunk = resting;
    sunk[0].z = sunk[0].z.next_down();
    assert!(triangles_cross(&face, &resting));
    assert!(!triangles_cross(&face, &lifted));
    assert!(triangles_cross(&face, &sunk));
    assert_eq!(triangle_distance(&face, &sunk), 0.0);
    assert!(triangle_distance(&face, &lifted) <= 1e-16);
}

/// On a grid of small integers, integer arithmetic decides everything: an independent brute force over all features.
#[test]
fn crossing_equals_integer_arithmetic_on_a_grid() {
    let mut random = Random::new(7);
    let (mut crossing, mut apart) = (0, 0);
    for _ in 0..pair_count() / 4 {
        let mut triangle = || [random.grid_point(2), random.grid_point(2), random.grid_point(2)];
        let (a, b) = (triangle(), triangle());
        let expected = integer_triangles_cross(&a.map(|p| p.to_array()), &b.map(|p| p.to_array()));
        // Scaling by a power of two must not change the answer, even at the extremes of f32.
        for exponent in [0, -140, 120] {
            let unit = 2f64.powi(exponent);
            assert_eq!(triangles_cross(&a.map(|p| p * unit), &b.map(|p| p * unit)), expected, "{a:?} {b:?}");
        }
        if expected {
            crossing += 1;
        } else {
            apart += 1;
            // Squared distances of integer features are fractions with small denominators, so they are never tiny.
            assert!(triangle_distance(&a, &b) > 1e-3, "{a:?} {b:?}");
        }
    }
    println!("integer grid: {crossing} crossing, {apart} apart");
    assert!(crossing > pair_count() / 20 && apart > pair_count() / 20);
}

/// Tests separating directions of two convex sets with integer corners. The triangles are disjoint if and only if one
/// of the candidates (normals, cross products of edges, in-plane perpendiculars, edges, and joins of corners, which
/// suffice for degenerate triangles, too) strictly separates their projections.
fn integer_triangles_cross(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> bool {
    type Vector = [i128; 3];
    let whole = |t: &[[f64; 3]; 3]| t.map(|p| p.map(|x| x as i128));
    let (a, b) = (whole(a), whole(b));
    let minus = |p: Vector, q: Vector| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let cross =
        |p: Vector, q: Vector| [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    let dot = |p: Vector, q: Vector| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let edges = |t: &[Vector; 3]| [minus(t[1], t[0]), minus(t[2], t[1]), minus(t[0], t[2])];
    let (edges_a, edges_b) = (edges(&a), edges(&b));
    let joins: Vec<Vector> = a.iter().flat_map(|p| b.iter().map(move |q| minus(*q, *p))).collect();
    let normals = [cross(edges_a[0], edges_a[1]), cross(edges_b[0], edges_b[1])];
    // The shortest join of two disjoint polytopes is corner to corner, perpendicular to an edge through a corner of the
    // other (e × (join × e)), perpendicular to two edges, or perpendicular to a face.
    let mut directions: Vec<Vector> = normals.to_vec();
    directions.extend(&joins);
    for edge in edges_a.iter().chain(&edges_b) {
        directions.extend(joins.iter().map(|join| cross(*edge, cross(*join, *edge))));
    }
    for edge_a in edges_a {
        directions.extend(edges_b.iter().map(|edge_b| cross(edge_a, *edge_b)));
    }
    !directions.into_iter().any(|direction| {
        let shadow = |t: &[Vector; 3]| t.map(|p| dot(p, direction));
        let (of_a, of_b) = (shadow(&a), shadow(&b));
        of_a.iter().max() < of_b.iter().min() || of_b.iter().max() < of_a.iter().min()
    })
}

#[test]
fn degenerate_triangles_are_the_segments_and_points_they_are() {
    let point = [v(1., 2., 3.); 3];
    let segment = [v(0., 2., 3.), v(2., 2., 3.), v(1., 2., 3.)];
    let elsewhere = [v(1., 2., 7.); 3];
    let face = [v(0., 0., 3.), v(4., 0., 3.), v(0., 8., 3.)];
    assert!(triangles_cross(&point, &point));
    assert!(triangles_cross(&point, &segment));
    assert!(triangles_cross(&segment, &face));
    assert!(triangles_cross(&face, &point));
    assert!(!triangles_cross(&point, &elsewhere));
    assert_near(triangle_distance(&point, &elsewhere), 4.0, ROUNDING);
    assert_near(triangle_distance(&elsewhere, &segment), 4.0, ROUNDING);
    assert_near(triangle_distance(&face, &elsewhere), 4.0, ROUNDING);
    let skew = [v(1., 0., 8.), v(1., 4., 8.), v(1., 1., 8.)];
    assert_near(triangle_distance(&segment, &skew), 5.0, ROUNDING);
    // Zero vectors of both signs.
    assert!(triangles_cross(&[v(0., 0., 0.); 3], &[v(-0., -0., -0.); 3]));
}

#[test]
fn point_and_segment_functions_have_their_closed_forms() {
    for exponent in SCALES {
        let unit = 2f64.powi(exponent);
        let on_segment = point_segment(v(3., 4., 0.) * unit, v(0., 0., 0.), v(10., 0., 0.) * unit);
        assert_near(on_segment.parameter, 0.3, ROUNDING);
        assert_near(on_segment.distance / unit, 4.0, ROUNDING * 10.0);
        let beyond = point_segment(v(13., 4., 0.) * unit, v(0., 0., 0.), v(10., 0., 0.) * unit);
        assert_eq!(beyond.parameter, 1.0);
        assert_near(beyond.distance / unit, 5.0, ROUNDING * 10.0);
        let no_length = point_segment(v(3., 4., 0.) * unit, v(0., 0., 0.), v(0., 0., 0.));
        assert_near(no_length.distance / unit, 5.0, ROUNDING * 10.0);
        let parallel = segment_segment(v(0., 0., 0.), v(2., 0., 0.) * unit, v(1., 3., 0.) * unit, v(9., 3., 0.) * unit);
        assert_near(parallel.distance / unit, 3.0, ROUNDING * 10.0);
        let collinear =
            segment_segment(v(0., 0., 0.), v(2., 0., 0.) * unit, v(5., 0., 0.) * unit, v(9., 0., 0.) * unit);
        assert_near(collinear.distance / unit, 3.0, ROUNDING * 10.0);
        assert_eq!((collinear.parameter_a, collinear.parameter_b), (1.0, 0.0));
    }
}

/// Each of the four ends in turn is the closest point, over the inside of the other segment.
#[test]
fn every_end_of_a_segment_can_be_the_closest_point() {
    let (low, high) = (v(-2., 0., 0.), v(6., 0., 0.));
    let (end, away) = (v(0., 3., 4.), v(1., 9., 9.));
    for flat_first in [true, false] {
        for reversed in [true, false] {
            let (b0, b1) = if reversed { (away, end) } else { (end, away) };
            let at_end = if reversed { 1.0 } else { 0.0 };
            let found = if flat_first {
                let found = segment_segment(low, high, b0, b1);
                (found.distance, found.parameter_a, found.parameter_b, found.point_a, found.point_b)
            } else {
                let found = segment_segment(b0, b1, low, high);
                (found.distance, found.parameter_b, found.parameter_a, found.point_b, found.point_a)
            };
            assert_eq!(found, (5.0, 0.25, at_end, DVec3::ZERO, end));
        }
    }
}

/// A sliver whose altitude is 1e-9 of its length: the normal of its plane is known only to 1e-7, the distance far
/// better.
#[test]
fn slivers_lose_nothing() {
    let mut random = Random::new(11);
    for _ in 0..20_000 {
        let (along, up) = (random.direction(), random.direction());
        let normal = along.cross(up).normalize();
        let across = normal.cross(along);
        let altitude = random.power_of_ten(-9.0, -3.0);
        let start = random.vector();
        let mut sliver = [start, start + along, start + along * random.unit() + across * altitude];
        sliver.rotate_left(random.below(3));
        let weights = random.weights();
        let height = random.power_of_ten(-6.0, 0.0);
        let point = at(&sliver, weights) + normal * height;
        // The construction rounds by 1e-16 of lengths near 1. That moves the foot at most along the sliver's plane, and
        // the height by as much.
        assert_near(point_triangle(point, &sliver).distance, height, 2e-15);
    }
}

/// Two segments at an angle of 1e-7 that pass each other midway. A plain determinant would know the square of the
/// angle, 1e-14, only to 1 % and misplace the crossing.
#[test]
fn nearly_parallel_segments_keep_their_distance() {
    let mut random = Random::new(12);
    for _ in 0..20_000 {
        let along = random.direction();
        let across = along.cross(random.direction()).normalize();
        let normal = along.cross(across);
        let angle = random.power_of_ten(-8.0, -1.0);
        let gap = random.power_of_ten(-6.0, 0.0);
        let (from, to) = (random.range(0.1, 1.0), random.range(0.1, 1.0));
        let other = (along + across * angle) * random.range(0.5, 2.0);
        let middle = random.vector();
        let found = segment_segment(
            middle - along * from,
            middle + along * to,
            middle + normal * gap - other * 0.5,
            middle + normal * gap + other * 0.5,
        );
        assert_near(found.distance, gap, 4e-15);
    }
}

#[test]
fn an_offset_of_a_million_costs_only_the_rounding_of_the_input() {
    // Integers and eighths are exact at that offset, so the distance must be exact, too.
    let offset = v(1e6, -1e6, 1e6);
    let a = [v(0., 0., 0.), v(1., 0., 0.), v(0., 1., 0.)].map(|p| p + offset);
    let b = [v(0.25, 0.25, 0.125), v(1., 0., 1.), v(0., 1., 1.)].map(|p| p + offset);
    assert_near(triangle_distance(&a, &b), 0.125, ROUNDING);
}

#[test]
fn f32_extremes_are_right() {
    let large = f64::from(f32::MAX);
    let a = [v(-large, -large, 0.), v(large, -large, 0.), v(0., large, 0.)];
    let piercing = [v(0., 0., -large), v(1., 0., large), v(0., 1., large)];
    assert!(triangles_cross(&a, &piercing));
    let above = a.map(|p| p + v(0., 0., large));
    assert_near(triangle_distance(&a, &above) / large, 1.0, ROUNDING);
    let smallest = f64::from(f32::from_bits(1));
    let tiny = [v(0., 0., 0.), v(smallest, 0., 0.), v(0., smallest, 0.)];
    let tiny_above = tiny.map(|p| p + v(0., 0., smallest));
    assert!(!triangles_cross(&tiny, &tiny_above));
    assert_near(triangle_distance(&tiny, &tiny_above) / smallest, 1.0, ROUNDING);
    // The smallest gap above the largest triangle. Signs can see it, distances cannot.
    assert!(!triangles_cross(&a, &tiny_above));
    assert!(triangles_cross(&a, &tiny));
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig { failure_persistence: None, ..Default::default() })]

    /// Distances scale exactly with powers of two and do not depend on the order of axes, corners, or triangles.
    #[test]
    fn distance_is_the_same_however_the_pair_is_written(seed: u64, exponent in -60..60i32, category in 0usize..16) {
        let mut random = Random::new(seed);
        let (a, b) = hard_pair(&mut random, category);
        let size = extent(&a, &b);
        let distance = triangle_distance(&a, &b);
        let unit = 2f64.powi(exponent);
        proptest::prop_assert_eq!(triangle_distance(&a.map(|p| p * unit), &b.map(|p| p * unit)), distance * unit);
        let turned = |t: Triangle| [t[2], t[0], t[1]].map(|p| DVec3::new(p.y, -p.z, p.x));
        let other = triangle_distance(&turned(b), &turned(a));
        proptest::prop_assert!((other - distance).abs() <= ROUNDING * size, "{} {}", other, distance);
        proptest::prop_assert_eq!(triangles_cross(&turned(b), &turned(a)), triangles_cross(&a, &b));
    }
}
