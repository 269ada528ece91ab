//! Which side of a surface a point is on, from the outward direction at the feature it is closest to.
//!
//! The outward direction at a face is its normal, at an edge the sum of its faces' unit normals, at a vertex their sum
//! weighted by the angles there: with these the sign of a closed surface's distance is right everywhere (Bærentzen
//! and Aanæs 2005, angle weighted pseudonormal). Used for contacts of one-sided surfaces.

use glam::{DVec3, Vec3};

use super::feature::Feature;
use crate::kernel::{
    ids::{EdgeId, VertexId},
    topology::SurfaceTopology,
};

fn corners(topology: &SurfaceTopology, positions: &[Vec3], triangle: usize) -> [DVec3; 3] {
    topology.triangles()[triangle].map(|vertex| positions[vertex as usize].as_dvec3())
}

/// Unit normal of a triangle; zero where it has no area.
#[must_use]
pub fn face_normal(corners: &[DVec3; 3]) -> DVec3 {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero()
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
                    let (u, v) = (corners[(at + 1) % 3] - corners[at], corners[(at + 2) % 3] - corners[at]);
                    face_normal(&corners) * u.cross(v).length().atan2(u.dot(v))
                })
                .sum()
        }
    }
}
