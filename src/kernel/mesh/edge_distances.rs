//! Distances along the edges of a mesh.
//!
//! Beside the flow, when bodies are made: topology and positions come in, a length per vertex goes out. Dijkstra's
//! algorithm: A note on two problems in connexion with graphs (1959).

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::Vec3;

use super::topology::SurfaceTopology;

/// The length of the shortest way from each vertex to the nearest of `starts`, along edges, in the unit of `positions`.
/// 0 for the starts, and infinite where no way leads to one. Welded vertices count as one.
///
/// # Panics
/// If there are fewer positions than vertices, or a start is out of range.
#[must_use]
pub fn edge_distances(topology: &SurfaceTopology, positions: &[Vec3], starts: impl Iterator<Item = u32>) -> Vec<f32> {
    let mut neighbors: Vec<Vec<(u32, f64)>> = vec![Vec::new(); topology.vertex_count()];
    for &[first, second] in topology.edges() {
        let [from, to] = [first, second].map(|vertex| positions[vertex as usize].as_dvec3());
        let length = from.distance(to);
        neighbors[first as usize].push((second, length));
        neighbors[second as usize].push((first, length));
    }
    let weld = topology.weld();
    let mut distances = vec![f64::INFINITY; topology.vertex_count()];
    // Numbers that are not negative are in the order of their bits.
    let mut open = BinaryHeap::new();
    for start in starts {
        let start = weld[start as usize];
        distances[start as usize] = 0.0;
        open.push(Reverse((0.0_f64.to_bits(), start)));
    }
    while let Some(Reverse((bits, vertex))) = open.pop() {
        let distance = f64::from_bits(bits);
        if distance > distances[vertex as usize] {
            continue;
        }
        for &(neighbor, length) in &neighbors[vertex as usize] {
            let along = distance + length;
            if along < distances[neighbor as usize] {
                distances[neighbor as usize] = along;
                open.push(Reverse((along.to_bits(), neighbor)));
            }
        }
    }
    weld.iter().map(|&own| distances[own as usize] as f32).collect()
}
