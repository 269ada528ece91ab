//! What lies exactly on, beside, around or over another: planes, edges, centers, corners and layers.

use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, cuboid, grid, icosphere, sheet_stack};
use glam::{Quat, Vec3};

use crate::harness::{Body, Case, Stated, Tally, at, turned};

const THIN: f32 = 0.02;

/// Nothing in a common plane is in the direction of a normal: what is found are triangles at the rims, whose cones are
/// widened most.
const COPLANAR: Stated =
    Stated { touching: 2836, false_by_balls: 848, missed_by_caps: 2325, bodies_missed_by_caps: 0, false_by_caps: 34 };

#[test]
fn coplanar_triangles_that_overlap_cross() {
    let sheet = Body::new(&grid(6, 6, 2.0, 2.0, Diagonals::Alternating), THIN);
    let others = [
        grid(6, 6, 2.0, 2.0, Diagonals::Alternating),
        grid(5, 7, 1.5, 1.7, Diagonals::Uniform),
        grid(4, 4, 2.0, 2.0, Diagonals::Uniform).translate([0.03, 0.0, 0.015]),
        // Beside it, rim to rim, and a little apart.
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

/// Of two boxes edge to edge cones reach round the edges, because they are widened by the angle there.
const PARALLEL: Stated =
    Stated { touching: 440, false_by_balls: 224, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 88 };

#[test]
fn parallel_edges_touch_along_their_length() {
    let mut tally = Tally::default();
    for cells in [1, 3] {
        let block = Body::new(&cuboid([0.5; 3], cells), THIN);
        // Diagonally beside it: only edges are near. In line with it, shifted along, and hardly turned.
        for (shift, turn) in [(0.0, 0.0), (0.17, 0.0), (1.0, 0.0), (0.17, 1.0e-3), (0.17, 1.0e-6)] {
            let place = at(1.02, 1.02, shift).with_rotation(turned(Vec3::new(1.0, -1.0, 0.0), turn));
            let other = block.clone().at(place);
            tally += Case::new([block.clone(), other]).judge(&format!("shift {shift}, turn {turn}"));
        }
    }
    tally.assert_as(PARALLEL);
}

/// Inside another sphere's surface the caps face away from each other, or towards each other across the whole body:
/// what is found are the few that face each other where the balls of different fineness cross.
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

/// A box whose edge along z, or whose corner, points straight down.
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
                assert!(judged.caps.missed < judged.caps.touching, "{what}: Circumsphere does not see the box at all");
                tally += judged;
            }
        }
    }
    tally
}

/// Of the box's faces at the edge some triangles have their centers too far up; each box is seen by others.
const ON_EDGE: Stated =
    Stated { touching: 472, false_by_balls: 1074, missed_by_caps: 8, bodies_missed_by_caps: 0, false_by_caps: 283 };

#[test]
fn a_box_on_its_edge_touches_the_floor() {
    judge_balanced(false).assert_as(ON_EDGE);
}

/// None is missed: crease clamps leave no gap between the cones of a corner. Caps bulge beyond the corner's triangles.
const ON_CORNER: Stated =
    Stated { touching: 120, false_by_balls: 914, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 157 };

#[test]
fn a_box_on_its_corner_touches_the_floor() {
    judge_balanced(true).assert_as(ON_CORNER);
}

/// Face to face none is missed; caps bulge sideways over the triangles beside.
const LAYERS: Stated =
    Stated { touching: 28_856, false_by_balls: 7992, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 936 };

#[test]
fn ten_layers_of_cloth_touch_their_next_layers() {
    let mut tally = Tally::default();
    // One surface of ten layers: nearer than the contact distance, and so near that the next but one touches too.
    for gap in [0.03, 0.015] {
        tally += Case::new([Body::new(&sheet_stack(10, gap, 6), THIN).meeting_itself()]).judge("one surface");
    }
    // Ten surfaces, each turned a little against the last.
    let layer = |number: u8| {
        let place = at(0.0, 0.03 * f32::from(number), 0.0);
        let turn = turned(Vec3::Y, 0.1 * f64::from(number));
        Body::new(&grid(6, 6, 1.0, 1.0, Diagonals::Alternating), THIN).at(place.with_rotation(turn))
    };
    tally += Case::new((0..10).map(layer).collect::<Vec<_>>()).judge("ten surfaces");
    tally.assert_as(LAYERS);
}
