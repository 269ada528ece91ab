//! Times of impact against closed forms, integer arithmetic, the distance over time, and recorded queries with known
//! answers.

use crate::common::{CATEGORIES, Mesh, Random, Triangle, hard_pair, soup};
use crate::exact_impact;
use circumsphere_support::recording::{
    QueryKind, read_ccd_queries, read_f64_recording, read_recorded_impacts, read_recording, recordings_folder,
};
use circumsphere_truth::{
    FeatureImpact, ImpactKind, ImpactTruth, MovingMesh, edge_edge_impact, exact_weld, feature_impacts_brute_force,
    feature_impacts_tree, triangle_distance, triangle_impact, triangle_impacts_brute_force, triangle_impacts_tree,
    triangles_cross, vertex_face_impact,
};
use glam::{DQuat, DVec3, Vec3};
use std::time::Instant;

/// Error of a distance relative to the pair's extent: a dozen operations with half a unit in the last place each, on
/// positions that are rounded once more.
const ROUNDING: f64 = 1.0e-14;

/// Required precision of a time of impact. The bisection stops well below it.
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

    /// The number of points of the first side.
    fn first_side(self) -> usize {
        match self {
            Self::VertexFace => 1,
            Self::EdgeEdge => 2,
        }
    }
}

/// Asserts that a time is enclosed by bounds at most `width` apart.
fn assert_first(truth: ImpactTruth, expected: f64, width: f64) {
    let ImpactTruth::First { earliest, latest } = truth else { panic!("{truth:?}, expected {expected}") };
    // The expected time itself is rounded.
    assert!(earliest <= expected + 1.0e-15 && expected - 1.0e-15 <= latest, "{truth:?}, expected {expected}");
    assert!(latest - earliest <= width, "{truth:?}, expected {expected}");
}

/// A pair as given, rotated and moved far away, and scaled by powers of two. All have the same times.
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
        // The face may rise, too.
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

/// The face tilts while the vertex slides along it. Above x = t, the plane z = t·x is at t² and the vertex at 1 − t.
#[test]
fn a_tilting_face_is_met_at_the_root_of_a_quadratic() {
    let start = [v(0., 0., 1.), v(0., -2., 0.), v(3., 0., 0.), v(0., 2., 0.)];
    let end = [v(1., 0., 0.), v(0., -2., 0.), v(3., 0., 3.), v(0., 2., 0.)];
    placed(start, end, |start, end, _| {
        assert_first(vertex_face_impact(&start, &end, 0.0), 0.5 * (5f64.sqrt() - 1.0), WIDTH);
    });
}

/// The face between (0, 0, 0), (1, t, t), and (−t, 1, t) has the normal (t² − t, −t² − t, 1 + t²). The vertex (0, t, 1
/// − t) is in its plane if (1 − t)(1 + t²) = t²(t + 1), that is, 1 − t − 2t³ = 0.
#[test]
fn a_turning_face_is_met_at_the_root_of_a_cubic() {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle: f64 = 0.5 * (low + high);
        if 1.0 - middle - 2.0 * middle.powi(3) > 0.0 { low = middle } else { high = middle }
    }
    // Enlarged by the same size on either side, so that the vertex is well inside.
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
                    // The error of the root is the rounding of the motion's ends over the speed of approach.
                    let slack = 1.0e-13 / (velocity.length() * discriminant.abs().sqrt()).min(1.0);
                    assert!(earliest <= expected + slack && expected <= latest + slack, "{truth:?} {expected}");
                    hits += 1;
                }
                // The closest approach equals the separation, or is at the end of the motion, up to rounding.
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
    // It is not certified to stay apart, because the last steps are within rounding. It is not a hit, either.
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

/// A vertex that touches a face from above and goes back. No sign changes, so f64 cannot certify the touch, but it
/// reports where the touch may be.
#[test]
fn a_grazing_touch_is_undecided_and_enclosed() {
    // z = (1 − 2t)² is not linear, but the height of a linear motion above a tilting face is quadratic.
    let start = [v(-1., 0., 1.), v(-3., -3., 1.), v(3., 0., -1.), v(-3., 3., 1.)];
    let end = [v(1., 0., 1.), v(-3., -3., -1.), v(3., 0., 1.), v(-3., 3., -1.)];
    // The plane is z = −x(1 − 2t)/3, so below x = 2t − 1 it is at (1 − 2t)²/3. At the start, the vertex is 2/3 above
    // it.
    let lowered = |points: Points, by: f64| [points[0] - v(0., 0., by), points[1], points[2], points[3]];
    let height = |time: f64| 1.0 - (1.0 - 2.0 * time).powi(2) / 3.0;
    assert!((height(0.0) - 2.0 / 3.0).abs() < 1.0e-15 && height(0.5) == 1.0);
    // The height is largest midway: seen from below, the vertex comes down to the plane and goes away again.
    let (start, end) = (lowered(start, 1.0), lowered(end, 1.0));
    let truth = vertex_face_impact(&start, &end, 0.0);
    let ImpactTruth::Undecided { earliest, latest, closest } = truth else { panic!("{truth:?}") };
    assert!((0.499..=0.5).contains(&earliest) && (0.5..0.501).contains(&latest) && closest < 1.0e-14, "{truth:?}");
    let exact = exact_impact::vertex_face(&start, &end);
    assert!(exact.is_some_and(|[low, high]| low <= 0.5 && 0.5 <= high), "{exact:?}");
    // Slightly farther, it never touches. Slightly closer, it touches twice, and the first touch counts.
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

/// Four points at both ends of a motion of one of the [`MOTIONS`]. Half of them are rounded to f32.
fn moving_points(random: &mut Random, kind: Kind, motion: usize) -> (Points, Points) {
    let cloud = |random: &mut Random| [0; 4].map(|_| random.vector());
    let (mut start, mut end) = (cloud(random), cloud(random));
    // Makes the sides have a point in common at some time by moving the end of the first side.
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
                points[3] =
                    at(points[2], points[usize::from(kind == Kind::VertexFace)], middle) + random.vector() * width;
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
            // Parallel to a face or edge, slightly off it.
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

/// The number of questions: 10,000 unless `CIRCUMSPHERE_PAIRS` is set.
fn question_count() -> usize {
    std::env::var("CIRCUMSPHERE_PAIRS").map_or(10_000, |text| text.parse().expect("CIRCUMSPHERE_PAIRS is a number"))
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

/// Two triangles at both ends of a motion: a hard pair at the start or the end, or aimed at each other.
fn moving_triangles(random: &mut Random, category: usize) -> [Triangle; 4] {
    let (mut a, mut b) = hard_pair(random, category);
    let size = a.iter().chain(&b).map(|p| (*p - a[0]).abs().max_element()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let (common, deformation) = (random.vector() * size, size * random.power_of_ten(-3.0, 0.0));
    let approach = match random.below(3) {
        // From their places to a random place, from far away through each other, or barely at all.
        0 => random.vector() * size,
        1 => {
            let from = random.direction() * 3.0 * size;
            b = b.map(|p| p + from);
            from * -2.0
        }
        _ => random.vector() * (size * random.power_of_ten(-6.0, -2.0)),
    };
    let mut end_a = a.map(|p| p + common + random.vector() * deformation);
    let mut end_b = b.map(|p| p + common + approach + random.vector() * deformation);
    if random.below(2) == 0 {
        (a, b, end_a, end_b) = (end_a, end_b, a, b);
    }
    [a, end_a, b, end_b].map(|triangle| triangle.map(stored))
}

fn speed(a: [Triangle; 2], b: [Triangle; 2]) -> f64 {
    let mut fastest = 0f64;
    for i in 0..3 {
        for j in 0..3 {
            fastest = fastest.max(((a[1][i] - a[0][i]) - (b[1][j] - b[0][j])).length());
        }
    }
    fastest
}

/// The distance changes no faster than the corners move, so a step of the remaining distance over the speed cannot pass
/// an impact. This encloses the impact using only the distance at single times.
#[test]
fn the_distance_over_time_confirms_every_verdict() {
    const PAIRS: usize = 4_000;
    const STEPS: usize = 400;
    let mut random = Random::new(5);
    let (mut never, mut first, mut undecided, mut proven, mut tight) = (0, 0, 0, 0, 0);
    let (mut spent, mut slowest) = (0.0, 0f64);
    for index in 0..PAIRS {
        let [a, end_a, b, end_b] = moving_triangles(&mut random, index % CATEGORIES.len());
        // Relative to a corner that moves along, because world coordinates far from the origin round more.
        let seen_from = |origin: DVec3| move |triangle: Triangle| triangle.map(|p| p - origin);
        let [from_a, from_b] = [a, b].map(seen_from(a[0]));
        let [to_a, to_b] = [end_a, end_b].map(seen_from(end_a[0]));
        let corners = [from_a, to_a, from_b, to_b];
        let size = corners.as_flattened().iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let speed = speed([a, end_a], [b, end_b]);
        let distance = |time: f64| {
            let now = |start: &Triangle, end: &Triangle| std::array::from_fn(|k| at(start[k], end[k], time));
            triangle_distance(&now(&from_a, &to_a), &now(&from_b, &to_b))
        };
        let separation = match random.below(3) {
            0 => 0.0,
            1 => distance(random.unit()) * random.range(0.2, 1.2),
            _ => size * random.power_of_ten(-5.0, -1.0),
        };
        let started = Instant::now();
        let truth = triangle_impact(&a, &end_a, &b, &end_b, separation);
        let micros = started.elapsed().as_secs_f64() * 1.0e6;
        spent += micros;
        slowest = slowest.max(micros);
        let tolerance = ROUNDING * 4.0 * size;
        let named = || format!("{index}: {truth:?} separation {separation:e}\n{a:?}\n{end_a:?}\n{b:?}\n{end_b:?}");
        let apart_until = match truth {
            ImpactTruth::Never => f64::INFINITY,
            ImpactTruth::First { earliest, .. } | ImpactTruth::Undecided { earliest, .. } => earliest,
        };
        for sample in 0..=100 {
            let time = f64::from(sample) / 100.0;
            assert!(time >= apart_until || distance(time) > separation - tolerance, "{time} {}", named());
        }
        // The time that such steps reach.
        let mut reached = 0.0;
        for _ in 0..STEPS {
            let left = distance(reached) - separation;
            if left <= tolerance || reached >= 1.0 {
                break;
            }
            reached += (left - tolerance) / speed.max(f64::MIN_POSITIVE);
        }
        match truth {
            ImpactTruth::Never => {
                never += 1;
                proven += usize::from(reached >= 1.0);
            }
            ImpactTruth::First { earliest, latest } => {
                first += 1;
                assert!(reached <= latest, "{reached} {}", named());
                let at_most = separation + speed * (latest - earliest) + tolerance;
                assert!(distance(earliest) <= at_most && distance(latest) <= at_most, "{}", named());
                assert!(distance(earliest) >= separation - tolerance || earliest == 0.0, "{}", named());
                tight += usize::from(latest - earliest <= WIDTH);
            }
            ImpactTruth::Undecided { latest, .. } => {
                undecided += 1;
                assert!(reached <= latest || reached >= 1.0, "{reached} {}", named());
            }
        }
    }
    println!(
        "{never} never ({proven} of them proven by steps), {first} first ({tight} to {WIDTH:e}), {undecided} undecided; {:.1} µs each, slowest {slowest:.0}",
        spent / PAIRS as f64
    );
    assert!(
        never > PAIRS / 10
            && first > PAIRS / 4
            && undecided * 50 < PAIRS
            && proven * 2 > never
            && tight * 10 > first * 9
    );
}

/// Triangles that are apart first meet with a vertex and a face or with two edges.
#[test]
fn triangles_meet_when_the_first_of_their_features_do() {
    let mut random = Random::new(6);
    let (mut never, mut first, mut exact) = (0, 0, 0);
    for index in 0..2_000 {
        let [a, end_a, b, end_b] = moving_triangles(&mut random, index % CATEGORIES.len());
        if triangles_cross(&a, &b) {
            continue;
        }
        let separation = if random.below(2) == 0 { 0.0 } else { triangle_distance(&a, &b) * random.range(0.1, 0.9) };
        let whole = triangle_impact(&a, &end_a, &b, &end_b, separation);
        let mut parts = Vec::new();
        for k in 0..3 {
            for (one, end_one, other, end_other) in [(&a, &end_a, &b, &end_b), (&b, &end_b, &a, &end_a)] {
                let start = [one[k], other[0], other[1], other[2]];
                let end = [end_one[k], end_other[0], end_other[1], end_other[2]];
                parts.push(vertex_face_impact(&start, &end, separation));
            }
            for l in 0..3 {
                let edges = |a: &Triangle, b: &Triangle| [a[k], a[(k + 1) % 3], b[l], b[(l + 1) % 3]];
                parts.push(edge_edge_impact(&edges(&a, &b), &edges(&end_a, &end_b), separation));
            }
        }
        let not_before = parts.iter().filter_map(|part| match *part {
            ImpactTruth::Never => None,
            ImpactTruth::First { earliest, .. } | ImpactTruth::Undecided { earliest, .. } => Some(earliest),
        });
        let not_before = not_before.fold(f64::INFINITY, f64::min);
        let not_after = parts.iter().filter_map(|part| match *part {
            ImpactTruth::First { latest, .. } => Some(latest),
            _ => None,
        });
        let not_after = not_after.fold(f64::INFINITY, f64::min);
        let named = || format!("{index}: {whole:?} {parts:?}\n{a:?}\n{end_a:?}\n{b:?}\n{end_b:?}");
        match whole {
            ImpactTruth::Never => {
                assert_eq!(not_after, f64::INFINITY, "{}", named());
                never += 1;
            }
            ImpactTruth::First { earliest, latest } => {
                assert!(not_before <= latest && earliest <= not_after, "{}", named());
                first += 1;
                exact += usize::from(not_after - not_before <= WIDTH && latest - earliest <= WIDTH);
            }
            ImpactTruth::Undecided { earliest, .. } => assert!(earliest <= not_after, "{}", named()),
        }
    }
    println!("{never} never, {first} first, of both sides to {WIDTH:e}: {exact}");
    assert!(never > 200 && first > 400 && exact * 10 > first * 8);
}

/// Shared motion, the order of the sides, and powers of two do not change the results.
#[test]
fn impacts_are_the_same_however_the_pair_is_written() {
    let mut random = Random::new(7);
    let (mut compared, mut decided) = (0, 0);
    for index in 0..1_600 {
        let [a, end_a, b, end_b] = moving_triangles(&mut random, index % CATEGORIES.len());
        let separation = triangle_distance(&a, &b) * random.range(0.0, 0.9);
        let truth = triangle_impact(&a, &end_a, &b, &end_b, separation);
        let scaled = |triangle: &Triangle| triangle.map(|p| p * 0.125);
        let other = triangle_impact(&scaled(&a), &scaled(&end_a), &scaled(&b), &scaled(&end_b), separation * 0.125);
        match (truth, other) {
            (ImpactTruth::Undecided { earliest, .. }, ImpactTruth::Undecided { earliest: other, .. }) => {
                assert_eq!(earliest, other);
            }
            _ => assert_eq!(truth, other),
        }
        let swapped = triangle_impact(&b, &end_b, &a, &end_a, separation);
        match (truth, swapped) {
            (ImpactTruth::Never, ImpactTruth::First { .. }) | (ImpactTruth::First { .. }, ImpactTruth::Never) => {
                panic!("{truth:?} {swapped:?} {a:?} {end_a:?} {b:?} {end_b:?}")
            }
            (ImpactTruth::First { earliest, latest }, ImpactTruth::First { earliest: other, latest: other_latest }) => {
                assert!(earliest <= other_latest && other <= latest);
                decided += 1;
            }
            _ => {}
        }
        compared += 1;
    }
    assert!(compared == 1_600 && decided > 400, "{decided}");
}

/// A soup at both ends of a motion.
fn moving_soup(random: &mut Random, count: usize, reach: f64) -> (Mesh, Vec<DVec3>) {
    let mesh = soup(random, count, 0.2);
    let mut end = Vec::new();
    for corners in mesh.positions.chunks(3) {
        let drift = random.vector() * reach;
        end.extend(corners.iter().map(|corner| stored(*corner + drift + random.vector() * 0.1 * reach)));
    }
    (mesh, end)
}

#[test]
fn tree_equals_brute_force_on_moving_soups() {
    let mut random = Random::new(8);
    let (mut triangle_impacts, mut feature_impacts, mut new_crossings, mut first) = (0, 0, 0, 0);
    for round in 0..6 {
        let (mesh, end) = moving_soup(&mut random, 70, [0.02, 0.1, 0.4][round % 3]);
        let weld = exact_weld(&mesh.positions);
        let moving = MovingMesh { start: &mesh.positions, end: &end, triangles: &mesh.triangles, weld: &weld };
        for separation in [0.0, 0.02] {
            let found = triangle_impacts_brute_force(&moving, separation);
            assert_eq!(found, triangle_impacts_tree(&moving, separation));
            assert!(found.is_sorted_by_key(|impact| (impact.triangle_a, impact.triangle_b)));
            triangle_impacts += found.len();
            first += found.iter().filter(|impact| matches!(impact.truth, ImpactTruth::First { .. })).count();
            for i in 0..mesh.triangles.len() {
                for j in i + 1..mesh.triangles.len() {
                    let corners =
                        |triangle: usize, points: &[DVec3]| mesh.triangles[triangle].map(|v| points[v as usize]);
                    let crosses = |points: &[DVec3]| triangles_cross(&corners(i, points), &corners(j, points));
                    if crosses(&end) && !crosses(&mesh.positions) {
                        let pair = (i as u32, j as u32);
                        let found = found.binary_search_by_key(&pair, |impact| (impact.triangle_a, impact.triangle_b));
                        assert!(found.is_ok(), "{pair:?}");
                        new_crossings += 1;
                    }
                }
            }
            let features = feature_impacts_brute_force(&moving, separation);
            assert_eq!(features, feature_impacts_tree(&moving, separation));
            feature_impacts += features.len();
            // Triangles that were apart meet by features, so one of their feature pairs must be in the list.
            let met: Vec<[u32; 4]> = features.iter().map(|impact| impact.vertices).collect();
            for impact in &found {
                let pair = [impact.triangle_a, impact.triangle_b].map(|triangle| mesh.triangles[triangle as usize]);
                let [a, b] = pair.map(|corners| corners.map(|v| mesh.positions[v as usize]));
                let own = pair.as_flattened();
                let has_features = met.iter().any(|vertices| vertices.iter().all(|vertex| own.contains(vertex)));
                assert!(has_features || triangles_cross(&a, &b), "{impact:?}");
            }
        }
    }
    println!(
        "{triangle_impacts} impacts of triangles ({first} first), {new_crossings} new crossings, {feature_impacts} of features"
    );
    assert!(triangle_impacts > 500 && feature_impacts > 500 && new_crossings > 50 && first * 10 > triangle_impacts * 9);
}

#[test]
fn neighbors_and_broken_triangles_meet_nothing() {
    let face = [v(0., 0., 0.), v(1., 0., 0.), v(0., 1., 0.)];
    let positions = [face[0], face[1], face[2], v(0.2, 0.2, 1.), v(0.3, 0.2, 1.), v(0.2, 0.3, 1.), v(1., 0., 0.)];
    let mut end = positions;
    for moved in &mut end[3..6] {
        moved.z = -1.0;
    }
    let weld = exact_weld(&positions);
    let triangles = [[0, 1, 2], [3, 4, 5], [6, 4, 5]];
    let moving = MovingMesh { start: &positions, end: &end, triangles: &triangles, weld: &weld };
    let pairs = |moving: &MovingMesh<'_>| -> Vec<(u32, u32)> {
        triangle_impacts_tree(moving, 0.0).iter().map(|impact| (impact.triangle_a, impact.triangle_b)).collect()
    };
    // A corner of the third triangle coincides with one of the first.
    assert_eq!(pairs(&moving), [(0, 1)]);
    let apart: Vec<u32> = (0..7).collect();
    assert_eq!(pairs(&MovingMesh { weld: &apart, ..moving }), [(0, 1), (0, 2)]);
    let features = feature_impacts_tree(&moving, 0.0);
    let expected = |impact: &FeatureImpact| impact.kind == ImpactKind::VertexFace && impact.vertices[1..] == [0, 1, 2];
    assert!(features.len() == 3 && features.iter().all(expected), "{features:?}");
    for impact in features {
        assert_first(impact.truth, 0.5, WIDTH);
    }
    let mut broken = end;
    broken[4].x = f64::NAN;
    assert!(pairs(&MovingMesh { end: &broken, ..moving }).is_empty());
    assert_eq!(feature_impacts_tree(&MovingMesh { end: &broken, ..moving }, 0.0).len(), 2);
}

#[derive(Clone, Copy, Debug, Default)]
struct Answers {
    asked: usize,
    never: usize,
    first: usize,
    undecided: usize,
    undecided_hits: usize,
    wide: usize,
}

impl Answers {
    fn count(&mut self, truth: ImpactTruth, collides: bool) {
        self.asked += 1;
        match truth {
            ImpactTruth::Never => self.never += 1,
            ImpactTruth::First { earliest, latest } => {
                self.first += 1;
                self.wide += usize::from(latest - earliest > WIDTH);
            }
            ImpactTruth::Undecided { .. } => {
                self.undecided += 1;
                self.undecided_hits += usize::from(collides);
            }
        }
    }
}

fn files(ending: &str) -> Vec<std::path::PathBuf> {
    let Some(folder) = recordings_folder() else { return Vec::new() };
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .expect("the folder of recordings can be read")
        .map(|entry| entry.expect("its entries can be read").path())
        .filter(|path| path.to_string_lossy().ends_with(ending))
        .collect();
    files.sort();
    files
}

fn kind_of(kind: QueryKind) -> Kind {
    match kind {
        QueryKind::VertexFace => Kind::VertexFace,
        QueryKind::EdgeEdge => Kind::EdgeEdge,
    }
}

/// Exact answers, both ways. Pairs that touch at a rim during the motion, or slide along it, stay undecided.
#[test]
fn recorded_queries_have_their_answers() {
    let mut all = Answers::default();
    for path in files(".ccdq.bin") {
        let queries = read_ccd_queries(&path).expect("the queries can be read");
        let kind = kind_of(queries.kind);
        let mut answers = Answers::default();
        for (index, query) in queries.queries.iter().enumerate() {
            let (start, end) = (query.start.map(DVec3::from), query.end.map(DVec3::from));
            let truth = kind.impact(&start, &end, 0.0);
            let exact = kind.exact(&start, &end);
            let named = || format!("{} {index}: {truth:?} {exact:?} {query:?}", path.display());
            assert_eq!(exact.is_some(), query.collides, "{}", named());
            match truth {
                ImpactTruth::Never => assert!(!query.collides, "{}", named()),
                ImpactTruth::First { .. } => assert!(query.collides, "{}", named()),
                ImpactTruth::Undecided { .. } => println!("{}", named()),
            }
            answers.count(truth, query.collides);
            all.count(truth, query.collides);
        }
        println!("{}: {answers:?}", path.display());
    }
    assert!(all.asked == 0 || all.undecided * 10 < all.asked, "{all:?}");
}

/// The pairs that must be found. The recordings store more digits than f32, or the answers were made from f32 values.
/// Integer arithmetic decides for the available positions.
#[test]
fn recorded_impacts_are_never_denied() {
    let started = Instant::now();
    let mut all = Answers::default();
    for path in files(".gt.bin") {
        let answers = read_recorded_impacts(&path).expect("the answers can be read");
        let kind = kind_of(answers.kind);
        let name = path.file_name().expect("it is a file").to_string_lossy().into_owned();
        let name = name.split('.').next().expect("the first part of a split is there").to_owned();
        let exact_path = path.with_file_name(format!("{name}.f64.bin"));
        let frames: Vec<Vec<DVec3>> = if exact_path.exists() {
            let recording = read_f64_recording(&exact_path).expect("the recording can be read");
            recording.frames.iter().map(|frame| frame.iter().map(|&p| DVec3::from(p)).collect()).collect()
        } else {
            let path = path.with_file_name(format!("{name}.bin"));
            let recording = read_recording(&[path]).expect("the recording can be read");
            recording.frames.iter().map(|frame| frame.iter().map(|&p| Vec3::from(p).as_dvec3()).collect()).collect()
        };
        let mut found = Answers::default();
        let (mut contradicted, mut judged) = (0, 0);
        for (index, answer) in answers.answers.iter().enumerate() {
            let points = |frame: usize| answer.vertices.map(|vertex| frames[frame][vertex as usize]);
            let (start, end) = (points(0), points(1));
            let truth = kind.impact(&start, &end, 0.0);
            found.count(truth, answer.collides);
            let differs = match truth {
                ImpactTruth::Never => answer.collides,
                ImpactTruth::First { .. } => !answer.collides,
                ImpactTruth::Undecided { .. } => true,
            };
            if differs || index % 64 == 0 {
                judged += 1;
                let exact = kind.exact(&start, &end);
                if differs {
                    println!("{name} {kind:?} {index}, stated {}: {truth:?}, whole numbers {exact:?}", answer.collides);
                }
                contradicted += usize::from(truth == ImpactTruth::Never && exact.is_some());
                contradicted += usize::from(matches!(truth, ImpactTruth::First { .. }) && exact.is_none());
                assert!(!(truth == ImpactTruth::Never && answer.collides), "{name} {index}");
            }
        }
        println!("{name} {kind:?}: {found:?}, {judged} judged in whole numbers");
        assert_eq!(contradicted, 0);
        all.asked += found.asked;
        all.undecided += found.undecided;
    }
    println!("{} answers in {:.1} s", all.asked, started.elapsed().as_secs_f64());
    assert!(all.undecided * 1000 <= all.asked);
}

/// Small recorded steps: the tree against brute force, and every feature impact against integer arithmetic.
#[test]
fn small_recorded_steps_meet() {
    for name in ["two_cubes_close_to_intersecting", "thick_cloth"] {
        let Some(path) = recordings_folder().map(|folder| folder.join(format!("{name}.bin"))) else { return };
        if !path.exists() {
            eprintln!("{name} is not in the folder of recordings: skipped");
            continue;
        }
        let recording = read_recording(&[path]).expect("the recording can be read");
        let points = |frame: usize| -> Vec<DVec3> {
            recording.frames[frame].iter().map(|&p| Vec3::from(p).as_dvec3()).collect()
        };
        let (start, end) = (points(0), points(1));
        let weld = exact_weld(&start);
        let moving = MovingMesh { start: &start, end: &end, triangles: &recording.triangles, weld: &weld };
        let features = feature_impacts_tree(&moving, 0.0);
        assert_eq!(features, feature_impacts_brute_force(&moving, 0.0), "{name}");
        let (mut of_features, mut of_triangles) = (Answers::default(), Answers::default());
        for impact in &features {
            let kind = if impact.kind == ImpactKind::VertexFace { Kind::VertexFace } else { Kind::EdgeEdge };
            let at = |points: &[DVec3]| impact.vertices.map(|vertex| points[vertex as usize]);
            let exact = kind.exact(&at(&start), &at(&end));
            of_features.count(impact.truth, exact.is_some());
            if let ImpactTruth::First { earliest, latest } = impact.truth {
                assert!(exact.is_some_and(|[low, high]| earliest <= high && low <= latest), "{impact:?} {exact:?}");
            }
        }
        for impact in triangle_impacts_tree(&moving, 0.0) {
            of_triangles.count(impact.truth, true);
        }
        println!("{name}: features {of_features:?}, triangles {of_triangles:?}");
        assert!(of_features.first > 0 && of_triangles.first > 0, "{name}");
    }
}

/// A vertex follows a point of a turning face, slightly above it. Spans must be shorter than the square root of the
/// gap. If there would be too many, the search gives up in time and reports from where on.
#[test]
fn what_would_take_millions_of_spans_is_given_up() {
    let mut random = Random::new(9);
    let (mut given_up, mut never) = (0, 0);
    for round in 0..60 {
        let gap = [1.0e-13, 1.0e-12, 1.0e-8, 1.0e-6][round % 4];
        let weights = [0.3, 0.3, 0.4];
        let mut riding = |turn: DQuat| {
            let face = [v(1., 0., 0.), v(0., 1., 0.), v(-1., -1., 0.)].map(|p| turn * (p + random.vector() * 0.3));
            let normal = (face[1] - face[0]).cross(face[2] - face[0]).normalize();
            let vertex = face[0] * weights[0] + face[1] * weights[1] + face[2] * weights[2] + normal * gap;
            [vertex, face[0], face[1], face[2]]
        };
        let (start, end) = (riding(DQuat::IDENTITY), riding(DQuat::from_rotation_x(1.0)));
        let started = Instant::now();
        let truth = vertex_face_impact(&start, &end, 0.0);
        let exact = exact_impact::vertex_face(&start, &end);
        println!("{gap:e}: {truth:?} in {:.1} ms, {exact:?}", started.elapsed().as_secs_f64() * 1.0e3);
        match truth {
            ImpactTruth::Never => never += usize::from(exact.is_none()),
            ImpactTruth::Undecided { earliest, latest: 1.0, .. } if earliest < 0.9 => given_up += 1,
            _ => panic!("{gap:e}: {truth:?}"),
        }
    }
    println!("{given_up} given up, {never} never");
    assert!(given_up >= 15 && never >= 15 && given_up + never == 60);
}
