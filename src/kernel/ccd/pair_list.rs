//! First impacts over a list of candidate pairs of triangles.
//!
//! All of continuous detection after the broad phase, whose boxes must cover both ends of the step: planes, then
//! features, pair by pair.

use glam::DVec3;

use super::{
    advance::ImpactCause,
    triangle_pair::{
        CommonVertices, MovingTriangle, TriangleImpact, crossing_at_start, feature_impacts_by, triangle_pair_impact_by,
    },
};
use crate::kernel::mesh::{feature::FeaturePair, ids::TriangleId, topology::SurfaceTopology};

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

    /// The features for which a triangle is the first of those around them.
    pub(super) fn firsts(&self, triangle: u32) -> u8 {
        self.topology.surroundings(TriangleId(triangle)).features()
    }
}

/// Which corners of a pair of triangles are one vertex.
fn common_of<Position>(
    a: &MovingSide<'_, Position>,
    b: &MovingSide<'_, Position>,
    same_surface: bool,
    [triangle_a, triangle_b]: [u32; 2],
) -> CommonVertices {
    if !same_surface {
        return CommonVertices::NONE;
    }
    let vertices = |side: &MovingSide<'_, Position>, triangle: u32| side.topology.welded_triangles()[triangle as usize];
    CommonVertices::of(vertices(a, triangle_a), vertices(b, triangle_b))
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
        let common = common_of(a, b, same_surface, [triangle_a, triangle_b]);
        let (one, other) = (a.triangle(triangle_a), b.triangle(triangle_b));
        let impact = triangle_pair_impact_by(&one, &other, &common, separation, &mut normal)?;
        Some(PairImpact { triangle_a, triangle_b, impact })
    }));
}

/// Appends the impact of each pair of features that comes within `separation`, once: in the pair of the first triangles around
/// them, as with the representative triangles of S. Curtis, R. Tamstorf and D. Manocha (2008). Two triangles share their
/// features with a dozen others each, so a pair has 3 pairs of features to test instead of 15. Appends pairs that cross at
/// the start, too. Of their features, those are left out that are in no other pair of triangles, or only in such that cross.
///
/// `candidates` must contain every pair of triangles that may meet. Welded vertices must be one point.
pub(super) fn feature_impacts(
    a: &MovingSide<'_, DVec3>,
    b: &MovingSide<'_, DVec3>,
    same_surface: bool,
    candidates: &[[u32; 2]],
    separation: f64,
    impacts: &mut Vec<PairImpact>,
) {
    let mut normal = DVec3::ZERO;
    let common = |pair: [u32; 2]| common_of(a, b, same_surface, pair);
    for &pair in candidates {
        let [triangle_a, triangle_b] = pair;
        let (one, other) = (a.triangle(triangle_a), b.triangle(triangle_b));
        let tested = [a.firsts(triangle_a), b.firsts(triangle_b)];
        let before = impacts.len();
        let push = |impact| impacts.push(PairImpact { triangle_a, triangle_b, impact });
        let crossing = feature_impacts_by(&one, &other, &common(pair), tested, separation, &mut normal, push);
        let Some(crossing) = crossing else { continue };
        let crosses = |[one, other]: [u32; 2]| {
            crossing_at_start(&a.triangle(one), &b.triangle(other), &common([one, other])).is_some()
        };
        let mut kept = before;
        for place in before..impacts.len() {
            let FeaturePair { a: of_a, b: of_b } = impacts[place].impact.features;
            let around_b = b.topology.triangles_around(&triangle_b, of_b);
            let mut pairs = a
                .topology
                .triangles_around(&triangle_a, of_a)
                .iter()
                .flat_map(|&one| around_b.iter().map(move |&other| [one, other]));
            if !pairs.all(crosses) {
                impacts.swap(kept, place);
                kept += 1;
            }
        }
        impacts.truncate(kept);
        impacts.push(PairImpact { triangle_a, triangle_b, impact: crossing });
    }
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
            let tested = [mesh.firsts(triangle_a), solid.firsts(triangle_b)];
            let all_before = until;
            let crossing =
                feature_impacts_by(&a, &b, &CommonVertices::NONE, tested, separation, &mut normal, |mut impact| {
                    impact.time *= all_before;
                    if impact.cause != ImpactCause::Within {
                        until = impact.time.min(until);
                    }
                    impacts.push(PairImpact { triangle_a, triangle_b, impact });
                });
            if crossing.is_some() {
                impacts.truncate(before);
                feature_impacts(mesh, solid, false, group, separation, impacts);
                break;
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
