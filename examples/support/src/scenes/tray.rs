//! A tray with ribs on its floor, as one closed solid: the static ground of a pile.
//!
//! It is built from uneven cells of a lattice. Its surface consists of the faces between filled and empty cells, so it
//! is closed and does not cross itself.

use std::collections::BTreeMap;

use super::{Mesh, index};
use crate::random::Random;

/// Thickness of the walls and the floor of a [`ribbed_tray`], in meters.
pub const TRAY_THICKNESS: f32 = 0.02;

/// Height of the ribs of a [`ribbed_tray`], in meters.
pub const RIB_HEIGHT: f32 = 0.02;

/// Width of the ribs of a [`ribbed_tray`] at the floor, in meters.
pub const RIB_WIDTH: f32 = 0.03;

/// Width of the ribs of a [`ribbed_tray`] at the top, in meters.
pub const RIB_TOP: f32 = 0.012;

/// Longest side of a cell, in meters. With the diagonal, no edge is longer than 11.4 cm.
const LONGEST_SIDE: f64 = 0.08;

/// Largest displacement of a line of the lattice from even spacing, as a share of the spacing.
const UNEVENNESS: f64 = 0.2;

/// A tray, open towards +y, as a closed solid wound outward. The origin is the center of the upper side of its floor.
///
/// Its inside is `width` meters wide along x, `depth` along z, and `height` along y. `ribs` ribs with the size of the
/// constants run from wall to wall along z, evenly spaced over x. Triangles are deliberately uneven: narrow on ribs and
/// rims, with edges of up to 11 cm elsewhere.
///
/// # Panics
///
/// If there is not enough room for the ribs with as much floor between them, or if the walls are less than twice as
/// high as the ribs.
pub fn ribbed_tray(width: f32, depth: f32, height: f32, ribs: usize) -> Mesh {
    assert!(width >= 2.0 * RIB_WIDTH * (ribs + 1) as f32, "the ribs need more room");
    assert!(height >= 2.0 * RIB_HEIGHT && depth > 0.0, "the tray must be at least twice as high as its ribs");
    let [width, depth, height] = [width, depth, height].map(f64::from);
    let [thickness, rib_height, rib_width, rib_top] = [TRAY_THICKNESS, RIB_HEIGHT, RIB_WIDTH, RIB_TOP].map(f64::from);
    let mut random = Random::new(0x7261_7920);

    let mut floor = vec![-0.5 * width];
    for rib in 0..ribs {
        let middle = width * ((rib + 1) as f64 / (ribs + 1) as f64 - 0.5);
        floor.extend([middle - 0.5 * rib_width, middle + 0.5 * rib_width]);
    }
    floor.push(0.5 * width);
    let (columns, kept) = lines(&walled(&floor, thickness), &mut random);
    // Between the walls, every second interval of the given lines is a rib.
    let is_rib = |column: usize| (0..ribs).any(|rib| (kept[2 + 2 * rib]..kept[3 + 2 * rib]).contains(&column));
    let (rows, kept_rows) = lines(&walled(&[-0.5 * depth, 0.5 * depth], thickness), &mut random);
    let (layers, kept_layers) = lines(&[-thickness, 0.0, rib_height, height], &mut random);

    let inside = |cell: usize, kept: &[usize]| (kept[1]..kept[kept.len() - 2]).contains(&cell);
    let is_filled = |[column, layer, row]: [usize; 3]| {
        let is_below = layer < kept_layers[1];
        let is_wall = !inside(column, &kept) || !inside(row, &kept_rows);
        is_below || is_wall || (is_rib(column) && layer < kept_layers[2])
    };
    let place = |[column, layer, row]: [usize; 3]| {
        let mut x = columns[column];
        let is_within_walls = (kept_rows[1]..=kept_rows[kept_rows.len() - 2]).contains(&row);
        if layer == kept_layers[2] && is_within_walls {
            // The flanks of a rib slope.
            let flank = 0.5 * (rib_width - rib_top);
            x += (0..ribs)
                .map(|rib| match column {
                    _ if column == kept[2 + 2 * rib] => flank,
                    _ if column == kept[3 + 2 * rib] => -flank,
                    _ => 0.0,
                })
                .sum::<f64>();
        }
        [x, layers[layer], rows[row]].map(|coordinate| coordinate as f32)
    };
    boundary([columns.len() - 1, layers.len() - 1, rows.len() - 1], is_filled, place)
}

/// `floor` with the outer sides of the walls at both ends.
fn walled(floor: &[f64], thickness: f64) -> Vec<f64> {
    let mut walled = vec![floor[0] - thickness];
    walled.extend(floor);
    walled.push(floor[floor.len() - 1] + thickness);
    walled
}

/// The lines `kept`, with uneven lines between them where they are far apart, and the index of each of `kept` in the
/// result.
fn lines(kept: &[f64], random: &mut Random) -> (Vec<f64>, Vec<usize>) {
    let mut lines = vec![kept[0]];
    let mut places = vec![0];
    for ends in kept.windows(2) {
        let length = ends[1] - ends[0];
        // Two adjacent lines move apart by up to twice the unevenness.
        let parts = (length * (1.0 + 2.0 * UNEVENNESS) / LONGEST_SIDE).ceil().max(1.0) as usize;
        for part in 1..parts {
            let stray = UNEVENNESS * f64::from(random.signed_unit());
            lines.push(ends[0] + length * (part as f64 + stray) / parts as f64);
        }
        lines.push(ends[1]);
        places.push(lines.len() - 1);
    }
    (lines, places)
}

/// The surface of the filled cells of a lattice with `cells` cells, wound outward. `place` returns the position of a
/// lattice corner.
pub(super) fn boundary(
    cells: [usize; 3],
    is_filled: impl Fn([usize; 3]) -> bool,
    place: impl Fn([usize; 3]) -> [f32; 3],
) -> Mesh {
    let mut mesh = Mesh::default();
    let mut vertices = BTreeMap::new();
    let all = (0..cells[0]).flat_map(|x| (0..cells[1]).flat_map(move |y| (0..cells[2]).map(move |z| [x, y, z])));
    for cell in all.filter(|&cell| is_filled(cell)) {
        for axis in 0..3 {
            for is_upper in [false, true] {
                let mut beyond = cell;
                beyond[axis] = beyond[axis].wrapping_add_signed(if is_upper { 1 } else { -1 });
                if beyond[axis] < cells[axis] && is_filled(beyond) {
                    continue;
                }
                let (first, second) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut corner = |along_first: usize, along_second: usize| {
                    let mut corner = cell;
                    corner[axis] += usize::from(is_upper);
                    corner[first] += along_first;
                    corner[second] += along_second;
                    *vertices.entry(corner).or_insert_with(|| {
                        mesh.positions.push(place(corner));
                        index(mesh.positions.len() - 1)
                    })
                };
                let mut quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                if !is_upper {
                    quad.reverse();
                }
                // Diagonals alternate in a checkerboard pattern.
                if (cell[0] + cell[1] + cell[2]) % 2 == 1 {
                    quad.rotate_left(1);
                }
                mesh.push_quad(quad);
            }
        }
    }
    mesh
}
