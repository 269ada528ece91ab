//! Defective meshes, for tests of what must hold regardless.

use super::{Diagonals, Mesh, grid, index};
use crate::random::Random;

/// Cells per side of [`ragged_slivers`], a power of two so that its coordinates are exact.
const RAGGED_CELLS: usize = 16;

/// Coordinates of [`ragged_slivers`] that are not moved to a neighbor are multiples of this power of two, so that the
/// middle of two vertices and the area of a triangle around it are exact.
const RAGGED_STEP: f32 = 1.0 / 1024.0;

/// Distance to which a vertex of [`ragged_slivers`] is moved to its neighbor, relative to their distance. It is less
/// than the 1/1000 of an aspect ratio of 1000, which leaves room for longer sides of the triangles.
const SLIVER: f32 = 1e-4;

/// `count` triangles without common vertices, at random in the cube from -1 to 1, each at most 0.7 long.
pub fn triangle_soup(count: usize, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for triangle in 0..count {
        let mut point = |reach: f32| -> [f32; 3] { std::array::from_fn(|_| reach * random.signed_unit()) };
        let center = point(0.8);
        for _ in 0..3 {
            let arm = point(0.2);
            mesh.positions.push(std::array::from_fn(|axis| center[axis] + arm[axis]));
        }
        let first = index(3 * triangle);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

/// A crumpled sheet of 16 by 16 cells, about 1 by 1 in the plane y = 0, with slivers and zero-area triangles.
///
/// Of the 64 vertices in odd rows and columns, a third are moved towards a neighbor until their triangles have aspect
/// ratios (longest edge / smallest height) above 1000, a third lie exactly on a neighbor, and a third exactly in the
/// middle of an opposite edge. So some triangles may be flipped. The `seed` determines which neighbor is used, and how
/// the other inner vertices are displaced.
pub fn ragged_slivers(seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = grid(RAGGED_CELLS, RAGGED_CELLS, 1.0, 1.0, Diagonals::Alternating);
    let side = RAGGED_CELLS + 1;
    let inner = || (1..RAGGED_CELLS).flat_map(|row| (1..RAGGED_CELLS).map(move |column| (row, column)));
    for (row, column) in inner() {
        for coordinate in &mut mesh.positions[row * side + column] {
            *coordinate += (random.below(25) as f32 - 12.0) * RAGGED_STEP;
        }
    }
    // No two of these vertices are neighbors, so the neighbors of each stay in place.
    for (row, column) in inner().filter(|(row, column)| row % 2 == 1 && column % 2 == 1) {
        let vertex = row * side + column;
        let across = if random.below(2) == 0 { vertex - 1 } else { vertex + 1 };
        let diagonal = if random.below(2) == 0 { across - side } else { across + side };
        let own = mesh.positions[vertex];
        let near = mesh.positions[across];
        let far = mesh.positions[diagonal];
        let fate = (row / 2 + column / 2) % 3;
        mesh.positions[vertex] = std::array::from_fn(|axis| match fate {
            0 => near[axis] + SLIVER * (own[axis] - near[axis]),
            1 => near[axis],
            _ => 0.5 * (near[axis] + far[axis]),
        });
    }
    mesh
}

/// Every triangle of `mesh` with its own three vertices, at exactly the same positions.
///
/// Triangle `t` has the vertices 3t, 3t + 1, and 3t + 2.
///
/// # Panics
///
/// If a triangle has a vertex index that is out of range.
pub fn duplicate_vertices(mesh: &Mesh) -> Mesh {
    let mut soup = Mesh::default();
    for corners in &mesh.triangles {
        let first = index(soup.positions.len());
        soup.positions.extend(corners.map(|corner| mesh.positions[corner as usize]));
        soup.triangles.push([first, first + 1, first + 2]);
    }
    soup
}
