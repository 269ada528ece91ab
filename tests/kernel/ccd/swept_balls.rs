//! First contacts of moving balls.

use bevy_circumsphere::kernel::{
    ccd::{MovingBall, first_impact_of_balls, swept_ball_pairs},
    circumsphere::{Ball, enclosing_ball},
    reference::triangle_distance,
};
use glam::{DVec3, Vec3};

use crate::common::Random;

/// The kernel makes radii longer by 1e-12 of all lengths and times shorter by as much; the rest is rounding.
const EARLINESS: f64 = 1.0e-9;

fn ball(random: &mut Random, spread: f64, radius: f64) -> Ball {
    Ball { center: (random.vector() * spread).as_vec3(), radius: (random.unit() * radius) as f32 }
}

fn moving(random: &mut Random, spread: f64, radius: f64) -> MovingBall {
    MovingBall { start: ball(random, spread, radius), end: ball(random, spread, radius) }
}

fn gap(a: &MovingBall, b: &MovingBall, time: f64) -> f64 {
    let at = |ball: &MovingBall| {
        let (start, end) = (ball.start.center.as_dvec3(), ball.end.center.as_dvec3());
        let radii = [ball.start.radius, ball.end.radius].map(f64::from);
        (start * (1.0 - time) + end * time, radii[0] * (1.0 - time) + radii[1] * time)
    };
    let ((center_a, radius_a), (center_b, radius_b)) = (at(a), at(b));
    center_a.distance(center_b) - radius_a - radius_b
}

#[test]
fn balls_touch_first_where_their_gap_closes() {
    let mut random = Random::new(11);
    let (mut impacts, mut none) = (0, 0);
    for _ in 0..50_000 {
        let radius = random.power_of_ten(-4.0, 0.0);
        let (a, b) = (moving(&mut random, 2.0, radius), moving(&mut random, 2.0, radius));
        let separation = if random.below(2) == 0 { 0.0 } else { random.unit() * 0.1 };
        let time = first_impact_of_balls(&a, &b, separation);
        // A gap between straight motions is convex only where radii shrink or stay; sampling needs no such thing.
        for sample in 0..=100 {
            let sampled = f64::from(sample) / 100.0;
            if gap(&a, &b, sampled) <= separation {
                let time = time.unwrap_or_else(|| panic!("missed: {a:?} {b:?}"));
                assert!(time <= sampled, "{time} is later than {sampled}");
                break;
            }
        }
        match time {
            Some(time) => {
                impacts += 1;
                assert!(gap(&a, &b, time) <= separation + EARLINESS, "{} at {time}: {a:?} {b:?}", gap(&a, &b, time));
            }
            None => none += 1,
        }
    }
    assert!(impacts > 500 && none > 1_000, "{impacts} {none}");
}

#[test]
fn small_balls_that_meet_after_a_long_way_are_found() {
    // Powers of two, so that the meeting is exact: radii of a millionth of the way.
    let radius = 2.0_f32.powi(-21);
    let at = |x: f32, y: f32| Ball { center: Vec3::new(x, y, 0.0), radius };
    let still = MovingBall { start: at(0.5, 0.0), end: at(0.5, 0.0) };
    for (offset, meets) in [(0.0, true), (2.0, true), (2.25, false)] {
        let passing = MovingBall { start: at(0.0, offset * radius), end: at(1.0, offset * radius) };
        assert_eq!(first_impact_of_balls(&passing, &still, 0.0).is_some(), meets, "{offset}");
    }
    // A separation is a longer radius.
    let passing = MovingBall { start: at(0.0, 4.0 * radius), end: at(1.0, 4.0 * radius) };
    assert!(first_impact_of_balls(&passing, &still, f64::from(2.0 * radius)).is_some());
}

#[test]
fn balls_that_overlap_touch_at_once_and_those_that_part_never() {
    let at = |x: f32, radius: f32| Ball { center: Vec3::new(x, 0.0, 0.0), radius };
    let cases = [
        ("overlapping and parting", [at(0.0, 1.0), at(-5.0, 1.0)], [at(1.5, 1.0), at(9.0, 1.0)], Some(0.0)),
        ("at rest, touching", [at(0.0, 1.0), at(0.0, 1.0)], [at(2.0, 1.0), at(2.0, 1.0)], Some(0.0)),
        ("at rest, apart", [at(0.0, 1.0), at(0.0, 1.0)], [at(2.5, 1.0), at(2.5, 1.0)], None),
        ("parting", [at(0.0, 1.0), at(-1.0, 1.0)], [at(2.5, 1.0), at(3.5, 1.0)], None),
        ("growing at rest", [at(0.0, 1.0), at(0.0, 2.0)], [at(4.0, 1.0), at(4.0, 3.0)], Some(2.0 / 3.0)),
        ("growing faster than they part", [at(0.0, 1.0), at(0.0, 4.0)], [at(4.0, 1.0), at(5.0, 1.0)], Some(1.0)),
        ("shrinking as fast as they come", [at(0.0, 1.0), at(0.0, 0.0)], [at(2.5, 1.0), at(1.5, 1.0)], None),
        ("coming too slowly", [at(0.0, 1.0), at(0.0, 1.0)], [at(4.0, 1.0), at(3.0, 1.0)], None),
    ];
    for (what, [start, end], [other_start, other_end], expected) in cases {
        let (a, b) = (MovingBall { start, end }, MovingBall { start: other_start, end: other_end });
        for time in [first_impact_of_balls(&a, &b, 0.0), first_impact_of_balls(&b, &a, 0.0)] {
            match (time, expected) {
                (Some(time), Some(expected)) => {
                    assert!(time <= expected && time > expected - EARLINESS, "{what}: {time}");
                }
                (time, expected) => assert_eq!(time, expected, "{what}"),
            }
        }
    }
}

#[test]
fn no_pair_of_triangles_that_comes_close_is_dropped() {
    let mut random = Random::new(12);
    let triangle = |random: &mut Random| {
        let center = random.vector() * 2.0;
        [0; 3].map(|_| (center + random.vector() * 0.3).as_vec3())
    };
    let count = 200;
    let mut motions = || -> [Vec<[Vec3; 3]>; 2] { [0; 2].map(|_| (0..count).map(|_| triangle(&mut random)).collect()) };
    let (a, b) = (motions(), motions());
    let balls = |triangles: &[[Vec3; 3]]| triangles.iter().map(|&corners| enclosing_ball(corners)).collect::<Vec<_>>();
    let (balls_a, balls_b) = ([balls(&a[0]), balls(&a[1])], [balls(&b[0]), balls(&b[1])]);
    let pairs: Vec<[u32; 2]> = (0..count).flat_map(|first| (0..count).map(move |second| [first, second])).collect();
    let mut found = Vec::new();
    let separation = 0.01;
    let both = |balls: &'_ [Vec<Ball>; 2]| [balls[0].clone(), balls[1].clone()];
    let (balls_a, balls_b) = (both(&balls_a), both(&balls_b));
    swept_ball_pairs([&balls_a[0], &balls_a[1]], [&balls_b[0], &balls_b[1]], &pairs, separation, &mut found);
    let mut kept = found.iter().peekable();
    let mut close = 0;
    for pair in &pairs {
        let time = kept.next_if(|(kept, _)| kept == pair).map(|&(_, time)| time);
        let corners = |motion: &[Vec<[Vec3; 3]>; 2], triangle: u32, time: f64| -> [DVec3; 3] {
            let [start, end] = [&motion[0][triangle as usize], &motion[1][triangle as usize]];
            std::array::from_fn(|k| start[k].as_dvec3() * (1.0 - time) + end[k].as_dvec3() * time)
        };
        let nearest = (0..=8)
            .map(|sample| f64::from(sample) / 8.0)
            .find(|&time| triangle_distance(&corners(&a, pair[0], time), &corners(&b, pair[1], time)) <= separation);
        if let Some(nearest) = nearest {
            close += 1;
            assert!(time.is_some_and(|time| time <= nearest), "{pair:?}: {time:?} and {nearest}");
        }
    }
    assert!(kept.next().is_none(), "in the order of the pairs");
    assert!(close > 100 && found.len() < pairs.len() / 2, "{close} close, {} kept", found.len());
}
