//! The contour of a region.

use std::ops::Range;

use crate::kernel::{
    bvh::tree::BoxTree,
    mesh::{ids::EdgeId, topology::SurfaceTopology},
};

/// More polygons than this are not followed: each is compared with all others.
const MOST_POLYGONS: usize = 16;

/// The sides of triangles that no other triangle of the region shares, as closed polygons of welded vertices, in the
/// direction of the triangles.
#[derive(Clone, Debug, Default)]
pub(super) struct Contour {
    /// One polygon after the other. Empty if there is no contour, or if sides do not form polygons that touch nowhere.
    pub(super) vertices: Box<[u32]>,
    /// The index after the last vertex of each polygon.
    pub(super) ends: Box<[u32]>,
}

impl Contour {
    /// The contour of the triangles in some leaves of a tree. `leaf_of` is the leaf of each triangle.
    pub(super) fn of(tree: &BoxTree, topology: &SurfaceTopology, leaf_of: &[u32], leaves: &Range<usize>) -> Self {
        sides_of(tree, topology, leaf_of, leaves).and_then(polygons).unwrap_or_default()
    }
}

/// The sides of the contour, sorted. `None` if more than two triangles share a side, or two in the same direction.
fn sides_of(
    tree: &BoxTree,
    topology: &SurfaceTopology,
    leaf_of: &[u32],
    leaves: &Range<usize>,
) -> Option<Vec<[u32; 2]>> {
    let mut sides = Vec::new();
    for &triangle in leaves.clone().flat_map(|leaf| tree.leaf_items(leaf)) {
        let corners = topology.welded_triangles()[triangle as usize];
        for (side, &edge) in topology.triangle_edges()[triangle as usize].iter().enumerate() {
            let around = topology.triangles_of_edge(EdgeId(edge)).iter().copied();
            let mut others =
                around.filter(|&other| other != triangle && leaves.contains(&(leaf_of[other as usize] as usize)));
            match (others.next(), others.next()) {
                (None, _) => sides.push([corners[side], corners[(side + 1) % 3]]),
                (Some(other), None) if topology.runs_forward(other, edge) != topology.runs_forward(triangle, edge) => {}
                _ => return None,
            }
        }
    }
    sides.sort_unstable();
    Some(sides)
}

/// Closed polygons made of `sides`, which are sorted. `None` if more than two sides meet at a vertex.
fn polygons(sides: Vec<[u32; 2]>) -> Option<Contour> {
    if sides.windows(2).any(|sides| sides[0][0] == sides[1][0]) {
        return None;
    }
    let mut is_used = vec![false; sides.len()];
    let (mut vertices, mut ends) = (Vec::with_capacity(sides.len()), Vec::new());
    for first in 0..sides.len() {
        if is_used[first] {
            continue;
        }
        let mut place = first;
        while !std::mem::replace(&mut is_used[place], true) {
            let [from, to] = sides[place];
            vertices.push(from);
            place = sides.binary_search_by_key(&to, |side| side[0]).ok()?;
        }
        if place != first || ends.len() == MOST_POLYGONS {
            return None;
        }
        ends.push(vertices.len() as u32);
    }
    Some(Contour { vertices: vertices.into(), ends: ends.into() })
}
