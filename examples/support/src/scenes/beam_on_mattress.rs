//! A box edge that the `Circumsphere` method misses with its default settings, as an example for a debugger.
//!
//! It is not a scene of the report. The report measures how much a method misses over many scenes, and this scene shows
//! why.

use super::{Mesh, MovingScene, index, moving::body, shapes::box_lattice};

/// Length of the mattress's edges. It must be small compared with the beam.
const MATTRESS_EDGE: f64 = 0.1;
const MATTRESS_COLUMNS: usize = 28;
const MATTRESS_ROWS: usize = 8;

/// Radius of the mattress's arch along the beam. Because of the arch, the beam touches neither the border of the
/// mattress nor anything with its ends.
const ARCH_RADIUS: f64 = 10.0;

/// Distance of the crest of the mattress from the middle of the beam.
const CREST: f64 = 2.5;

const BEAM_LENGTH: f64 = 8.0;
const BEAM_WIDTH: f64 = 0.2;

/// Height of the beam's edge above the crest at the start, and depth below it at the end.
const LOWERED: [f64; 2] = [0.08, 0.04];

/// A beam of 8 by 0.2 by 0.2, with one of its long edges downward, is lowered onto a mattress below one of its halves,
/// and sinks 0.04 deep into it.
///
/// The first body is the mattress: an open sheet of 448 triangles with edges of 0.1. The second is the beam: a box of
/// 12 triangles if `beam_cells` is 1, otherwise split into that many parts along its length. Its edge is parallel to x,
/// and the crest of the mattress is parallel to z at y = 0.
///
/// # Panics
///
/// If `ticks` or `beam_cells` is 0.
#[must_use]
pub fn beam_on_mattress(beam_cells: usize, ticks: usize) -> MovingScene {
    assert!(ticks > 0, "a scene needs at least 1 tick");
    let mattress = body(staggered_grid(MATTRESS_COLUMNS, MATTRESS_ROWS), ticks, false, false, |[column, _, row], _| {
        let (x, z) = (column * MATTRESS_EDGE, row * MATTRESS_EDGE);
        [x + CREST, -x * x / (2.0 * ARCH_RADIUS), z]
    });
    let half_diagonal = BEAM_WIDTH / 2.0_f64.sqrt();
    let beam = body(box_lattice([beam_cells, 1, 1]), ticks, true, false, |[x, y, z], moment| {
        let height = LOWERED[0] - (LOWERED[0] + LOWERED[1]) * moment;
        // Rotated by 45 degrees about x, and slightly displaced, so that its edge hits no vertex of the mattress.
        let (up, aside) = (0.5 * (y + z), 0.5 * (z - y));
        [0.5 * BEAM_LENGTH * x, half_diagonal * (up + 1.0) + height, half_diagonal * aside + 0.013]
    });
    MovingScene {
        name: "beam_on_mattress",
        what: "a beam is lowered edge first onto a mattress under one of its halves",
        deforms: false,
        bodies: vec![mattress, beam],
    }
}

/// A flat sheet in the plane y = 0 around the origin, facing up, with triangles whose edges all have length 1.
fn staggered_grid(columns: usize, rows: usize) -> Mesh {
    let row_distance = 0.75_f64.sqrt();
    let mut mesh = Mesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let shift = if row % 2 == 0 { -0.25 } else { 0.25 };
            let x = column as f64 - 0.5 * columns as f64 + shift;
            let z = (row as f64 - 0.5 * rows as f64) * row_distance;
            mesh.positions.push([x as f32, 0.0, z as f32]);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let corner = |right: usize, front: usize| index((row + front) * (columns + 1) + column + right);
            let quad = [corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)];
            // Split along the shorter diagonal, which is as long as the sides.
            let is_turned = row % 2 == 0;
            mesh.push_quad(if is_turned { [quad[1], quad[2], quad[3], quad[0]] } else { quad });
        }
    }
    mesh
}
