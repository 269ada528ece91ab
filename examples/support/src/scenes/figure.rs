//! A person made of capsules that walks in place, and a skirt to wear.
//!
//! The origin is midway between the hips of the standing figure. y points up, z forwards. Capsules overlap at the
//! joints, so the limbs of a figure must not be tested against each other.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use super::points::{Point, advance, between, ease, rotate, rotation_from_y, subtract, unit};
use super::revolution::{Circle, revolve};
use super::{Mesh, capsule};

/// The names of the limbs, in the order of [`walking_figure`].
pub const FIGURE_LIMBS: [&str; 11] = [
    "pelvis",
    "trunk",
    "head",
    "left_thigh",
    "right_thigh",
    "left_shin",
    "right_shin",
    "left_upper_arm",
    "right_upper_arm",
    "left_forearm",
    "right_forearm",
];

/// Height of the standing figure from its soles to its crown, in meters.
pub const FIGURE_HEIGHT: f64 = 1.7;

/// Duration of the transition from standing to walking, in seconds.
pub const FIGURE_EASE: f64 = 1.0;

/// Duration of a step, in seconds. The motion repeats after two steps.
pub const FIGURE_STEP: f64 = 1.0;

/// Height of the waist of [`skirt`] above the origin, in meters.
pub const SKIRT_WAIST: f64 = 0.06;

/// Height of the hem of [`skirt`], at the knees, in meters.
pub const SKIRT_HEM: f64 = -0.46;

/// Half the width of the skirt along x and z, at the waist and at the hem, in meters.
const SKIRT_WAIST_REACH: [f64; 2] = [0.205, 0.165];
const SKIRT_HEM_REACH: [f64; 2] = [0.29, 0.23];

/// Hip joint of the left leg relative to the center of the pelvis, in meters. The right one is its mirror image.
const HIP: Point = [0.09, -0.04, 0.0];

/// Shoulder joint of the left arm relative to the center of the pelvis, in meters.
const SHOULDER: Point = [0.22, 0.5, 0.0];

/// Lengths of the limbs between their joints, in meters.
const THIGH: f64 = 0.42;
const SHIN: f64 = 0.4;
const UPPER_ARM: f64 = 0.27;
const FOREARM: f64 = 0.24;

/// Amplitude of a thigh's swing, in radians.
const THIGH_SWING: f64 = 0.42;

/// Bend of a knee in the middle of its leg's forward motion, in radians.
const KNEE_BEND: f64 = 0.7;

/// Amplitude of an arm's swing, in radians.
const ARM_SWING: f64 = 0.3;

/// Constant bend of the elbows, in radians. It keeps the forearms above the skirt.
const ELBOW_BEND: f64 = 1.5;

/// Vertical drop of the pelvis in every step, and its sway towards the standing leg, in meters.
const BOB: f64 = 0.015;
const SWAY: f64 = 0.01;

/// A limb: the ends of its axis, their distance, its radius, and the number of vertices around it. Lengths are in
/// meters.
struct Limb {
    from: Point,
    to: Point,
    // Given rather than computed from the ends, so that it is bitwise equal at all times.
    length: f64,
    radius: f64,
    segments: usize,
}

/// Displacement of the pelvis from its place at 0 s, in meters, at most 2 cm. The waist of a [`skirt`] follows it.
///
/// The pelvis does not rotate.
pub fn pelvis_offset(time: f64) -> [f32; 3] {
    pelvis(time).map(|coordinate| coordinate as f32)
}

/// The figure `time` seconds after the start: one closed capsule per name in [`FIGURE_LIMBS`], wound outward.
///
/// It stands with bent elbows until 0 s, then begins to walk in place. A step takes [`FIGURE_STEP`], and strides have
/// their full size after [`FIGURE_EASE`]. The figure is 1.7 m high, from −0.905 m to 0.795 m, with its left side
/// towards +x. Each limb is rigid and has the same triangles at all times. The velocity is continuous. There are 3,152
/// triangles.
pub fn walking_figure(time: f64) -> Vec<Mesh> {
    limbs(time).iter().map(mesh).collect()
}

/// The rest shape of a skirt around [`walking_figure`] at 0 s: an open elliptic cone from the waist to the knees,
/// facing away from the body.
///
/// It has `rings` bands of triangles below each other, with `segments` segments around: 2 · rings · segments triangles,
/// which is 3,072 for 24 and 64. The vertices of ring k, from 0 at the waist to `rings` at the hem, start at index k ·
/// segments. The skirt keeps more than 2.5 cm from every limb at 0 s. The knees push it forwards while walking. No
/// vertex is pinned yet: the caller pins [`skirt_waist_vertices`] and moves them by [`pelvis_offset`].
///
/// # Panics
///
/// If there is no ring, or fewer than 3 segments.
pub fn skirt(rings: usize, segments: usize) -> Mesh {
    assert!(rings > 0 && segments >= 3, "a skirt needs at least 1 ring and 3 segments");
    let circles: Vec<Circle> = (0..=rings)
        .map(|ring| {
            let share = ring as f64 / rings as f64;
            Circle { height: SKIRT_WAIST + share * (SKIRT_HEM - SKIRT_WAIST), radius: 1.0, segments }
        })
        .collect();
    let mut mesh = revolve(&circles);
    for (vertex, position) in mesh.positions.iter_mut().enumerate() {
        let share = (vertex / segments) as f64 / rings as f64;
        for (axis, side) in [(0, 0), (2, 1)] {
            let reach = SKIRT_WAIST_REACH[side] + share * (SKIRT_HEM_REACH[side] - SKIRT_WAIST_REACH[side]);
            position[axis] = (f64::from(position[axis]) * reach) as f32;
        }
    }
    mesh
}

/// The vertices of a [`skirt`] with `segments` segments to pin to the waist.
pub const fn skirt_waist_vertices(segments: usize) -> Range<usize> {
    0..segments
}

/// Strength of the motion, from 0 (standing) to 1 (walking).
fn strength(time: f64) -> f64 {
    ease(0.0, FIGURE_EASE, time)
}

/// Phase of a side's stride. `side` is 1 for the left and −1 for the right side, which is half a stride behind.
fn phase(time: f64, side: f64) -> f64 {
    PI * (time / FIGURE_STEP + 0.5 * (1.0 - side))
}

fn pelvis(time: f64) -> Point {
    let strength = strength(time);
    let phase = phase(time, 1.0);
    // A leg stands while its thigh moves backwards. Spread legs reach less far down.
    [-SWAY * strength * libm::cos(phase), -0.5 * BOB * strength * (1.0 - libm::cos(2.0 * phase)), 0.0]
}

fn limbs(time: f64) -> Vec<Limb> {
    let middle = pelvis(time);
    let at = |offset: Point| advance(middle, 1.0, offset);
    let legs = [1.0, -1.0].map(|side| leg(time, side, middle));
    let arms = [1.0, -1.0].map(|side| arm(time, side, middle));
    let limb = |from, to, length, radius, segments| Limb { from, to, length, radius, segments };
    let mut limbs = vec![
        limb(at([-0.06, 0.0, 0.0]), at([0.06, 0.0, 0.0]), 0.12, 0.12, 16),
        limb(at([0.0, 0.12, 0.0]), at([0.0, 0.42, 0.0]), 0.3, 0.13, 16),
        limb(at([0.0, 0.645, 0.0]), at([0.0, 0.705, 0.0]), 0.06, 0.09, 12),
    ];
    limbs.extend(legs.map(|[hip, knee, _]| limb(knee, hip, THIGH, 0.07, 12)));
    limbs.extend(legs.map(|[_, knee, ankle]| limb(ankle, knee, SHIN, 0.045, 10)));
    limbs.extend(arms.map(|[shoulder, elbow, _]| limb(elbow, shoulder, UPPER_ARM, 0.04, 10)));
    limbs.extend(arms.map(|[_, elbow, hand]| limb(hand, elbow, FOREARM, 0.035, 10)));
    limbs
}

/// Hip, knee, and ankle of a side.
fn leg(time: f64, side: f64, middle: Point) -> [Point; 3] {
    let strength = strength(time);
    let phase = phase(time, side);
    let swing = THIGH_SWING * strength * libm::sin(phase);
    let forwards = 0.5 * (1.0 + libm::cos(phase));
    let bend = KNEE_BEND * strength * forwards * forwards;
    let hip = advance(middle, 1.0, [side * HIP[0], HIP[1], HIP[2]]);
    let knee = advance(hip, THIGH, hanging(swing));
    [hip, knee, advance(knee, SHIN, hanging(swing - bend))]
}

/// Shoulder, elbow, and hand of a side. Arms swing opposite to the legs.
fn arm(time: f64, side: f64, middle: Point) -> [Point; 3] {
    let swing = ARM_SWING * strength(time) * libm::sin(phase(time, -side));
    let shoulder = advance(middle, 1.0, [side * SHOULDER[0], SHOULDER[1], SHOULDER[2]]);
    let elbow = advance(shoulder, UPPER_ARM, hanging(swing));
    [shoulder, elbow, advance(elbow, FOREARM, hanging(swing + ELBOW_BEND))]
}

/// The direction of a hanging limb, lifted forwards by an angle in radians.
fn hanging(angle: f64) -> Point {
    [0.0, -libm::cos(angle), libm::sin(angle)]
}

/// The capsule of a limb, at the place of the limb.
fn mesh(limb: &Limb) -> Mesh {
    let half_length = 0.5 * limb.length;
    let edge = TAU * limb.radius / limb.segments as f64;
    let along = (limb.length / edge).round().max(1.0) as usize;
    let mut mesh = capsule(limb.radius as f32, half_length as f32, limb.segments, along, limb.segments / 4);
    let rotation = rotation_from_y(unit(subtract(limb.to, limb.from)));
    let middle = between(limb.from, limb.to, 0.5);
    for position in &mut mesh.positions {
        let turned = rotate(rotation, position.map(f64::from));
        *position = advance(middle, 1.0, turned).map(|coordinate| coordinate as f32);
    }
    mesh
}
