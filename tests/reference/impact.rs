//! Times of impact against closed forms, against whole numbers, against the distance over time, and against recorded
//! queries with known answers.

use crate::common::{CATEGORIES, Mesh, Random, Triangle, hard_pair, soup};
use crate::exact_impact;
use bevy_circumsphere::kernel::reference::{
    FeatureImpact, ImpactKind, ImpactTruth, MovingMesh, edge_edge_impact, exact_weld, feature_impacts_brute_force,
    feature_impacts_tree, point_triangle, segment_segment, triangle_distance, triangle_impact,
    triangle_impacts_brute_force, triangle_impacts_tree, triangles_cross, vertex_face_impact,
};
use circumsphere_support::recording::{
    QueryKind, read_ccd_queries, read_f64_recording, read_impact_truth, read_recording, recordings_folder,
};
use glam::{DQuat, DVec3, Vec3};
use std::time::Instant;

/// Error of a distance relative to the pair's extent: a dozen operations of half a unit in the last place each, of
/// positions that are rounded once more on the way.
const ROUNDING: f64 = 1.0e-14;

/// A time of impact is wanted to this; the bisection stops well below.
const WIDTH: f64 = 1.0e-9;

type Points = [DVec3; 4];

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

fn at(start: DVec3, end: DVec3, time: f64) -> DVec3 {
    start * (1.0 - time) + end * time
}

fn stored(point: DVec3) -> DVec3 {
    point.as_vec3().as_dvec3()
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    VertexFace,
    EdgeEdge,
}

const KINDS: [Kind; 2] = [Kind::VertexFace, Kind::EdgeEdge];

impl Kind {
    fn impact(self, start: &Points, end: &Points, separation: f64) -> ImpactTruth {
        match self {
            Self::VertexFace => vertex_face_impact(start, end, separation),
            Self::EdgeEdge => edge_edge_impact(start, end, separation),
        }
    }

    fn exact(self, start: &Points, end: &Points) -> Option<[f64; 2]> {
        match self {
            Self::VertexFace => exact_impact::vertex_face(start, end),
            Self::EdgeEdge => exact_impact::edge_edge(start, end),
        }
    }

    fn distance(self, [p, q, r, s]: Points) -> f64 {
        match self {
            Self::VertexFace => point_triangle(p, &[q, r, s]).distance,
            Self::EdgeEdge => segment_segment(p, q, r, s).distance,
        }
    }

    /// How many of the points are the first side's.
    fn first_side(self) -> usize {
        match self {
            Self::VertexFace => 1,
            Self::EdgeEdge => 2,
        }
    }
}

/// Asserts that a time is enclosed, by bounds that are no farther apart than `width`.
fn assert_first(truth: ImpactTruth, expected: f64, width: f64) {
    let ImpactTruth::First { earliest, latest } = truth else { panic!("{truth:?}, expected {expected}") };
    // The expected time itself is rounded.
    assert!(earliest <= expected + 1.0e-15 && expected - 1.0e-15 <= latest, "{truth:?}, expected {expected}");
    assert!(latest - earliest <= width, "{truth:?}, expected {expected}");
}

/// A pair as given, turned and moved far away, and scaled by powers of two: all have the same times.
fn placed(start: Points, end: Points, check: impl Fn(Points, Points, f64)) {
    let turn = DQuat::from_axis_angle(v(1., 2., 3.).normalize(), 0.7);
    for exponent in [-60, -20, 0, 20, 60] {
        let unit = 2f64.powi(exponent);
        for offset in [DVec3::ZERO, v(1.0e4, -2.0e4, 3.0e4)] {
            check(start.map(|p| (p + offset) * unit), end.map(|p| (p + offset) * unit), unit);
        }
        check(start.map(|p| turn * p * unit), end.map(|p| turn * p * unit), unit);
    }
}

#[test]
fn a_vertex_falling_on_a_face_arrives_when_the_height_is_used_up() {
    for (height, depth) in [(1.0, 3.0), (0.25, 0.75), (0.5, 40.0)] {
        let face = [v(0., 0., 0.), v(4., 0., 0.), v(0., 4., 0.)];
        let start = [v(1., 1., height), face[0], face[1], face[2]];
        let end = [v(1., 1., height - depth), face[0], face[1], face[2]];
        placed(start, end, |start, end, unit| {
            for separation in [0.0, 0.125] {
                let truth = vertex_face_impact(&start, &end, separation * unit);
                assert_first(truth, (height - separation) / depth, WIDTH);
            }
        });
        // The face may rise as well.
        let rising = [end[0], face[0] + v(0., 0., depth), face[1] + v(0., 0., depth), face[2] + v(0., 0., depth)];
        placed(start, rising, |start, end, unit| {
            assert_first(vertex_face_impact(&start, &end, 0.0), height / (2.0 * depth), WIDTH);
            assert_first(vertex_face_impact(&start, &end, 0.125 * unit), (height - 0.125) / (2.0 * depth), WIDTH);
        });
    }
}

#[test]
fn a_vertex_that_passes_beside_a_face_meets_it_only_with_separation() {
    let face = [v(0., 0., 0.), v(4., 0., 0.), v(0., 4., 0.)];
    for beside in [1.0, 1.0e-3, 1.0e-9, 1.0e-13] {
        let start = [v(1., -beside, 1.), face[0], face[1], face[2]];
        let end = [v(1., -beside, -1.), face[0], face[1], face[2]];
        assert_eq!(vertex_face_impact(&start, &end, 0.0), ImpactTruth::Never, "{beside}");
        assert_eq!(vertex_face_impact(&start, &end, 0.5 * beside), ImpactTruth::Never, "{beside}");
        if beside > 1.0e-6 {
            // √(beside² + height²) = 2 beside.
            let expected = (0.5 * (1.0 - beside * 3f64.sqrt())).max(0.0);
            assert_first(vertex_face_impact(&start, &end, 2.0 * beside), expected, WIDTH);
        }
    }
    let inside = [v(1., 1.0e-13, 1.), v(1., 1.0e-13, -1.)];
    assert_first(
        vertex_face_impact(&[inside[0], face[0], face[1], face[2]], &[inside[1], face[0], face[1], face[2]], 0.0),
        0.5,
        WIDTH,
    );
}

#[test]
fn crossing_edges_meet_when_the_gap_is_closed() {
    for gap in [1.0, 2f64.powi(-10)] {
        let start = [v(-1., 0., 0.), v(1., 0., 0.), v(0.25, -1., gap), v(0.25, 1., gap)];
        let end = [v(-1., 0., 0.), v(1., 0., 0.), v(0.25, -1., -3. * gap), v(0.25, 1., -3. * gap)];
        placed(start, end, |start, end, unit| {
            assert_first(edge_edge_impact(&start, &end, 0.0), 0.25, WIDTH);
            assert_first(edge_edge_impact(&start, &end, 0.5 * gap * unit), 0.125, WIDTH);
        });
        let short = [start[0], start[1], v(1.25, -1., gap), v(1.25, 1., gap)];
        let short_end = [end[0], end[1], v(1.25, -1., -3. * gap), v(1.25, 1., -3. * gap)];
        assert_eq!(edge_edge_impact(&short, &short_end, 0.0), ImpactTruth::Never);
        assert_eq!(edge_edge_impact(&short, &short_end, 0.2499 * gap), ImpactTruth::Never);
    }
}

/// The face tilts as the vertex slides along it: over x = t the plane z = t·x is at t², the vertex at 1 − t.
#[test]
fn a_tilting_face_is_met_at_the_root_of_a_quadratic() {
    let start = [v(0., 0., 1.), v(0., -2., 0.), v(3., 0., 0.), v(0., 2., 0.)];
    let end = [v(1., 0., 0.), v(0., -2., 0.), v(3., 0., 3.), v(0., 2., 0.)];
    placed(start, end, |start, end, _| {
        assert_first(vertex_face_impact(&start, &end, 0.0), 0.5 * (5f64.sqrt() - 1.0), WIDTH);
    });
}

/// The face between (0, 0, 0), (1, t, t) and (−t, 1, t) has the normal (t² − t, −t² − t, 1 + t²); the vertex (0, t, 1 − t) is
/// in its plane where (1 − t)(1 + t²) = t²(t + 1), that is 1 − t − 2t³ = 0.
#[test]
fn a_turning_face_is_met_at_the_root_of_a_cubic() {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle: f64 = 0.5 * (low + high);
        if 1.0 - middle - 2.0 * middle.powi(3) > 0.0 { low = middle } else { high = middle }
    }
    // As large again to either side, so that the vertex is well inside.
    let (start, end) = ([v(1., 0., 0.), v(0., 1., 0.)], [v(1., 1., 1.), v(-1., 1., 1.)]);
    let corners = |[one, other]: [DVec3; 2]| [-one - other, one * 3.0, other * 3.0];
    let join = |vertex: DVec3, face: [DVec3; 3]| [vertex, face[0], face[1], face[2]];
    placed(join(v(0., 0., 1.), corners(start)), join(v(0., 1., 0.), corners(end)), |start, end, _| {
        assert_first(vertex_face_impact(&start, &end, 0.0), low, WIDTH);
    });
}

/// Two points, as a face and a vertex and as two edges without length, meet like balls: |Δ + v t| = separation.
#[test]
fn points_meet_like_balls() {
    let mut random = Random::new(1);
    let (mut hits, mut misses) = (0, 0);
    for _ in 0..20_000 {
        let offset = random.vector() * 2.0;
        let velocity = random.vector() - offset * random.range(0.3, 2.0);
        let separation = random.range(0.05, 0.8);
        let common = random.vector() * 10.0;
        let (b, c) = (offset.dot(velocity), offset.length_squared() - separation * separation);
        let discriminant = b * b - velocity.length_squared() * c;
        let expected = if c <= 0.0 { Some(0.0) } else { (discriminant >= 0.0).then(|| c / (discriminant.sqrt() - b)) };
        let expected = expected.filter(|time| (0.0..=1.0).contains(time));
        let start = [DVec3::ZERO, offset, offset, offset];
        let end = [common, common + offset + velocity, common + offset + velocity, common + offset + velocity];
        let edges = |points: Points| [points[0], points[0], points[1], points[1]];
        for truth in
            [vertex_face_impact(&start, &end, separation), edge_edge_impact(&edges(start), &edges(end), separation)]
        {
            match (truth, expected) {
                (ImpactTruth::Never, None) => misses += 1,
                (ImpactTruth::First { earliest, latest }, Some(expected)) => {
                    // The root errs by the rounding of the motion's ends over the speed at which they approach.
                    let slack = 1.0e-13 / (velocity.length() * discriminant.abs().sqrt()).min(1.0);
                    assert!(earliest <= expected + slack && expected <= latest + slack, "{truth:?} {expected}");
                    hits += 1;
                }
                // The closest approach is the separation, or at the end of the motion, up to rounding.
                _ => assert!(discriminant.abs() < 1.0e-9, "{truth:?} {expected:?} {discriminant}"),
            }
        }
    }
    println!("{hits} hits, {misses} misses");
    assert!(hits > 5_000 && misses > 5_000);
}

#[test]
fn what_touches_at_the_start_meets_at_time_zero() {
    let face = [v(0., 0., 0.), v(4., 0., 0.), v(0., 4., 0.)];
    let zero = ImpactTruth::First { earliest: 0.0, latest: 0.0 };
    for vertex in [v(1., 1., 0.), v(0., 0., 0.), v(2., 2., 0.), v(0.1, 0., 0.)] {
        let start = [vertex, face[0], face[1], face[2]];
        for motion in [DVec3::ZERO, v(0., 0., 1.), v(1., 0., 0.)] {
            let end = [vertex + motion, face[0], face[1], face[2]];
            assert_eq!(vertex_face_impact(&start, &end, 0.0), zero, "{vertex} {motion}");
            assert_eq!(vertex_face_impact(&start, &end, 0.5), zero, "{vertex} {motion}");
        }
    }
    let crossing = [v(1., 1., -1.), v(1.5, 1., 1.), v(1., 1.5, 1.)];
    assert_eq!(triangle_impact(&face, &face, &crossing, &crossing.map(|p| p + v(9., 0., 0.)), 0.0), zero);
    assert_eq!(triangle_impact(&face, &face, &face, &face, 0.0), zero);
}

/// Exact signs decide the ends of the motion, down to the last bit.
#[test]
fn a_touch_at_the_very_end_counts_and_one_bit_less_does_not() {
    let face = [v(0.1, 0.2, 0.3), v(0.9, 0.25, 0.3), v(0.4, 0.75, 0.3)];
    let query = |last: f64| {
        vertex_face_impact(
            &[v(0.5, 0.5, 1.0), face[0], face[1], face[2]],
            &[v(0.5, 0.5, last), face[0], face[1], face[2]],
            0.0,
        )
    };
    assert_first(query(0.3), 1.0, WIDTH);
    assert_first(query(0.3f64.next_down()), 1.0, WIDTH);
    // Not certified to be apart, for the last steps are within rounding; but not a hit either.
    let above = query(0.3f64.next_up());
    assert!(
        matches!(above, ImpactTruth::Undecided { earliest, latest: 1.0, .. } if earliest > 1.0 - WIDTH),
        "{above:?}"
    );
    assert_eq!(query(0.3 + 1.0e-13), ImpactTruth::Never);
}

#[test]
fn without_relative_motion_nothing_meets_that_does_not_touch() {
    let mut random = Random::new(2);
    for index in 0..4_000 {
        let (a, b) = hard_pair(&mut random, index % CATEGORIES.len());
        let size = a.iter().chain(&b).map(|p| (*p - a[0]).abs().max_element()).fold(0.0, f64::max);
        let gap = triangle_distance(&a, &b);
        let truth = triangle_impact(&a, &a, &b, &b, 0.0);
        if triangles_cross(&a, &b) {
            assert_eq!(truth, ImpactTruth::First { earliest: 0.0, latest: 0.0 });
        } else if gap > 1.0e-6 * size {
            assert_eq!(truth, ImpactTruth::Never, "{a:?} {b:?}");
            assert_eq!(triangle_impact(&a, &a, &b, &b, gap * 0.999), ImpactTruth::Never, "{a:?} {b:?}");
            let within = triangle_impact(&a, &a, &b, &b, gap * 1.001);
            assert_eq!(within, ImpactTruth::First { earliest: 0.0, latest: 0.0 }, "{a:?} {b:?}");
        }
    }
}

/// A vertex that touches a face from above and goes back: no sign changes, so f64 cannot certify the touch, but it says
/// where it may be.
#[test]
fn a_grazing_touch_is_undecided_and_enclosed() {
    // z = (1 − 2t)² is not linear; over a tilting face the height of a linear motion is.
    let start = [v(-1., 0., 1.), v(-3., -3., 1.), v(3., 0., -1.), v(-3., 3., 1.)];
    let end = [v(1., 0., 1.), v(-3., -3., -1.), v(3., 0., 1.), v(-3., 3., -1.)];
    // The plane is z = −x(1 − 2t)/3, under x = 2t − 1 at (1 − 2t)²/3: 1 above it at the start, 2/3.
    let lowered = |points: Points, by: f64| [points[0] - v(0., 0., by), points[1], points[2], points[3]];
    let height = |time: f64| 1.0 - (1.0 - 2.0 * time).powi(2) / 3.0;
    assert!((height(0.0) - 2.0 / 3.0).abs() < 1.0e-15 && height(0.5) == 1.0);
    // The height is largest midway: seen from below the vertex comes down to the plane and goes away again.
    let (start, end) = (lowered(start, 1.0), lowered(end, 1.0));
    let truth = vertex_face_impact(&start, &end, 0.0);
    let ImpactTruth::Undecided { earliest, latest, closest } = truth else { panic!("{truth:?}") };
    assert!((0.499..=0.5).contains(&earliest) && (0.5..0.501).contains(&latest) && closest < 1.0e-14, "{truth:?}");
    let exact = exact_impact::vertex_face(&start, &end);
    assert!(exact.is_some_and(|[low, high]| low <= 0.5 && 0.5 <= high), "{exact:?}");
    // By a hair less it never touches, by a hair more it does, and twice: the first counts.
    assert_eq!(vertex_face_impact(&lowered(start, 1.0e-9), &lowered(end, 1.0e-9), 0.0), ImpactTruth::Never);
    let deeper = vertex_face_impact(&lowered(start, -0.01), &lowered(end, -0.01), 0.0);
    // (1 − 2t)² = 3 · 0.01.
    assert_first(deeper, 0.5 * (1.0 - 0.03f64.sqrt()), WIDTH);
}

const MOTIONS: [&str; 10] = [
    "random",
    "small motion",
    "aimed",
    "aimed at the rim",
    "sliver",
    "integer grid",
    "always in one plane",
    "grazing",
    "large and far",
    "resting",
];

/// Four points at both ends of a motion, of one of [`MOTIONS`]; half of them as f32 stores them.
fn moving_points(random: &mut Random, kind: Kind, motion: usize) -> (Points, Points) {
    let cloud = |random: &mut Random| [0; 4].map(|_| random.vector());
    let (mut start, mut end) = (cloud(random), cloud(random));
    // Makes the sides have a point in common at a time, by moving the first side's end.
    let aim = |random: &mut Random, start: &Points, end: &mut Points, rim: bool| {
        let time = random.range(0.05, 1.0);
        let now: Points = std::array::from_fn(|k| at(start[k], end[k], time));
        let mut weights = random.weights();
        if rim {
            weights[random.below(3)] = 0.0;
            let sum: f64 = weights.iter().sum();
            weights = weights.map(|weight| weight / sum);
        }
        let along = if rim { f64::from(random.whole(0, 1)) } else { random.unit() };
        let miss = match kind {
            Kind::VertexFace => now[1] * weights[0] + now[2] * weights[1] + now[3] * weights[2] - now[0],
            Kind::EdgeEdge => at(now[2], now[3], along) - at(now[0], now[1], random.unit()),
        };
        for k in 0..kind.first_side() {
            end[k] += miss / time;
        }
        time
    };
    match MOTIONS[motion] {
        "small motion" => {
            let reach = random.power_of_ten(-8.0, -1.0);
            end = start.map(|p| p + random.vector() * reach);
            aim(random, &start, &mut end, false);
        }
        "aimed" => {
            aim(random, &start, &mut end, false);
        }
        "aimed at the rim" => {
            aim(random, &start, &mut end, true);
        }
        "sliver" => {
            let width = random.power_of_ten(-7.0, -1.0);
            for points in [&mut start, &mut end] {
                let middle = random.unit();
                points[3] = at(points[2], points[if kind == Kind::VertexFace { 1 } else { 0 }], middle)
                    + random.vector() * width;
            }
            aim(random, &start, &mut end, false);
        }
        "integer grid" => {
            let half_width = 1 + random.below(2);
            start = [0; 4].map(|_| random.grid_point(half_width));
            end = [0; 4].map(|_| random.grid_point(half_width));
        }
        "always in one plane" => {
            let flat = |p: DVec3| v(p.x, p.y, p.x - p.y);
            start = [0; 4].map(|_| flat(random.grid_point(3)));
            end = [0; 4].map(|_| flat(random.grid_point(3)));
        }
        "grazing" => {
            // Parallel to a face or edge, a little off it.
            let gap = random.power_of_ten(-16.0, -3.0);
            let slide = random.vector();
            end = start;
            let across = match kind {
                Kind::VertexFace => (start[2] - start[1]).cross(start[3] - start[1]),
                Kind::EdgeEdge => (start[1] - start[0]).cross(start[3] - start[2]),
            };
            let across = across.normalize_or(DVec3::Z);
            let slide = slide - across * slide.dot(across);
            let lift = across * (start[2] - start[0]).dot(across) - across * gap;
            for k in 0..kind.first_side() {
                start[k] += lift - slide;
                end[k] += lift + slide;
            }
        }
        "large and far" => {
            aim(random, &start, &mut end, false);
            let (size, offset, drift) =
                (random.power_of_ten(-5.0, 5.0), random.vector() * 1.0e5, random.vector() * 1.0e3);
            start = start.map(|p| (p + offset) * size);
            end = end.map(|p| (p + offset + drift) * size);
        }
        "resting" => {
            let time = aim(random, &start, &mut end, false);
            let rest: Points = std::array::from_fn(|k| at(start[k], end[k], time));
            let drift = random.vector();
            (start, end) = (rest, rest.map(|p| p + drift));
        }
        _ => {}
    }
    if random.below(2) == 0 { (start.map(stored), end.map(stored)) } else { (start, end) }
}

#[derive(Clone, Default)]
struct Tally {
    asked: usize,
    never: usize,
    first: usize,
    undecided: usize,
    undecided_hits: usize,
    wide: usize,
    widest: f64,
}

/// Questions put to both, 60,000 unless `CIRCUMSPHERE_PAIRS` says otherwise.
fn question_count() -> usize {
    std::env::var("CIRCUMSPHERE_PAIRS").map_or(60_000, |text| text.parse().expect("CIRCUMSPHERE_PAIRS is a number"))
}

#[test]
fn whole_numbers_never_contradict_a_verdict() {
    let (count, mut random) = (question_count(), Random::new(20_261_120));
    let mut tallies = vec![[Tally::default(), Tally::default()]; MOTIONS.len()];
    let (mut spent, mut spent_exactly) = (0.0, 0.0);
    for index in 0..count {
        let (motion, which) = (index / 2 % MOTIONS.len(), index % 2);
        let kind = KINDS[which];
        let (start, end) = moving_points(&mut random, kind, motion);
        let started = Instant::now();
        let truth = kind.impact(&start, &end, 0.0);
        spent += started.elapsed().as_secs_f64();
        let started = Instant::now();
        let exact = kind.exact(&start, &end);
        spent_exactly += started.elapsed().as_secs_f64();
        let tally = &mut tallies[motion][which];
        tally.asked += 1;
        let named = || format!("{index} {kind:?} {}: {truth:?} {exact:?}\n{start:?}\n{end:?}", MOTIONS[motion]);
        match truth {
            ImpactTruth::Never => {
                assert!(exact.is_none(), "{}", named());
                tally.never += 1;
            }
            ImpactTruth::First { earliest, latest } => {
                let Some([low, high]) = exact else { panic!("{}", named()) };
                assert!(earliest <= high && low <= latest, "{}", named());
                tally.first += 1;
                tally.wide += usize::from(latest - earliest > WIDTH);
                tally.widest = tally.widest.max(latest - earliest);
            }
            ImpactTruth::Undecided { earliest, latest, .. } => {
                assert!(exact.is_none_or(|[low, high]| earliest <= high && low <= latest), "{}", named());
                tally.undecided += 1;
                tally.undecided_hits += usize::from(exact.is_some());
            }
        }
    }
    println!(
        "{:<22}{:<12}{:>8}{:>8}{:>8}{:>10}{:>9}{:>8}{:>10}",
        "", "", "asked", "never", "first", "undecided", "of them hits", "wide", "widest"
    );
    for (name, tallies) in MOTIONS.iter().zip(&tallies) {
        for (kind, t) in KINDS.iter().zip(tallies) {
            println!(
                "{name:<22}{kind:<12?}{:>8}{:>8}{:>8}{:>10}{:>9}{:>8}{:>10.1e}",
                t.asked, t.never, t.first, t.undecided, t.undecided_hits, t.wide, t.widest
            );
        }
    }
    println!(
        "{:.1} µs each; in whole numbers {:.1} µs",
        spent * 1.0e6 / count as f64,
        spent_exactly * 1.0e6 / count as f64
    );
    let total = |field: fn(&Tally) -> usize| tallies.iter().flatten().map(field).sum::<usize>();
    assert_eq!(total(|t| t.asked), count);
    assert!(total(|t| t.never) * 10 > count && total(|t| t.first) * 5 > count);
}
