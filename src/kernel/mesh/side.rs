//! Which side of a surface a point is on, from the outward direction at the feature it is closest to.
//!
//! The outward direction at a face is its normal, at an edge the sum of its faces' unit normals, at a vertex their sum
//! weighted by the angles there: with these the sign of a closed surface's distance is right everywhere (Bærentzen
//! and Aanæs 2005, angle weighted pseudonormal). Used for contacts of one-sided surfaces.

use glam::{DVec3, Vec3};

use super::{
    feature::Feature,
    ids::{EdgeId, VertexId},
    topology::SurfaceTopology,
};

/// The faces around a feature agree beyond doubt where a direction rises over each of them, or falls below each, by more than
/// this sine: far more than f64 rounds by.
const CLEAR_SINE: f64 = 1.0e-9;

fn corners(topology: &SurfaceTopology, positions: &[Vec3], triangle: usize) -> [DVec3; 3] {
    topology.triangles()[triangle].map(|vertex| positions[vertex as usize].as_dvec3())
}

/// Unit normal of a triangle; zero where it has no area.
#[must_use]
#[inline]
pub fn face_normal(corners: &[DVec3; 3]) -> DVec3 {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero()
}

/// The part of a triangle that is closest to a point, and where.
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

/// How a direction goes along the [outward direction](outward_direction) at a feature of `triangle`: more than 0 where it leads
/// out, less than 0 where it leads in. Only the sign has a meaning.
///
/// Mostly the faces around the feature agree about that, and then no weights are needed.
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

/// The outward direction at a feature of `triangle`, of any length, zero where nothing around it has an area.
#[must_use]
#[expect(clippy::missing_panics_doc, reason = "the triangles around a vertex contain it")]
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
                    // In single precision, which is plenty for a weight and the same on every platform where asked for.
                    face_normal(&corners) * f64::from(bevy_math::ops::atan2(sine as f32, cosine as f32))
                })
                .sum()
        }
    }
}
