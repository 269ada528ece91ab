//! Compares shapes with their closed forms, and checks that defective meshes have the defects they promise.

use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, PI};

use circumsphere_support::scenes::{
    Diagonals, Mesh, crumpled_sheet, cuboid, cylinder_side, duplicate_vertices, grid, icosphere, merge, ragged_slivers,
    saddle, sheet_stack, torus, triangle_soup, twisted_rod,
};

/// Rounding of coordinates of about 1 after a dozen operations in f32.
const ROUNDING: f64 = 1e-5;

type Point = [f64; 3];

fn subtract(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

fn length(a: Point) -> f64 {
    dot(a, a).sqrt()
}

fn corners(mesh: &Mesh) -> impl Iterator<Item = [Point; 3]> {
    mesh.triangles.iter().map(|corners| corners.map(|corner| mesh.positions[corner as usize].map(f64::from)))
}

/// Twice the area times the unit normal.
fn normal([a, b, c]: [Point; 3]) -> Point {
    cross(subtract(b, a), subtract(c, a))
}

fn volume(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| dot(a, cross(b, c)) / 6.0).sum()
}

/// How often each edge is used in each of its two directions.
fn edges(mesh: &Mesh) -> BTreeMap<[u32; 2], [usize; 2]> {
    let mut edges = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let entry: &mut [usize; 2] = edges.entry([from.min(to), from.max(to)]).or_default();
            entry[usize::from(from > to)] += 1;
        }
    }
    edges
}

/// Every edge has two triangles that use it in opposite directions, and every vertex has an edge.
fn assert_watertight(mesh: &Mesh) {
    let edges = edges(mesh);
    assert!(edges.values().all(|count| *count == [1, 1]));
    assert_all_used(mesh);
}

fn assert_all_used(mesh: &Mesh) {
    let mut used = vec![false; mesh.positions.len()];
    for &corner in mesh.triangles.iter().flatten() {
        used[corner as usize] = true;
    }
    assert!(used.into_iter().all(|is_used| is_used));
    assert!(corners(mesh).all(|corners| length(normal(corners)) > 0.0));
}

/// Asserts that no edge has two triangles that use it in the same direction. Returns the number of border edges.
fn border(mesh: &Mesh) -> usize {
    let edges = edges(mesh);
    assert!(edges.values().all(|count| count[0] <= 1 && count[1] <= 1));
    assert_all_used(mesh);
    edges.values().filter(|count| count.contains(&0)).count()
}

fn assert_near(found: f64, expected: f64, tolerance: f64) {
    let difference = (found - expected).abs();
    assert!(difference <= tolerance, "{found} is not {expected} ± {tolerance}");
}

#[test]
fn grid_is_a_flat_sheet_that_faces_up() {
    for diagonals in [Diagonals::Uniform, Diagonals::Alternating] {
        let mesh = grid(5, 3, 2.0, 1.5, diagonals);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (24, 30));
        assert_eq!(border(&mesh), 16);
        assert_eq!(mesh.positions[0], [-1.0, 0.0, -0.75]);
        assert_eq!(mesh.positions[23], [1.0, 0.0, 0.75]);
        for corners in corners(&mesh) {
            let normal = normal(corners);
            assert_eq!((normal[0], normal[2]), (0.0, 0.0));
            // Twice the area of half a cell of 0.4 by 0.5.
            assert_near(normal[1], 0.2, ROUNDING);
        }
    }
    assert_ne!(
        grid(2, 1, 1.0, 1.0, Diagonals::Uniform).triangles,
        grid(2, 1, 1.0, 1.0, Diagonals::Alternating).triangles
    );
}

#[test]
fn alternating_diagonals_meet_in_every_other_vertex() {
    let degrees = |diagonals| {
        let mesh = grid(4, 4, 1.0, 1.0, diagonals);
        let inner = |vertex: u32| (1..4).contains(&(vertex % 5)) && (1..4).contains(&(vertex / 5));
        let mut degrees: Vec<usize> = (0..25)
            .filter(|vertex| inner(*vertex))
            .map(|vertex| edges(&mesh).keys().filter(|edge| edge.contains(&vertex)).count())
            .collect();
        degrees.sort_unstable();
        degrees
    };
    assert_eq!(degrees(Diagonals::Uniform), [6; 9]);
    assert_eq!(degrees(Diagonals::Alternating), [4, 4, 4, 4, 8, 8, 8, 8, 8]);
}

#[test]
fn icosphere_is_closed_and_round() {
    for level in 0..4 {
        let mesh = icosphere(level, 1.5);
        let quarters = 4_usize.pow(level);
        assert_eq!(mesh.positions.len(), 10 * quarters + 2);
        assert_eq!(mesh.triangles.len(), 20 * quarters);
        assert_watertight(&mesh);
        for position in &mesh.positions {
            assert_near(length(position.map(f64::from)), 1.5, ROUNDING);
        }
        assert!(corners(&mesh).all(|corners| dot(normal(corners), corners[0]) > 0.0));
    }
    // The volume of the icosahedron with circumradius R: edge R / sin(2π/5), volume 5/12 (3 + √5) edge³.
    let edge = 1.0 / (0.4 * std::f64::consts::PI).sin();
    let expected = 5.0 / 12.0 * (3.0 + 5.0_f64.sqrt()) * edge.powi(3);
    assert_near(volume(&icosphere(0, 1.0)), expected, ROUNDING);
    // Each level quarters the missing volume, up to the next order.
    let missing = |level| 4.0 / 3.0 * std::f64::consts::PI - volume(&icosphere(level, 1.0));
    assert_near(missing(3) / missing(4), 4.0, 0.1);
}

#[test]
fn cuboid_is_closed_and_has_its_volume() {
    for n in 1..5 {
        let mesh = cuboid([0.5, 1.0, 2.0], n);
        assert_eq!(mesh.positions.len(), 6 * n * n + 2);
        assert_eq!(mesh.triangles.len(), 12 * n * n);
        assert_watertight(&mesh);
        assert_near(volume(&mesh), 8.0, 8.0 * ROUNDING);
        for position in &mesh.positions {
            let relative = [position[0] / 0.5, position[1], position[2] / 2.0].map(f32::abs);
            assert_eq!(relative.into_iter().fold(0.0, f32::max), 1.0);
        }
    }
}

#[test]
fn torus_is_closed_and_near_its_volume() {
    let mesh = torus(1.0, 0.25, 48, 32);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (1536, 3072));
    assert_watertight(&mesh);
    for position in &mesh.positions {
        let [x, y, z] = position.map(f64::from);
        assert_near((x.hypot(z) - 1.0).hypot(y), 0.25, ROUNDING);
    }
    // 2π² R r². The 48 by 32 flat sides cut off less than 2 %.
    let expected = 2.0 * std::f64::consts::PI.powi(2) * 0.0625;
    assert_near(volume(&mesh), expected, 0.02 * expected);
    assert_eq!(mesh.positions[0], [1.25, 0.0, 0.0]);
    assert!(mesh.positions[1][1] > 0.0 && mesh.positions[32][2] > 0.0);
}

#[test]
fn cylinder_side_is_open_and_faces_outwards() {
    let mesh = cylinder_side(0.5, 2.0, 12, 4);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (60, 96));
    assert_eq!(border(&mesh), 24);
    for corners in corners(&mesh) {
        let normal = normal(corners);
        assert_near(normal[1], 0.0, ROUNDING);
        let [x, _, z] = corners[0];
        assert!(normal[0] * x + normal[2] * z > 0.0);
        assert_near(x.hypot(z), 0.5, ROUNDING);
    }
    assert_eq!((mesh.positions[0][1], mesh.positions[59][1]), (-1.0, 1.0));
}

#[test]
fn saddle_is_the_graph_of_its_formula() {
    let mesh = saddle(8, 0.5, 3.0);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (81, 128));
    assert_eq!(border(&mesh), 32);
    for position in &mesh.positions {
        let [x, y, z] = position.map(f64::from);
        assert_near(z, 1.5 * (x * x - y * y), ROUNDING);
    }
    assert!(corners(&mesh).all(|corners| normal(corners)[2] > 0.0));
    assert_eq!(mesh.positions[0][..2], [-0.5, -0.5]);
    assert_eq!(mesh.positions[1][1], -0.5);
}

#[test]
fn twisted_rod_is_closed_and_turns_its_ends() {
    let straight = twisted_rod(4.0, 0.5, 40, 3, 0.0);
    assert_watertight(&straight);
    assert_near(volume(&straight), 1.0, ROUNDING);

    let twisted = twisted_rod(4.0, 0.5, 40, 3, PI);
    assert_eq!(twisted.triangles, straight.triangles);
    for (turned, rest) in twisted.positions.iter().zip(&straight.positions) {
        assert_eq!(turned[2], rest[2]);
        let angle = f64::from(rest[2]) / 4.0 * std::f64::consts::PI;
        let [x, y, _] = rest.map(f64::from);
        assert_near(f64::from(turned[0]), x * angle.cos() - y * angle.sin(), ROUNDING);
        assert_near(f64::from(turned[1]), x * angle.sin() + y * angle.cos(), ROUNDING);
    }
    // The section keeps its area. Flat triangles between rotated sections lose a little volume.
    assert_near(volume(&twisted), 1.0, 0.01);
}

#[test]
fn sheet_stack_is_sheets_above_each_other() {
    let mesh = sheet_stack(3, 0.25, 4);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (75, 96));
    assert_eq!(border(&mesh), 48);
    for (vertex, position) in mesh.positions.iter().enumerate() {
        assert_eq!(position[1], 0.25 * (vertex / 25) as f32);
        assert_eq!(position[0], mesh.positions[vertex % 25][0]);
    }
    assert_eq!(sheet_stack(0, 1.0, 1), Mesh::default());
}

#[test]
fn merge_shifts_the_triangles_of_later_meshes() {
    let one = cuboid([1.0; 3], 1);
    let other = one.clone().translate([3.0, 0.0, 0.0]);
    let both = merge(&[one.clone(), Mesh::default(), other]);
    assert_watertight(&both);
    assert_eq!(both.positions.len(), 16);
    assert_eq!(both.triangles[12], one.triangles[0].map(|corner| corner + 8));
    assert_near(volume(&both), 16.0, 16.0 * ROUNDING);
    assert_eq!(merge(&[]), Mesh::default());
}

#[test]
fn moves_are_exact_where_they_can_be() {
    let point = |position| Mesh { positions: vec![position], triangles: Vec::new() };
    let start = point([1.0, 2.0, 3.0]);
    assert_eq!(start.clone().translate([1.0, 0.5, -3.0]), point([2.0, 2.5, 0.0]));
    assert_eq!(start.clone().scale(2.0), point([2.0, 4.0, 6.0]));
    for (axis, expected) in
        [([2.0, 0.0, 0.0], [1.0, -3.0, 2.0]), ([0.0, 0.5, 0.0], [3.0, 2.0, -1.0]), ([0.0, 0.0, 1.0], [-2.0, 1.0, 3.0])]
    {
        let turned = start.clone().rotate(axis, FRAC_PI_2);
        for (found, expected) in turned.positions[0].iter().zip(expected) {
            assert_near(f64::from(*found), expected, ROUNDING);
        }
    }
    // A third of a full rotation about the diagonal permutes the axes.
    let turned = start.rotate([1.0; 3], 2.0 * PI / 3.0);
    for (found, expected) in turned.positions[0].iter().zip([3.0, 1.0, 2.0]) {
        assert_near(f64::from(*found), expected, ROUNDING);
    }
}

#[test]
fn triangle_soup_follows_its_seed() {
    let soup = triangle_soup(200, 7);
    assert_eq!((soup.positions.len(), soup.triangles.len()), (600, 200));
    assert_eq!(soup, triangle_soup(200, 7));
    assert_eq!(soup.positions[..30], triangle_soup(10, 7).positions);
    assert_ne!(soup, triangle_soup(200, 8));
    assert_all_used(&soup);
    assert!(soup.positions.iter().flatten().all(|value| value.abs() <= 1.0));
    for [a, b, c] in corners(&soup) {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            assert!(length(subtract(to, from)) < 0.7);
        }
    }
}

#[test]
fn ragged_slivers_have_slivers_and_triangles_without_area() {
    for seed in 0..20 {
        let mesh = ragged_slivers(seed);
        assert_eq!(mesh, ragged_slivers(seed));
        assert_ne!(mesh, ragged_slivers(seed + 1));
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (289, 512));
        assert!(mesh.positions.iter().flatten().all(|value| value.is_finite()));
        let mut flat = 0;
        let mut coincident = 0;
        let mut slivers = 0;
        let mut sound = 0;
        for corners @ [a, b, c] in corners(&mesh) {
            let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| length(subtract(to, from)));
            let longest = sides.into_iter().fold(0.0, f64::max);
            let double_area = length(normal(corners));
            if sides.contains(&0.0) {
                coincident += 1;
            } else if double_area == 0.0 {
                flat += 1;
            } else if longest * longest / double_area > 1000.0 {
                slivers += 1;
            } else {
                sound += 1;
            }
        }
        let counts = [flat, coincident, slivers, sound];
        assert!(counts.into_iter().all(|count| count >= 15), "{counts:?}");
    }
}

#[test]
fn duplicate_vertices_keeps_every_position_exactly() {
    let mesh = icosphere(1, 0.3);
    let soup = duplicate_vertices(&mesh);
    assert_eq!(soup.positions.len(), 3 * mesh.triangles.len());
    assert!(soup.triangles.iter().flatten().copied().eq(0..240));
    assert!(corners(&mesh).eq(corners(&soup)));
}

#[test]
fn crumpled_sheets_of_any_fineness_have_alike_edges_and_move_with_their_phase() {
    let mean_edge = |mesh: &Mesh| {
        let lengths: Vec<f64> = corners(mesh)
            .flat_map(|[a, b, c]| [(a, b), (b, c), (c, a)])
            .map(|(from, to)| length(subtract(to, from)))
            .collect();
        lengths.iter().sum::<f64>() / lengths.len() as f64
    };
    for (asked, made) in [(1, 2), (200, 200), (1_000, 968), (20_000, 20_000)] {
        let mesh = crumpled_sheet(asked, 0.0);
        assert_eq!(mesh.triangles.len(), made);
        assert_eq!(mesh, crumpled_sheet(asked, 0.0));
        let moved = crumpled_sheet(asked, 0.05);
        assert_eq!(mesh.triangles, moved.triangles);
        let displacements = mesh.positions.iter().zip(&moved.positions).map(|(&from, &to)| {
            let difference: [f64; 3] = std::array::from_fn(|axis| f64::from(to[axis]) - f64::from(from[axis]));
            length(difference)
        });
        // Every vertex moves, and none by more than the sum of the waves' amplitudes, 12 of up to about 10, times the
        // phase.
        assert!(displacements.into_iter().all(|moved| moved > 0.0 && moved < 12.0 * 10.0 * 0.05));
        if made > 2 {
            // Edges are stretched by the waves, but not more so with more triangles.
            assert!((1.5..4.0).contains(&mean_edge(&mesh)), "{}", mean_edge(&mesh));
        }
    }
}
