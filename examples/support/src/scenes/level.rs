//! The ground of a level and the objects that move on it, all as functions of place and time.

use std::f64::consts::{PI, TAU};

use super::{Diagonals, Mesh, grid};

/// Half the width of the level along x and z, in meters. The half at x < 0 is intended for a mesh, and the other for a
/// height field, so that a level has both kinds of ground.
pub const LEVEL_HALF_WIDTH: f32 = 3.0;

/// Number of cells of each half of the level, along x and along z.
pub const LEVEL_CELLS: [usize; 2] = [12, 24];

/// Height of the ground at a place: hills of up to 0.15 m, with two continuous derivatives.
pub fn level_height(x: f32, z: f32) -> f32 {
    let (x, z) = (f64::from(x), f64::from(z));
    (0.15 * libm::sin(1.7 * x) * libm::cos(1.3 * z)) as f32
}

/// The half of the ground at x < 0, facing up.
pub fn level_ground() -> Mesh {
    let [columns, rows] = LEVEL_CELLS;
    let ground = grid(columns, rows, LEVEL_HALF_WIDTH, 2.0 * LEVEL_HALF_WIDTH, Diagonals::Uniform);
    let mut ground = ground.translate([-0.5 * LEVEL_HALF_WIDTH, 0.0, 0.0]);
    for [x, y, z] in &mut ground.positions {
        *y = level_height(*x, *z);
    }
    ground
}

/// The heights of the half at x > 0, row by row along z, and in each row from x = 0. In each direction there is one
/// more height than there are cells. The border with [`level_ground`] has the same heights.
pub fn level_heights() -> Vec<Vec<f32>> {
    let [columns, rows] = LEVEL_CELLS;
    let at = |row: usize, column: usize| {
        let x = column as f32 / columns as f32 * LEVEL_HALF_WIDTH;
        let z = (row as f32 / rows as f32 - 0.5) * 2.0 * LEVEL_HALF_WIDTH;
        level_height(x, z)
    };
    (0..=rows).map(|row| (0..=columns).map(|column| at(row, column)).collect()).collect()
}

/// Center of the lift `time` seconds after the start: from 0.45 m to 1.25 m high, at up to 1.3 m/s.
pub fn level_lift(time: f64) -> [f32; 3] {
    let height = 0.45 + 0.4 * (1.0 - libm::cos(TAU * time.max(0.0) / 2.0));
    [1.8, height as f32, 1.5]
}

/// Center of the ferry and its rotation about y in radians. It slides back and forth along z by a meter, at up to 1.6
/// m/s, and rotates.
pub fn level_ferry(time: f64) -> ([f32; 3], f32) {
    let time = time.max(0.0);
    let along = -0.5 * (1.0 - libm::cos(PI * time));
    ([-1.8, 0.5, (1.8 + along) as f32], (0.8 * (1.0 - libm::cos(1.3 * time))) as f32)
}

/// Center of the fast ball. It is at rest until 1 s, and then flies 5 m along z at `speed` meters per second.
pub fn level_ball(time: f64, speed: f64) -> [f32; 3] {
    let way = (speed * (time - 1.0)).clamp(0.0, 5.0);
    [0.0, 1.3, (way - 2.5) as f32]
}
