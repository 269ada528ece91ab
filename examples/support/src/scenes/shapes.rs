//! Shapes with a closed form, for tests with known answers.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::{Mesh, index, merge};

/// How the squares of a sheet are split into triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Diagonals {
    /// All squares in the same way, which makes the mesh anisotropic.
    Uniform,
    /// In a checkerboard pattern: adjacent squares are split in opposite ways.
    Alternating,
}

/// A flat sheet of `columns` by `rows` cells in the plane y = 0, centered at the origin, facing up.
///
/// It is `width` long in x and `depth` long in z. Vertex `row * (columns + 1) + column` is in column `column` along x
/// and in row `row` along z, both counted from the negative side.
///
/// # Panics
///
/// If there is no column or no row.
pub fn grid(columns: usize, rows: usize, width: f32, depth: f32, diagonals: Diagonals) -> Mesh {
    assert!(columns > 0 && rows > 0, "a sheet needs at least 1 cell");
    let mut mesh = Mesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let x = (column as f32 / columns as f32 - 0.5) * width;
            let z = (row as f32 / rows as f32 - 0.5) * depth;
            mesh.positions.push([x, 0.0, z]);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let corner = |right: usize, front: usize| index((row + front) * (columns + 1) + column + right);
            let quad = [corner(0, 0), corner(0, 1), corner(1, 1), corner(1, 0)];
            let is_turned = diagonals == Diagonals::Alternating && (row + column) % 2 == 1;
            mesh.push_quad(if is_turned { [quad[1], quad[2], quad[3], quad[0]] } else { quad });
        }
    }
    mesh
}

/// A closed sphere around the origin: an icosahedron whose triangles are split in four `level` times.
///
/// It has 10 · 4^level + 2 vertices, all at `radius`, and 20 · 4^level triangles.
pub fn icosphere(level: u32, radius: f32) -> Mesh {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut positions: Vec<[f64; 3]> = Vec::new();
    for (one, long) in [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)] {
        positions.push([one, long, 0.0]);
        positions.push([0.0, one, long]);
        positions.push([long, 0.0, one]);
    }
    // The twelve corners are 2 apart along an edge. All other distances are larger.
    let mut triangles = Vec::new();
    let squared =
        |a: usize, b: usize| -> f64 { (0..3).map(|axis| (positions[a][axis] - positions[b][axis]).powi(2)).sum() };
    let is_edge = |a, b| squared(a, b) < 4.5;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if is_edge(a, b) && is_edge(b, c) && is_edge(c, a) {
                    let outward = determinant([positions[a], positions[b], positions[c]]) > 0.0;
                    let (b, c) = if outward { (b, c) } else { (c, b) };
                    triangles.push([index(a), index(b), index(c)]);
                }
            }
        }
    }
    for _ in 0..level {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let sum = std::array::from_fn(|axis| positions[a as usize][axis] + positions[b as usize][axis]);
                positions.push(at_distance(sum, 1.0));
                index(positions.len() - 1)
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
        // Between levels, all corners must be at the same distance. Otherwise the middles would lean towards the
        // farther end.
        for position in &mut positions {
            *position = at_distance(*position, 1.0);
        }
    }
    Mesh {
        positions: positions
            .into_iter()
            .map(|position| at_distance(position, f64::from(radius)).map(|value| value as f32))
            .collect(),
        triangles,
    }
}

/// A closed box around the origin that extends `half_extents` along each axis, with `subdivisions` cells per side.
///
/// It has 6 n² + 2 vertices and 12 n² triangles for n subdivisions. Adjacent faces share their vertices.
///
/// # Panics
///
/// If `subdivisions` is 0.
pub fn cuboid(half_extents: [f32; 3], subdivisions: usize) -> Mesh {
    let mut mesh = box_lattice([subdivisions; 3]);
    for position in &mut mesh.positions {
        *position = std::array::from_fn(|axis| position[axis] * half_extents[axis]);
    }
    mesh
}

/// A closed torus around the y axis, with a tube of radius `minor` at the distance `major` from the axis.
///
/// Vertex `ring * minor_segments + tube` is at the angle 2π · ring / `major_segments` around y, from x towards z, and
/// at 2π · tube / `minor_segments` around the tube, from the outside upwards.
///
/// # Panics
///
/// If either number of segments is below 3.
pub fn torus(major: f32, minor: f32, major_segments: usize, minor_segments: usize) -> Mesh {
    assert!(major_segments >= 3 && minor_segments >= 3, "a torus needs at least 3 segments");
    let mut mesh = Mesh::default();
    for ring in 0..major_segments {
        let (sine, cosine) = sine_cosine(ring, major_segments);
        for tube in 0..minor_segments {
            let (up, out) = sine_cosine(tube, minor_segments);
            let distance = f64::from(major) + f64::from(minor) * out;
            let position = [distance * cosine, f64::from(minor) * up, distance * sine];
            mesh.positions.push(position.map(|value| value as f32));
        }
    }
    for ring in 0..major_segments {
        for tube in 0..minor_segments {
            let vertex =
                |ring: usize, tube: usize| index((ring % major_segments) * minor_segments + tube % minor_segments);
            mesh.push_quad([
                vertex(ring, tube),
                vertex(ring, tube + 1),
                vertex(ring + 1, tube + 1),
                vertex(ring + 1, tube),
            ]);
        }
    }
    mesh
}

/// A tube without ends along the y axis, centered at the origin, facing away from the axis.
///
/// Vertex `along * segments_around + around` is at the height of `along` from the lower end, and at the angle 2π ·
/// around / `segments_around` from x towards z.
///
/// # Panics
///
/// If `segments_around` is below 3 or `segments_along` is 0.
pub fn cylinder_side(radius: f32, length: f32, segments_around: usize, segments_along: usize) -> Mesh {
    assert!(segments_around >= 3 && segments_along > 0, "a tube needs at least 3 segments around and 1 along");
    let mut mesh = Mesh::default();
    for along in 0..=segments_along {
        let height = (along as f32 / segments_along as f32 - 0.5) * length;
        for around in 0..segments_around {
            let (sine, cosine) = sine_cosine(around, segments_around);
            let radius = f64::from(radius);
            mesh.positions.push([(radius * cosine) as f32, height, (radius * sine) as f32]);
        }
    }
    for along in 0..segments_along {
        for around in 0..segments_around {
            let vertex = |along: usize, around: usize| index(along * segments_around + around % segments_around);
            mesh.push_quad([
                vertex(along, around),
                vertex(along + 1, around),
                vertex(along + 1, around + 1),
                vertex(along, around + 1),
            ]);
        }
    }
    mesh
}

/// The graph z = ½ k (x² − y²) over the square that extends `extent` along x and y, facing +z.
///
/// `k` is the `curvature`, in 1 / length: at the origin the principal curvatures are k and −k. There are `n` cells per
/// side. Vertex `row * (n + 1) + column` is in column `column` along x and in row `row` along y.
///
/// # Panics
///
/// If `n` is 0.
pub fn saddle(n: usize, extent: f32, curvature: f32) -> Mesh {
    let mut mesh = grid(n, n, 2.0 * extent, 2.0 * extent, Diagonals::Alternating);
    for position in &mut mesh.positions {
        let [x, _, y] = *position;
        *position = [x, y, 0.5 * curvature * (x * x - y * y)];
    }
    // Mapping the sheet's z to y mirrors it.
    for corners in &mut mesh.triangles {
        corners.swap(1, 2);
    }
    mesh
}

/// A closed rod with a square section along the z axis, centered at the origin, twisted about that axis.
///
/// The section is `side` wide, with `cells_across` cells per side. `cells_along` cells span the `length`. Seen from +z,
/// the end at +z is rotated counter-clockwise by `twist` radians relative to the end at −z.
///
/// # Panics
///
/// If either number of cells is 0.
pub fn twisted_rod(length: f32, side: f32, cells_along: usize, cells_across: usize, twist: f32) -> Mesh {
    let mut mesh = box_lattice([cells_across, cells_across, cells_along]);
    for position in &mut mesh.positions {
        let [x, y, z] = *position;
        let angle = 0.5 * twist * z;
        let (sine, cosine) = (libm::sinf(angle), libm::cosf(angle));
        let half = 0.5 * side;
        *position = [half * (x * cosine - y * sine), half * (x * sine + y * cosine), 0.5 * length * z];
    }
    mesh
}

/// `layers` flat sheets of 1 by 1 above each other, `gap` apart, the lowest in the plane y = 0.
///
/// Each is a [`grid`] of `n` by `n` cells with alternating diagonals, so vertices are directly above vertices.
///
/// # Panics
///
/// If `n` is 0.
pub fn sheet_stack(layers: usize, gap: f32, n: usize) -> Mesh {
    let sheet = grid(n, n, 1.0, 1.0, Diagonals::Alternating);
    let sheets: Vec<Mesh> = (0..layers).map(|layer| sheet.clone().translate([0.0, layer as f32 * gap, 0.0])).collect();
    merge(&sheets)
}

/// The surface of the cube [-1, 1]³ with the given number of cells along each axis.
pub(super) fn box_lattice(cells: [usize; 3]) -> Mesh {
    assert!(cells.iter().all(|&count| count > 0), "a box needs at least 1 cell");
    let mut mesh = Mesh::default();
    let mut vertices = BTreeMap::new();
    for axis in 0..3 {
        let (first, second) = ((axis + 1) % 3, (axis + 2) % 3);
        for end in [0, cells[axis]] {
            for i in 0..cells[first] {
                for j in 0..cells[second] {
                    let mut corner = |i: usize, j: usize| {
                        let mut place = [0; 3];
                        place[axis] = end;
                        place[first] = i;
                        place[second] = j;
                        *vertices.entry(place).or_insert_with(|| {
                            mesh.positions.push(std::array::from_fn(|axis| {
                                2.0 * (place[axis] as f32 / cells[axis] as f32) - 1.0
                            }));
                            index(mesh.positions.len() - 1)
                        })
                    };
                    let quad = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                    mesh.push_quad(if end == 0 { [quad[0], quad[3], quad[2], quad[1]] } else { quad });
                }
            }
        }
    }
    mesh
}

/// Sine and cosine of the angle 2π · `part` / `parts`.
fn sine_cosine(part: usize, parts: usize) -> (f64, f64) {
    let angle = TAU * part as f64 / parts as f64;
    (libm::sin(angle), libm::cos(angle))
}

fn determinant([a, b, c]: [[f64; 3]; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// The point in the direction of `position`, at a distance from the origin.
fn at_distance(position: [f64; 3], distance: f64) -> [f64; 3] {
    let length = position.iter().map(|value| value * value).sum::<f64>().sqrt();
    position.map(|value| value * distance / length)
}
