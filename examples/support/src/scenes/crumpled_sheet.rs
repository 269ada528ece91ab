//! A crumpled sheet of any resolution, as a hard input that needs no recording.

use super::{Diagonals, Mesh, grid};
use crate::random::Random;

/// Number of waves that crumple the sheet: enough that no two folds are alike, and few enough that the sheet is smooth
/// at the scale of its triangles.
const WAVES: usize = 12;

/// A square sheet of about `triangles` triangles, crumpled so that it folds over and passes through itself.
///
/// `phase` shifts the waves, in radians: 0 and 0.05 are two states of one moving sheet. Edges have length 1 before
/// crumpling, which stretches them to a mean of about 2.7, whatever the number of triangles. So contacts grow in
/// proportion to triangles.
///
/// # Panics
///
/// If `triangles` is 0.
pub fn crumpled_sheet(triangles: usize, phase: f64) -> Mesh {
    assert!(triangles > 0, "a sheet needs at least 1 triangle");
    let cells = (triangles as f64 / 2.0).sqrt().round().max(1.0);
    let side = cells as usize;
    let mut random = Random::new(0x5EED);
    let mut signed = || f64::from(random.signed_unit());
    let waves: Vec<([f64; 2], f64, [f64; 3])> = (0..WAVES)
        .map(|_| {
            // Wavelengths of about 8 edges and more, with amplitudes of about half of that: steep enough to fold over.
            let number = [0.8 * signed(), 0.8 * signed()];
            let height = 1.6 / number[0].hypot(number[1]).max(0.25);
            (number, 3.2 * signed(), [height * signed(), 0.5 * height * signed(), height * signed()])
        })
        .collect();
    let mut mesh = grid(side, side, cells as f32, cells as f32, Diagonals::Alternating);
    for position in &mut mesh.positions {
        let at = position.map(f64::from);
        let mut moved = at;
        for (number, start, along) in &waves {
            let sine = libm::sin(number[0] * at[0] + number[1] * at[2] + start + phase);
            for axis in 0..3 {
                moved[axis] += along[axis] * sine;
            }
        }
        *position = moved.map(|coordinate| coordinate as f32);
    }
    mesh
}
