//! Degenerate triangles: needles, caps, and triangles without area.

use circumsphere_support::scenes::{Diagonals, Mesh, duplicate_vertices, grid, icosphere, merge, ragged_slivers};
use glam::{DVec3, Vec3};

use crate::harness::{Body, Case, Random, Stated, Tally, at, loose_triangles};

const THIN: f32 = 0.02;

fn sheet() -> Mesh {
    grid(6, 6, 2.0, 2.0, Diagonals::Alternating)
}

/// Slivers of length 1 at the origin. Their third corner is `along` the first edge and `width` away from it.
fn slivers(count: usize, along: f64, width: f64, random: &mut Random) -> Mesh {
    let triangles: Vec<[Vec3; 3]> = (0..count)
        .map(|_| {
            let (from, direction) = (random.vector() * 0.5, random.direction());
            let across = direction.cross(random.direction()).normalize();
            [from, from + direction, from + direction * along + across * width].map(DVec3::as_vec3)
        })
        .collect();
    loose_triangles(&triangles)
}

fn judge_slivers(along: f64) -> Tally {
    let mut tally = Tally::default();
    let mut random = Random::new(1);
    for width in [1.0e-2, 1.0e-3, 1.0e-4, 1.0e-5, 1.0e-6, 1.0e-7] {
        let bodies = [
            Body::new(&sheet(), THIN),
            Body::new(&slivers(60, along, width, &mut random), THIN).meeting_itself(),
            Body::new(&slivers(30, along, width, &mut random), THIN),
        ];
        tally += Case::new(bodies).judge(&format!("width {width:e}"));
    }
    tally
}

/// A needle's ball is as large as the needle is long and reaches far beyond its sides, which gives many false pairs.
/// Needles that cross at an angle have their sphere centers side by side, some of them outside a cone. Slabs along
/// their normals, which are inaccurate in single precision, let a few more false pairs through.
const NEEDLES: Stated =
    Stated { touching: 995, false_by_balls: 6089, missed_by_caps: 90, bodies_missed_by_caps: 0, false_by_caps: 1907 };

#[test]
fn needles_touch_what_they_reach() {
    // The corner is at the end of the first edge: one short edge and two long ones.
    judge_slivers(1.0).assert_as(NEEDLES);
}

/// As for needles: the ball of an obtuse sliver is that of its longest edge.
const CAPS: Stated = Stated {
    touching: 2005,
    false_by_balls: 12_098,
    missed_by_caps: 149,
    bodies_missed_by_caps: 0,
    false_by_caps: 3668,
};

#[test]
fn caps_touch_what_they_reach() {
    // The corner is over the inside of the first edge: an angle of nearly 180 degrees.
    let mut tally = judge_slivers(0.4);
    tally += judge_slivers(0.01);
    tally.assert_as(CAPS);
}

/// The sphere of a segment has no cone and is as thick as the segment is long. Coplanar segments of the ragged sheet
/// are missed like needles.
const ZERO_AREA: Stated =
    Stated { touching: 2136, false_by_balls: 4344, missed_by_caps: 38, bodies_missed_by_caps: 0, false_by_caps: 2517 };

#[test]
fn triangles_without_area_touch_as_the_segments_and_points_that_they_are() {
    let mut random = Random::new(2);
    // Multiples of 1/64 have exact midpoints.
    let exact = |vector: DVec3| (vector * 64.0).round() / 64.0;
    let collapsed: Vec<[Vec3; 3]> = (0..90)
        .map(|triangle| {
            let (from, to) = (exact(random.vector() * 0.5), exact(random.vector() * 0.5));
            let corners = match triangle % 3 {
                0 => [from, to, (from + to) * 0.5],
                1 => [from, from, to],
                _ => [from; 3],
            };
            corners.map(DVec3::as_vec3)
        })
        .collect();
    let collapsed = loose_triangles(&collapsed);
    let ragged = ragged_slivers(5);
    let mut tally = Tally::default();
    // The copy lies exactly on it: segment on segment, point on point.
    let body = Body::new(&collapsed, THIN);
    tally += Case::new([Body::new(&sheet(), THIN), body.clone().meeting_itself(), body]).judge("collapsed");
    let ball = Body::new(&icosphere(2, 0.3), THIN).at(at(0.1, 0.31, 0.0));
    tally += Case::new([Body::new(&ragged, THIN).meeting_itself(), ball]).judge("ragged");
    tally.assert_as(ZERO_AREA);
}

#[test]
fn duplicate_vertices_change_nothing() {
    let shared = merge(&[icosphere(2, 0.5), icosphere(1, 0.4).translate([0.6, 0.1, 0.0])]);
    let own = duplicate_vertices(&shared);
    let judge = |mesh: &Mesh| {
        let body = Body::new(mesh, THIN).at(at(0.1, 0.52, 0.2)).meeting_itself();
        Case::new([Body::new(&sheet(), THIN), body]).judge("duplicates")
    };
    let (shared, own) = (judge(&shared), judge(&own));
    own.assert_as(DUPLICATES);
    assert_eq!(
        (own.refined.touching, own.balls, own.caps),
        (shared.refined.touching, shared.balls, shared.caps),
        "the same triangles"
    );
}

/// Equals the result of the same ball with shared vertices, which the test also checks.
const DUPLICATES: Stated =
    Stated { touching: 155, false_by_balls: 358, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 65 };

/// Mostly segments on a ball of radius 0.5. Their spheres stick out by less than an edge.
const REPEATED: Stated =
    Stated { touching: 186, false_by_balls: 367, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 66 };

#[test]
fn a_repeated_index_makes_a_segment_or_a_point() {
    let mut ball = icosphere(2, 0.5);
    for (number, corners) in ball.triangles.iter_mut().enumerate() {
        match number % 5 {
            0 => corners[1] = corners[0],
            1 => corners[0] = corners[2],
            2 => *corners = [corners[0]; 3],
            _ => {}
        }
    }
    let body = Body::new(&ball, THIN).at(at(0.1, 0.51, 0.2)).meeting_itself();
    let beside = Body::new(&ball, THIN).at(at(0.9, 0.51, 0.2));
    Case::new([Body::new(&sheet(), THIN), body, beside]).judge("repeated").assert_as(REPEATED);
}
