//! The ground of a level, and what moves on it: all of it a function of place and time alone.

use std::f64::consts::{PI, TAU};

use super::{Diagonals, Mesh, grid};

/// Half the width of the level along x and z, in metres. The half at x < 0 is meant for a mesh, the other for a height
/// field, so that both kinds of ground are in one level.
pub const LEVEL_HALF_WIDTH: f32 = 3.0;

/// Along how many cells each half of the level is cut, along x and along z.
pub const LEVEL_CELLS: [usize; 2] = [12, 24];

/// How high the ground of the level is at a place: hills of up to 0.15 m, with two continuous derivatives.
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

/// The heights of the half at x > 0, row by row along z, in each from x = 0: one more in each direction than there are
/// cells. The border with [`level_ground`] has the same heights.
pub fn level_heights() -> Vec<Vec<f32>> {
    let [columns, rows] = LEVEL_CELLS;
    let at = |row: usize, column: usize| {
        let x = column as f32 / columns as f32 * LEVEL_HALF_WIDTH;
        let z = (row as f32 / rows as f32 - 0.5) * 2.0 * LEVEL_HALF_WIDTH;
        level_height(x, z)
    };
    (0..=rows).map(|row| (0..=columns).map(|column| at(row, column)).collect()).collect()
}

/// Where the middle of the lift is, `time` seconds after the start: between 0.45 m and 1.25 m, at up to 1.3 m/s.
pub fn level_lift(time: f64) -> [f32; 3] {
    let height = 0.45 + 0.4 * (1.0 - libm::cos(TAU * time.max(0.0) / 2.0));
    [1.8, height as f32, 1.5]
}

/// Where the middle of the ferry is and how far it has turned around y, in radians: it slides to and fro along z by a
/// metre at up to 1.6 m/s and turns.
pub fn level_ferry(time: f64) -> ([f32; 3], f32) {
    let time = time.max(0.0);
    let along = -0.5 * (1.0 - libm::cos(PI * time));
    ([-1.8, 0.5, (1.8 + along) as f32], (0.8 * (1.0 - libm::cos(1.3 * time))) as f32)
}

/// Where the middle of the fast ball is: it stands until 1 s and then flies 5 m along z at `speed` metres per second.
pub fn level_ball(time: f64, speed: f64) -> [f32; 3] {
    let way = (speed * (time - 1.0)).clamp(0.0, 5.0);
    [0.0, 1.3, (way - 2.5) as f32]
}
