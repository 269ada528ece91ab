//! Cloths by number and length of their edges: one, or several on top of each other.

use super::{Diagonals, Mesh, grid};

/// A flat square cloth in the plane y = 0, centered at the origin, facing up, with alternating diagonals.
///
/// It has `side_vertices` vertices per side, `edge` meters apart; see [`grid`] for their order. No vertex is pinned:
/// [`cloth_corners`] returns the corners.
///
/// # Panics
///
/// If there are fewer than 2 vertices per side.
pub fn cloth(side_vertices: usize, edge: f32) -> Mesh {
    assert!(side_vertices >= 2, "a cloth needs at least 2 vertices per side");
    let cells = side_vertices - 1;
    let width = cells as f32 * edge;
    grid(cells, cells, width, width, Diagonals::Alternating)
}

/// The corners of a [`cloth`] with that many vertices per side: −x −z, +x −z, −x +z, +x +z.
///
/// # Panics
///
/// If there are fewer than 2 vertices per side.
pub fn cloth_corners(side_vertices: usize) -> [usize; 4] {
    assert!(side_vertices >= 2, "a cloth needs at least 2 vertices per side");
    [0, side_vertices - 1, side_vertices * (side_vertices - 1), side_vertices * side_vertices - 1]
}

/// `layers` separate cloths above each other, the lowest in the plane y = 0, each `gap` meters above the one below.
///
/// Each is a [`cloth`] of `side` vertices per side, `edge` meters apart. Vertices are directly above vertices. No
/// vertex is pinned.
///
/// # Panics
///
/// If there are fewer than 2 vertices per side.
pub fn cloth_layers(layers: usize, side: usize, edge: f32, gap: f32) -> Vec<Mesh> {
    let lowest = cloth(side, edge);
    (0..layers).map(|layer| lowest.clone().translate([0.0, layer as f32 * gap, 0.0])).collect()
}
