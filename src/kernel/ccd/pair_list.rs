//! First impacts over a list of candidate pairs of triangles.
//!
//! All of continuous detection after the broad phase, whose boxes must cover both ends of the step: planes, then
//! features, pair by pair.

use glam::DVec3;

use super::{
    advance::ImpactCause,
    triangle_pair::{CommonVertices, MovingTriangle, TriangleImpact, triangle_pair_impact_by},
};
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
    // Neighbors in the list are often separated by the same plane.
    let mut normal = DVec3::ZERO;
    impacts.extend(candidates.iter().filter_map(|&[triangle_a, triangle_b]| {
        let common = if same_surface {
            let vertices =
                |side: &MovingSide<'_, Position>, triangle: u32| side.topology.welded_triangles()[triangle as usize];
            CommonVertices::of(vertices(a, triangle_a), vertices(b, triangle_b))
        } else {
            CommonVertices::NONE
        };
        let (one, other) = (a.triangle(triangle_a), b.triangle(triangle_b));
        let impact = triangle_pair_impact_by(&one, &other, &common, separation, &mut normal)?;
        Some(PairImpact { triangle_a, triangle_b, impact })
    }));
}

/// Appends the impacts of triangles of a mesh with a convex solid: of each triangle that begins outside, those that begin
/// within the separation, the first of the others, and some later ones. Nothing gets past the first to what lies behind.
/// Of a triangle that begins across the solid, all.
///
/// A thin cylinder has hundreds of triangles in the way of one triangle of a cloth. After the first few, most of them
/// cannot come earlier, which a plane shows. Sorts the candidates by the mesh's triangles.
pub(super) fn impacts_with_solid(
    mesh: &MovingSide<'_, DVec3>,
    solid: &MovingSide<'_, DVec3>,
    candidates: &mut [[u32; 2]],
    separation: f64,
    impacts: &mut Vec<PairImpact>,
) {
    candidates.sort_unstable();
    let mut normal = DVec3::ZERO;
    for group in candidates.chunk_by(|one, other| one[0] == other[0]) {
        let before = impacts.len();
        let own = mesh.triangle(group[0][0]);
        let mut until = 1.0;
        for &[triangle_a, triangle_b] in spread(group) {
            let (a, b) = (own.until(until), solid.triangle(triangle_b).until(until));
            let found = triangle_pair_impact_by(&a, &b, &CommonVertices::NONE, separation, &mut normal);
            let Some(mut impact) = found else { continue };
            if impact.cause == ImpactCause::Crossing {
                impacts.truncate(before);
                first_impacts(mesh, solid, false, group, separation, impacts);
                break;
            }
            impact.time *= until;
            impacts.push(PairImpact { triangle_a, triangle_b, impact });
            if impact.cause != ImpactCause::Within {
                until = impact.time;
            }
        }
    }
}

/// All items of a list, in an order in which the first few are from all over it.
fn spread<T>(items: &[T]) -> impl Iterator<Item = &T> {
    let size = items.len().next_power_of_two();
    let unused = usize::BITS - size.trailing_zeros();
    (0..size).filter_map(move |place| items.get(place.reverse_bits().checked_shr(unused).unwrap_or(0)))
}
