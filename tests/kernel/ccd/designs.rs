//! Why steps are bounded by turning planes: comparison with the same search bounded by speeds.

use glam::DVec3;

use super::families::{KINDS, Kind, Motion};
use crate::common::Random;

/// The result of plain additive continuous detection at a separation of 0, and the number of steps.
struct Plain {
    time: Option<f64>,
    steps: u32,
}

/// Additive continuous detection as published: the mean motion is subtracted, each step is nine tenths of the distance
/// divided by the sum of both features' largest speeds, and an impact is reported once the distance is at most
/// `tolerance`.
fn plain(motion: &Motion, tolerance: f64) -> Plain {
    let first = motion.kind.first_count();
    let velocities: [DVec3; 4] = std::array::from_fn(|k| motion.end[k] - motion.start[k]);
    let mean = velocities.iter().sum::<DVec3>() * 0.25;
    let largest = |range: std::ops::Range<usize>| range.map(|k| (velocities[k] - mean).length()).fold(0.0, f64::max);
    let speed = largest(0..first) + largest(first..4);
    let (mut time, mut steps) = (0.0, 0);
    loop {
        let distance = motion.distance_at(time);
        if distance <= tolerance || steps == 100_000 {
            return Plain { time: Some(time), steps };
        }
        steps += 1;
        time += 0.9 * distance / speed;
        if time > 1.0 {
            return Plain { time: None, steps };
        }
    }
}

/// A motion in which the features meet, or pass with a clearance, in a turning and drifting frame.
fn passing(random: &mut Random, kind: Kind, clearance: f64) -> Motion {
    let mut point =
        |low: f64, high: f64| DVec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(low, high));
    let first = kind.first_count();
    // The first feature descends past the other one on its own side of a wall: x stays above the clearance, or at 0.
    let mut start: [DVec3; 4] = std::array::from_fn(|k| if k < first { point(0.2, 1.0) } else { point(-0.1, 0.1) });
    let mut end: [DVec3; 4] = std::array::from_fn(|k| if k < first { point(-1.0, -0.2) } else { point(-0.1, 0.1) });
    for points in [&mut start, &mut end] {
        points[0].x = clearance;
        if kind == Kind::EdgeEdge {
            points[1].x = clearance + points[1].x.abs();
        }
        points[first].x = 0.0;
        for point in &mut points[first + 1..] {
            point.x = -point.x.abs();
        }
        // The ends of the features at the wall pass close to each other.
        points[0].y *= 0.1;
        points[first].y = points[0].y;
    }
    Motion { kind, start, end }
}

#[test]
fn turning_planes_pass_near_misses_that_speeds_take_for_impacts_or_creep_up_to() {
    let mut random = Random::new(31);
    for clearance in [1.0e-4, 1.0e-7, 1.0e-10] {
        let count = 500;
        let (mut false_impacts, mut plain_steps) = ([0; 2], [0_u64; 2]);
        for _ in 0..count {
            for kind in KINDS {
                let motion = passing(&mut random, kind, clearance);
                assert_eq!(motion.impact(0.0), None, "{motion:?}");
                for (place, tolerance) in [1.0e-6, 1.0e-12].into_iter().enumerate() {
                    let Plain { time, steps } = plain(&motion, tolerance);
                    false_impacts[place] += u32::from(time.is_some());
                    plain_steps[place] += u64::from(steps);
                }
            }
        }
        let mean = plain_steps.map(|steps| steps as f64 / f64::from(2 * count));
        println!(
            "clearance {clearance:.0e}: speeds with a tolerance of 1e-6, 1e-12: {false_impacts:?} false of {}, {mean:.1?} steps",
            2 * count
        );
        if clearance < 1.0e-6 {
            assert!(false_impacts[0] > 100, "the tolerance should turn near misses into impacts");
        }
    }
}

#[test]
fn turning_planes_take_a_fifth_of_the_steps_to_an_impact() {
    let mut random = Random::new(32);
    let (mut steps, mut plain_steps, mut impacts) = (0_u64, 0_u64, 0);
    for _ in 0..2_000 {
        for kind in KINDS {
            // Through the other feature instead of past it.
            let mut motion = passing(&mut random, kind, 0.0);
            motion.start[0].x -= 0.5;
            motion.end[0].x -= 0.5;
            let Some(impact) = motion.impact(0.0) else { continue };
            let Plain { time, steps: more } = plain(&motion, 1.0e-12);
            let time = time.expect("both searches find the impact");
            assert!((time - impact.time).abs() < 1.0e-9, "{time} and {}: {motion:?}", impact.time);
            impacts += 1;
            steps += u64::from(impact.steps);
            plain_steps += u64::from(more);
        }
    }
    let [mean, plain_mean] = [steps, plain_steps].map(|steps| steps as f64 / f64::from(impacts));
    println!("{impacts} impacts: {mean:.1} steps by planes, {plain_mean:.1} by speeds");
    assert!(impacts > 500 && mean * 5.0 < plain_mean, "{impacts} {mean} {plain_mean}");
}
