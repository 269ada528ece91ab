//! A crumpled sheet of any fineness, for whoever needs a hard input and has no recording at hand.

use super::{Diagonals, Mesh, grid};
use crate::random::Random;

/// Waves that crumple the sheet: enough that no fold is like another, few enough that the sheet stays smooth at the
/// scale of its triangles.
const WAVES: usize = 12;

/// A square sheet of about `triangles` triangles, crumpled so that it folds over and passes through itself.
///
/// `phase` shifts the waves that crumple it, in radians: 0 and 0.05 are two states of one moving sheet. Its edges were 1
/// long before it was crumpled, which stretches them to some 2.7 in the mean, however many triangles it has: contacts
/// and triangles grow alike.
///
/// # Panics
///
/// Panics if there is no triangle.
pub fn crumpled_sheet(triangles: usize, phase: f64) -> Mesh {
    assert!(triangles > 0, "a sheet needs a triangle");
    let cells = (triangles as f64 / 2.0).sqrt().round().max(1.0);
    let side = cells as usize;
    let mut random = Random::new(0x5EED);
    let mut signed = || f64::from(random.signed_unit());
    let waves: Vec<([f64; 2], f64, [f64; 3])> = (0..WAVES)
        .map(|_| {
            // Wave lengths of about 8 edges and more, amplitudes of about half of them: steep enough to fold over.
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
