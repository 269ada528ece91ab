//! Moves what the exact test found on flat triangles to the patches of smooth surfaces.
//!
//! The exact test runs with distances that are wider by how far the patches may be from their triangles, so it finds
//! every pair that may touch. Here each pair of triangles gets the distance of its patches. Each contact keeps its
//! features, and its points move to where the curved features are closest. Two patches whose closest points lie inside
//! both have one more contact there.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the dispatched instruction set")]

use fearless_simd::{Level, dispatch, f32x8, prelude::*};
use glam::{DVec3, Vec3};

use super::{
    SmoothSide,
    features::closest_of_features,
    newton::closest_inside,
    patch::Patch,
    patch_lanes::{MeetingLanes, PatchLanes, closest},
};
use crate::kernel::{
    contact::{CompactContact, FacePlace, TouchingPair},
    exact::{PairProximity, examine_pair},
    mesh::feature::FeatureKind,
    pair::PairSettings,
    simd::lanes::{DoubleVectorLanes, SetLanes, VectorLanes, WIDTH, first_lanes, stored},
};

/// Moves contacts to the patches. Those beyond the reported distance become empty. `settings` has the distances that
/// count for the patches.
pub fn refine_contacts(sides: [SmoothSide<'_>; 2], settings: &PairSettings, contacts: &mut [CompactContact]) {
    for contact in contacts {
        // Whether surfaces cross is decided by their patches, pair by pair.
        if contact.features.kind() == FeatureKind::EdgeFace {
            continue;
        }
        let patches = [sides[0].patch(contact.triangle_a), sides[1].patch(contact.triangle_b)];
        if patches.iter().all(Patch::is_flat) {
            if f64::from(contact.distance) > settings.reported_distance {
                contact.drop_name();
            }
            continue;
        }
        let weights = [contact.barycentric_a, contact.barycentric_b].map(|[first, second]| {
            let [first, second] = [f64::from(first), f64::from(second)];
            [first, second, 1.0 - first - second]
        });
        let old = contact.normal.as_dvec3();
        let (weights, points) = closest_of_features(&patches, contact.features, weights);
        let between = points[1] - points[0];
        let sign = if between.dot(old) < 0.0 { -1.0 } else { 1.0 };
        let length = between.length();
        let distance = sign * length * settings.scale;
        if distance > settings.reported_distance {
            contact.drop_name();
            continue;
        }
        let size = patches[0].size();
        contact.normal = if length > 1.0e-6 * size { (between * (sign / length)).as_vec3() } else { contact.normal };
        contact.barycentric_a = [weights[0][0] as f32, weights[0][1] as f32];
        contact.barycentric_b = [weights[1][0] as f32, weights[1][1] as f32];
        contact.point_b = points[1].as_vec3();
        contact.distance = distance as f32;
    }
}

/// Computes the distances of pairs of triangles between their patches, in world units, at least 0, and appends the
/// contacts between the insides of patches.
pub fn refine_touching(
    sides: [SmoothSide<'_>; 2],
    settings: &PairSettings,
    touching: &mut [TouchingPair],
    contacts: &mut Vec<CompactContact>,
) {
    dispatch!(Level::new(), simd => refine_blocks(simd, sides, settings, touching, contacts));
}

#[inline(always)]
fn refine_blocks<S: Simd>(
    simd: S,
    sides: [SmoothSide<'_>; 2],
    settings: &PairSettings,
    touching: &mut [TouchingPair],
    contacts: &mut Vec<CompactContact>,
) {
    let scale = settings.scale as f32;
    for pairs in touching.chunks_mut(WIDTH) {
        let pair = |lane: usize| pairs[lane.min(pairs.len() - 1)];
        let triangles: [[u32; WIDTH]; 2] =
            [std::array::from_fn(|lane| pair(lane).triangle_a), std::array::from_fn(|lane| pair(lane).triangle_b)];
        let ([a, b], heights) = gather(simd, sides, &triangles);
        let flat = f32x8::from_slice(simd, &std::array::from_fn::<f32, WIDTH, _>(|lane| pair(lane).distance as f32));
        let bulge = heights * (scale * 1.000_01);
        let is_bent = heights.simd_gt(0.0);
        if !is_bent.any_true() {
            continue;
        }
        let found = closest(simd, &a, &b);
        let distances = stored(found.distance * scale);
        let requested = first_lanes(pairs.len()) as u32 & is_bent.to_bitmask() as u32;
        let reached = (found.distance * scale).simd_le(settings.reported_distance as f32);
        // No distance is larger than that of the triangles by more than the patches are away from them. If it seems so,
        // the triangles are too slender for f32.
        let is_too_large = (found.distance * scale).simd_gt((flat + bulge) * 1.000_1).to_bitmask() as u32;
        for lane in SetLanes(requested) {
            let pair = &mut pairs[lane];
            pair.distance = if is_too_large >> lane & 1 == 0 {
                f64::from(distances[lane])
            } else {
                distance_at_flat_points(sides, settings, pair)
            };
        }
        let inside = requested & (found.is_nearly_normal & reached).to_bitmask() as u32;
        if inside != 0 {
            add_contacts(sides, settings, &found, inside, pairs, contacts);
        }
    }
}

/// The distance of two patches at the closest points of their triangles.
#[cold]
fn distance_at_flat_points(sides: [SmoothSide<'_>; 2], settings: &PairSettings, pair: &TouchingPair) -> f64 {
    let triangles = [pair.triangle_a, pair.triangle_b];
    let patches = [sides[0].patch(triangles[0]), sides[1].patch(triangles[1])];
    let mut found = PairProximity::default();
    examine_pair(&patches[0].corners, &patches[1].corners, pair.distance / settings.scale, &mut found);
    let closest = found.proximities.iter().min_by(|one, other| one.distance.total_cmp(&other.distance));
    closest.map_or(pair.distance, |closest| {
        let points = [patches[0].point(&closest.barycentric_a), patches[1].point(&closest.barycentric_b)];
        points[0].distance(points[1]) * settings.scale
    })
}

/// Finds the closest points of patches that are closest inside both, and adds a contact there.
#[inline(always)]
fn add_contacts<S: Simd>(
    sides: [SmoothSide<'_>; 2],
    settings: &PairSettings,
    found: &MeetingLanes<S>,
    lanes: u32,
    pairs: &mut [TouchingPair],
    contacts: &mut Vec<CompactContact>,
) {
    let weights = [0, 1].map(|side| found.weights[side].0.map(stored));
    let between = found.between.stored();
    for lane in SetLanes(lanes) {
        let pair = &mut pairs[lane];
        let triangles = [pair.triangle_a, pair.triangle_b];
        let weights = weights.map(|[second, third]| {
            let [second, third] = [f64::from(second[lane]), f64::from(third[lane])];
            [1.0 - second - third, second, third]
        });
        let patches = [sides[0].patch(triangles[0]), sides[1].patch(triangles[1])];
        let Some(start) = between.get(lane).as_dvec3().try_normalize() else { continue };
        let Some(meeting) = closest_inside(&patches, weights, start) else { continue };
        let distance = meeting.distance * settings.scale;
        if distance > pair.distance * (1.0 + 1.0e-4) {
            continue;
        }
        pair.distance = distance.max(0.0);
        // What is inside a body has its own way out, by its vertices.
        let is_inside = |side: usize, direction: DVec3| {
            let surface = sides[side].surface;
            let outward = patches[side].normal(&meeting.weights[side]) * if surface.mirrored { -1.0 } else { 1.0 };
            !settings.same_surface && surface.one_sided && outward.dot(direction) < 0.0
        };
        if is_inside(0, meeting.normal) || is_inside(1, -meeting.normal) {
            continue;
        }
        let place = FacePlace {
            barycentrics: meeting.weights.map(|[first, second, _]| [first as f32, second as f32]),
            point_b: meeting.points[1].as_vec3(),
            normal: meeting.normal.as_vec3(),
            distance: distance as f32,
        };
        contacts.push(CompactContact::between_faces(triangles, settings.same_surface, place));
    }
}

/// The patches of eight pairs, relative to the first corners of the first ones, and how far both patches of each pair
/// together may be from their triangles.
#[inline(always)]
fn gather<S: Simd>(
    simd: S,
    sides: [SmoothSide<'_>; 2],
    triangles: &[[u32; WIDTH]; 2],
) -> ([PatchLanes<S>; 2], f32x8<S>) {
    let corners = [0, 1].map(|side| corners(simd, &sides[side], &triangles[side]));
    let origin = corners[0][0];
    let mut heights = f32x8::splat(simd, 0.0);
    let patches = [0, 1].map(|side| {
        let [p, q, r] = corners[side];
        let offsets = offsets(simd, &sides[side], &triangles[side]);
        let squared = |offset: VectorLanes<S>| offset.dot(offset);
        heights += squared(offsets[0]).max(squared(offsets[1])).max(squared(offsets[2])).sqrt() * (1.0 / 3.0);
        PatchLanes { corners: [(p - origin).rounded(), (q - origin).rounded(), (r - origin).rounded()], offsets }
    });
    (patches, heights)
}

#[inline(always)]
fn corners<S: Simd>(simd: S, side: &SmoothSide<'_>, triangles: &[u32; WIDTH]) -> [DoubleVectorLanes<S>; 3] {
    let (positions, all) = (side.surface.own_positions(), side.surface.topology.triangles());
    let corner = |corner: usize| {
        let vertices: [Vec3; WIDTH] =
            std::array::from_fn(|lane| positions[all[triangles[lane] as usize][corner] as usize]);
        VectorLanes::of(simd, vertices).widened().moved(simd, side.surface.moved.map(|moved| moved.pose))
    };
    [corner(0), corner(1), corner(2)]
}

#[inline(always)]
fn offsets<S: Simd>(simd: S, side: &SmoothSide<'_>, triangles: &[u32; WIDTH]) -> [VectorLanes<S>; 3] {
    let Some(edges) = side.edges else { return [VectorLanes::splat(simd, Vec3::ZERO); 3] };
    let all = triangles.map(|triangle| edges.of_triangle(side.surface.topology, triangle));
    let offset = |edge: usize| {
        let offset = VectorLanes::of(simd, std::array::from_fn(|lane| all[lane][edge]));
        match side.surface.moved {
            Some(moved) => offset.widened().turned(simd, &moved.pose.to_affine().matrix3).rounded(),
            None => offset,
        }
    };
    [offset(0), offset(1), offset(2)]
}
