//! Tetrahedral bodies for scenes and tests.

use super::TetrahedralMesh;

/// The six tetrahedra of a cube, which share the diagonal from the lowest to the highest corner (Kuhn 1960). Corners
/// have one bit per axis. Equal on both sides of a face between two cubes.
const TETRAHEDRA_OF_CUBE: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// A box around the origin that extends `half_extents`, of so many cubes along each axis, each of 6 tetrahedra.
///
/// # Panics
///
/// If a number of cubes is 0.
#[must_use]
pub fn tetrahedral_box(cubes: [usize; 3], half_extents: [f64; 3]) -> TetrahedralMesh {
    assert!(cubes.iter().all(|&count| count > 0), "a box needs cubes along each axis");
    let [width, height, depth] = cubes.map(|count| count + 1);
    let vertex = |[x, y, z]: [usize; 3]| ((z * height + y) * width + x) as u32;
    let mut mesh = TetrahedralMesh::default();
    for z in 0..depth {
        for y in 0..height {
            for x in 0..width {
                let place = [x, y, z];
                mesh.positions.push(std::array::from_fn(|axis| {
                    ((2.0 * place[axis] as f64 / cubes[axis] as f64 - 1.0) * half_extents[axis]) as f32
                }));
            }
        }
    }
    for z in 0..cubes[2] {
        for y in 0..cubes[1] {
            for x in 0..cubes[0] {
                let corner = |bits: usize| vertex([x + (bits & 1), y + (bits >> 1 & 1), z + (bits >> 2)]);
                mesh.tetrahedra.extend(TETRAHEDRA_OF_CUBE.map(|corners| corners.map(corner)));
            }
        }
    }
    mesh
}

/// A ball around the origin: a box of `cubes` cubes along each axis, rounded. Its outer vertices are on the sphere.
///
/// # Panics
///
/// If `cubes` is 0.
#[must_use]
pub fn tetrahedral_ball(cubes: usize, radius: f64) -> TetrahedralMesh {
    let mut mesh = tetrahedral_box([cubes; 3], [1.0; 3]);
    for position in &mut mesh.positions {
        let [x, y, z] = position.map(|coordinate| f64::from(coordinate) * f64::from(coordinate));
        // Maps every square around the origin to a sphere, without a crease at its edges.
        let shrink = |own: f32, one: f64, other: f64| {
            (f64::from(own) * (1.0 - 0.5 * (one + other) + one * other / 3.0).sqrt() * radius) as f32
        };
        *position = [shrink(position[0], y, z), shrink(position[1], z, x), shrink(position[2], x, y)];
    }
    mesh
}
