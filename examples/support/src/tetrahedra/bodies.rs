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

/// Half the size of the bodies of [`tetrahedral_pile`], in meters.
const HALF_EXTENTS_OF_BOX: [f64; 3] = [0.14, 0.1, 0.1];
const RADIUS_OF_BALL: f64 = 0.12;

/// Half the width of the pit of [`tetrahedral_pile`], in meters.
pub const HALF_WIDTH_OF_PIT: f64 = 0.29;

/// The normals of its walls, which point into it.
pub const WALLS_OF_PIT: [[f32; 3]; 4] = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];

/// Where the first box and the first ball are, and how far each pair is above the last. They are as far from each other
/// and from the walls as their radii ask for.
const PLACE_OF_BOX: [f64; 3] = [0.08, 0.25, 0.08];
const PLACE_OF_BALL: [f64; 3] = [-0.155, 0.25, -0.155];
const RISE: f64 = 0.35;

/// Ten bodies, five boxes of 1,050 and five balls of 1,296 tetrahedra, above a pit into which they fall: the plane y = 0
/// between four walls, at x and z = ±[`HALF_WIDTH_OF_PIT`]. It has room for six of them side by side.
#[must_use]
pub fn tetrahedral_pile() -> Vec<TetrahedralMesh> {
    let boxes = tetrahedral_box([7, 5, 5], HALF_EXTENTS_OF_BOX);
    let ball = tetrahedral_ball(6, RADIUS_OF_BALL);
    let body = |number: usize| {
        let (mesh, [x, y, z]) = if number.is_multiple_of(2) { (&boxes, PLACE_OF_BOX) } else { (&ball, PLACE_OF_BALL) };
        // Each pair is mirrored below the next one.
        let level = (number / 2) as f64;
        let mirror = if (number / 2).is_multiple_of(2) { 1.0 } else { -1.0 };
        let place = [mirror * x, y + RISE * level, mirror * z];
        // Each is turned about two axes, by angles of its own.
        let turns = [0.7, 0.4].map(|angle: f64| libm::sincos(angle * (number + 1) as f64));
        let turned = |position: &[f32; 3]| {
            let [x, y, z] = position.map(f64::from);
            let (sine, cosine) = turns[0];
            let [x, z] = [cosine * x + sine * z, cosine * z - sine * x];
            let (sine, cosine) = turns[1];
            let [y, z] = [cosine * y - sine * z, cosine * z + sine * y];
            std::array::from_fn(|axis| ([x, y, z][axis] + place[axis]) as f32)
        };
        TetrahedralMesh { positions: mesh.positions.iter().map(turned).collect(), tetrahedra: mesh.tetrahedra.clone() }
    };
    (0..10).map(body).collect()
}
