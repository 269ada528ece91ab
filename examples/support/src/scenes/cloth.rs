//! Cloths of a scene by the number and the length of their edges: one, and several on top of each other.

use super::{Diagonals, Mesh, grid};

/// A flat square cloth in the plane y = 0, its middle at the origin, facing up, with alternating diagonals.
///
/// It has `side_vertices` vertices a side, `edge` metres apart; see [`grid`] for their order. Nothing is pinned:
/// [`cloth_corners`] names the corners.
///
/// # Panics
///
/// Panics if there are fewer than 2 vertices a side.
pub fn cloth(side_vertices: usize, edge: f32) -> Mesh {
    assert!(side_vertices >= 2, "a cloth has a cell");
    let cells = side_vertices - 1;
    let width = cells as f32 * edge;
    grid(cells, cells, width, width, Diagonals::Alternating)
}

/// The corners of a [`cloth`] of that many vertices a side: −x −z, +x −z, −x +z, +x +z.
///
/// # Panics
///
/// Panics if there are fewer than 2 vertices a side.
pub fn cloth_corners(side_vertices: usize) -> [usize; 4] {
    assert!(side_vertices >= 2, "a cloth has a cell");
    [0, side_vertices - 1, side_vertices * (side_vertices - 1), side_vertices * side_vertices - 1]
}

/// `layers` separate cloths above each other, the lowest in the plane y = 0, each `gap` metres above the one below.
///
/// Each is a [`cloth`] of `side` vertices a side, `edge` metres apart; vertices lie straight above vertices. Nothing is
/// pinned.
///
/// # Panics
///
/// Panics if there are fewer than 2 vertices a side.
pub fn cloth_layers(layers: usize, side: usize, edge: f32, gap: f32) -> Vec<Mesh> {
    let lowest = cloth(side, edge);
    (0..layers).map(|layer| lowest.clone().translate([0.0, layer as f32 * gap, 0.0])).collect()
}
