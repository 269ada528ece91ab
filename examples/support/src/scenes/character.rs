//! A character with one skin over two bones, torso and leg, that walks in a circle, and a skirt to hang from its waist.
//!
//! The skin is a closed surface of revolution, deformed by linear blend skinning. In the frame of the torso, the waist
//! is the origin, y points up, and z forwards. Every position is a function of time alone.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::Range;

use super::Mesh;
use super::points::{Point, advance, between, ease, product, rotate};
use super::revolution::{Circle, revolve};

/// The walking speeds that tests and examples play, in meters per second.
pub const CHARACTER_SPEEDS: [f64; 4] = [0.0, 1.2, 5.0, 10.0];

/// Duration of the transition from standing to full walking speed, in seconds.
pub const CHARACTER_EASE: f64 = 1.0;

/// Radius of the circle that it walks on, in meters.
pub const CHARACTER_CIRCLE: f64 = 6.0;

/// Top speed of the tip of its leg relative to the torso, in meters per second.
pub const CHARACTER_TIP_SPEED: f64 = 10.0;

/// Length of [`character_skirt`] below the waist, in meters.
pub const CHARACTER_SKIRT_LENGTH: f64 = 0.45;

/// Gap between the skin and the skirt at the waist, in meters.
pub const CHARACTER_WAIST_GAP: f64 = 0.015;

/// The hip joint. The leg swings about its x axis.
const HIP: Point = [0.0, -0.2, 0.0];

/// Height below which the leg begins to move a vertex, and height below which it alone moves it.
const BEND: [f64; 2] = [-0.08, -0.32];

/// The poles of the skin.
const TOP: f64 = 0.5;
const TIP: f64 = -0.95;

/// Radii of the skin at the torso, the waist, the hips, and the lower end of the leg.
const TORSO_RADIUS: f64 = 0.15;
const WAIST_RADIUS: f64 = 0.13;
const HIP_RADIUS: f64 = 0.145;
const LEG_RADIUS: f64 = 0.07;

/// Radius of the skirt at its hem.
const HEM_RADIUS: f64 = 0.3;

/// Resolution of the skin of [`Character`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CharacterFineness {
    /// 684 vertices.
    Coarse,
    /// 1,024 vertices.
    Fine,
    /// 5,000 vertices and 10,000 triangles.
    Finest,
}

/// A character that walks at a speed. It stands straight until 0 s, and has its full speed and stride after
/// [`CHARACTER_EASE`].
#[derive(Clone, Debug)]
pub struct Character {
    rest: Mesh,
    /// Skinning weight of the leg for each vertex. The rest belongs to the torso.
    leg_shares: Vec<f64>,
    speed: f64,
}

impl Character {
    /// A character that walks at `speed` meters per second, from 0 to 10.
    ///
    /// # Panics
    ///
    /// If the speed is out of range.
    pub fn new(fineness: CharacterFineness, speed: f64) -> Self {
        assert!((0.0..=10.0).contains(&speed), "the speed must be from 0 to 10 m/s");
        let (segments, bands) = match fineness {
            CharacterFineness::Coarse => (22, 26),
            CharacterFineness::Fine => (26, 33),
            CharacterFineness::Finest => (56, 77),
        };
        let rest = skin(segments, bands);
        let leg_shares = rest.positions.iter().map(|position| leg_share(position[1].into())).collect();
        Self { rest, leg_shares, speed }
    }

    /// The skin of the standing character. Its triangles, wound outward, are the same at all times.
    pub const fn rest(&self) -> &Mesh {
        &self.rest
    }

    /// The skinning weight of the leg for each vertex, from 0 to 1. The rest belongs to the torso.
    pub fn leg_shares(&self) -> &[f64] {
        &self.leg_shares
    }

    /// The full walking speed, in meters per second.
    pub const fn speed(&self) -> f64 {
        self.speed
    }

    /// World positions of the vertices of the skin, `time` seconds after the start.
    pub fn positions(&self, time: f64) -> Vec<[f32; 3]> {
        let motion = Motion::at(self.speed, time);
        let place = |(position, &share): (&[f32; 3], &f64)| {
            let point = position.map(f64::from);
            motion.to_world(between(point, motion.swung(point), share)).map(|coordinate| coordinate as f32)
        };
        self.rest.positions.iter().zip(&self.leg_shares).map(place).collect()
    }

    /// World positions of points that are fixed to the torso, given their positions at the start. The pinned vertices
    /// of [`character_skirt`] follow them exactly as the skin of the waist does.
    pub fn follow_torso(&self, time: f64, points: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let motion = Motion::at(self.speed, time);
        let place = |point: &[f32; 3]| motion.to_world(point.map(f64::from)).map(|coordinate| coordinate as f32);
        points.iter().map(place).collect()
    }

    /// Translation and rotation (a unit quaternion in the order x, y, z, w) of the torso's frame, whose origin is the
    /// waist.
    pub fn torso_pose(&self, time: f64) -> ([f32; 3], [f32; 4]) {
        let motion = Motion::at(self.speed, time);
        (motion.place.map(|coordinate| coordinate as f32), motion.turn.map(|part| part as f32))
    }

    /// Translation and rotation of the leg's frame, whose origin is the hip joint. The leg points along −y.
    pub fn leg_pose(&self, time: f64) -> ([f32; 3], [f32; 4]) {
        let motion = Motion::at(self.speed, time);
        let rotation = product(motion.turn, around([1.0, 0.0, 0.0], motion.swing));
        (motion.to_world(HIP).map(|coordinate| coordinate as f32), rotation.map(|part| part as f32))
    }
}

/// The torso of a rigid character as a capsule: its lower and upper center in the torso's frame, and its radius. It is
/// inside the skin of the standing character.
pub const CHARACTER_TORSO: ([f32; 3], [f32; 3], f32) = ([0.0, -0.1, 0.0], [0.0, 0.36, 0.0], 0.125);

/// The leg of a rigid character in the leg's frame, in the form of [`CHARACTER_TORSO`].
pub const CHARACTER_LEG: ([f32; 3], [f32; 3], f32) = ([0.0, -0.68, 0.0], [0.0, 0.0, 0.0], 0.065);

/// A skirt around a standing [`Character`]: an open cone that hangs from the waist, facing away from the body.
///
/// It has `rings` bands of triangles below each other, with `segments` segments around. The vertices of ring k, from 0
/// at the waist to `rings` at the hem, start at index k · segments. The skirt keeps [`CHARACTER_WAIST_GAP`] from the
/// skin at the waist, and more below it. No vertex is pinned yet: the caller pins [`character_waist_vertices`] and
/// moves them with [`Character::follow_torso`].
///
/// # Panics
///
/// If there is no ring, or fewer than 3 segments.
pub fn character_skirt(rings: usize, segments: usize) -> Mesh {
    assert!(rings > 0 && segments >= 3, "a skirt needs at least 1 ring and 3 segments");
    // The flat sides keep the gap, not only the vertices.
    let waist = (WAIST_RADIUS + CHARACTER_WAIST_GAP) / libm::cos(TAU / (2 * segments) as f64);
    let circles: Vec<Circle> = (0..=rings)
        .map(|ring| {
            let share = ring as f64 / rings as f64;
            Circle { height: -share * CHARACTER_SKIRT_LENGTH, radius: waist + share * (HEM_RADIUS - waist), segments }
        })
        .collect();
    revolve(&circles)
}

/// The vertices of a [`character_skirt`] with `segments` segments to pin to the waist.
pub const fn character_waist_vertices(segments: usize) -> Range<usize> {
    0..segments
}

/// The state of torso and leg at a time.
struct Motion {
    /// Position of the waist.
    place: Point,
    /// Rotation of the torso.
    turn: [f64; 4],
    /// Angle of the leg, positive forwards.
    swing: f64,
}

impl Motion {
    fn at(speed: f64, time: f64) -> Self {
        let time = time.max(0.0);
        let strength = ease(0.0, CHARACTER_EASE, time);
        let (amplitude, frequency) = stride(speed);
        let phase = TAU * frequency * time;
        let angle = speed * eased_time(time) / CHARACTER_CIRCLE;
        // A character without speed turns on the spot.
        let idle = (1.0 - speed).max(0.0);
        let heading = angle + strength * (0.2 * libm::sin(phase) + 0.8 * idle * libm::sin(2.0 * time));
        let bob = 0.015 * strength * libm::sin(2.0 * phase);
        let circle = CHARACTER_CIRCLE;
        // Forwards is z at the start, and turns towards x along the circle.
        let place = [circle * (1.0 - libm::cos(angle)), bob, circle * libm::sin(angle)];
        let turn = around([0.0, 1.0, 0.0], heading);
        Self { place, turn, swing: -strength * amplitude * libm::sin(phase) }
    }

    /// A point of the standing leg, rotated about the hip, in the torso's frame.
    fn swung(&self, point: Point) -> Point {
        advance(HIP, 1.0, rotate(around([1.0, 0.0, 0.0], self.swing), advance(point, -1.0, HIP)))
    }

    fn to_world(&self, point: Point) -> Point {
        advance(self.place, 1.0, rotate(self.turn, point))
    }
}

/// Amplitude of the leg's swing in radians, and its frequency in 1/s. The tip is faster at higher walking speeds.
fn stride(speed: f64) -> (f64, f64) {
    let amplitude = 0.3 + 0.04 * speed;
    let tip_speed = (1.5 + 0.85 * speed).min(CHARACTER_TIP_SPEED);
    (amplitude, tip_speed / (TAU * amplitude * (HIP[1] - TIP)))
}

/// The integral of [`ease`] since the start.
fn eased_time(time: f64) -> f64 {
    let share = (time / CHARACTER_EASE).min(1.0);
    let cube = share * share * share;
    let eased = cube * share * (2.5 + share * (share - 3.0));
    CHARACTER_EASE * eased + (time - CHARACTER_EASE).max(0.0)
}

/// Skinning weight of the leg at a height of the standing character.
fn leg_share(height: f64) -> f64 {
    ease(-BEND[0], -BEND[1], -height)
}

/// Radius of the skin at a height, without the caps.
fn profile(height: f64) -> f64 {
    let step = |from: f64, to: f64| ease(-from, -to, -height);
    let waist = TORSO_RADIUS + (WAIST_RADIUS - TORSO_RADIUS) * step(0.25, 0.02);
    let hips = (HIP_RADIUS - WAIST_RADIUS) * step(-0.02, -0.16);
    let leg = (HIP_RADIUS - LEG_RADIUS) * step(-0.2, -0.85);
    waist + hips - leg
}

/// Rings with `segments` vertices, fewer on the caps, and a pole at either end.
fn skin(segments: usize, bands: usize) -> Mesh {
    let cap_rings = segments / 5;
    let cap = |radius: f64, end: f64, sign: f64| -> Vec<Circle> {
        (1..cap_rings)
            .map(|ring| {
                let angle = FRAC_PI_2 * ring as f64 / cap_rings as f64;
                let around = (segments as f64 * libm::sin(angle)).round() as usize;
                Circle {
                    height: end - sign * radius * (1.0 - libm::cos(angle)),
                    radius: radius * libm::sin(angle),
                    segments: around.max(3),
                }
            })
            .collect()
    };
    let (upper, lower) = (TOP - TORSO_RADIUS, TIP + LEG_RADIUS);
    let mut circles = vec![Circle::point(TOP)];
    circles.extend(cap(TORSO_RADIUS, TOP, 1.0));
    circles.extend((0..=bands).map(|band| {
        let height = upper + (lower - upper) * band as f64 / bands as f64;
        Circle { height, radius: profile(height), segments }
    }));
    circles.extend(cap(LEG_RADIUS, TIP, -1.0).into_iter().rev());
    circles.push(Circle::point(TIP));
    revolve(&circles)
}

/// The rotation about a unit axis by an angle, counter-clockwise as seen against the axis.
fn around(axis: Point, angle: f64) -> [f64; 4] {
    let sine = libm::sin(0.5 * angle);
    [axis[0] * sine, axis[1] * sine, axis[2] * sine, libm::cos(0.5 * angle)]
}
