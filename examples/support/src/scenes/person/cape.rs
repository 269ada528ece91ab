//! The cape of the person.

use super::{
    super::{
        Mesh, index,
        points::{Point, advance},
    },
    body::{Limb, distance, outward},
};

/// Cells along the collar, and down the back.
const COLUMNS: usize = 30;
const ROWS: usize = 38;

/// The least gap between the cape and the skin, in meters.
const GAP: f64 = 0.018;

/// An outline of the cape: its height, its half widths along x and z around the neck, and the angle to either side of the
/// back that it goes round.
type Outline = [f64; 4];

/// From the collar over the shoulders to the hem, in equal parts of the length.
const OUTLINES: [Outline; 7] = [
    [1.475, 0.085, 0.085, 1.9],
    [1.445, 0.165, 0.13, 1.6],
    [1.33, 0.235, 0.16, 1.35],
    [1.17, 0.265, 0.185, 1.22],
    [0.98, 0.305, 0.215, 1.12],
    [0.76, 0.33, 0.25, 1.06],
    [0.52, 0.355, 0.29, 1.0],
];

/// The outline at a share of the way down, on a smooth curve through [`OUTLINES`].
fn outline(share: f64) -> Outline {
    let place = share * (OUTLINES.len() - 1) as f64;
    let before = (place as usize).min(OUTLINES.len() - 2);
    let part = place - before as f64;
    let at = |offset: isize| OUTLINES[(before as isize + offset).clamp(0, OUTLINES.len() as isize - 1) as usize];
    let [a, b, c, d] = [-1, 0, 1, 2].map(at);
    // Catmull and Rom 1974.
    std::array::from_fn(|value| {
        let slopes = [0.5 * (c[value] - a[value]), 0.5 * (d[value] - b[value])];
        let (square, cube) = (part * part, part * part * part);
        (2.0 * cube - 3.0 * square + 1.0) * b[value]
            + (cube - 2.0 * square + part) * slopes[0]
            + (3.0 * square - 2.0 * cube) * c[value]
            + (cube - square) * slopes[1]
    })
}

/// The cape, outside the skin, facing away from it.
pub(super) fn cape(limbs: &[Limb]) -> Mesh {
    let mut mesh = Mesh::default();
    for row in 0..=ROWS {
        let [height, width, depth, angle] = outline(row as f64 / ROWS as f64);
        for column in 0..=COLUMNS {
            let turn = angle * (2.0 * column as f64 / COLUMNS as f64 - 1.0);
            let mut at: Point = [width * libm::sin(turn), height, -0.012 - depth * libm::cos(turn)];
            for _ in 0..12 {
                let off = distance(limbs, at);
                if off < GAP {
                    at = advance(at, GAP - off, outward(|at| distance(limbs, at), at));
                }
            }
            mesh.positions.push(at.map(|coordinate| coordinate as f32));
        }
    }
    let vertex = |row: usize, column: usize| index(row * (COLUMNS + 1) + column);
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let quad = [[0, 0], [0, 1], [1, 1], [1, 0]].map(|[down, along]| vertex(row + down, column + along));
            // Alternating diagonals, so that no direction is stiffer.
            let mut quad = quad;
            if (row + column) % 2 == 1 {
                quad.rotate_left(1);
            }
            mesh.push_quad(quad);
        }
    }
    mesh
}
