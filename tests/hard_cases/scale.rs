//! Sizes and places that strain single precision.

use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid, icosphere, torus};
use glam::Vec3;

use crate::harness::{Body, Case, Stated, Tally, at, turned};

const THIN: f32 = 0.02;

/// To the small body, a large triangle's sphere is a plane, and the body's side faces are turned away from it. Balls of
/// the large triangles contain everything near them.
const THOUSAND_TO_ONE: Stated =
    Stated { touching: 340, false_by_balls: 2862, missed_by_caps: 6, bodies_missed_by_caps: 0, false_by_caps: 262 };

#[test]
fn bodies_a_thousand_times_each_others_size_touch() {
    let mut tally = Tally::default();
    let floor = Body::new(&grid(2, 2, 1000.0, 1000.0, Diagonals::Uniform), THIN);
    let planet = Body::new(&icosphere(2, 500.0), THIN);
    // A vertex of the planet is at its top.
    for place in [at(0.1, 0.51, 0.2), at(123.4, 0.5, -321.0), at(0.0, -0.2, 0.0)] {
        let place = place.with_rotation(turned(Vec3::new(1.0, 0.3, 0.0), 0.4));
        for small in [icosphere(2, 0.5), cuboid([0.4, 0.5, 0.3], 2)] {
            let body = Body::new(&small, THIN).at(place);
            tally += Case::new([floor.clone(), body.clone()]).judge("floor");
            let over_planet = at(0.0, 500.0, 0.0) * place;
            tally += Case::new([planet.clone(), body.at(over_planet)]).judge("planet");
        }
    }
    tally.assert_as(THOUSAND_TO_ONE);
}

/// Two linked rings, and a ball on one of them.
fn rings() -> [(Mesh, Transform); 3] {
    let ring = torus(0.5, 0.15, 24, 12);
    [
        (ring.clone(), at(0.0, 0.0, 0.0).with_rotation(turned(Vec3::X, 0.3))),
        (ring, at(0.55, 0.05, 0.0).with_rotation(turned(Vec3::new(1.0, 0.2, 0.1), 1.4))),
        (icosphere(2, 0.2), at(-0.3, 0.33, 0.0).with_rotation(turned(Vec3::Z, 1.0))),
    ]
}

const FAR: [f32; 3] = [1.0e4, 1.0e5, 1.0e6];

/// About the same counts as for the rings at the origin, apart from the rounding of their translations.
const FAR_POSES: Stated =
    Stated { touching: 2433, false_by_balls: 12_909, missed_by_caps: 2, bodies_missed_by_caps: 0, false_by_caps: 1004 };

#[test]
fn poses_a_million_sizes_from_the_origin_cost_no_precision() {
    let mut tally = Tally::default();
    for far in FAR {
        for direction in [Vec3::X, Vec3::new(-1.0, 1.0, -1.0), Vec3::new(0.3, -0.7, 0.1)] {
            let far_away = Transform::from_translation(direction * far);
            let turned_away = far_away.with_rotation(turned(Vec3::new(0.2, 1.0, 0.5), 2.0));
            // Placed individually: f32 rounds translations there, and the reference uses the same rounded translations.
            let own = rings().map(|(mesh, place)| {
                let translation = far_away.translation + place.translation;
                Body::new(&mesh, THIN).at(Transform { translation, ..place })
            });
            tally += Case::new(own).judge(&format!("{far:e} along {direction}"));
            // Under a parent that is far away and rotated.
            let children = rings().map(|(mesh, place)| Body::new(&mesh, THIN).at(place).under(turned_away));
            tally += Case::new(children).judge(&format!("{far:e} along {direction}, children"));
        }
    }
    tally.assert_as(FAR_POSES);
}

/// At 1e6, the ball's vertices are rounded to sixteenths. Many triangles are crumpled or without area.
const FAR_POSITIONS: Stated =
    Stated { touching: 400, false_by_balls: 4944, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 1718 };

/// The vertices themselves are far away in both surfaces. Their rounded f32 values count as exact.
#[test]
fn positions_far_from_the_origin_are_taken_as_they_are_stored() {
    let mut tally = Tally::default();
    for far in FAR {
        let sheet = grid(8, 8, 4.0, 4.0, Diagonals::Uniform).translate([far, -far, far]);
        let ball = icosphere(2, 0.5).translate([far, 0.5 - far, far]);
        let case = Case::new([Body::new(&sheet, 0.05), Body::new(&ball, 0.05).meeting_itself()]);
        tally += case.judge(&format!("{far:e}"));
    }
    tally.assert_as(FAR_POSITIONS);
}

/// Balls on a sheet at three distances. Spheres are rounded in the frame of the pair, by up to 1e-3 at the farthest.
const FAR_FROM_OWN_ORIGIN: Stated =
    Stated { touching: 2091, false_by_balls: 4047, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 711 };

/// A mesh placed by its positions against one placed by its pose. One of them is transformed into the other's frame,
/// where f32 is coarse.
#[test]
fn positions_far_from_their_own_origin_cost_no_precision() {
    let judge = |far: f32| {
        let sheet = grid(16, 16, 4.0, 4.0, Diagonals::Uniform).translate([far, 0.0, -far]);
        // The sheet has more triangles and provides the frame first; then the ball does.
        let mut tally = Tally::default();
        for (level, height) in [(1, 0.5), (1, 0.53), (1, 0.55), (1, 0.58), (3, 0.53)] {
            let place = at(0.1, height, 0.2).with_rotation(turned(Vec3::Z, f64::from(height)));
            let ball = Body::new(&icosphere(level, 0.5), 0.05).at(place);
            let sheet = Body::new(&sheet, 0.05).at(at(-far, 0.0, far));
            tally += Case::new([sheet, ball]).judge(&format!("{far:e}"));
        }
        tally
    };
    let mut tally = Tally::default();
    for far in [1.0e2, 1.0e3, 1.0e4] {
        tally += judge(far);
    }
    tally.assert_as(FAR_FROM_OWN_ORIGIN);
    // Spheres are stored in f32. Where their rounding exceeds the contact distance, only the exact methods hold.
    for far in [1.0e5, 1.0e6] {
        assert!(judge(far).refined.touching > 50);
    }
}

/// Twice the counts of the rings at any size. Rings that cross at right angles touch at their sides.
const LENGTHS: Stated =
    Stated { touching: 226, false_by_balls: 1442, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 95 };

#[test]
fn lengths_from_a_millionth_to_a_million_touch_alike() {
    let judge = |scale: f32| {
        let bodies = rings().map(|(mesh, place)| {
            let place = place.with_translation(place.translation * scale);
            Body::new(&mesh.scale(scale), THIN * scale).at(place)
        });
        Case::new(bodies).judge(&format!("scale {scale:e}"))
    };
    let unit = judge(1.0);
    let mut tally = Tally::default();
    for scale in [1.0e-6, 1.0e6] {
        let scaled = judge(scale);
        let difference = scaled.refined.touching.abs_diff(unit.refined.touching);
        assert!(difference <= 2, "{difference} pairs within rounding of the threshold");
        tally += scaled;
    }
    tally.assert_as(LENGTHS);
}

/// Ten times the counts of the rings at any size. Where squares of lengths do not fit, curvature is 0 and spheres are
/// larger.
const EXTREMES: Stated =
    Stated { touching: 1130, false_by_balls: 7210, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 448 };

/// Squares of such lengths leave the range of f32. Curvature and sphere overlap still use them: caps are coarser at the
/// extremes, but always finite.
#[test]
fn lengths_at_the_ends_of_single_precision_touch_alike() {
    let mut tally = Tally::default();
    for scale in [1.0e-36, 1.0e-30, 1.0e-24, 1.0e-18, 1.0e-12, 1.0e12, 1.0e18, 1.0e20, 1.0e30, 1.0e37] {
        let bodies = rings().map(|(mesh, place)| {
            let place = place.with_translation(place.translation * scale);
            Body::new(&mesh.scale(scale), THIN * scale).at(place)
        });
        tally += Case::new(bodies).judge(&format!("scale {scale:e}"));
    }
    tally.assert_as(EXTREMES);
}
