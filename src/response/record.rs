//! From a contact record to the features or the plane that the solver watches.
//!
//! Corners are passed as particles. A record is in single precision and in the frame of its pair. It becomes either
//! features, which are evaluated again in every substep, or a plane, which stays fixed for the tick.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{
    contact::{ContactConstraint, Features},
    particles::Particles,
    reaction::NO_REACTION,
    untangle::untangling_direction,
};
use crate::{
    contacts::StoredPair,
    kernel::{
        contact::CompactContact,
        mesh::{feature::Feature, ids::EdgeId},
    },
};

pub(super) fn face_of(vertex: u32, [a, b, c]: [u32; 3]) -> Features {
    Features::VertexFace([vertex, a, b, c])
}

pub(super) fn edges_of(a: [u32; 3], edge_a: u8, b: [u32; 3], edge_b: u8) -> Features {
    let ends = |corners: [u32; 3], edge: u8| [corners[edge as usize], corners[(edge as usize + 1) % 3]];
    let ([a0, a1], [b0, b1]) = (ends(a, edge_a), ends(b, edge_b));
    Features::EdgeEdge([a0, a1, b0, b1])
}

/// The direction in which a contact pushes its first side. `None` if it has none.
pub(super) fn normal_of(pair: &StoredPair, record: &CompactContact) -> Option<DVec3> {
    let normal = -pair.frame_pose.transform_direction(record.normal.as_dvec3()).normalize_or_zero();
    (normal != DVec3::ZERO).then_some(normal)
}

/// Distance that a cut-off part moves back per tick, in contact distances, unless the push-out speed limits it.
const WAY_BACK: f64 = 4.0;

/// Distance that an edge moves per tick to shorten the intersection contour, in contact distances. Less in a crowd.
const WAY_OF_EDGE: f64 = 2.0;

/// Crossings around a corner up to which an edge moves that far: there are six or seven where two sheets cross. Where there
/// are more, each pulls another way, and the edge moves less by the square of their number. Otherwise a crumpled cloth
/// crumples more and more.
const CROWD: f64 = 6.0;

/// How a crossing moves back.
#[derive(Clone, Copy, Debug)]
pub(super) enum MoveBack {
    /// With the whole part that is cut off, along a unit vector.
    Part(DVec3),
    /// The edge alone, so that the intersection contour shortens.
    Edge {
        /// How often the triangles around a corner cross, on average.
        crowd: f64,
    },
}

/// Completes the first two weights to three. Corners that are not part of the feature get 0.
pub(super) fn completed(feature: Feature, [first, second]: [f32; 2]) -> [f64; 3] {
    let [first, second] = [f64::from(first), f64::from(second)];
    match feature {
        Feature::Edge(0) => [first, 1.0 - first, 0.0],
        _ => [first, second, 1.0 - first - second],
    }
}

/// The corners of two triangles with their weights, negative for the second. Corners with weight 0 are left out.
pub(super) fn weighted([a, b]: [[u32; 3]; 2], [weights_a, weights_b]: [[f64; 3]; 2]) -> ArrayVec<(u32, f64), 6> {
    let mut entries = ArrayVec::new();
    entries.extend(a.into_iter().zip(weights_a));
    entries.extend(b.into_iter().zip(weights_b.map(|weight| -weight)));
    entries.retain(|&mut (_, weight)| weight != 0.0);
    entries
}

/// The weights of the corners of both triangles in a record.
pub(super) fn weights_of(record: &CompactContact) -> [[f64; 3]; 2] {
    [completed(record.features.a, record.barycentric_a), completed(record.features.b, record.barycentric_b)]
}

/// The constraint of a crossing for which no side is remembered.
pub(super) fn untangling(
    particles: &Particles,
    pair: &StoredPair,
    record: &CompactContact,
    [a, b]: [[u32; 3]; 2],
    firsts: [Option<usize>; 2],
    move_back: MoveBack,
) -> Option<ContactConstraint> {
    let (normal, way) = match move_back {
        MoveBack::Part(back) => (back, WAY_BACK),
        MoveBack::Edge { crowd } => {
            let way = WAY_OF_EDGE * (CROWD / crowd).min(1.0).powi(2);
            (shortening(particles, pair, record, [a, b], firsts)?, way)
        }
    };
    let entries = weighted([a, b], weights_of(record));
    let distance = f64::from(pair.contact_distance_at(record));
    let offset = -distance * way - normal.dot(detected_sum(particles, &entries));
    let features = Features::Plane { particles: entries, offset };
    Some(ContactConstraint {
        parts: features,
        normal,
        distance,
        friction: [0.0; 2],
        reaction: NO_REACTION,
        recovers: true,
    })
}

/// Direction in which the first side of a crossing moves to shorten the intersection contour.
fn shortening(
    particles: &Particles,
    pair: &StoredPair,
    record: &CompactContact,
    [a, b]: [[u32; 3]; 2],
    firsts: [Option<usize>; 2],
) -> Option<DVec3> {
    let topology_b = pair.topology_b.as_ref()?;
    let (topology, triangle, corners, edge, face, first_particle, sign) = match (record.features.a, record.features.b) {
        (Feature::Edge(edge), Feature::Face) => {
            (&pair.topology_a, record.triangle_a, a, edge as usize, b, firsts[0], 1.0)
        }
        (Feature::Face, Feature::Edge(edge)) => (topology_b, record.triangle_b, b, edge as usize, a, firsts[1], -1.0),
        _ => return None,
    };
    let [start, end] = [corners[edge], corners[(edge + 1) % 3]];
    let at = |particle: u32| particles.start[particle as usize];
    let around = topology.triangles_of_edge(EdgeId(topology.triangle_edges()[triangle as usize][edge]));
    let beside = around.iter().filter_map(|&other| {
        if other == triangle {
            return Some(at(corners[(edge + 2) % 3]));
        }
        let first_particle = first_particle?;
        let corners = topology.welded_triangles()[other as usize].map(|vertex| first_particle as u32 + vertex);
        corners.into_iter().find(|corner| ![start, end].contains(corner)).map(at)
    });
    let direction = untangling_direction([at(start), at(end)], &face.map(at), beside)?;
    Some(direction * sign)
}

/// A contact whose normal and weights stay fixed for the tick: between spheres, or between features that have
/// penetrated at a rim.
pub(super) fn flat(
    particles: &Particles,
    record: &CompactContact,
    corners: [[u32; 3]; 2],
    normal: DVec3,
    distance: f64,
) -> Features {
    let entries = weighted(corners, weights_of(record));
    let separation = f64::from(record.distance) - distance;
    let offset = separation - normal.dot(detected_sum(particles, &entries));
    Features::Plane { particles: entries, offset }
}

/// The weighted sum of particles at the positions that detection saw.
pub(super) fn detected_sum(particles: &Particles, entries: &[(u32, f64)]) -> DVec3 {
    entries.iter().map(|&(particle, weight)| particles.start[particle as usize] * weight).sum()
}
