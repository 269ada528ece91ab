//! First impacts over a list of candidate pairs of triangles.
//!
//! All of continuous detection after the broad phase, whose boxes must cover both ends of the step: planes, then
//! features, pair by pair.

use glam::DVec3;

use super::triangle_pair::{CommonVertices, MovingTriangle, TriangleImpact, triangle_pair_impact};
use crate::kernel::mesh::topology::SurfaceTopology;

/// One moving side of a list of pairs, in a frame common to both sides and to both ends of the step.
#[derive(Clone, Copy, Debug)]
pub struct MovingSide<'a, Position> {
    /// Its triangles.
    pub topology: &'a SurfaceTopology,
    /// Its vertices at the start of the step, in f32 or f64.
    pub start: &'a [Position],
    /// Its vertices at the end of the step.
    pub end: &'a [Position],
}

/// The first impact of one pair of a list.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairImpact {
    /// A triangle of the first side.
    pub triangle_a: u32,
    /// A triangle of the second side.
    pub triangle_b: u32,
    /// When and how they meet.
    pub impact: TriangleImpact,
}

impl<Position: Copy + Into<DVec3>> MovingSide<'_, Position> {
    fn triangle(&self, triangle: u32) -> MovingTriangle {
        let vertices = self.topology.triangles()[triangle as usize];
        let corners = |positions: &[Position]| vertices.map(|vertex| positions[vertex as usize].into());
        MovingTriangle { start: corners(self.start), end: corners(self.end) }
    }
}

/// Appends the first impact of each of `candidates` that comes within `separation`, in the order of the candidates.
///
/// If `same_surface` is set, both sides are one surface, and features that share a (welded) vertex are left out. The
/// other features of triangles that share one are tested. A candidate may be a triangle with itself, which is no
/// impact.
pub fn first_impacts<Position: Copy + Into<DVec3>>(
    a: &MovingSide<'_, Position>,
    b: &MovingSide<'_, Position>,
    same_surface: bool,
    candidates: &[[u32; 2]],
    separation: f64,
    impacts: &mut Vec<PairImpact>,
) {
    impacts.extend(candidates.iter().filter_map(|&[triangle_a, triangle_b]| {
        let common = if same_surface {
            let vertices =
                |side: &MovingSide<'_, Position>, triangle: u32| side.topology.welded_triangles()[triangle as usize];
            CommonVertices::of(vertices(a, triangle_a), vertices(b, triangle_b))
        } else {
            CommonVertices::NONE
        };
        let impact = triangle_pair_impact(&a.triangle(triangle_a), &b.triangle(triangle_b), &common, separation)?;
        Some(PairImpact { triangle_a, triangle_b, impact })
    }));
}
