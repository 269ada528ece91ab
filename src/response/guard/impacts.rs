//! Which impacts the guard has to do something about.

use super::mesh::{MeshPair, ROUNDING};
use crate::kernel::{
    ccd::{CommonVertices, ImpactCause, PairImpact, SweptMesh, triangle_pair_impact},
    exact::triangle_pair::{PairProximity, examine_pair},
};

/// Keeps two triangles that begin within their separation from coming closer, so that nothing pressed into a rounded
/// shape gets deeper.
pub(super) fn deeper(
    a: &SweptMesh<'_>,
    b: &SweptMesh<'_>,
    found: PairImpact,
    separation: f64,
    scratch: &mut PairProximity,
) -> Option<PairImpact> {
    let (a, b) = (a.triangle(found.triangle_a), b.triangle(found.triangle_b));
    examine_pair(&a.start, &b.start, separation, scratch);
    let distance = scratch.distance;
    if !(distance > 0.0 && distance.is_finite()) {
        return None;
    }
    let impact = triangle_pair_impact(&a, &b, &CommonVertices::NONE, distance * (1.0 - ROUNDING))?;
    is_met(impact.cause).then_some(PairImpact { impact, ..found })
}

/// Of the impacts from a place on, which are those of a body with a convex solid, keeps the first of each feature of the
/// body's triangles. What it would strike behind that it cannot reach, and whatever is left of such impacts once the first
/// is resolved is found then. A thin cylinder has hundreds of triangles across the way of one edge.
///
/// Impacts of one triangle must be next to each other.
pub(super) fn keep_first(found: &mut Vec<(MeshPair, PairImpact)>, from: usize) {
    let (mut kept, mut first_of_triangle) = (from, from);
    for place in from..found.len() {
        let (_, PairImpact { triangle_a, impact, .. }) = found[place];
        if kept > from && found[kept - 1].1.triangle_a != triangle_a {
            first_of_triangle = kept;
        }
        let is_same = |(_, other): &(MeshPair, PairImpact)| other.impact.features.a == impact.features.a;
        if let Some(same) = found[first_of_triangle..kept].iter().position(is_same) {
            let same = first_of_triangle + same;
            if impact.time < found[same].1.impact.time {
                found[same] = found[place];
            }
        } else {
            found[kept] = found[place];
            kept += 1;
        }
    }
    found.truncate(kept);
}

/// Whether two triangles collide along their trajectories. Triangles that begin within the separation or crossing
/// cannot be kept apart.
pub(super) fn is_met(cause: ImpactCause) -> bool {
    !matches!(cause, ImpactCause::Within | ImpactCause::Crossing)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::kernel::{
        ccd::TriangleImpact,
        mesh::feature::{Feature, FeaturePair},
    };

    fn found(triangle_a: u32, a: Feature, triangle_b: u32, time: f64) -> (MeshPair, PairImpact) {
        let (features, cause) = (FeaturePair { a, b: Feature::Face }, ImpactCause::Reached);
        let [barycentric_a, barycentric_b] = [[1.0, 0.0, 0.0]; 2];
        let impact = TriangleImpact { time, cause, features, barycentric_a, barycentric_b, normal: DVec3::Y };
        let pair = MeshPair { places: [0, 1], separation: 0.0, clearance: 0.0, radius: 0.0 };
        (pair, PairImpact { triangle_a, triangle_b, impact })
    }

    #[test]
    fn the_first_impact_of_each_feature_is_kept() {
        let (corner, edge) = (Feature::Vertex(1), Feature::Edge(2));
        let mut list = vec![
            // Of another pair of meshes: nothing of it is looked at.
            found(3, corner, 9, 0.9),
            found(3, corner, 0, 0.5),
            found(3, edge, 1, 0.4),
            found(3, corner, 2, 0.25),
            found(3, edge, 3, 0.75),
            found(4, corner, 1, 0.125),
            found(4, Feature::Vertex(2), 3, 0.5),
            found(7, edge, 0, 1.0),
        ];
        keep_first(&mut list, 1);
        let kept: Vec<_> =
            list.iter().map(|(_, found)| (found.triangle_a, found.triangle_b, found.impact.time)).collect();
        assert_eq!(kept, [(3, 9, 0.9), (3, 2, 0.25), (3, 1, 0.4), (4, 1, 0.125), (4, 3, 0.5), (7, 0, 1.0)]);
    }
}
