//! First impacts of two triangles, and of lists of pairs.

use bevy_circumsphere::kernel::{
    ccd::{
        CommonVertices, ImpactCause, MovingSide, MovingTriangle, PairImpact, TriangleImpact, first_impacts,
        triangle_pair_impact,
    },
    mesh::{
        feature::{Feature, FeatureKind, FeaturePair},
        topology::SurfaceTopology,
    },
};
use circumsphere_truth::triangle_distance;
use glam::{DVec3, Vec3};

use crate::common::{CATEGORIES, Random, hard_pair};

/// Reference distances are accurate to a few units in the last place of the pair's size.
const REFERENCE_ERROR: f64 = 4.0e-15;

/// As for single features: the resolution plus the loss at slivers.
const REACHED: f64 = 1.0e-12;

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Both triangles at a given time, relative to a corner of the first, so that rounding depends only on their distances.
fn at(a: &MovingTriangle, b: &MovingTriangle, time: f64) -> [[DVec3; 3]; 2] {
    [a, b].map(|triangle| {
        std::array::from_fn(|k| (triangle.start[k] - a.start[0]) * (1.0 - time) + (triangle.end[k] - a.end[0]) * time)
    })
}

fn distance(a: &MovingTriangle, b: &MovingTriangle, time: f64) -> f64 {
    let [a, b] = at(a, b, time);
    triangle_distance(&a, &b)
}

fn size(a: &MovingTriangle, b: &MovingTriangle) -> f64 {
    let of = |a: &[DVec3; 3], b: &[DVec3; 3]| {
        let differences = a.iter().flat_map(|p| b.iter().map(move |q| (*p - *q).abs().max_element()));
        differences.fold(0.0, f64::max)
    };
    of(&a.start, &b.start).max(of(&a.end, &b.end))
}

fn impact(a: &MovingTriangle, b: &MovingTriangle, separation: f64) -> Option<TriangleImpact> {
    triangle_pair_impact(a, b, &CommonVertices::NONE, separation)
}

fn still(corners: [DVec3; 3]) -> MovingTriangle {
    MovingTriangle { start: corners, end: corners }
}

/// Pairs of hard triangles that each move from one shape or place to another.
fn each_pair(count: usize, mut examine: impl FnMut(&MovingTriangle, &MovingTriangle, f64)) {
    let mut random = Random::new(21);
    for category in 0..CATEGORIES.len() {
        for _ in 0..count {
            let (a, b) = hard_pair(&mut random, category);
            let extent = a.iter().chain(&b).fold(0.0_f64, |extent, corner| extent.max(corner.distance(a[0])));
            let mut end = |corners: [DVec3; 3]| {
                let (shift, bend) = (random.vector() * extent, random.below(2) as f64 * extent);
                corners.map(|corner| corner + shift + random.vector() * 0.3 * bend)
            };
            let (a, b) = (MovingTriangle { start: a, end: end(a) }, MovingTriangle { start: b, end: end(b) });
            // Played forwards, the pair starts in its category. Played backwards, it ends there.
            let back = |triangle: &MovingTriangle| MovingTriangle { start: triangle.end, end: triangle.start };
            let separation = [0.0, 0.02][random.below(2)] * extent;
            examine(&a, &b, separation);
            examine(&back(&a), &back(&b), separation);
        }
    }
}

#[test]
fn no_time_is_later_than_a_sampled_one_and_every_time_is_one_at_which_the_triangles_are_close() {
    let (mut pairs, mut counts, mut kinds) = (0, [0; 4], [0; 3]);
    let mut worst = 0.0_f64;
    each_pair(1_000, |a, b, separation| {
        pairs += 1;
        let (found, size) = (impact(a, b, separation), size(a, b));
        let sampled = (0..=32).map(|sample| f64::from(sample) / 32.0).find(|&time| {
            let distance = distance(a, b, time);
            distance <= separation - REFERENCE_ERROR * size || time == 0.0 && distance == 0.0
        });
        if let Some(sampled) = sampled {
            let time = found.map(|found| found.time);
            assert!(
                time.is_some_and(|time| time <= sampled),
                "{time:?} instead of {sampled}: {a:?} {b:?} {separation}"
            );
        }
        let Some(found) = found else { return };
        counts[match found.cause {
            ImpactCause::Within => 0,
            ImpactCause::Crossing => 1,
            ImpactCause::Reached => 2,
            ImpactCause::Undecided => 3,
        }] += 1;
        kinds[match found.features.kind() {
            FeatureKind::VertexFace => 0,
            FeatureKind::EdgeEdge => 1,
            FeatureKind::EdgeFace => 2,
            kind => panic!("{kind:?}"),
        }] += 1;
        for weights in [found.barycentric_a, found.barycentric_b] {
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1.0e-12, "{found:?}");
            assert!(weights.iter().all(|weight| (-1.0e-12..=1.0 + 1.0e-12).contains(weight)), "{found:?}");
        }
        let [corners_a, corners_b] = at(a, b, found.time);
        let point = |corners: [DVec3; 3], weights: [f64; 3]| {
            corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
        };
        let gap = point(corners_a, found.barycentric_a).distance(point(corners_b, found.barycentric_b));
        if found.cause == ImpactCause::Undecided {
            return;
        }
        // Where an edge pierces a sliver, the contact point is only as accurate as the sliver is wide.
        if found.cause != ImpactCause::Crossing {
            worst = worst.max((gap - separation) / size.max(f64::MIN_POSITIVE));
        }
        assert!(distance(a, b, found.time) <= separation + REACHED * size, "{found:?} {a:?} {b:?} {separation}");
    });
    println!("{pairs} pairs: within, crossing, reached, undecided {counts:?}; excess of the points {worst:.1e}");
    assert!(counts[..3].iter().all(|&count| count > 500), "{counts:?}");
    assert!(kinds.iter().all(|&count| count > 500), "{kinds:?}");
    assert!(counts[3] * 1_000 < pairs, "{counts:?}");
    assert!(worst < REACHED, "{worst}");
}

#[test]
fn the_order_of_the_triangles_changes_no_time() {
    let mut impacts = 0;
    each_pair(300, |a, b, separation| {
        let (found, other) = (impact(a, b, separation), impact(b, a, separation));
        assert_eq!(found.map(|found| found.time), other.map(|other| other.time), "{a:?} {b:?}");
        impacts += usize::from(found.is_some());
        let (Some(found), Some(other)) = (found, other) else { return };
        if found.features == other.features.swapped() {
            assert_eq!(found.normal, -other.normal);
        }
    });
    assert!(impacts > 1_000, "{impacts}");
}

#[test]
fn hard_cases_have_the_times_worked_out_by_hand() {
    let floor = [v(-4.0, -4.0, 0.0), v(4.0, -4.0, 0.0), v(0.0, 4.0, 0.0)];
    let flat = [v(-0.5, -0.5, 1.0), v(0.5, -0.5, 1.0), v(0.0, 0.5, 1.0)];
    let tip_down = [v(0.0, 0.0, 1.0), v(-0.5, 0.0, 2.0), v(0.5, 0.0, 2.0)];
    let moved = |corners: [DVec3; 3], shift: DVec3| MovingTriangle { start: corners, end: corners.map(|p| p + shift) };
    let down = |way: f64| v(0.0, 0.0, -way);
    let cases = [
        ("flat onto the floor", moved(flat, down(2.0)), still(floor), Some(0.5)),
        ("flat, both moving", moved(flat, down(2.0)), moved(floor, v(1.0, 0.0, 2.0)), Some(0.25)),
        ("tip onto the floor", moved(tip_down, down(4.0)), still(floor), Some(0.25)),
        ("floor onto the tip", moved(floor, v(0.0, 0.0, 4.0)), still(tip_down), Some(0.25)),
        ("too slow", moved(flat, down(0.999)), still(floor), None),
        ("exactly at the end", moved(flat, down(1.0)), still(floor), Some(1.0)),
        ("at rest above", still(flat), still(floor), None),
        ("at rest, touching", still(flat.map(|p| p - v(0.0, 0.0, 1.0))), still(floor), Some(0.0)),
        ("sliding at a height", moved(flat, v(3.0, 0.0, 0.0)), still(floor), None),
        ("a thousand times the height in one step", moved(flat, down(1000.0)), still(floor), Some(0.001)),
        ("past the floor", moved(flat.map(|p| p + v(9.0, 0.0, 0.0)), down(2.0)), still(floor), None),
    ];
    for (what, a, b, expected) in cases {
        for (a, b) in [(a, b), (b, a)] {
            match (impact(&a, &b, 0.0), expected) {
                (Some(found), Some(time)) => {
                    assert!(found.time <= time + 1.0e-15 && found.time > time - 1.0e-12, "{what}: {found:?}");
                }
                (found, expected) => assert_eq!(found.map(|found| found.time), expected, "{what}"),
            }
        }
    }
    // At a separation of 1/4, the flat triangle arrives at 3/8.
    let found = impact(&moved(flat, down(2.0)), &still(floor), 0.25).expect("it comes within the separation");
    assert!(found.time <= 0.375 && found.time > 0.375 - 1.0e-12, "{found:?}");
    assert_eq!((found.features.kind(), found.cause), (FeatureKind::VertexFace, ImpactCause::Reached));
    assert!((found.normal + DVec3::Z).length() < 1.0e-12, "{found:?}");
}

#[test]
fn triangles_that_cross_in_the_beginning_are_said_to() {
    let floor = still([v(-4.0, -4.0, 0.0), v(4.0, -4.0, 0.0), v(0.0, 4.0, 0.0)]);
    // All corners and edges are far from those of the floor, and move away.
    let stake = [v(0.0, 0.0, -1.0), v(-0.5, 0.0, 1.0), v(0.5, 0.0, 1.0)];
    let stake = MovingTriangle { start: stake, end: stake.map(|corner| corner + v(0.0, 0.0, 0.25)) };
    for (a, b) in [(&stake, &floor), (&floor, &stake)] {
        let found = impact(a, b, 0.0).expect("they cross");
        assert_eq!((found.time, found.cause), (0.0, ImpactCause::Crossing));
        assert_eq!(found.features.kind(), FeatureKind::EdgeFace);
        let point = |corners: &[DVec3; 3], weights: [f64; 3]| {
            corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
        };
        let (on_a, on_b) = (point(&a.start, found.barycentric_a), point(&b.start, found.barycentric_b));
        assert!(on_a.distance(on_b) < 1.0e-14, "{on_a} {on_b}");
    }
}

#[test]
fn neighbors_meet_only_by_features_that_share_no_vertex() {
    // Two triangles share the edge between vertices 0 and 1. The second folds over like a page, in a straight line,
    // until vertex 3 passes the face of the first.
    let page = [v(0.0, -1.0, 0.0), v(0.0, 1.0, 0.0), v(2.0, 0.0, 0.0)];
    let a = still(page);
    let b = MovingTriangle { start: [page[1], page[0], v(-1.0, 0.0, 1.0)], end: [page[1], page[0], v(2.0, 0.0, -1.0)] };
    let common = CommonVertices::of([0, 1, 2], [1, 0, 3]);
    let found = triangle_pair_impact(&a, &b, &common, 0.0).expect("vertex 3 passes the face at 1/2");
    assert!(found.time <= 0.5 && found.time > 0.5 - 1.0e-12, "{found:?}");
    assert_eq!(found.features, FeaturePair { a: Feature::Face, b: Feature::Vertex(2) });
    // Flat neighbors at rest touch only each other. Treated as separate surfaces, they touch at once.
    let flat = still([page[1], page[0], v(-1.0, 0.0, 0.0)]);
    assert_eq!(triangle_pair_impact(&a, &flat, &common, 0.0), None);
    assert_eq!(impact(&a, &flat, 0.0).map(|found| found.time), Some(0.0));
    // One common vertex, and an edge that starts across the other face.
    let across = still([page[2], v(1.0, 0.0, -1.0), v(1.0, 0.0, 1.0)]);
    let found = triangle_pair_impact(&a, &across, &CommonVertices::of([0, 1, 2], [2, 3, 4]), 0.0);
    assert_eq!(found.map(|found| found.cause), Some(ImpactCause::Crossing));
    // A triangle and itself.
    assert_eq!(triangle_pair_impact(&a, &a, &CommonVertices::of([0, 1, 2], [0, 1, 2]), 0.0), None);
}

#[test]
fn coordinates_that_are_not_finite_never_meet() {
    let a = still([v(0.0, 0.0, 0.0), v(1.0, 0.0, 0.0), v(0.0, 1.0, 0.0)]);
    for value in [f64::NAN, f64::INFINITY] {
        for corner in 0..6 {
            let mut b = a;
            if corner < 3 {
                b.start[corner].y = value;
            } else {
                b.end[corner - 3].y = value;
            }
            assert_eq!(impact(&a, &b, 0.1), None);
            assert_eq!(impact(&b, &a, 0.1), None);
        }
    }
}

/// A wavy sheet of `side`² vertices over the unit square.
fn sheet(side: u32, height: impl Fn(f64, f64) -> f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let place = |k: u32| f64::from(k) / f64::from(side - 1);
    let positions =
        (0..side * side).map(|k| (place(k % side), place(k / side))).map(|(x, y)| v(x, y, height(x, y))).collect();
    let triangles = (0..(side - 1) * (side - 1))
        .map(|k| k / (side - 1) * side + k % (side - 1))
        .flat_map(|k| [[k, k + 1, k + side], [k + 1, k + side + 1, k + side]])
        .collect();
    (positions, triangles)
}

fn narrow(positions: &[DVec3]) -> Vec<Vec3> {
    positions.iter().map(|position| position.as_vec3()).collect()
}

#[test]
fn a_list_holds_the_impacts_of_its_pairs_in_order_and_precision_of_storage_does_not_matter() {
    let (lower, triangles) = sheet(8, |x, y| 0.05 * (7.0 * x).sin() * (5.0 * y).cos());
    let (upper, _) = sheet(8, |x, y| 0.3 + 0.05 * (4.0 * x + 6.0 * y).sin());
    let fallen: Vec<DVec3> = upper.iter().map(|position| *position - v(0.03, 0.02, 0.3)).collect();
    let [lower, upper, fallen] = [lower, upper, fallen].map(|positions| narrow(&positions));
    let topology = SurfaceTopology::new(&lower, &triangles).unwrap();
    let (a, b) = (
        MovingSide { topology: &topology, start: &lower, end: &lower },
        MovingSide { topology: &topology, start: &upper, end: &fallen },
    );
    let count = triangles.len() as u32;
    let candidates: Vec<[u32; 2]> =
        (0..count).flat_map(|first| (0..count).map(move |second| [first, second])).collect();
    let mut impacts: Vec<PairImpact> = Vec::new();
    first_impacts(&a, &b, false, &candidates, 0.01, &mut impacts);
    assert!(impacts.len() > 50 && impacts.len() < candidates.len() / 10, "{}", impacts.len());
    assert!(impacts.is_sorted_by_key(|found| [found.triangle_a, found.triangle_b]));

    let wide = |positions: &[Vec3]| positions.iter().map(|position| position.as_dvec3()).collect::<Vec<_>>();
    let [wide_lower, wide_upper, wide_fallen] = [wide(&lower), wide(&upper), wide(&fallen)];
    let mut from_wide = Vec::new();
    first_impacts(
        &MovingSide { topology: &topology, start: &wide_lower, end: &wide_lower },
        &MovingSide { topology: &topology, start: &wide_upper, end: &wide_fallen },
        false,
        &candidates,
        0.01,
        &mut from_wide,
    );
    assert_eq!(impacts, from_wide);

    let mut found = impacts.iter().peekable();
    for [first, second] in candidates {
        let corners = |start: &[DVec3], end: &[DVec3], triangle: u32| {
            let pick = |positions: &[DVec3]| triangles[triangle as usize].map(|vertex| positions[vertex as usize]);
            MovingTriangle { start: pick(start), end: pick(end) }
        };
        let (a, b) = (corners(&wide_lower, &wide_lower, first), corners(&wide_upper, &wide_fallen, second));
        let is_here = |found: &&PairImpact| [found.triangle_a, found.triangle_b] == [first, second];
        let time = found.next_if(is_here).map(|found| found.impact.time);
        for sample in 0..=16 {
            let sampled = f64::from(sample) / 16.0;
            if distance(&a, &b, sampled) < 0.01 - 1.0e-12 {
                assert!(time.is_some_and(|time| time <= sampled), "{first} {second}: {time:?} and {sampled}");
            }
        }
        if let Some(time) = time {
            assert!(distance(&a, &b, time) < 0.01 + 1.0e-11, "{first} {second} at {time}");
        }
    }
}

#[test]
fn a_surface_at_rest_or_moved_as_a_whole_never_meets_itself() {
    let (positions, triangles) = sheet(6, |x, y| 0.05 * (7.0 * x).sin() * (5.0 * y).cos());
    let topology = SurfaceTopology::new(&narrow(&positions), &triangles).unwrap();
    // Halves and eighths, so that the shift does not round.
    let moved: Vec<DVec3> = positions.iter().map(|position| *position + v(4.0, -8.5, 0.125)).collect();
    let count = triangles.len() as u32;
    let candidates: Vec<[u32; 2]> =
        (0..count).flat_map(|first| (first..count).map(move |second| [first, second])).collect();
    for end in [&positions, &moved] {
        let side = MovingSide { topology: &topology, start: &positions, end };
        let mut impacts = Vec::new();
        first_impacts(&side, &side, true, &candidates, 0.0, &mut impacts);
        assert_eq!(impacts, []);
        // Treated as two surfaces, each triangle meets itself at once.
        first_impacts(&side, &side, false, &candidates, 0.0, &mut impacts);
        assert!(impacts.len() >= triangles.len());
    }
    // Folded shut along the diagonal, the halves meet although they are one surface.
    let folded: Vec<DVec3> =
        positions.iter().map(|p| if p.x > p.y { v(p.y, p.x, 0.2) - v(0.0, 0.0, 0.4) } else { *p }).collect();
    let mut impacts = Vec::new();
    let side = MovingSide { topology: &topology, start: &positions, end: &folded };
    first_impacts(&side, &side, true, &candidates, 0.0, &mut impacts);
    assert!(!impacts.is_empty());
}
