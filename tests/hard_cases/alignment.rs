//! Exact alignment on, beside, around, or above each other: planes, edges, centers, corners, and layers.

use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, cuboid, grid, icosphere, sheet_stack};
use glam::{Quat, Vec3};

use crate::harness::{Body, Case, Stated, Tally, at, turned};

const THIN: f32 = 0.02;

/// In a common plane, nothing lies along a normal. Only triangles at the rims are found, where cones are widened most.
const COPLANAR: Stated =
    Stated { touching: 2836, false_by_balls: 848, missed_by_caps: 2325, bodies_missed_by_caps: 0, false_by_caps: 34 };

#[test]
fn coplanar_triangles_that_overlap_cross() {
    let sheet = Body::new(&grid(6, 6, 2.0, 2.0, Diagonals::Alternating), THIN);
    let others = [
        grid(6, 6, 2.0, 2.0, Diagonals::Alternating),
        grid(5, 7, 1.5, 1.7, Diagonals::Uniform),
        grid(4, 4, 2.0, 2.0, Diagonals::Uniform).translate([0.03, 0.0, 0.015]),
        // Beside it, rim to rim, and slightly apart.
        grid(6, 6, 2.0, 2.0, Diagonals::Uniform).translate([2.0, 0.0, 0.0]),
        grid(6, 6, 2.0, 2.0, Diagonals::Uniform).translate([2.03, 0.0, 0.1]),
    ];
    let mut tally = Tally::default();
    for other in &others {
        for turn in [Quat::IDENTITY, turned(Vec3::Y, 0.7)] {
            let other = Body::new(other, THIN).at(Transform::from_rotation(turn));
            tally += Case::new([sheet.clone(), other]).judge("coplanar");
        }
    }
    assert!(tally.crossing > 1000, "{} cross", tally.crossing);
    tally.assert_as(COPLANAR);
}

/// For two boxes edge to edge, cones reach around the edges because they are widened by the angle there.
const PARALLEL: Stated =
    Stated { touching: 440, false_by_balls: 224, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 88 };

#[test]
fn parallel_edges_touch_along_their_length() {
    let mut tally = Tally::default();
    for cells in [1, 3] {
        let block = Body::new(&cuboid([0.5; 3], cells), THIN);
        // Diagonally beside it, where only edges are near: aligned, shifted along the edge, and barely rotated.
        for (shift, turn) in [(0.0, 0.0), (0.17, 0.0), (1.0, 0.0), (0.17, 1.0e-3), (0.17, 1.0e-6)] {
            let place = at(1.02, 1.02, shift).with_rotation(turned(Vec3::new(1.0, -1.0, 0.0), turn));
            let other = block.clone().at(place);
            tally += Case::new([block.clone(), other]).judge(&format!("shift {shift}, turn {turn}"));
        }
    }
    tally.assert_as(PARALLEL);
}

/// Inside the surface of another sphere, caps face away from each other, or towards each other across the whole body.
/// Only the few pairs are found that face each other where balls of different resolution cross.
const CONCENTRIC: Stated = Stated {
    touching: 25_506,
    false_by_balls: 5190,
    missed_by_caps: 25_184,
    bodies_missed_by_caps: 7,
    false_by_caps: 0,
};

#[test]
fn concentric_spheres_touch_where_their_faces_are_near() {
    let mut tally = Tally::default();
    for radius in [0.5, 0.52, 0.47, 0.3] {
        for (level, turn) in [(2, Quat::IDENTITY), (2, turned(Vec3::new(1.0, 2.0, 0.5), 0.4)), (1, Quat::IDENTITY)] {
            let other = Body::new(&icosphere(level, radius), THIN).at(Transform::from_rotation(turn));
            tally += Case::new([Body::new(&icosphere(2, 0.5), THIN), other]).judge(&format!("radius {radius}"));
        }
    }
    tally.assert_as(CONCENTRIC);
}

/// A box with an edge along z, or a corner, pointing straight down.
fn balanced(on_corner: bool) -> (Quat, f32) {
    if on_corner {
        (Quat::from_rotation_arc(Vec3::splat(-1.0).normalize(), Vec3::NEG_Y), 0.75_f32.sqrt())
    } else {
        (turned(Vec3::Z, std::f64::consts::FRAC_PI_4), 0.5_f32.sqrt())
    }
}

fn judge_balanced(on_corner: bool) -> Tally {
    let mut tally = Tally::default();
    let floor = Body::new(&grid(6, 6, 3.0, 3.0, Diagonals::Uniform), THIN);
    let (upright, height) = balanced(on_corner);
    for cells in [1, 2, 4] {
        for gap in [0.03, 0.0, -0.02] {
            for yaw in [0.0, 0.3] {
                let place = at(0.1, height + gap, 0.2).with_rotation(turned(Vec3::Y, yaw) * upright);
                let block = Body::new(&cuboid([0.5; 3], cells), THIN).at(place);
                let what = format!("{cells} cells, gap {gap}, yaw {yaw}");
                let judged = Case::new([floor.clone(), block]).judge(&what);
                assert!(judged.caps.missed < judged.caps.touching, "{what}: Circumsphere finds nothing of the box");
                tally += judged;
            }
        }
    }
    tally
}

/// At the edge, some triangles of the box's faces have centers too far up. Others find each box.
const ON_EDGE: Stated =
    Stated { touching: 472, false_by_balls: 1074, missed_by_caps: 8, bodies_missed_by_caps: 0, false_by_caps: 283 };

#[test]
fn a_box_on_its_edge_touches_the_floor() {
    judge_balanced(false).assert_as(ON_EDGE);
}

/// None is missed: crease clamps leave no gap between the cones of a corner. Caps bulge beyond the triangles at the
/// corner.
const ON_CORNER: Stated =
    Stated { touching: 120, false_by_balls: 914, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 157 };

#[test]
fn a_box_on_its_corner_touches_the_floor() {
    judge_balanced(true).assert_as(ON_CORNER);
}

/// Face to face, none is missed. Caps bulge sideways over adjacent triangles.
const LAYERS: Stated =
    Stated { touching: 28_856, false_by_balls: 7992, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 936 };

#[test]
fn ten_layers_of_cloth_touch_their_next_layers() {
    let mut tally = Tally::default();
    // One surface of ten layers, closer than the contact distance, and so close that layers two apart touch, too.
    for gap in [0.03, 0.015] {
        tally += Case::new([Body::new(&sheet_stack(10, gap, 6), THIN).meeting_itself()]).judge("one surface");
    }
    // Ten surfaces, each rotated slightly against the previous one.
    let layer = |number: u8| {
        let place = at(0.0, 0.03 * f32::from(number), 0.0);
        let turn = turned(Vec3::Y, 0.1 * f64::from(number));
        Body::new(&grid(6, 6, 1.0, 1.0, Diagonals::Alternating), THIN).at(place.with_rotation(turn))
    };
    tally += Case::new((0..10).map(layer).collect::<Vec<_>>()).judge("ten surfaces");
    tally.assert_as(LAYERS);
}
