//! Tests candidate triangles of a surface against a rigid shape.

use super::{ShapeGeometry, ShapeProximity};
use crate::kernel::{
    contact::{CompactContact, TouchingPair},
    exact::triangle_pair::PairProximity,
    pair::{FoundPairs, PairSettings, SurfaceSide},
};

/// Tests candidate triangles of a surface exactly against a rigid shape, and appends the results. The shape's frame is
/// the pair's frame.
pub fn shape_pairs(
    side: &SurfaceSide<'_>,
    shape: &ShapeGeometry,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    let mut scratch = PairProximity::default();
    test_each(side, candidates, settings, found, |triangle, proximities| {
        let range = settings.range / settings.scale;
        shape.examine(&side.corners(triangle), range, &mut scratch, proximities)
    });
}

/// Tests candidate triangles by a function. Given a triangle and an empty list, it writes the proximities within the
/// range, and returns the signed distance, in the unit of the pair's frame.
pub(in crate::kernel) fn test_each(
    side: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
    mut examine: impl FnMut(u32, &mut Vec<ShapeProximity>) -> f64,
) {
    let mut proximities: Vec<ShapeProximity> = Vec::new();
    let first_contact = found.contacts.len();
    for &[triangle, _] in candidates {
        proximities.clear();
        found.examined += 1;
        let distance = examine(triangle, &mut proximities) * settings.scale;
        if distance > settings.range {
            continue;
        }
        found.nearest = found.nearest.min(distance.max(0.0));
        if distance <= settings.contact_distance {
            found.touching.push(TouchingPair { triangle_a: triangle, triangle_b: 0, distance: distance.max(0.0) });
        }
        let reported = proximities
            .iter()
            .filter(|proximity| proximity.distance * settings.scale <= settings.reported_distance)
            .map(|proximity| CompactContact::with_shape(side, triangle, proximity, settings.scale));
        found.contacts.extend(reported);
    }
    found.finish_contacts(first_contact);
}
