//! Which vertices of a mesh are one: those at equal positions, or within a distance of each other.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

/// For each vertex, the first one with exactly the same position (−0 equals 0).
pub(super) fn exact_weld(positions: &[Vec3]) -> Vec<u32> {
    let mut first = HashMap::with_capacity(positions.len());
    let bits = |position: &Vec3| (*position + Vec3::ZERO).to_array().map(f32::to_bits);
    positions
        .iter()
        .enumerate()
        .map(|(vertex, position)| *first.entry(bits(position)).or_insert(vertex as u32))
        .collect()
}

/// The side of a grid cell, in welding distances. Most points are then near no other cell, and each cell has few
/// points.
const DISTANCES_OF_A_CELL: f64 = 4.0;

/// Joins vertices that are no farther apart than `distance`, transitively, in addition to those that are already
/// welded.
pub(super) fn weld_within(positions: &[Vec3], distance: f64, weld: &mut [u32]) {
    let size = DISTANCES_OF_A_CELL * distance;
    // Whole numbers as f64. Beyond 2^53, where adjacent cells have no numbers of their own, different f32 are farther
    // apart than a cell.
    let cell_of = |point: DVec3| (point / size).floor() + DVec3::ZERO;
    let key = |cell: DVec3| cell.to_array().map(f64::to_bits);
    let mut cells: HashMap<[u64; 3], Vec<u32>> = HashMap::with_capacity(positions.len());
    for vertex in 0..positions.len() {
        if weld[vertex] as usize != vertex {
            continue;
        }
        let point = positions[vertex].as_dvec3();
        let [low, high] = [point - distance, point + distance].map(cell_of);
        for x in whole_numbers(low.x, high.x) {
            for y in whole_numbers(low.y, high.y) {
                for z in whole_numbers(low.z, high.z) {
                    for &other in cells.get(&key(DVec3::new(x, y, z))).into_iter().flatten() {
                        if point.distance_squared(positions[other as usize].as_dvec3()) <= distance * distance {
                            join(weld, vertex as u32, other);
                        }
                    }
                }
            }
        }
        cells.entry(key(cell_of(point))).or_default().push(vertex as u32);
    }
    for vertex in 0..weld.len() {
        weld[vertex] = root(weld, vertex as u32);
    }
}

/// The one or two cells along an axis.
fn whole_numbers(low: f64, high: f64) -> impl Iterator<Item = f64> {
    [Some(low), (high != low).then_some(high)].into_iter().flatten()
}

/// The lowest vertex of a chain.
fn root(weld: &mut [u32], vertex: u32) -> u32 {
    let mut root = vertex;
    while weld[root as usize] != root {
        // Path halving keeps chains short.
        weld[root as usize] = weld[weld[root as usize] as usize];
        root = weld[root as usize];
    }
    root
}

/// Merges two chains into one, named by its lowest vertex.
fn join(weld: &mut [u32], first: u32, second: u32) {
    let (first, second) = (root(weld, first), root(weld, second));
    weld[first.max(second) as usize] = first.min(second);
}
