//! A pile of mixed soft bodies above a ribbed tray: the bodies and their initial places.
//!
//! Shape, size, and place of a body depend only on its index, so a smaller pile is a prefix of a larger one.

use std::f32::consts::PI;

use super::{Mesh, capsule, icosphere, lobed_ball, ribbed_tray, rounded_cuboid, torus};
use crate::random::Random;

/// Number of bodies that the pile is designed for. [`pile_start`] stacks any number of them.
pub const PILE_BODIES: usize = 100;

/// Largest distance of a point of a [`pile_body`] from its origin, in meters.
pub const PILE_BODY_REACH: f32 = LARGEST * 0.06;

/// Inner size of [`pile_tray`] along x, y, and z, in meters.
pub const PILE_TRAY_SIZE: [f32; 3] = [0.72, 0.3, 0.72];

/// Number of bodies in a row of a layer, along x and along z.
const ROW: usize = 4;

/// Distance of neighbors in a layer before jitter, in meters.
const SPACING: f32 = 0.17;

/// Distance of layers before jitter, in meters.
const LAYER_SPACING: f32 = 0.165;

/// Height of the lowest layer above the floor of the tray, in meters.
const LOWEST: f32 = 0.12;

/// Largest displacement of a body from its place in the grid along each axis, in meters. Twice the reach plus twice
/// this is less than the distance of neighbors.
const JITTER: f32 = 0.01;

/// Smallest and largest scale of a body relative to its shape in [`soft_shapes`].
const SMALLEST: f32 = 0.85;
const LARGEST: f32 = 1.15;

/// The five shapes of the pile: a ball, a rounded box, a torus, a capsule, and a lobed ball. They are closed, about 0.1
/// m long, have 184 to 320 triangles, and are centered at the origin.
///
/// No point is farther than 0.06 m from the origin.
pub fn soft_shapes() -> [Mesh; 5] {
    [
        icosphere(2, 0.05),
        rounded_cuboid([0.045, 0.036, 0.04], 0.016, 5),
        torus(0.042, 0.0175, 16, 8),
        capsule(0.03, 0.029, 12, 4, 3),
        lobed_ball(2, 0.047),
    ]
}

/// The body with that index, at the origin: one of [`soft_shapes`], scaled by 0.85 to 1.15 and rotated at random.
pub fn pile_body(index: usize) -> Mesh {
    let mut random = random(index, 0);
    let shapes = soft_shapes();
    let shape = random.below(shapes.len() as u64) as usize;
    let size = SMALLEST + (LARGEST - SMALLEST) * random.unit() as f32;
    let angle = PI * random.signed_unit();
    // The offset of 0.5 keeps the axis away from zero. It does not matter that directions are not uniform.
    let axis = [0.5 + random.unit() as f32, random.signed_unit(), random.signed_unit()];
    shapes[shape].clone().scale(size).rotate(axis, angle)
}

/// Initial place of the origin of the [`pile_body`] with that index, in meters, in the frame of [`pile_tray`].
///
/// A layer has sixteen bodies, jittered by 1 cm along each axis. All start between the walls or above them, the lowest
/// layer 12 cm above the floor. The bounding boxes of any two bodies are apart.
pub fn pile_start(index: usize) -> [f32; 3] {
    let mut random = random(index, 1);
    let middle = 0.5 * (ROW - 1) as f32;
    let grid = [
        ((index % ROW) as f32 - middle) * SPACING,
        LOWEST + (index / (ROW * ROW)) as f32 * LAYER_SPACING,
        ((index / ROW % ROW) as f32 - middle) * SPACING,
    ];
    grid.map(|coordinate| coordinate + JITTER * random.signed_unit())
}

/// The static tray below the pile: a [`ribbed_tray`] of [`PILE_TRAY_SIZE`] with four ribs.
pub fn pile_tray() -> Mesh {
    let [width, height, depth] = PILE_TRAY_SIZE;
    ribbed_tray(width, depth, height, 4)
}

/// The random numbers of a body for one purpose, independent of those of other bodies.
fn random(index: usize, purpose: u64) -> Random {
    Random::new(Random::new(2 * index as u64 + purpose).bits())
}
