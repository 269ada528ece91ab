//! A person of capsules who walks in place, and a skirt to wear.
//!
//! The origin is the middle between the hips of the standing figure, y points up and z forwards. A joint is where two
//! capsules overlap, so limbs of one figure are not to be tested against each other.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use super::points::{Point, advance, between, ease, rotate, rotation_from_y, subtract, unit};
use super::revolution::{Circle, revolve};
use super::{Mesh, capsule};

/// The limbs of [`walking_figure`], in its order.
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

/// How high the standing figure is from its soles to its crown, in metres.
pub const FIGURE_HEIGHT: f64 = 1.7;

/// How long the figure takes from standing to walking, in seconds.
pub const FIGURE_EASE: f64 = 1.0;

/// How long a step takes, in seconds; the motion repeats after two.
pub const FIGURE_STEP: f64 = 1.0;

/// How high the waist of [`skirt`] lies above the origin, in metres.
pub const SKIRT_WAIST: f64 = 0.06;

/// How high the hem of [`skirt`] lies: at the knees.
pub const SKIRT_HEM: f64 = -0.46;

/// Half the width of the skirt along x and z at the waist and at the hem, in metres.
const SKIRT_WAIST_REACH: [f64; 2] = [0.205, 0.165];
const SKIRT_HEM_REACH: [f64; 2] = [0.29, 0.23];

/// The hip joint of the left leg, from the middle of the pelvis; the right one mirrors it.
const HIP: Point = [0.09, -0.04, 0.0];

/// The shoulder joint of the left arm, from the middle of the pelvis.
const SHOULDER: Point = [0.22, 0.5, 0.0];

/// The lengths of the limbs between their joints.
const THIGH: f64 = 0.42;
const SHIN: f64 = 0.4;
const UPPER_ARM: f64 = 0.27;
const FOREARM: f64 = 0.24;

/// How far the hips swing a thigh forwards and backwards, in radians.
const THIGH_SWING: f64 = 0.42;

/// How far a knee bends in the middle of its leg's way forwards, in radians.
const KNEE_BEND: f64 = 0.7;

/// How far the shoulders swing an arm forwards and backwards, in radians.
const ARM_SWING: f64 = 0.3;

/// How far the elbows are always bent, in radians: forearms stay above the skirt.
const ELBOW_BEND: f64 = 1.5;

/// How far the pelvis sinks with every step, and how far it sways towards the standing leg, in metres.
const BOB: f64 = 0.015;
const SWAY: f64 = 0.01;

/// The two ends of a limb's axis, their distance and its radius, in metres, with the vertices around it.
struct Limb {
    from: Point,
    to: Point,
    // Stated rather than computed from the ends, so that the last bit is the same at every time.
    length: f64,
    radius: f64,
    segments: usize,
}

/// How far the pelvis is from where it stands at 0 s, in metres, at most 2 cm: what the waist of a [`skirt`] follows.
///
/// The pelvis does not turn.
pub fn pelvis_offset(time: f64) -> [f32; 3] {
    pelvis(time).map(|coordinate| coordinate as f32)
}

/// The figure `time` seconds after the start, as one closed capsule for each of [`FIGURE_LIMBS`], wound outward.
///
/// It stands until 0 s, with bent elbows, then begins to walk in place: a step takes [`FIGURE_STEP`], and the strides have
/// their full size after [`FIGURE_EASE`]. It is 1.7 m high, from −0.905 m to 0.795 m, with its left side towards +x. The
/// triangles of a limb are the same at every time and its shape is rigid; the velocity is continuous. There are 3,152
/// triangles.
pub fn walking_figure(time: f64) -> Vec<Mesh> {
    limbs(time).iter().map(mesh).collect()
}

/// A skirt at rest around [`walking_figure`] at 0 s: an open elliptic cone from the waist to the knees, facing away from
/// the body.
///
/// `rings` bands of triangles hang below each other, `segments` around: 2 · rings · segments triangles, 3,072 for 24 and
/// 64. The ring of vertices with number k, from 0 at the waist to `rings` at the hem, is k · segments onwards. It keeps
/// more than 2.5 cm from every limb at 0 s; walking knees push it forwards. Nothing is pinned yet: [`skirt_waist_vertices`] are to follow [`pelvis_offset`].
///
/// # Panics
///
/// Panics if there is no ring or fewer than 3 segments.
pub fn skirt(rings: usize, segments: usize) -> Mesh {
    assert!(rings > 0 && segments >= 3, "a skirt needs a ring and 3 segments around");
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

/// The vertices of a [`skirt`] with so many segments that are to be pinned to the waist.
pub const fn skirt_waist_vertices(segments: usize) -> Range<usize> {
    0..segments
}

/// How far the motion has grown from standing to walking.
fn strength(time: f64) -> f64 {
    ease(0.0, FIGURE_EASE, time)
}

/// The phase of a side's stride: `side` is 1 for the left and −1 for the right, which is half a stride behind.
fn phase(time: f64, side: f64) -> f64 {
    PI * (time / FIGURE_STEP + 0.5 * (1.0 - side))
}

fn pelvis(time: f64) -> Point {
    let strength = strength(time);
    let phase = phase(time, 1.0);
    // A leg stands while its thigh goes backwards; legs spread in front and behind reach less far down.
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

/// Hip, knee and ankle of a side.
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

/// Shoulder, elbow and hand of a side; arms swing against the legs.
fn arm(time: f64, side: f64, middle: Point) -> [Point; 3] {
    let swing = ARM_SWING * strength(time) * libm::sin(phase(time, -side));
    let shoulder = advance(middle, 1.0, [side * SHOULDER[0], SHOULDER[1], SHOULDER[2]]);
    let elbow = advance(shoulder, UPPER_ARM, hanging(swing));
    [shoulder, elbow, advance(elbow, FOREARM, hanging(swing + ELBOW_BEND))]
}

/// The direction of what hangs down, lifted forwards by an angle in radians.
fn hanging(angle: f64) -> Point {
    [0.0, -libm::cos(angle), libm::sin(angle)]
}

/// The capsule of a limb where the limb is.
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
