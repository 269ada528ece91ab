//! A person with a skin over twelve joints, who walks on the spot, and a cape for the shoulders.
//!
//! The skin is a closed surface around a smooth union of limbs. The person stands at the origin, y points up, and z
//! forwards.

mod body;
mod cape;
mod nets;
mod walk;

use super::Mesh;
pub use walk::{PERSON_PERIOD, PERSON_SPEED, PersonPose, person_walk};

use super::points::Point;

/// A joint of the person.
#[derive(Clone, Copy, Debug)]
pub struct PersonJoint {
    /// Its name.
    pub name: &'static str,
    /// The number of its parent.
    pub parent: Option<usize>,
    /// Where it is while the person stands, in meters.
    pub place: [f64; 3],
}

const HIPS: usize = 0;
const SPINE: usize = 1;
const HEAD: usize = 2;
const ARMS: [usize; 2] = [3, 5];
const LEGS: [usize; 2] = [7, 10];

const fn joint(name: &'static str, parent: usize, place: Point) -> PersonJoint {
    PersonJoint { name, parent: Some(parent), place }
}

/// The joints, parents before their children. Without a rotation, the person stands.
pub const PERSON_JOINTS: [PersonJoint; 13] = [
    PersonJoint { name: "Hips", parent: None, place: [0.0, 0.95, 0.0] },
    joint("Spine", HIPS, [0.0, 1.06, 0.0]),
    joint("Head", SPINE, [0.0, 1.5, -0.005]),
    joint("Arm left", SPINE, [0.17, 1.385, -0.01]),
    joint("Forearm left", 3, [0.26, 1.125, -0.01]),
    joint("Arm right", SPINE, [-0.17, 1.385, -0.01]),
    joint("Forearm right", 5, [-0.26, 1.125, -0.01]),
    joint("Thigh left", HIPS, [0.09, 0.92, 0.0]),
    joint("Shin left", 7, [0.1, 0.5, 0.01]),
    joint("Foot left", 8, [0.105, 0.09, -0.01]),
    joint("Thigh right", HIPS, [-0.09, 0.92, 0.0]),
    joint("Shin right", 10, [-0.1, 0.5, 0.01]),
    joint("Foot right", 11, [-0.105, 0.09, -0.01]),
];

/// A standing person.
#[derive(Clone, Debug)]
pub struct Person {
    /// The skin.
    pub skin: Mesh,
    /// For each vertex of the skin, the numbers of up to four joints, and how much each of them moves the vertex.
    pub influences: Vec<([u8; 4], [f32; 4])>,
    /// For each vertex of the skin, its color as linear red, green, blue, and opacity.
    pub colors: Vec<[f32; 4]>,
    /// An open cape that hangs from the neck over the shoulders, outside the skin. The [`SPINE`](PERSON_JOINTS) moves it.
    pub cape: Mesh,
}

/// The person.
pub fn person() -> Person {
    let limbs = body::limbs();
    let skin = nets::surface(|at| body::distance(&limbs, at), [[-0.5, -0.06, -0.3], [0.5, 1.84, 0.3]], 0.021);
    let places: Vec<Point> = skin.positions.iter().map(|at| at.map(f64::from)).collect();
    Person {
        influences: places.iter().map(|&at| body::influences(&limbs, at)).collect(),
        colors: places.iter().map(|&at| body::color(&limbs, at)).collect(),
        cape: cape::cape(&limbs),
        skin,
    }
}
