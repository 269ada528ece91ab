//! A pile of mixed soft bodies above a ribbed tray: which bodies they are, and where they start.
//!
//! Shape, size and place of a body depend on its number alone, so that a smaller pile is the beginning of a larger one.

use std::f32::consts::PI;

use super::{Mesh, capsule, icosphere, lobed_ball, ribbed_tray, rounded_cuboid, torus};
use crate::random::Random;

/// How many bodies the pile is made for; [`pile_start`] stacks more of them as high as it takes.
pub const PILE_BODIES: usize = 100;

/// No point of a [`pile_body`] is farther from its origin than this, in metres.
pub const PILE_BODY_REACH: f32 = LARGEST * 0.06;

/// How far [`pile_tray`] reaches inside along x, y and z, in metres.
pub const PILE_TRAY_SIZE: [f32; 3] = [0.72, 0.3, 0.72];

/// Bodies in a row of a layer, along x and along z alike.
const ROW: usize = 4;

/// How far neighbours of a layer are apart before they are jittered, in metres.
const SPACING: f32 = 0.17;

/// How far layers are apart before they are jittered, in metres.
const LAYER_SPACING: f32 = 0.165;

/// How high the lowest layer starts above the floor of the tray, in metres.
const LOWEST: f32 = 0.12;

/// How far a body lies from its place in the grid at most along each axis, in metres: twice the reach and twice this are
/// less than the distance of neighbours.
const JITTER: f32 = 0.01;

/// The smallest and the largest size of a body against its shape in [`soft_shapes`].
const SMALLEST: f32 = 0.85;
const LARGEST: f32 = 1.15;

/// The five shapes of the pile, closed, about 0.1 m long, of 184 to 320 triangles, their middles at the origin: a ball, a
/// rounded box, a ring, a capsule and a ball with lobes.
///
/// None of their points is farther than 0.06 m from the origin.
pub fn soft_shapes() -> [Mesh; 5] {
    [
        icosphere(2, 0.05),
        rounded_cuboid([0.045, 0.036, 0.04], 0.016, 5),
        torus(0.042, 0.0175, 16, 8),
        capsule(0.03, 0.029, 12, 4, 3),
        lobed_ball(2, 0.047),
    ]
}

/// The body of that number around the origin: one of [`soft_shapes`], scaled by 0.85 to 1.15 and turned at random.
pub fn pile_body(index: usize) -> Mesh {
    let mut random = random(index, 0);
    let shapes = soft_shapes();
    let shape = random.below(shapes.len() as u64) as usize;
    let size = SMALLEST + (LARGEST - SMALLEST) * random.unit() as f32;
    let angle = PI * random.signed_unit();
    // The half keeps the axis away from zero; that directions are not all as likely does not matter.
    let axis = [0.5 + random.unit() as f32, random.signed_unit(), random.signed_unit()];
    shapes[shape].clone().scale(size).rotate(axis, angle)
}

/// Where the origin of that [`pile_body`] starts, in metres, in the frame of [`pile_tray`].
///
/// Sixteen bodies make a layer, jittered by 1 cm along each axis. All start between the walls or above them, the lowest
/// layer 12 cm above the floor; the boxes around any two bodies are apart.
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

/// The static tray under the pile: a [`ribbed_tray`] of [`PILE_TRAY_SIZE`] with four ribs.
pub fn pile_tray() -> Mesh {
    let [width, height, depth] = PILE_TRAY_SIZE;
    ribbed_tray(width, depth, height, 4)
}

/// The random numbers of a body for one purpose, independent of those of its neighbours.
fn random(index: usize, purpose: u64) -> Random {
    Random::new(Random::new(2 * index as u64 + purpose).bits())
}
