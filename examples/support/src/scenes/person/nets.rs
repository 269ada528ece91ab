//! A mesh of the surface where a distance is 0: one vertex for each cell of a grid that the surface passes, led onto it.
//!
//! Gibson 1998, "Constrained Elastic Surface Nets".

use std::collections::BTreeMap;

use super::{
    super::{
        Mesh, index,
        points::{Point, advance, dot, subtract},
    },
    body::outward,
};

/// The corners of a cell, and its edges as pairs of these.
const CORNERS: [[usize; 3]; 8] =
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]];
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];

/// Rounds in which vertices are led apart along the surface, until triangles are of similar size.
const ROUNDS: usize = 6;

/// The surface in a box, facing away from where the distance is negative. The box must contain all of it.
pub(super) fn surface(distance: impl Fn(Point) -> f64, [low, high]: [Point; 2], cell: f64) -> Mesh {
    let counts: [usize; 3] = std::array::from_fn(|axis| ((high[axis] - low[axis]) / cell).ceil() as usize + 1);
    let place = |at: [usize; 3]| -> Point { std::array::from_fn(|axis| low[axis] + at[axis] as f64 * cell) };
    let number = |[x, y, z]: [usize; 3]| (z * counts[1] + y) * counts[0] + x;
    let mut values = vec![0.0; counts.iter().product()];
    for at in cells(counts) {
        values[number(at)] = distance(place(at));
    }
    let (mut places, mut vertices) = (Vec::new(), BTreeMap::new());
    for at in cells(counts.map(|count| count - 1)) {
        let corner = |corner: usize| -> [usize; 3] { std::array::from_fn(|axis| at[axis] + CORNERS[corner][axis]) };
        let crossings = EDGES.iter().filter_map(|&[a, b]| {
            let (from, to) = (values[number(corner(a))], values[number(corner(b))]);
            ((from < 0.0) != (to < 0.0)).then(|| {
                let way = subtract(place(corner(b)), place(corner(a)));
                advance(place(corner(a)), from / (from - to), way)
            })
        });
        let (sum, count) = crossings.fold(([0.0; 3], 0), |(sum, count), at| (advance(sum, 1.0, at), count + 1));
        if count == 0 {
            continue;
        }
        vertices.insert(at, index(places.len()));
        places.push(sum.map(|coordinate| coordinate / f64::from(count)));
    }
    let mut quads = Vec::new();
    for at in cells(counts.map(|count| count - 1)) {
        for axis in 0..3 {
            let mut next = at;
            next[axis] += 1;
            let is_inside = [at, next].map(|at| values[number(at)] < 0.0);
            if is_inside[0] == is_inside[1] {
                continue;
            }
            // The four cells around the edge, counter-clockwise as seen against it.
            let around = |back: [usize; 2]| {
                let mut cell = at;
                cell[(axis + 1) % 3] -= back[0];
                cell[(axis + 2) % 3] -= back[1];
                vertices[&cell]
            };
            let mut quad = [around([1, 1]), around([0, 1]), around([0, 0]), around([1, 0])];
            if is_inside[1] {
                quad.reverse();
            }
            quads.push(quad);
        }
    }
    for _ in 0..ROUNDS {
        places = evened(&places, &quads);
        for place in &mut places {
            for _ in 0..2 {
                *place = advance(*place, -distance(*place), outward(&distance, *place));
            }
        }
    }
    let mut mesh = Mesh::default();
    let length = |a: u32, b: u32| {
        let way = subtract(places[a as usize], places[b as usize]);
        dot(way, way)
    };
    for mut quad in quads {
        // The shorter diagonal.
        if length(quad[0], quad[2]) > length(quad[1], quad[3]) {
            quad.rotate_left(1);
        }
        mesh.push_quad(quad);
    }
    mesh.positions = places.iter().map(|place| place.map(|coordinate| coordinate as f32)).collect();
    mesh
}

/// Each vertex in the middle of its neighbors.
fn evened(places: &[Point], quads: &[[u32; 4]]) -> Vec<Point> {
    let mut sums = vec![([0.0; 3], 0); places.len()];
    for quad in quads {
        for corner in 0..4 {
            let (sum, count) = &mut sums[quad[corner] as usize];
            *sum = advance(*sum, 1.0, places[quad[(corner + 1) % 4] as usize]);
            *count += 1;
        }
    }
    sums.iter().map(|&(sum, count)| sum.map(|coordinate| coordinate / f64::from(count))).collect()
}

/// All places of a grid, x first.
fn cells([columns, rows, layers]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..layers).flat_map(move |z| (0..rows).flat_map(move |y| (0..columns).map(move |x| [x, y, z])))
}
