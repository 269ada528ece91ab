//! The exact test of two triangles against the f64 reference.

use bevy_circumsphere::kernel::{
    exact::{PairProximity, Proximity, examine_pair},
    mesh::{
        feature::{Feature, FeatureKind, FeaturePair},
        side::{outward_direction, rise},
        topology::SurfaceTopology,
    },
};
use circumsphere_support::scenes::icosphere;
use circumsphere_truth::{ClosestKind, closest_features, segment_segment};
use glam::{DVec3, Vec3};

use crate::common::{CATEGORIES, Random, Triangle, hard_pair};

/// Error of a distance relative to the pair's extent. Products of f32 differences are exact or nearly exact in f64. The
/// remaining error comes from the division by a sliver's normal, whose square is 1e-16 of the edges' for the flattest
/// triangle that f32 can store.
const DISTANCE_TOLERANCE: f64 = 1.0e-9;

const PAIRS: usize = 320_000;

fn extent(a: &Triangle, b: &Triangle) -> f64 {
    a.iter().chain(b).map(|p| (*p - a[0]).abs().max_element()).fold(0.0, f64::max)
}

fn at(triangle: &Triangle, weights: [f64; 3]) -> DVec3 {
    // Relative to a corner, because weights times coordinates would cancel far from the origin.
    triangle[0] + (triangle[1] - triangle[0]) * weights[1] + (triangle[2] - triangle[0]) * weights[2]
}

fn pierces(features: FeaturePair) -> bool {
    features.kind() == FeatureKind::EdgeFace
}

/// Whether weights describe a point on a feature.
fn lies_on(weights: [f64; 3], feature: Feature) -> bool {
    let sums_to_one = (weights.iter().sum::<f64>() - 1.0).abs() <= 1.0e-14;
    // The first weight is 1 less the others, so it may differ from 0 by their rounding.
    let bounded = weights.iter().all(|&weight| (-1.0e-15..=1.0 + 1.0e-15).contains(&weight));
    let exact = match feature {
        Feature::Vertex(corner) => (0..3).all(|k| weights[k] == if k == corner as usize { 1.0 } else { 0.0 }),
        Feature::Edge(edge) => weights[(edge as usize + 2) % 3] == 0.0,
        Feature::Face => true,
    };
    sums_to_one && bounded && exact
}

/// The fault of a reported proximity, if any.
fn fault(a: &Triangle, b: &Triangle, found: &Proximity, size: f64) -> Option<&'static str> {
    let (weights_a, weights_b) = (found.barycentric_a, found.barycentric_b);
    if !weights_a.iter().chain(&weights_b).all(|weight| weight.is_finite()) {
        return Some("weights are not finite");
    }
    if !lies_on(weights_a, found.features.a) || !lies_on(weights_b, found.features.b) {
        return Some("weights do not lie on their feature");
    }
    let between = at(a, weights_a) - (at(b, weights_b) - b[0]) - b[0];
    let tolerance = DISTANCE_TOLERANCE * size;
    if (between.length() - found.distance).abs() > tolerance {
        return Some("the points are not at the distance");
    }
    if between.distance(found.separation) > tolerance {
        return Some("the separation is not between the points");
    }
    if (found.separation.length() - found.distance).abs() > tolerance * 1.0e-3 {
        return Some("the separation is not as long as the distance");
    }
    if pierces(found.features) && (found.distance != 0.0 || found.separation != DVec3::ZERO) {
        return Some("a piercing pair has a distance");
    }
    None
}

#[derive(Clone, Default)]
struct Tally {
    pairs: usize,
    within: usize,
    beyond: usize,
    crossing: usize,
    undecided: usize,
    proximities: usize,
    worst: f64,
}

#[test]
fn distances_and_features_equal_the_reference_on_hard_pairs() {
    let mut random = Random::new(20_260_801);
    let mut tallies = vec![Tally::default(); CATEGORIES.len()];
    let mut kinds = std::collections::BTreeMap::new();
    let mut failures: Vec<String> = Vec::new();
    let mut faults = vec![0usize; CATEGORIES.len()];
    let mut found = PairProximity::default();
    for index in 0..PAIRS {
        let category = index % CATEGORIES.len();
        let tally = &mut tallies[category];
        let (a, b) = hard_pair(&mut random, category);
        let size = extent(&a, &b).max(f64::MIN_POSITIVE);
        let truth = closest_features(&a, &b);
        let range = match random.below(4) {
            0 => 0.0,
            1 => truth.distance * random.range(0.5, 1.5),
            2 => size * random.power_of_ten(-4.0, 0.0),
            _ => size * 4.0,
        };
        examine_pair(&a, &b, range, &mut found);
        tally.pairs += 1;
        let tolerance = DISTANCE_TOLERANCE * size;
        let mut fail = |what: &str| {
            faults[category] += 1;
            if failures.len() < 12 {
                failures.push(format!(
                    "{what}: pair {index} ({}) range {range:e} truth {:e} {:?} found {:e}, extent {size:e}\n  {a:?}\n  {b:?}\n  {:?}",
                    CATEGORIES[category], truth.distance, truth.kind, found.distance, found.proximities
                ));
            }
        };
        for proximity in &found.proximities {
            tally.proximities += 1;
            *kinds.entry(proximity.features.kind()).or_insert(0usize) += 1;
            if let Some(what) = fault(&a, &b, proximity, size) {
                fail(what);
            }
            if proximity.distance > range {
                fail("a proximity beyond the range");
            }
            if proximity.distance < truth.distance - tolerance {
                fail("a proximity closer than the triangles are");
            }
        }
        let least = found.proximities.iter().map(|proximity| proximity.distance).fold(f64::INFINITY, f64::min);
        if truth.distance <= range - tolerance || truth.distance == 0.0 && range > tolerance {
            tally.within += 1;
            tally.crossing += usize::from(truth.kind == ClosestKind::Crossing);
            let error = (found.distance - truth.distance).abs() / size;
            tally.worst = tally.worst.max(error);
            if error > DISTANCE_TOLERANCE {
                fail("wrong distance");
            }
            if found.proximities.is_empty() {
                fail("within range without a proximity");
            }
            if least != found.distance {
                fail("the least proximity is not the distance");
            }
        } else if truth.distance > range + tolerance {
            tally.beyond += 1;
            if found.distance <= range || !found.proximities.is_empty() {
                fail("beyond the range but reported");
            }
        } else {
            tally.undecided += 1;
        }
    }
    println!(
        "{:<24}{:>8}{:>8}{:>9}{:>8}{:>10}{:>12}{:>9}",
        "category", "pairs", "within", "crossing", "beyond", "undecided", "proximities", "worst"
    );
    for (name, t) in CATEGORIES.iter().zip(&tallies) {
        println!(
            "{name:<24}{:>8}{:>8}{:>9}{:>8}{:>10}{:>12}{:>9.1e}",
            t.pairs, t.within, t.crossing, t.beyond, t.undecided, t.proximities, t.worst
        );
    }
    println!("kinds: {kinds:?}");
    assert!(failures.is_empty(), "{faults:?}\n{}", failures.join("\n"));
    let total = |field: fn(&Tally) -> usize| tallies.iter().map(field).sum::<usize>();
    assert!(total(|t| t.within) > PAIRS / 3 && total(|t| t.beyond) > PAIRS / 8);
    assert!(total(|t| t.crossing) > PAIRS / 10);
    assert!(tallies.iter().all(|t| t.within > 100), "every category has pairs in range");
    assert_eq!(kinds.len(), 5, "every kind except face–face occurs: {kinds:?}");
}

/// The distance does not depend on the order of the triangles or of their corners.
#[test]
fn the_distance_does_not_depend_on_the_order_of_triangles_and_corners() {
    let mut random = Random::new(2);
    let (mut found, mut other) = (PairProximity::default(), PairProximity::default());
    let mut compared = 0;
    for index in 0..64_000 {
        let (a, b) = hard_pair(&mut random, index % CATEGORIES.len());
        let size = extent(&a, &b);
        let range = size * 4.0;
        examine_pair(&a, &b, range, &mut found);
        let (mut turned_a, mut turned_b) = (a, b);
        turned_a.rotate_left(random.below(3));
        turned_b.swap(0, 2);
        examine_pair(&turned_b, &turned_a, range, &mut other);
        let difference = (found.distance - other.distance).abs();
        assert!(difference <= DISTANCE_TOLERANCE * size, "{} {} {a:?} {b:?}", found.distance, other.distance);
        compared += 1;
    }
    assert_eq!(compared, 64_000);
}

/// Every feature pair within range is reported, not only the closest: vertices over faces and crossing edges.
#[test]
fn every_facing_feature_within_range_is_reported() {
    let mut random = Random::new(3);
    let mut found = PairProximity::default();
    let (mut faces, mut edges) = (0, 0);
    for index in 0..60_000 {
        // Well-shaped pairs, for which inside and outside are clear.
        let category = [0, 11, 14][index % 3];
        let (a, b) = hard_pair(&mut random, category);
        let size = extent(&a, &b);
        let range = size * random.power_of_ten(-2.0, 0.0);
        examine_pair(&a, &b, range, &mut found);
        for vertex in 0..3u8 {
            for (own, face, of_a) in [(&a, &b, true), (&b, &a, false)] {
                let normal = (face[1] - face[0]).cross(face[2] - face[0]).normalize_or_zero();
                let offset = own[vertex as usize] - face[0];
                let height = normal.dot(offset);
                let foot = own[vertex as usize] - normal * height;
                // Distances of the foot from the three edges, positive inside.
                let inside = (0..3)
                    .map(|k| {
                        let along = (face[(k + 1) % 3] - face[k]).normalize_or_zero();
                        normal.cross(along).dot(foot - face[k])
                    })
                    .fold(f64::INFINITY, f64::min);
                let expected = FeaturePair { a: Feature::Vertex(vertex), b: Feature::Face };
                let expected = if of_a { expected } else { expected.swapped() };
                let reported = found.proximities.iter().any(|proximity| proximity.features == expected);
                if inside > 1.0e-6 * size && height.abs() < range * (1.0 - 1.0e-9) {
                    assert!(reported, "{expected:?} {a:?} {b:?}");
                    faces += 1;
                } else if inside < -1.0e-6 * size || height.abs() > range * (1.0 + 1.0e-9) {
                    assert!(!reported, "{expected:?} {a:?} {b:?}");
                }
            }
        }
        for edge_a in 0..3usize {
            for edge_b in 0..3usize {
                let closest = segment_segment(a[edge_a], a[(edge_a + 1) % 3], b[edge_b], b[(edge_b + 1) % 3]);
                let inner = |along: f64| along > 1.0e-6 && along < 1.0 - 1.0e-6;
                let expected = FeaturePair { a: Feature::Edge(edge_a as u8), b: Feature::Edge(edge_b as u8) };
                let reported = found.proximities.iter().any(|proximity| proximity.features == expected);
                if inner(closest.parameter_a) && inner(closest.parameter_b) && closest.distance < range * (1.0 - 1.0e-9)
                {
                    assert!(reported, "{expected:?} {a:?} {b:?}");
                    edges += 1;
                } else if closest.distance > range * (1.0 + 1.0e-9) {
                    assert!(!reported, "{expected:?} {a:?} {b:?}");
                }
            }
        }
    }
    println!("{faces} vertex–face and {edges} edge–edge pairs");
    assert!(faces > 10_000 && edges > 10_000);
}

/// How often two edges that end at the common corner of two triangles are reported to meet in their interiors. Every
/// pair must report something.
fn meetings_at_a_common_corner(pairs: usize, mut point: impl FnMut() -> DVec3) -> usize {
    let ends_there = |feature: Feature, corner: usize| {
        let Feature::Edge(edge) = feature else { return false };
        corner == edge as usize || corner == (edge as usize + 1) % 3
    };
    let mut meetings = 0;
    for pair in 0..pairs {
        let a: Triangle = [point(), point(), point()];
        let mut b: Triangle = [point(), point(), point()];
        let corners = [pair % 3, pair / 3 % 3];
        b[corners[1]] = a[corners[0]];
        let found = examined(&a, &b, 1.0e-3);
        assert!(found.distance == 0.0 && !found.proximities.is_empty(), "pair {pair}: {found:?}");
        let meets = |features: FeaturePair| ends_there(features.a, corners[0]) && ends_there(features.b, corners[1]);
        meetings += found.proximities.iter().filter(|found| meets(found.features)).count();
    }
    meetings
}

/// Where vertices of two meshes coincide, as they often do in authored models, the edges that end there report nothing
/// else.
#[test]
fn edges_that_end_in_one_point_do_not_meet_inside() {
    const PAIRS: usize = 90_000;
    let mut random = Random::new(17);
    // Products of these numbers are exact.
    let on_grid = || [0; 3].map(|_| (random.range(-1.0, 1.0) * 1024.0).round() / 1024.0).into();
    let meetings = meetings_at_a_common_corner(PAIRS, on_grid);
    assert_eq!(meetings, 0, "on a grid");
    // With rounding, they may miss the end.
    let anywhere = || Vec3::from_array([0; 3].map(|_| random.range(-1.0, 1.0) as f32)).as_dvec3();
    let meetings = meetings_at_a_common_corner(PAIRS, anywhere);
    assert!(meetings < PAIRS / 100, "{meetings} of {PAIRS} anywhere");
}

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn examined(a: &Triangle, b: &Triangle, range: f64) -> PairProximity {
    let mut found = PairProximity::default();
    examine_pair(a, b, range, &mut found);
    found
}

/// The named hard cases with distances worked out by hand, at every length that occurs in f32 meshes.
#[test]
fn hard_cases_have_the_distance_worked_out_by_hand() {
    let base = [v(0., 0., 0.), v(4., 0., 0.), v(0., 4., 0.)];
    let cases: [(&str, Triangle, Triangle, f64, bool); 15] = [
        ("the same triangle twice", base, base, 0.0, false),
        ("turned over on itself", base, [base[0], base[2], base[1]], 0.0, false),
        ("coplanar, one inside the other", base, [v(1., 1., 0.), v(1.5, 1., 0.), v(1., 1.5, 0.)], 0.0, false),
        (
            "coplanar star, no vertex inside",
            [v(-3., -1., 0.), v(3., -1., 0.), v(0., 4., 0.)],
            [v(-3., 2., 0.), v(3., 2., 0.), v(0., -3., 0.)],
            0.0,
            false,
        ),
        ("coplanar apart", base, [v(-3., 0., 0.), v(-1., 0., 0.), v(-1., 4., 0.)], 1.0, false),
        ("parallel planes", base, base.map(|p| p + v(0.5, 0.5, 0.25)), 0.25, false),
        ("parallel edges side by side", base, [v(0., -2., 0.), v(4., -2., 0.), v(2., -5., 3.)], 2.0, false),
        ("parallel edges end to end", base, [v(7., 0., 0.), v(9., 0., 0.), v(9., 0., 5.)], 3.0, false),
        ("a shared vertex", base, [v(0., 0., 0.), v(-4., 0., 1.), v(0., -4., 1.)], 0.0, false),
        ("a shared edge", base, [v(4., 0., 0.), v(0., 0., 0.), v(2., -3., 3.)], 0.0, false),
        ("a T-junction", base, [v(2., 0., 0.), v(1., -3., 1.), v(3., -3., 1.)], 0.0, false),
        (
            "piercing mid-face",
            [v(-30., -20., 0.), v(30., -20., 0.), v(0., 40., 0.)],
            [v(-1., 0., -30.), v(1., 0., -30.), v(0., 0., 60.)],
            0.0,
            true,
        ),
        ("a point over a face", base, [v(1., 1., 3.); 3], 3.0, false),
        ("a segment through a face", base, [v(1., 1., 3.), v(1., 1., -3.), v(1., 1., -3.)], 0.0, true),
        ("two points", [v(1., 1., 1.); 3], [v(1., 4., 5.); 3], 5.0, false),
    ];
    for exponent in [-20, -10, 0, 10, 20] {
        for offset in [DVec3::ZERO, v(1.0e6, -2.0e6, 3.0e6)] {
            let unit = 2f64.powi(exponent);
            // Offsets are whole units, so the sums are exact.
            let moved = |triangle: &Triangle| triangle.map(|p| (p + offset) * unit);
            for (name, a, b, distance, crossing) in &cases {
                let (a, b) = (moved(a), moved(b));
                for (a, b) in [(a, b), (b, a)] {
                    let found = examined(&a, &b, 100.0 * unit);
                    let error = (found.distance / unit - distance).abs();
                    assert!(error <= 1.0e-12, "{name}: {} 2^{exponent}", found.distance / unit);
                    assert!(!found.proximities.is_empty(), "{name}");
                    let pierced = found.proximities.iter().any(|proximity| pierces(proximity.features));
                    assert!(!crossing || pierced, "{name}: {:?}", found.proximities);
                    for proximity in &found.proximities {
                        let what = fault(&a, &b, proximity, extent(&a, &b));
                        assert!(what.is_none(), "{name}: {what:?} {proximity:?}");
                    }
                    if *distance > 0.0 {
                        let beyond = examined(&a, &b, 0.99 * distance * unit);
                        assert!(beyond.distance > 0.99 * distance * unit && beyond.proximities.is_empty(), "{name}");
                    }
                }
            }
        }
    }
}

/// The mesh is bumpy: at many vertices and edges, some faces rise along a direction and others fall. Some faces have no
/// area.
#[test]
fn a_direction_leads_out_where_it_goes_along_the_outward_one() {
    let mut random = Random::new(23);
    let ball = icosphere(3, 1.0);
    let mut positions: Vec<Vec3> = ball.positions.iter().map(|&position| Vec3::from_array(position)).collect();
    for position in &mut positions {
        *position *= 1.0 + 0.1 * random.unit() as f32;
    }
    for place in (0..positions.len() - 1).step_by(40) {
        positions[place] = positions[place + 1];
    }
    let topology = SurfaceTopology::new(&positions, &ball.triangles).expect("it is a mesh");
    let features =
        [0, 1, 2].map(Feature::Vertex).into_iter().chain([0, 1, 2].map(Feature::Edge)).chain([Feature::Face]);
    let (mut outward_count, mut inward_count, mut split) = (0, 0, 0);
    for feature in features {
        for triangle in 0..ball.triangles.len() {
            let outward = outward_direction(&topology, &positions, triangle, feature);
            let face = outward_direction(&topology, &positions, triangle, Feature::Face);
            // A random direction, one nearly along the surface, and one exactly along it.
            let tangent = outward.cross(random.direction());
            for direction in [random.direction(), tangent + random.direction() * 0.1, tangent] {
                let (expected, found) =
                    (outward.dot(direction), rise(&topology, &positions, triangle, feature, direction));
                assert!(
                    expected == 0.0 && found == 0.0 || expected * found > 0.0,
                    "{feature:?} of {triangle}: {found} for {expected}"
                );
                outward_count += usize::from(found > 0.0);
                inward_count += usize::from(found < 0.0);
                split += usize::from(face.dot(direction) * expected < 0.0);
            }
        }
    }
    assert!(outward_count > 1000 && inward_count > 1000 && split > 300, "{outward_count} {inward_count} {split}");
}
