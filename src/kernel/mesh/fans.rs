//! The triangles around each vertex in cyclic order, and both sides of each edge. Found once for a mesh.
//!
//! A *fan* is a run of triangles around a vertex, joined by edges that two triangles traverse in opposite directions.
//! Most vertices have one. A vertex at which two sheets meet has one for each.

use super::topology::SurfaceTopology;
use crate::kernel::mesh::ids::{EdgeId, TriangleId, VertexId};

/// No triangle, or no slot.
pub(super) const NONE: u32 = u32::MAX;

/// The fans of a mesh. Every corner of a triangle has one slot, and a fan is a range of slots.
#[derive(Clone, Debug, Default)]
pub(in crate::kernel) struct Fans {
    /// The first slot of each fan, and the end of the last one.
    starts: Vec<u32>,
    /// Whether the last triangle of a fan is joined to the first.
    closed: Vec<bool>,
    slots: Vec<Slot>,
    /// The fan of each slot.
    fan_of_slot: Vec<u32>,
    edges: Vec<EdgeSides>,
}

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct Slot {
    pub(in crate::kernel) triangle: u32,
    pub(in crate::kernel) corner: u32,
    /// The edge to the next triangle of the fan. [`NONE`] if there is none.
    pub(super) next_edge: u32,
}

/// Both sides of an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgeSides {
    /// The triangles. The second is [`NONE`] at a boundary. Both are if there are more, or two that do not fit together.
    pub(super) triangles: [u32; 2],
    /// The vertices at both ends, in the caller's numbering, as the first triangle names them.
    pub(super) ends: [u32; 2],
    /// For each triangle, its slots at both ends.
    pub(super) slots: [[u32; 2]; 2],
}

impl EdgeSides {
    const FLAT: Self = Self { triangles: [NONE; 2], ends: [0; 2], slots: [[NONE; 2]; 2] };

    /// The first triangle on both sides.
    pub(super) const AT_ZERO: Self = Self { triangles: [0; 2], ends: [0; 2], slots: [[0; 2]; 2] };

    /// With the only triangle of a boundary on both sides.
    #[inline]
    pub(super) fn doubled(mut self) -> Self {
        if self.triangles[1] == NONE {
            (self.triangles[1], self.slots[1]) = (self.triangles[0], self.slots[0]);
        }
        self
    }
}

impl Fans {
    pub(super) fn of(topology: &SurfaceTopology) -> Self {
        let mut fans = Self { starts: vec![0], ..Self::default() };
        let mut slot_of = vec![[NONE; 3]; topology.triangles().len()];
        let vertex_count = topology.vertex_count() as u32;
        let (mut left, mut run) = (Vec::new(), Vec::new());
        for vertex in (0..vertex_count).filter(|&vertex| topology.weld()[vertex as usize] == vertex) {
            left.clear();
            left.extend_from_slice(topology.triangles_of_vertex(VertexId(vertex)));
            while let Some(&start) = left.first() {
                let closed = walk(topology, vertex, start, &mut run);
                for (place, &triangle) in run.iter().enumerate() {
                    left.retain(|&other| other != triangle);
                    let is_joined = closed || place + 1 < run.len();
                    for corner in 0..3 {
                        if topology.welded_triangles()[triangle as usize][corner] == vertex {
                            slot_of[triangle as usize][corner] = fans.slots.len() as u32;
                            let after = topology.triangle_edges()[triangle as usize][(corner + 2) % 3];
                            let next_edge = if is_joined { after } else { NONE };
                            fans.fan_of_slot.push(fans.closed.len() as u32);
                            fans.slots.push(Slot { triangle, corner: corner as u32, next_edge });
                        }
                    }
                }
                fans.closed.push(closed);
                fans.starts.push(fans.slots.len() as u32);
            }
        }
        fans.edges = (0..topology.edges().len() as u32).map(|edge| sides_of(topology, edge, &slot_of)).collect();
        fans
    }

    pub(in crate::kernel) fn len(&self) -> usize {
        self.closed.len()
    }

    /// The slots of all fans.
    pub(in crate::kernel) fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// The range of a fan's slots, and whether it is closed.
    #[inline]
    pub(in crate::kernel) fn fan(&self, fan: usize) -> (std::ops::Range<usize>, bool) {
        (self.starts[fan] as usize..self.starts[fan + 1] as usize, self.closed[fan])
    }

    /// The fan that a slot belongs to.
    #[inline]
    pub(super) fn fan_of(&self, slot: u32) -> u32 {
        self.fan_of_slot[slot as usize]
    }

    pub(super) fn edges(&self) -> &[EdgeSides] {
        &self.edges
    }
}

/// The triangle that continues the surface over an edge of `triangle`.
fn beyond(topology: &SurfaceTopology, triangle: u32, edge: u32) -> Option<u32> {
    let other = match *topology.triangles_of_edge(EdgeId(edge)) {
        [first, second] if first == triangle => second,
        [first, second] if second == triangle => first,
        _ => return None,
    };
    let is_turned = topology.runs_forward(triangle, edge) == topology.runs_forward(other, edge);
    (!is_turned && !is_collapsed(topology, triangle) && !is_collapsed(topology, other)).then_some(other)
}

fn is_collapsed(topology: &SurfaceTopology, triangle: u32) -> bool {
    topology.surroundings(TriangleId(triangle)).is_collapsed()
}

/// The fan of a triangle around one of its vertices, and whether it is closed.
fn walk(topology: &SurfaceTopology, vertex: u32, start: u32, run: &mut Vec<u32>) -> bool {
    run.clear();
    run.push(start);
    // The edge that ends at the vertex comes before it, and the one that starts there after it.
    let step = |triangle: u32, forward: bool| {
        let corners = topology.welded_triangles()[triangle as usize];
        let corner = corners.iter().position(|&welded| welded == vertex)?;
        let edge = topology.triangle_edges()[triangle as usize][if forward { (corner + 2) % 3 } else { corner }];
        beyond(topology, triangle, edge)
    };
    while let Some(next) = step(run[run.len() - 1], true) {
        if next == start {
            return true;
        }
        if run.contains(&next) {
            return false;
        }
        run.push(next);
    }
    let end = run.len();
    let mut at = start;
    while let Some(next) = step(at, false) {
        if run.contains(&next) {
            break;
        }
        run.push(next);
        at = next;
    }
    // Those found backward come first.
    run[end..].reverse();
    run.rotate_left(end);
    false
}

fn sides_of(topology: &SurfaceTopology, edge: u32, slot_of: &[[u32; 3]]) -> EdgeSides {
    let triangles = match *topology.triangles_of_edge(EdgeId(edge)) {
        [only] if !is_collapsed(topology, only) => [only, NONE],
        [first, second] if beyond(topology, first, edge) == Some(second) => [first, second],
        _ => return EdgeSides::FLAT,
    };
    let side = |triangle: u32| {
        let edges = topology.triangle_edges()[triangle as usize];
        edges.iter().position(|&own| own == edge).unwrap_or_default()
    };
    let from = side(triangles[0]);
    let corners = topology.triangles()[triangles[0] as usize];
    let mut slots = [[NONE; 2]; 2];
    slots[0] = [slot_of[triangles[0] as usize][from], slot_of[triangles[0] as usize][(from + 1) % 3]];
    if triangles[1] != NONE {
        let to = side(triangles[1]);
        // The other triangle traverses the edge in the opposite direction.
        slots[1] = [slot_of[triangles[1] as usize][(to + 1) % 3], slot_of[triangles[1] as usize][to]];
    }
    EdgeSides { triangles, ends: [corners[from], corners[(from + 1) % 3]], slots }
}
