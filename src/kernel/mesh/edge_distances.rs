//! Distances along the edges of a mesh.
//!
//! Beside the flow, when bodies are made: topology and positions come in, a length per vertex goes out. Dijkstra's
//! algorithm: A note on two problems in connexion with graphs (1959).

use std::{cmp::Reverse, collections::BinaryHeap};

use glam::Vec3;

use super::topology::SurfaceTopology;

/// The nearest of `starts` to each vertex, along edges, and the length of the way there in the unit of `positions`: 0
/// for the starts. `None` where no way leads to one. Welded vertices count as one, and the first of them is named.
///
/// # Panics
/// If there are fewer positions than vertices, or a start is out of range.
#[must_use]
pub fn nearest_along_edges(
    topology: &SurfaceTopology,
    positions: &[Vec3],
    starts: impl Iterator<Item = u32>,
) -> Vec<Option<(u32, f32)>> {
    let mut neighbors: Vec<Vec<(u32, f64)>> = vec![Vec::new(); topology.vertex_count()];
    for &[first, second] in topology.edges() {
        let [from, to] = [first, second].map(|vertex| positions[vertex as usize].as_dvec3());
        let length = from.distance(to);
        neighbors[first as usize].push((second, length));
        neighbors[second as usize].push((first, length));
    }
    let weld = topology.weld();
    let mut found = vec![(u32::MAX, f64::INFINITY); topology.vertex_count()];
    // Numbers that are not negative are in the order of their bits.
    let mut open = BinaryHeap::new();
    for start in starts {
        let start = weld[start as usize];
        found[start as usize] = (start, 0.0);
        open.push(Reverse((0.0_f64.to_bits(), start)));
    }
    while let Some(Reverse((bits, vertex))) = open.pop() {
        let distance = f64::from_bits(bits);
        let (start, nearest) = found[vertex as usize];
        if distance > nearest {
            continue;
        }
        for &(neighbor, length) in &neighbors[vertex as usize] {
            let along = distance + length;
            if along < found[neighbor as usize].1 {
                found[neighbor as usize] = (start, along);
                open.push(Reverse((along.to_bits(), neighbor)));
            }
        }
    }
    let nearest = weld.iter().map(|&own| found[own as usize]);
    nearest.map(|(start, length)| length.is_finite().then_some((start, length as f32))).collect()
}
