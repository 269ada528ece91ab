//! Tests candidate triangles of a surface against a rigid shape.

use super::{ShapeGeometry, ShapeProximity};
use crate::kernel::{
    contact::{CompactContact, TouchingPair},
    exact::triangle_pair::PairProximity,
    mesh::thickness::lack_at,
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
        let distance = shape.examine(&side.corners(triangle), range, &mut scratch, proximities);
        Nearness { reach: distance, distance }
    });
}

/// How near a triangle is to a shape, in the unit of the pair's frame.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct Nearness {
    /// The least sum of the signed distance of a point and of what lacks there. Without lacks, the signed distance.
    pub(in crate::kernel) reach: f64,
    /// The signed distance.
    pub(in crate::kernel) distance: f64,
}

/// Tests candidate triangles by a function. Given a triangle and an empty list, it writes the proximities within the
/// range, and returns how near the triangle is.
pub(in crate::kernel) fn test_each(
    side: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
    mut examine: impl FnMut(u32, &mut Vec<ShapeProximity>) -> Nearness,
) {
    let mut proximities: Vec<ShapeProximity> = Vec::new();
    let first_contact = found.contacts.len();
    for &[triangle, _] in candidates {
        proximities.clear();
        found.examined += 1;
        let nearness = examine(triangle, &mut proximities);
        let reach = nearness.reach * settings.scale;
        if reach > settings.range {
            continue;
        }
        found.nearest = found.nearest.min(reach.max(0.0));
        if reach <= settings.contact_distance {
            let distance = (nearness.distance * settings.scale).max(0.0);
            found.touching.push(TouchingPair { triangle_a: triangle, triangle_b: 0, distance });
        }
        let lacks = side.lacks(triangle);
        let reported = proximities
            .iter()
            .filter(|proximity| {
                proximity.distance * settings.scale + lack_at(&lacks, &proximity.barycentric)
                    <= settings.reported_distance
            })
            .map(|proximity| CompactContact::with_shape(side, triangle, proximity, settings.scale));
        found.contacts.extend(reported);
    }
    found.finish_contacts(first_contact);
}
