//! Measures of meshes in `f64`, by brute force.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use circumsphere_support::scenes::Mesh;

pub type Point = [f64; 3];

pub fn point(position: [f32; 3]) -> Point {
    position.map(f64::from)
}

pub fn advance(a: Point, factor: f64, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] + factor * b[axis])
}

pub fn subtract(a: Point, b: Point) -> Point {
    advance(a, -1.0, b)
}

pub fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

pub fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub fn length(a: Point) -> f64 {
    dot(a, a).sqrt()
}

pub fn corners(mesh: &Mesh) -> impl Iterator<Item = [Point; 3]> {
    mesh.triangles.iter().map(|corners| corners.map(|corner| point(mesh.positions[corner as usize])))
}

pub fn volume(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| dot(a, cross(b, c)) / 6.0).sum()
}

pub fn centroid(mesh: &Mesh) -> Point {
    let sum = mesh.positions.iter().fold([0.0; 3], |sum, &position| advance(sum, 1.0, point(position)));
    sum.map(|coordinate| coordinate / mesh.positions.len() as f64)
}

/// The lowest and the highest corner of the mesh's bounding box.
pub fn bounds(mesh: &Mesh) -> [Point; 2] {
    let all = || mesh.positions.iter().map(|&position| point(position));
    [
        std::array::from_fn(|axis| all().map(|at| at[axis]).fold(f64::INFINITY, f64::min)),
        std::array::from_fn(|axis| all().map(|at| at[axis]).fold(f64::NEG_INFINITY, f64::max)),
    ]
}

/// The triangles at each edge, by the direction in which they use it.
pub fn edges(mesh: &Mesh) -> BTreeMap<[u32; 2], [Vec<usize>; 2]> {
    let mut edges: BTreeMap<[u32; 2], [Vec<usize>; 2]> = BTreeMap::new();
    for (triangle, &[a, b, c]) in mesh.triangles.iter().enumerate() {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            edges.entry([from.min(to), from.max(to)]).or_default()[usize::from(from > to)].push(triangle);
        }
    }
    edges
}

pub fn edge_lengths(mesh: &Mesh) -> Vec<f64> {
    let at = |vertex: u32| point(mesh.positions[vertex as usize]);
    edges(mesh).into_keys().map(|[a, b]| length(subtract(at(a), at(b)))).collect()
}

/// Asserts that every edge has one triangle in each direction, the triangles around every vertex form one fan, all
/// triangles have an area, and the mesh is one body with positive volume.
pub fn assert_closed(mesh: &Mesh, name: &str) {
    let edges = edges(mesh);
    assert!(edges.values().all(|[up, down]| up.len() == 1 && down.len() == 1), "{name} is not a closed manifold");
    // One body without handles has Euler number 2, and a torus has 0. Anything else has several pieces or is pinched.
    let euler = mesh.positions.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64;
    assert!(euler == 2 || euler == 0, "{name} has Euler number {euler}");
    for vertex in 0..mesh.positions.len() as u32 {
        let next: BTreeMap<u32, u32> = mesh
            .triangles
            .iter()
            .filter_map(|corners| {
                let place = corners.iter().position(|&corner| corner == vertex)?;
                Some((corners[(place + 1) % 3], corners[(place + 2) % 3]))
            })
            .collect();
        let start = *next.keys().next().unwrap_or_else(|| panic!("vertex {vertex} of {name} is unused"));
        let mut at = next[&start];
        let mut steps = 1;
        while at != start {
            at = next[&at];
            steps += 1;
        }
        assert_eq!(steps, next.len(), "vertex {vertex} of {name} has several fans");
    }
    let smallest = corners(mesh).map(|[a, b, c]| length(cross(subtract(b, a), subtract(c, a)))).fold(1.0, f64::min);
    assert!(smallest > 1e-9, "{name} has a triangle of twice the area {smallest}");
    assert!(volume(mesh) > 0.0, "{name} is inside out");
}

/// Winding number of the surface around a point: 1 inside a closed body, 0 outside.
pub fn winding(mesh: &Mesh, at: Point) -> f64 {
    // Half the solid angle of a triangle, after van Oosterom and Strackee (1983).
    let half = corners(mesh).map(|corners| {
        let [a, b, c] = corners.map(|corner| subtract(corner, at));
        let [x, y, z] = [length(a), length(b), length(c)];
        let below = x * y * z + dot(a, b) * z + dot(b, c) * x + dot(c, a) * y;
        dot(a, cross(b, c)).atan2(below)
    });
    half.sum::<f64>() / (2.0 * PI)
}

/// The distance of a point from a segment.
pub fn point_segment(at: Point, [a, b]: [Point; 2]) -> f64 {
    let edge = subtract(b, a);
    let share = (dot(subtract(at, a), edge) / dot(edge, edge)).clamp(0.0, 1.0);
    length(subtract(at, advance(a, share, edge)))
}

/// The distance of a point from a triangle: from its plane if the point projects into it, otherwise from the nearest
/// side.
pub fn point_triangle(at: Point, [a, b, c]: [Point; 3]) -> f64 {
    let normal = cross(subtract(b, a), subtract(c, a));
    let is_above = [[a, b], [b, c], [c, a]].iter().all(|&[from, to]| {
        let inward = cross(normal, subtract(to, from));
        dot(inward, subtract(at, from)) >= 0.0
    });
    if is_above {
        return dot(normal, subtract(at, a)).abs() / length(normal);
    }
    [[a, b], [b, c], [c, a]].map(|side| point_segment(at, side)).into_iter().fold(f64::INFINITY, f64::min)
}

/// The distance of two segments: between their interiors if the common normal intersects both, otherwise at an end.
pub fn segment_segment(first: [Point; 2], second: [Point; 2]) -> f64 {
    let (u, v) = (subtract(first[1], first[0]), subtract(second[1], second[0]));
    let between = subtract(second[0], first[0]);
    let normal = cross(u, v);
    let squared = dot(normal, normal);
    let mut nearest = point_segment(first[0], second)
        .min(point_segment(first[1], second))
        .min(point_segment(second[0], first))
        .min(point_segment(second[1], first));
    if squared > 0.0 {
        let s = dot(cross(between, v), normal) / squared;
        let t = dot(cross(between, u), normal) / squared;
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            nearest = nearest.min(dot(between, normal).abs() / squared.sqrt());
        }
    }
    nearest
}

/// The distance of a segment from a mesh that it does not cross.
pub fn segment_mesh(segment: [Point; 2], mesh: &Mesh) -> f64 {
    corners(mesh)
        .flat_map(|triangle| {
            let [a, b, c] = triangle;
            let ends = segment.map(|end| point_triangle(end, triangle));
            let sides = [[a, b], [b, c], [c, a]].map(|side| segment_segment(segment, side));
            ends.into_iter().chain(sides)
        })
        .fold(f64::INFINITY, f64::min)
}
