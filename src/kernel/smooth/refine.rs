//! Moves what the exact test found on flat triangles to the smooth surfaces.
//!
//! The exact test runs with distances that are wider by how far the patches may be from their triangles, so it finds
//! every pair that may touch. Here each contact slides to the closest points nearby, and pairs and contacts that turn out to
//! be too far away are dropped.

use super::slide::{Domain, SmoothSide, Spot, closest_on_patches};
use crate::kernel::{
    contact::{CompactContact, TouchingPair},
    exact::{PairProximity, examine_pair},
    mesh::feature::{Feature, FeatureKind, FeaturePair},
    pair::PairSettings,
};

/// The faces on which the contacts of patches lie.
const FACES: FeaturePair = FeaturePair { a: Feature::Face, b: Feature::Face };

/// Moves contacts to the patches. Those beyond the reported distance become empty. `settings` has the distances that count
/// for the patches.
pub fn refine_contacts(sides: [SmoothSide<'_>; 2], settings: &PairSettings, contacts: &mut [CompactContact]) {
    for contact in contacts {
        refine(sides, settings, contact);
    }
}

fn refine(sides: [SmoothSide<'_>; 2], settings: &PairSettings, contact: &mut CompactContact) {
    let spot = |triangle: u32, [first, second]: [f32; 2]| {
        let [first, second] = [f64::from(first), f64::from(second)];
        Spot { triangle, weights: [first, second, (1.0 - first - second).max(0.0)] }
    };
    let spots = [spot(contact.triangle_a, contact.barycentric_a), spot(contact.triangle_b, contact.barycentric_b)];
    let meeting = closest_on_patches(sides, spots, contact.normal.as_dvec3(), Domain::Surfaces);
    let distance = meeting.distance * settings.scale;
    let is_crossing = contact.features.kind() == FeatureKind::EdgeFace;
    let has_inside = !settings.same_surface && sides.iter().any(|side| side.surface.one_sided);
    if is_crossing && !has_inside && distance <= 0.0 {
        // Two sheets that cross have no side to leave by.
        return;
    }
    if distance > settings.reported_distance {
        contact.drop_name();
        return;
    }
    let weights = meeting.spots.map(|Spot { weights: [first, second, _], .. }| [first as f32, second as f32]);
    *contact = CompactContact {
        triangle_a: meeting.spots[0].triangle,
        triangle_b: meeting.spots[1].triangle,
        features: FACES,
        // Others may have slid to the same triangles, or from them.
        is_shared: true,
        barycentric_a: weights[0],
        barycentric_b: weights[1],
        point_b: meeting.points[1].as_vec3(),
        normal: meeting.normal.as_vec3(),
        distance: distance as f32,
        ..*contact
    };
}

/// Computes the distances of pairs of triangles between their patches, in world units, at least 0.
pub fn refine_touching(sides: [SmoothSide<'_>; 2], settings: &PairSettings, bulge: f64, touching: &mut [TouchingPair]) {
    let mut proximity = PairProximity::default();
    for pair in touching {
        pair.distance = patch_distance(sides, settings, bulge, pair, &mut proximity);
    }
}

fn patch_distance(
    sides: [SmoothSide<'_>; 2],
    settings: &PairSettings,
    bulge: f64,
    pair: &TouchingPair,
    proximity: &mut PairProximity,
) -> f64 {
    let triangles = [pair.triangle_a, pair.triangle_b];
    let corners = [sides[0].surface.corners(triangles[0]), sides[1].surface.corners(triangles[1])];
    examine_pair(&corners[0], &corners[1], (pair.distance + 2.0 * bulge) / settings.scale, proximity);
    let patches = [sides[0].patch(triangles[0]), sides[1].patch(triangles[1])];
    let mut inner = PairProximity::default();
    let mut least = f64::INFINITY;
    for features in &proximity.proximities {
        let spots = [
            Spot { triangle: triangles[0], weights: features.barycentric_a },
            Spot { triangle: triangles[1], weights: features.barycentric_b },
        ];
        let direction = (-features.separation).try_normalize();
        let direction = direction.unwrap_or_else(|| sides[1].patch(triangles[1]).normal(&spots[1].weights));
        let meeting = closest_on_patches(sides, spots, direction, Domain::Triangles);
        let _ = meeting; let starts = [spots.map(|spot| spot.weights)];
        for weights in starts {
            least = least.min(nearest_of(&patches, weights, &mut inner));
        }
    }
    least * settings.scale
}

/// The least distance of two patches near given points, by the triangles that touch the patches there.
fn nearest_of(patches: &[super::patch::Patch; 2], mut weights: [[f64; 3]; 2], scratch: &mut PairProximity) -> f64 {
    let apart = |weights: &[[f64; 3]; 2]| patches[0].point(&weights[0]).distance(patches[1].point(&weights[1]));
    let mut least = apart(&weights);
    for _ in 0..10 {
        let [a, b] = [0, 1].map(|side| patches[side].touching_triangle(&weights[side]));
        examine_pair(&a, &b, least, scratch);
        let closest = scratch.proximities.iter().min_by(|one, other| one.distance.total_cmp(&other.distance));
        let Some(closest) = closest else { break };
        let target = [closest.barycentric_a, closest.barycentric_b];
        let mut share = 1.0;
        let mut is_better = false;
        for _ in 0..4 {
            let next = [0, 1].map(|side| {
                std::array::from_fn(|k| weights[side][k] + share * (target[side][k] - weights[side][k]))
            });
            let distance = apart(&next);
            if distance < least * (1.0 - 1.0e-6) {
                (least, weights, is_better) = (distance, next, true);
                break;
            }
            share *= 0.5;
        }
        if !is_better {
            break;
        }
    }
    least
}
