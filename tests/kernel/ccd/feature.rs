//! Times of impact of a vertex and a face, and of two edges.

use bevy_circumsphere::kernel::ccd::{
    FeatureImpact, ImpactCause, MOST_STEPS, RESOLUTION, edge_edge_impact, vertex_face_impact,
};
use glam::{DQuat, DVec3};

use super::families::{FAMILIES, KINDS, Kind, Motion, motion};
use crate::common::Random;

/// Rounding of an expected time computed in f64: a few units in the last place of a number up to 1.
const TIME_ROUNDING: f64 = 1.0e-15;

/// How much earlier than the closed form a time may be where features approach by about their size in one step. The
/// kernel stops at its resolution, 1.4e-14 of their size, and loses some precision at slivers and corners.
const EARLINESS: f64 = 1.0e-12;

/// Reference distances are accurate to a few units in the last place of the pair's size.
const REFERENCE_ERROR: f64 = 4.0e-15;

/// Distance above the separation at which features count as having reached it: the resolution plus the error of normals
/// on slivers (1e-13 in half a million impacts).
const REACHED: f64 = 1.0e-12;

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Asserts that a motion has its impact at `time`, or earlier by no more than the kernel's resolution allows.
fn assert_time(what: &str, motion: &Motion, separation: f64, time: f64) -> FeatureImpact {
    let impact = motion.impact(separation).unwrap_or_else(|| panic!("{what}: missed, {motion:?}"));
    assert!(impact.time <= time + TIME_ROUNDING, "{what}: {} is later than {time}", impact.time);
    assert!(impact.time >= time - EARLINESS, "{what}: {} is earlier than {time}, {impact:?}", impact.time);
    impact
}

#[test]
fn a_point_falling_on_a_triangle_arrives_when_height_and_speed_say() {
    let mut random = Random::new(1);
    for _ in 0..20_000 {
        let corners = [random.vector(), random.vector(), random.vector()].map(|corner| v(corner.x, corner.y, 0.0));
        let weights = random.weights();
        let below = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
        let (height, way) = (random.range(0.1, 1.0), random.range(0.2, 2.0));
        let separation = if random.below(2) == 0 { 0.0 } else { random.range(0.0, 0.05) };
        let side = if random.below(2) == 0 { 1.0 } else { -1.0 };
        let (above, drift) = (below + v(0.0, 0.0, side * height), random.vector());
        // Motion common to all four points must not change the result.
        let end = [above - v(0.0, 0.0, side * way), corners[0], corners[1], corners[2]].map(|point| point + drift);
        let motion = Motion { kind: Kind::VertexFace, start: [above, corners[0], corners[1], corners[2]], end };
        let time = (height - separation) / way;
        if time < 1.0 - EARLINESS {
            let impact = assert_time("falling point", &motion, separation, time);
            assert_eq!(impact.cause, ImpactCause::Reached);
            assert!(impact.normal.dot(DVec3::NEG_Z * side) > 1.0 - 1.0e-9, "{impact:?}");
            let contact = (1..4).map(|k| motion.start[k] * impact.weights[k]).sum::<DVec3>();
            assert!(contact.distance(below) < 1.0e-6, "{contact} instead of {below}");
        } else if time > 1.0 + EARLINESS {
            assert_eq!(motion.impact(separation), None, "{motion:?}");
        }
    }
}

#[test]
fn edges_that_are_lowered_onto_each_other_meet_when_height_and_speed_say() {
    let mut random = Random::new(2);
    for _ in 0..20_000 {
        let turn = DQuat::from_axis_angle(random.direction(), random.range(0.0, 3.0));
        let angle = random.range(1.0e-3, 1.57);
        let (half, other_half) = (random.range(0.1, 1.0), random.range(0.1, 1.0));
        let (height, way) = (random.range(0.1, 1.0), random.range(0.2, 2.0));
        let separation = if random.below(2) == 0 { 0.0 } else { random.range(0.0, 0.05) };
        let crossing = DVec3::X * random.range(-0.9, 0.9) * half;
        let along = v(angle.cos(), angle.sin(), 0.0) * other_half;
        let upper = [crossing - along, crossing + along].map(|end| end + v(0.0, 0.0, height));
        let start = [v(-half, 0.0, 0.0), v(half, 0.0, 0.0), upper[0], upper[1]].map(|point| turn * point);
        let fall = turn * v(0.0, 0.0, way);
        let motion =
            Motion { kind: Kind::EdgeEdge, start, end: [start[0], start[1], start[2] - fall, start[3] - fall] };
        let time = (height - separation) / way;
        if time < 1.0 - EARLINESS {
            let impact = assert_time("lowered edge", &motion, separation, time);
            assert!(impact.normal.dot(turn * DVec3::Z) > 1.0 - 1.0e-9, "{impact:?}");
        } else if time > 1.0 + EARLINESS {
            assert_eq!(motion.impact(separation), None, "{motion:?}");
        }
    }
}

#[test]
fn moving_points_come_within_a_separation_when_the_quadratic_says() {
    let mut random = Random::new(3);
    let mut compared = 0;
    for _ in 0..50_000 {
        let (from, to) = (random.vector() * 2.0, random.vector() * 2.0);
        let separation = random.power_of_ten(-6.0, 0.0);
        let (a, half_b, c) =
            ((to - from).length_squared(), from.dot(to - from), from.length_squared() - separation.powi(2));
        let discriminant = half_b * half_b - a * c;
        // Triangles and edges without extent are points.
        for kind in KINDS {
            let first = kind.first_count();
            let place = |point: DVec3| std::array::from_fn(|k| if k < first { point } else { DVec3::ZERO });
            let motion = Motion { kind, start: place(from), end: place(to) };
            // Near a double root or the end of the step, rounding decides.
            if c > 1.0e-9 && discriminant > 1.0e-9 {
                let time = c / (-half_b + discriminant.sqrt());
                if half_b < 0.0 && time < 1.0 - 1.0e-9 {
                    let impact = motion.impact(separation).expect("the quadratic has a root");
                    assert!(impact.time <= time + TIME_ROUNDING * 10.0, "{} is later than {time}", impact.time);
                    assert!(impact.time >= time - 1.0e-9, "{} is earlier than {time}: {motion:?}", impact.time);
                    compared += 1;
                } else if half_b > 0.0 || time > 1.0 + 1.0e-9 {
                    assert_eq!(motion.impact(separation), None, "{motion:?}");
                }
            } else if c > 1.0e-9 && discriminant < -1.0e-9 {
                assert_eq!(motion.impact(separation), None, "{motion:?}");
            }
        }
    }
    assert!(compared > 1_000, "{compared}");
}

#[test]
fn a_flap_on_a_hinge_meets_a_point_when_its_slope_says() {
    // Corners (0, ±1, 0.25) and (1, 0, 1 − 2t): above (x, 0), the height of the flap is 0.25 (1 − x) + (1 − 2t) x.
    for eighths in 2..8 {
        let x = f64::from(eighths) / 8.0;
        let time = (0.25 * (1.0 - x) + x) / (2.0 * x);
        let still = [v(x, 0.0, 0.0), v(0.0, -1.0, 0.25), v(0.0, 1.0, 0.25)];
        let motion = Motion {
            kind: Kind::VertexFace,
            start: [still[0], still[1], still[2], v(1.0, 0.0, 1.0)],
            end: [still[0], still[1], still[2], v(1.0, 0.0, -1.0)],
        };
        assert_time("flap", &motion, 0.0, time);
    }
}

#[test]
fn features_that_only_graze_each_other_are_found() {
    // A seesaw of height (t − 1/2) x above (x, 0), and a point, or an edge along y, at x = 2t − 1 and z = 0. The seesaw
    // passes above it at a height of 2 (t − 1/2)².
    let seesaw = |y: f64| {
        (
            [v(-4.0, -y, 2.0), v(4.0, 0.0, -2.0), v(-4.0, y, 2.0)],
            [v(-4.0, -y, -2.0), v(4.0, 0.0, 2.0), v(-4.0, y, -2.0)],
        )
    };
    let (wide, narrow) = (seesaw(4.0), seesaw(0.0));
    let motions = [
        Motion {
            kind: Kind::VertexFace,
            start: [v(-1.0, 0.0, 0.0), wide.0[0], wide.0[1], wide.0[2]],
            end: [v(1.0, 0.0, 0.0), wide.1[0], wide.1[1], wide.1[2]],
        },
        Motion {
            kind: Kind::EdgeEdge,
            start: [v(-1.0, -1.0, 0.0), v(-1.0, 1.0, 0.0), narrow.0[0], narrow.0[1]],
            end: [v(1.0, -1.0, 0.0), v(1.0, 1.0, 0.0), narrow.1[0], narrow.1[1]],
        },
    ];
    for motion in motions {
        let impact = motion.impact(0.0).expect("they touch");
        // The height 2 (t − 1/2)² equals the resolution, 1e-13 at this size, 2e-7 before the touch.
        assert!(impact.time <= 0.5 && impact.time > 0.5 - 4.0e-7, "{impact:?}");
        // Raised by a thousandth, the seesaw does not touch.
        let first = motion.kind.first_count();
        let mut higher = motion;
        for k in first..4 {
            higher.start[k].z += 1.0e-3;
            higher.end[k].z += 1.0e-3;
        }
        assert_eq!(higher.impact(0.0), None);
        assert!(higher.impact(1.1e-3).is_some());
    }
}

/// Calls `examine` with every motion of every family and a few separations relative to its size.
fn each_motion(count: usize, mut examine: impl FnMut(&str, &Motion, f64)) {
    let mut random = Random::new(4);
    for (family, name) in FAMILIES.into_iter().enumerate() {
        for kind in KINDS {
            for _ in 0..count {
                let motion = motion(&mut random, family, kind);
                let separation = [0.0, 1.0e-3, 0.05][random.below(3)] * motion.size();
                examine(name, &motion, separation);
            }
        }
    }
}

/// Whether a reference distance refutes an answer: the first of 65 samples that is certainly within the separation
/// comes earlier.
fn is_refuted(motion: &Motion, separation: f64, time: Option<f64>) -> bool {
    let surely_within = separation - REFERENCE_ERROR * motion.size();
    let within = |time: &f64| {
        let distance = motion.distance_at(*time);
        distance <= surely_within || distance == 0.0
    };
    let first = (0..=64).map(|sample| f64::from(sample) / 64.0).find(within);
    first.is_some_and(|first| time.is_none_or(|time| time > first))
}

#[test]
fn no_time_is_later_than_a_sampled_one_and_every_time_is_one_at_which_the_features_are_close() {
    let (mut impacts, mut reached, mut undecided, mut within) = (0, 0, 0, 0);
    let mut worst = 0.0_f64;
    each_motion(4_000, |family, motion, separation| {
        let impact = motion.impact(separation);
        assert!(!is_refuted(motion, separation, impact.map(|impact| impact.time)), "{family}: {impact:?} {motion:?}");
        let Some(impact) = impact else { return };
        impacts += 1;
        let excess = (motion.distance_at(impact.time) - separation) / motion.size().max(f64::MIN_POSITIVE);
        match impact.cause {
            ImpactCause::Undecided => {
                undecided += 1;
                assert_eq!(impact.steps, MOST_STEPS);
            }
            ImpactCause::Within => {
                within += 1;
                assert_eq!(impact.time, 0.0);
                worst = worst.max(excess);
            }
            _ => {
                reached += 1;
                worst = worst.max(excess);
            }
        }
    });
    println!("{impacts} impacts, {reached} reached, {within} within, {undecided} undecided, excess {worst:.1e}");
    assert!(impacts > 20_000 && reached > 20_000 && within > 1_000, "{impacts} {reached} {within}");
    assert!(undecided * 10_000 < impacts, "{undecided} of {impacts}");
    assert!(worst < REACHED, "{worst}");
}

#[test]
fn the_sampled_check_refutes_answers_that_are_late_or_missing() {
    let (mut late, mut missing, mut impacts) = (0, 0, 0);
    each_motion(500, |_, motion, separation| {
        let Some(impact) = motion.impact(separation) else { return };
        impacts += 1;
        late += usize::from(is_refuted(motion, separation, Some(impact.time + 0.05)));
        missing += usize::from(is_refuted(motion, separation, None));
    });
    // At separation 0, the check cannot see features that pass through each other between two samples.
    assert!(late * 4 > impacts && missing * 4 > impacts, "{late} and {missing} of {impacts}");
}

#[test]
fn ends_of_edges_that_meet_at_a_right_angle_are_not_found_early() {
    // Where an edge is perpendicular to the connection to its end, rounding hides which of its points is closest. The
    // difference of the ends 0 and 3 is (0, 1 − t, 4 − 5t).
    let start = [v(0.0, -1.0, 2.0), v(-2.0, 2.0, 0.0), v(1.0, -2.0, -2.0), v(0.0, -2.0, -2.0)];
    let end = [v(2.0, 0.0, -2.0), v(1.0, 2.0, -2.0), v(2.0, 0.0, 2.0), v(2.0, 0.0, -1.0)];
    assert_time("at a distance", &Motion { kind: Kind::EdgeEdge, start, end }, 0.2, 0.8);
    // Ends that pass each other at 1e-11, with one edge across their connection.
    let start = [
        v(-158_106.465_047_457_4, -49_365.985_175_291_025, -157_144.871_905_062_76),
        v(-158_108.654_827_152_8, -49_365.812_291_562_57, -157_144.571_966_342_2),
        v(-158_106.331_189_2, -49_366.114_119_097_91, -157_144.532_272_937_85),
        v(-158_105.991_721_071_42, -49_366.570_669_689_5, -157_144.522_808_406_9),
    ];
    let end = [
        v(-158_106.860_793_136_88, -49_365.341_119_337_71, -157_144.544_138_861_38),
        v(-158_107.846_815_478_3, -49_365.483_492_068_386, -157_144.063_193_620_18),
        v(-158_107.062_479_270_65, -49_365.146_837_876_18, -157_145.055_867_398_04),
        v(-158_106.622_685_483_02, -49_367.518_494_328_85, -157_144.446_737_722_55),
    ];
    let motion = Motion { kind: Kind::EdgeEdge, start, end };
    let distance = motion.impact(0.0).map_or(0.0, |impact| motion.distance_at(impact.time));
    assert!(distance < 1.0e-13 * motion.size(), "{distance}");
}

/// A motion on a dyadic grid that touches exactly, without any rounding, and the time of the touch.
fn exact_touch(random: &mut Random, kind: Kind) -> (Motion, f64) {
    let first = kind.first_count();
    let grid = |random: &mut Random| random.grid_point(1 << 10) / 1024.0;
    let mut points: [DVec3; 4] = std::array::from_fn(|_| grid(random));
    let velocities: [DVec3; 4] = std::array::from_fn(|_| grid(random));
    // Eighths that sum to 1 in each feature. Zeros put the touch on a boundary.
    let share = |random: &mut Random| random.below(9) as f64 / 8.0;
    let (s, t) = (share(random), share(random));
    let weights = match kind {
        Kind::VertexFace => [1.0, -(1.0 - s), -(s - s * t), -(s * t)],
        Kind::EdgeEdge => [1.0 - s, s, -(1.0 - t), -t],
    };
    let apart: DVec3 = (0..4).map(|k| points[k] * weights[k]).sum();
    for point in &mut points[..first] {
        *point -= apart;
    }
    let touch: DVec3 = (0..4).map(|k| points[k] * weights[k]).sum();
    assert_eq!(touch, DVec3::ZERO, "sixteenths of thousandths are exact");
    let time = random.below(17) as f64 / 16.0;
    let start = std::array::from_fn(|k| points[k] - velocities[k] * time);
    let end = std::array::from_fn(|k| points[k] + velocities[k] * (1.0 - time));
    (Motion { kind, start, end }, time)
}

#[test]
fn features_that_touch_exactly_are_never_missed_nor_found_late() {
    let mut random = Random::new(5);
    let (mut steps, mut farthest) = (Vec::new(), 0.0_f64);
    for kind in KINDS {
        for _ in 0..100_000 {
            let (motion, time) = exact_touch(&mut random, kind);
            let impact = motion.impact(0.0).unwrap_or_else(|| panic!("missed: {motion:?}"));
            assert!(impact.time <= time, "{} is later than {time}: {motion:?}", impact.time);
            steps.push(impact.steps);
            if impact.cause != ImpactCause::Undecided {
                farthest = farthest.max(motion.distance_at(impact.time) / motion.size());
            }
        }
    }
    steps.sort_unstable();
    println!(
        "steps: median {}, largest {}; at most {farthest:.0e} apart",
        steps[steps.len() / 2],
        steps[steps.len() - 1]
    );
    assert!(farthest < REACHED, "{farthest}");
}

#[test]
fn features_kept_apart_by_a_plane_are_never_found() {
    let mut random = Random::new(6);
    let mut nearest = f64::INFINITY;
    for kind in KINDS {
        for _ in 0..50_000 {
            // The first feature stays at or above z = gap, the second at or below 0. Corners often touch these bounds
            // or move along them.
            let gap = random.power_of_ten(-12.0, -1.0);
            let turn = DQuat::from_axis_angle(random.direction(), random.range(0.0, 3.0));
            let point = |random: &mut Random, k: usize| {
                let depth = if random.below(3) == 0 { random.unit() } else { 0.0 };
                let height = if k < kind.first_count() { gap + depth } else { -depth };
                turn * v(random.range(-1.0, 1.0), random.range(-1.0, 1.0), height)
            };
            let start = std::array::from_fn(|k| point(&mut random, k));
            let end = std::array::from_fn(|k| point(&mut random, k));
            let motion = Motion { kind, start, end };
            // The rotation rounds by far less than a tenth of the gap.
            assert_eq!(motion.impact(0.0), None, "{gap}: {motion:?}");
            assert_eq!(motion.impact(gap * 0.9), None, "{gap}: {motion:?}");
            nearest = (0..=4).map(|k| motion.distance_at(f64::from(k) / 4.0)).fold(nearest, f64::min);
        }
    }
    assert!(nearest < 1.0e-9, "none came close: {nearest}");
}

#[test]
fn degenerate_features_are_points_and_segments() {
    let x = |at: f64| v(at, 0.0, 0.0);
    let cases = [
        ("points", Kind::EdgeEdge, [x(0.0), x(0.0), x(1.0), x(1.0)], [x(0.5), x(0.5), x(0.0), x(0.0)], Some(2.0 / 3.0)),
        ("points that stay", Kind::EdgeEdge, [x(0.0), x(0.0), x(1.0), x(1.0)], [x(0.0), x(0.0), x(1.0), x(1.0)], None),
        (
            "segments on one line",
            Kind::EdgeEdge,
            [x(0.0), x(1.0), x(2.0), x(3.0)],
            [x(0.0), x(1.0), x(0.0), x(1.0)],
            Some(0.5),
        ),
        (
            "segments on one line, receding",
            Kind::EdgeEdge,
            [x(0.0), x(1.0), x(2.0), x(3.0)],
            [x(0.0), x(1.0), x(3.0), x(4.0)],
            None,
        ),
        (
            "a face that is a point",
            Kind::VertexFace,
            [x(0.0), x(1.0), x(1.0), x(1.0)],
            [x(2.0), x(1.0), x(1.0), x(1.0)],
            Some(0.5),
        ),
        (
            "a face that is a segment",
            Kind::VertexFace,
            [v(0.5, 1.0, 0.0), x(0.0), x(1.0), x(2.0)],
            [v(0.5, -1.0, 0.0), x(0.0), x(1.0), x(2.0)],
            Some(0.5),
        ),
        (
            "a point past the end of a segment",
            Kind::VertexFace,
            [v(2.5, 1.0, 0.0), x(0.0), x(1.0), x(2.0)],
            [v(2.5, -1.0, 0.0), x(0.0), x(1.0), x(2.0)],
            None,
        ),
        (
            "parallel edges",
            Kind::EdgeEdge,
            [x(0.0), x(1.0), v(0.0, 1.0, 0.0), v(1.0, 1.0, 0.0)],
            [x(0.0), x(1.0), v(0.0, -1.0, 0.0), v(1.0, -1.0, 0.0)],
            Some(0.5),
        ),
        (
            "antiparallel edges",
            Kind::EdgeEdge,
            [x(0.0), x(1.0), v(1.0, 1.0, 0.0), v(0.0, 1.0, 0.0)],
            [x(0.0), x(1.0), v(1.0, -3.0, 0.0), v(0.0, -3.0, 0.0)],
            Some(0.25),
        ),
        (
            "a point sliding in a face's plane",
            Kind::VertexFace,
            [x(-1.0), v(0.0, -1.0, 0.0), v(0.0, 1.0, 0.0), x(1.0)],
            [x(1.0), v(0.0, -1.0, 0.0), v(0.0, 1.0, 0.0), x(1.0)],
            Some(0.5),
        ),
        (
            "edges sliding in one plane",
            Kind::EdgeEdge,
            [v(0.0, -1.0, 0.0), v(0.0, 1.0, 0.0), x(1.0), x(2.0)],
            [v(0.0, -1.0, 0.0), v(0.0, 1.0, 0.0), x(-1.0), x(0.0)],
            Some(0.5),
        ),
        (
            "a face that collapses onto the point",
            Kind::VertexFace,
            [x(0.0), v(1.0, 0.0, 1.0), v(-1.0, 1.0, 1.0), v(-1.0, -1.0, 1.0)],
            [x(0.0); 4],
            Some(1.0),
        ),
        (
            "a common motion",
            Kind::VertexFace,
            [v(0.0, 0.0, 1.0), v(1.0, 0.0, 0.0), v(-1.0, 1.0, 0.0), v(-1.0, -1.0, 0.0)],
            [v(0.0, 9.0, -8.0), v(1.0, 9.0, -9.0), v(-1.0, 10.0, -9.0), v(-1.0, 8.0, -9.0)],
            None,
        ),
    ];
    for (what, kind, start, end, time) in cases {
        for length in [1.0, 1.0e-6, 1.0e6, 1.0e-150, 1.0e150, f64::MIN_POSITIVE] {
            let motion = Motion { kind, start, end }.map(|point| point * length);
            match time {
                Some(time) => {
                    assert_time(what, &motion, 0.0, time);
                }
                None => assert_eq!(motion.impact(0.0), None, "{what} at {length}"),
            }
        }
    }
}

#[test]
fn features_that_begin_within_the_separation_are_said_to() {
    let face = [v(1.0, 0.0, 0.0), v(-1.0, 1.0, 0.0), v(-1.0, -1.0, 0.0)];
    let motion = |from: f64, to: f64| Motion {
        kind: Kind::VertexFace,
        start: [v(0.0, 0.0, from), face[0], face[1], face[2]],
        end: [v(0.0, 0.0, to), face[0], face[1], face[2]],
    };
    for (from, to, separation) in [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.1, 1.0, 0.2), (0.1, 1.0, 0.1), (0.1, -1.0, 0.1)]
    {
        let impact = motion(from, to).impact(separation).expect("they are within");
        assert_eq!((impact.time, impact.cause), (0.0, ImpactCause::Within), "{from} {to} {separation}");
        let expected = if from > 0.0 { DVec3::NEG_Z } else { impact.normal };
        assert_eq!(impact.normal, expected);
    }
    // Just outside the separation, and moving away.
    assert_eq!(motion(0.1, 1.0).impact(0.1 * (1.0 - 1.0e-12)), None);
    // No impact can be ruled out for a separation that is NaN.
    assert!(motion(0.1, 1.0).impact(f64::NAN).is_some());
    assert!(motion(0.1, 1.0).impact(f64::INFINITY).is_some());
}

#[test]
fn coordinates_that_are_not_finite_never_meet() {
    let start = [v(0.0, 0.0, 1.0), v(1.0, 0.0, 0.0), v(-1.0, 1.0, 0.0), v(-1.0, -1.0, 0.0)];
    let end = [v(0.0, 0.0, -1.0), start[1], start[2], start[3]];
    for kind in KINDS {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for place in 0..24 {
                let mut points = [start, end];
                points[place / 12][place / 3 % 4][place % 3] = value;
                let motion = Motion { kind, start: points[0], end: points[1] };
                assert_eq!(motion.impact(0.1), None, "{place}");
            }
        }
    }
}

#[test]
fn any_bits_give_an_answer() {
    let mut random = Random::new(7);
    let mut impacts = 0;
    for _ in 0..100_000 {
        let mut points = || -> [DVec3; 4] {
            std::array::from_fn(|_| DVec3::from_array([0; 3].map(|_| f64::from_bits(random.bits()))))
        };
        let (start, end) = (points(), points());
        for kind in KINDS {
            let impact = Motion { kind, start, end }.impact(0.0);
            assert!(impact.is_none_or(|impact| (0.0..=1.0).contains(&impact.time)), "{impact:?}");
            impacts += usize::from(impact.is_some());
        }
    }
    assert!(impacts > 0);
}

#[test]
fn the_order_of_features_and_corners_changes_no_time() {
    each_motion(500, |family, motion, separation| {
        let impact = motion.impact(separation);
        let orders: &[[usize; 4]] = match motion.kind {
            Kind::VertexFace => &[[0, 2, 3, 1], [0, 1, 3, 2], [0, 3, 2, 1]],
            Kind::EdgeEdge => &[[1, 0, 2, 3], [0, 1, 3, 2], [2, 3, 0, 1], [3, 2, 0, 1]],
        };
        for order in orders {
            let other = Motion { start: order.map(|k| motion.start[k]), end: order.map(|k| motion.end[k]), ..*motion };
            let other = other.impact(separation);
            assert_eq!(impact.map(|impact| impact.time), other.map(|impact| impact.time), "{family}: {motion:?}");
            let (Some(impact), Some(other)) = (impact, other) else { continue };
            let is_swapped = motion.kind == Kind::EdgeEdge && order[0] > 1;
            assert_eq!(other.normal, if is_swapped { -impact.normal } else { impact.normal }, "{family}");
            if (0..4).all(|k| (0..k).all(|l| motion.start[k] != motion.start[l])) {
                assert_eq!(other.weights, order.map(|k| impact.weights[k]), "{family}: {motion:?}");
            }
        }
    });
}

#[test]
fn a_power_of_two_changes_no_time() {
    each_motion(500, |family, motion, separation| {
        let time = motion.impact(separation).map(|impact| impact.time);
        for factor in [2.0_f64.powi(-40), 2.0_f64.powi(40)] {
            let scaled = motion.map(|point| point * factor).impact(separation * factor);
            assert_eq!(time, scaled.map(|impact| impact.time), "{family}: {motion:?}");
        }
    });
}

#[test]
fn normals_and_weights_describe_the_features_at_the_time_of_impact() {
    let mut compared = 0;
    each_motion(2_000, |family, motion, separation| {
        let Some(impact) = motion.impact(separation) else { return };
        let size = motion.size();
        let first = motion.kind.first_count();
        let [own, other] =
            [&impact.weights[..first], &impact.weights[first..]].map(|weights| weights.iter().sum::<f64>());
        assert!((own - 1.0).abs() < 1.0e-15 && (other - 1.0).abs() < 1.0e-15, "{family}: {impact:?}");
        assert!(
            impact.weights.iter().all(|weight| (-1.0e-15..=1.0 + 1.0e-15).contains(weight)),
            "{family}: {impact:?}"
        );
        if impact.cause != ImpactCause::Reached {
            return;
        }
        compared += 1;
        let points = motion.at(impact.time);
        let connection: DVec3 =
            (0..4).map(|k| points[k] * impact.weights[k] * if k < first { 1.0 } else { -1.0 }).sum();
        assert!(
            (connection.length() - motion.distance_at(impact.time)).abs() < REACHED * size,
            "{family}: {connection} {impact:?} {motion:?}"
        );
        // All of the first feature is equally far along the normal from all of the second.
        assert!((impact.normal.length() - 1.0).abs() < 1.0e-12, "{family}: {impact:?}");
        for k in 0..first {
            for l in first..4 {
                let height = impact.normal.dot(points[l] - points[k]);
                assert!(height > separation - REACHED * size, "{family}: {height} {separation} {impact:?} {motion:?}");
            }
        }
    });
    assert!(compared > 20_000, "{compared}");
}

#[test]
fn a_search_that_is_cut_short_says_so_and_is_early() {
    // The lines of the edges meet at 1/2 in a double root, inside both edges: the kind of impact that takes the most
    // steps.
    let start = [v(-2.0, 0.0, -1.0), v(2.0, -2.0, 1.0), v(1.0, -1.0, -1.0), v(2.0, -2.0, 2.0)];
    let end = [v(1.0, -1.0, -2.0), v(1.0, 1.0, 2.0), v(0.0, 0.0, 1.0), v(1.0, 1.0, 1.0)];
    let motion = Motion { kind: Kind::EdgeEdge, start, end };
    assert!(motion.distance_at(0.5) < 1.0e-15);
    let impact = motion.impact(0.0).expect("they touch");
    assert_eq!((impact.cause, impact.steps), (ImpactCause::Undecided, MOST_STEPS));
    assert!(impact.time < 0.5 && impact.time > 0.4999, "{impact:?}");
}

#[test]
fn features_that_pass_at_more_than_the_resolution_are_told_from_those_that_meet() {
    // A point passes the corner of a face, or an edge the end of another, at a clearance along x.
    for exponent in 0..46 {
        let clearance = 2.0_f64.powi(-exponent);
        for (kind, start) in [
            (Kind::VertexFace, [v(clearance, 0.0, 1.0), v(0.0, 0.0, 0.0), v(-1.0, 1.0, 0.0), v(-1.0, -1.0, 0.0)]),
            (Kind::EdgeEdge, [v(clearance, -1.0, 1.0), v(clearance, 1.0, 1.0), v(-1.0, 0.0, 0.0), v(0.0, 0.0, 0.0)]),
        ] {
            let first = kind.first_count();
            let end = std::array::from_fn(|k| if k < first { start[k] - v(0.0, 0.0, 2.0) } else { start[k] });
            let motion = Motion { kind, start, end };
            if clearance > 2.0 * RESOLUTION * motion.size() {
                assert_eq!(motion.impact(0.0), None, "{kind:?} at {clearance:e}");
            }
            let meeting = motion.map(|point| if point.x == clearance { v(0.0, point.y, point.z) } else { point });
            assert!(meeting.impact(0.0).is_some(), "{kind:?}");
        }
    }
}

#[test]
fn public_functions_ask_for_their_kind() {
    let start = [v(0.0, 0.0, 1.0), v(1.0, 0.0, 0.0), v(-1.0, 1.0, 0.0), v(-1.0, -1.0, 0.0)];
    let end = [v(0.0, 0.0, -1.0), start[1], start[2], start[3]];
    assert_eq!(vertex_face_impact(&start, &end, 0.0).map(|impact| impact.time < 0.5), Some(true));
    // Tested as edges, (0, 0, ±1)–(1, 0, 0) passes (−1, ±1, 0) at a distance.
    assert_eq!(edge_edge_impact(&start, &end, 0.0), None);
}
