//! Which impacts the guard has to do something about.

use super::mesh::ROUNDING;
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

/// Whether two triangles collide along their trajectories. Triangles that begin within the separation or crossing
/// cannot be kept apart.
pub(super) fn is_met(cause: ImpactCause) -> bool {
    !matches!(cause, ImpactCause::Within | ImpactCause::Crossing)
}
