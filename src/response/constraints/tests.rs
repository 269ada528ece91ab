//! Checks gradients against finite differences, and single constraints against closed forms.

use glam::DVec3;

use super::{Hinge, Spring, bend::value_and_gradients, enclosed_volume};
use crate::response::particles::Particles;

/// A hinge folded by some angle about the z axis.
fn folded(angle: f64) -> [DVec3; 4] {
    [
        DVec3::new(0.0, 0.0, -0.4),
        DVec3::new(0.0, 0.0, 0.7),
        DVec3::new(-0.8, 0.0, 0.1),
        DVec3::new(0.6 * angle.cos(), -0.6 * angle.sin(), 0.2),
    ]
}

#[test]
fn a_hinge_tells_twice_the_sine_of_half_its_angle() {
    for step in -31..=31 {
        let angle = f64::from(step) * 0.1;
        let bend = Hinge::bend_at(&folded(angle));
        assert!((bend.abs() - 2.0 * (0.5 * angle).sin().abs()).abs() < 1e-12, "{angle}: {bend}");
        assert_eq!(
            bend > 0.0,
            Hinge::bend_at(&folded(1.0)) > 0.0 && angle > 0.0 || angle < 0.0 && Hinge::bend_at(&folded(-1.0)) > 0.0
        );
    }
}

#[test]
fn gradients_of_a_hinge_are_those_of_its_value() {
    let nudge = 1e-6;
    for angle in [-2.8, -1.5, -0.3, 0.05, 0.9, 2.0, 3.0] {
        let points = folded(angle);
        let (_, gradients) = value_and_gradients(&points).unwrap();
        for corner in 0..4 {
            for axis in 0..3 {
                let at = |by: f64| {
                    let mut points = points;
                    points[corner][axis] += by;
                    Hinge::bend_at(&points)
                };
                let slope = (at(nudge) - at(-nudge)) / (2.0 * nudge);
                // The error is the square of the nudge, plus rounding divided by the nudge.
                assert!(
                    (slope - gradients[corner][axis]).abs() < 1e-7,
                    "{angle} {corner} {axis}: {slope} {gradients:?}"
                );
            }
        }
    }
}

#[test]
fn a_box_encloses_the_product_of_its_sides() {
    let corner = |k: usize| DVec3::new((k & 1) as f64 * 2.0, (k >> 1 & 1) as f64 * 3.0, (k >> 2) as f64 * 5.0);
    let corners: Vec<DVec3> = (0..8).map(|k| corner(k) + 7.0).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    assert!((enclosed_volume(&corners, 0, &triangles) - 30.0).abs() < 1e-12);
}

#[test]
fn a_spring_makes_up_for_its_step_at_once_and_for_what_was_before_at_a_pace() {
    let (step, length) = (1.0 / 1200.0, 0.1);
    let after = |before: f64, added: f64| {
        let mut particles = Particles::default();
        particles.push_moved(DVec3::ZERO, DVec3::ZERO, 1.0);
        particles.push_moved(DVec3::X * before, DVec3::X * (added / step), 3.0);
        particles.predict(step, DVec3::ZERO, 1.0);
        let spring = Spring { ends: [0, 1], length };
        spring.solve(&mut particles, 0, 0.0, step, &mut 0.0);
        particles.position[0].distance(particles.position[1])
    };
    // 100 rest lengths per second.
    let pace = 100.0 * step * length;
    let cases = [
        // Length before the substep, change in the substep, length after the solve.
        (0.1, 0.05, 0.1),
        (0.1, -0.05, 0.1),
        (0.105, 0.0, 0.1),
        (0.4, 0.0, 0.4 - pace),
        (0.4, 0.2, 0.4 - pace),
        (0.02, 0.0, 0.02 + pace),
        (0.4, -0.35, 0.1),
        (0.4, -0.1, 0.3),
    ];
    for (before, added, expected) in cases {
        let left = after(before, added);
        assert!((left - expected).abs() < 1e-12, "{before} {added}: {left} instead of {expected}");
    }
}
