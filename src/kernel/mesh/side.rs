//! Decides on which side of a surface a point is, from the outward direction at the closest feature.
//!
//! The outward direction of a face is its normal, of an edge the sum of the unit normals of its faces, and of a vertex
//! their sum weighted by the angles there. With these directions the sign of the distance from a closed surface is
//! correct everywhere (Bærentzen and Aanæs 2005, angle weighted pseudonormal). Used for contacts of one-sided surfaces.

use glam::{DVec3, Vec3};

use super::{
    feature::Feature,
    ids::{EdgeId, VertexId},
    topology::SurfaceTopology,
};

/// The faces around a feature clearly agree if a direction rises over all of them, or falls below all of them, by more
/// than this sine. Far above the rounding of f64.
const CLEAR_SINE: f64 = 1.0e-9;

fn corners(topology: &SurfaceTopology, positions: &[Vec3], triangle: usize) -> [DVec3; 3] {
    topology.triangles()[triangle].map(|vertex| positions[vertex as usize].as_dvec3())
}

/// The unit normal of a triangle, or zero if it has no area.
#[must_use]
#[inline]
pub fn face_normal(corners: &[DVec3; 3]) -> DVec3 {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero()
}

/// The feature of a triangle that is closest to a point, and the closest point.
#[must_use]
pub fn closest_feature(corners: &[DVec3; 3], point: DVec3) -> (Feature, DVec3) {
    let edges = [0, 1, 2].map(|k| corners[(k + 1) % 3] - corners[k]);
    let normal = edges[0].cross(edges[1]);
    if [0, 1, 2].iter().all(|&k| normal.dot(edges[k].cross(point - corners[k])) > 0.0) {
        return (Feature::Face, point - normal * (normal.dot(point - corners[0]) / normal.length_squared()));
    }
    let mut closest = (Feature::Vertex(0), corners[0]);
    let mut nearest = f64::INFINITY;
    for (k, edge) in edges.into_iter().enumerate() {
        let squared = edge.length_squared();
        let along = if squared > 0.0 { ((point - corners[k]).dot(edge) / squared).clamp(0.0, 1.0) } else { 0.0 };
        let (feature, candidate) = if along <= 0.0 {
            (Feature::Vertex(k as u8), corners[k])
        } else if along >= 1.0 {
            (Feature::Vertex(((k + 1) % 3) as u8), corners[(k + 1) % 3])
        } else {
            (Feature::Edge(k as u8), corners[k] + edge * along)
        };
        let distance = candidate.distance_squared(point);
        if distance < nearest {
            nearest = distance;
            closest = (feature, candidate);
        }
    }
    closest
}

/// Whether a direction leads out at a feature of `triangle`, judged by the [outward direction](outward_direction)
/// there: greater than 0 if it leads out, less than 0 if it leads in. Only the sign is meaningful.
///
/// The faces around the feature usually agree, and then no weights are needed.
#[must_use]
pub fn rise(
    topology: &SurfaceTopology,
    positions: &[Vec3],
    triangle: usize,
    feature: Feature,
    direction: DVec3,
) -> f64 {
    let own = [triangle as u32];
    let around = match feature {
        Feature::Face => &own[..],
        Feature::Edge(edge) => topology.triangles_of_edge(EdgeId(topology.triangle_edges()[triangle][edge as usize])),
        Feature::Vertex(corner) => {
            topology.triangles_of_vertex(VertexId(topology.welded_triangles()[triangle][corner as usize]))
        }
    };
    let unclear = CLEAR_SINE * CLEAR_SINE * direction.length_squared();
    let (mut out, mut inward) = (false, false);
    for &around in around {
        let corners = corners(topology, positions, around as usize);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let height = normal.dot(direction);
        let is_clear = height * height > unclear * normal.length_squared();
        out |= height > 0.0 || !is_clear;
        inward |= height < 0.0 || !is_clear;
    }
    match (out, inward) {
        (true, false) => 1.0,
        (false, true) => -1.0,
        _ => outward_direction(topology, positions, triangle, feature).dot(direction),
    }
}

/// The outward direction at a feature of `triangle`, of any length. Zero if nothing around the feature has an area.
#[must_use]
pub fn outward_direction(topology: &SurfaceTopology, positions: &[Vec3], triangle: usize, feature: Feature) -> DVec3 {
    match feature {
        Feature::Face => face_normal(&corners(topology, positions, triangle)),
        Feature::Edge(edge) => {
            let edge = EdgeId(topology.triangle_edges()[triangle][edge as usize]);
            topology
                .triangles_of_edge(edge)
                .iter()
                .map(|&around| face_normal(&corners(topology, positions, around as usize)))
                .sum()
        }
        Feature::Vertex(corner) => {
            let vertex = topology.welded_triangles()[triangle][corner as usize];
            topology
                .triangles_of_vertex(VertexId(vertex))
                .iter()
                .map(|&around| {
                    let corners = corners(topology, positions, around as usize);
                    let at = topology.welded_triangles()[around as usize]
                        .iter()
                        .position(|&welded| welded == vertex)
                        .expect("the triangles around a vertex contain it");
                    let along = |to: usize| (corners[(at + to) % 3] - corners[at]).normalize_or_zero();
                    let (u, v) = (along(1), along(2));
                    let (sine, cosine) = (u.cross(v).length(), u.dot(v));
                    // f32 is precise enough for a weight, and this function can be made the same on every platform.
                    face_normal(&corners) * f64::from(bevy_math::ops::atan2(sine as f32, cosine as f32))
                })
                .sum()
        }
    }
}
