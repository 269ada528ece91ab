//! How the person walks.

use std::f64::consts::TAU;

use super::{
    super::points::{Point, advance, product, rotate, subtract},
    ARMS, HEAD, LEGS, PERSON_JOINTS, SPINE,
};

/// Duration of two steps, in seconds.
pub const PERSON_PERIOD: f64 = 1.1;

/// The speed at which the feet seem to stand still on the ground, in meters per second.
pub const PERSON_SPEED: f64 = 1.3;

/// The farthest that a thigh swings, in radians.
const SWING: f64 = 0.42;

/// Heel and ball of a foot, from the joint of the foot.
const SOLE: [Point; 2] = [[0.0, -0.09, -0.04], [0.0, -0.09, 0.14]];

/// Sharpness of the change from one foot to the other, in meters.
const SHIFT: f64 = 0.01;

/// A pose of the person.
#[derive(Clone, Debug)]
pub struct PersonPose {
    /// Where the hips are.
    pub hips: [f64; 3],
    /// The rotation of each joint relative to its parent: a unit quaternion in the order x, y, z, w.
    pub rotations: [[f64; 4]; PERSON_JOINTS.len()],
}

/// The pose at a share of [`PERSON_PERIOD`]: the same at 0 and at 1. One foot is always on the ground.
pub fn person_walk(share: f64) -> PersonPose {
    let mut rotations = [[0.0, 0.0, 0.0, 1.0]; PERSON_JOINTS.len()];
    let sway = libm::sin(TAU * share);
    rotations[0] = turned(1, 0.07 * sway);
    rotations[SPINE] = product(turned(0, 0.045), turned(1, -0.15 * sway));
    rotations[HEAD] = turned(1, 0.08 * sway);
    for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
        let (arm, leg) = (ARMS[side], LEGS[side]);
        // Positive forwards.
        let thigh = SWING * sign * sway + 0.05;
        let lift = (sign * libm::cos(TAU * (share - 0.03))).max(0.0);
        let knee = 0.14 + 0.8 * lift * lift;
        rotations[leg] = turned(0, -thigh);
        rotations[leg + 1] = turned(0, knee);
        rotations[leg + 2] = turned(0, 0.7 * (thigh - knee));
        let reach = -0.4 * sign * sway;
        rotations[arm] = turned(0, -reach);
        rotations[arm + 1] = turned(0, -0.3 - 0.2 * reach);
    }
    let mut pose = PersonPose { hips: PERSON_JOINTS[0].place, rotations };
    // A smooth minimum, so that the hips do not jerk when the other foot takes over.
    let lowest = soles(&pose).map(|at| libm::exp(-at[1] / SHIFT)).iter().sum::<f64>();
    pose.hips[1] += SHIFT * libm::log(lowest / 2.0);
    pose
}

/// Heels and balls of both feet.
fn soles(pose: &PersonPose) -> [Point; 4] {
    let mut places = [(pose.hips, pose.rotations[0]); PERSON_JOINTS.len()];
    for (number, joint) in PERSON_JOINTS.iter().enumerate() {
        let Some(parent) = joint.parent else { continue };
        let (place, rotation) = places[parent];
        let offset = subtract(joint.place, PERSON_JOINTS[parent].place);
        places[number] = (advance(place, 1.0, rotate(rotation, offset)), product(rotation, pose.rotations[number]));
    }
    std::array::from_fn(|sole| {
        let (place, rotation) = places[LEGS[sole / 2] + 2];
        advance(place, 1.0, rotate(rotation, SOLE[sole % 2]))
    })
}

/// The rotation about an axis by an angle, counter-clockwise as seen against the axis.
fn turned(axis: usize, angle: f64) -> [f64; 4] {
    let mut rotation = [0.0, 0.0, 0.0, libm::cos(0.5 * angle)];
    rotation[axis] = libm::sin(0.5 * angle);
    rotation
}
