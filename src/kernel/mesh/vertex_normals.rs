//! Unit normals of vertices, to draw a mesh: smooth across welds, split at creases.
//!
//! After everything else in the flow: moved positions come in, normals for the renderer go out. Weights of faces are
//! those of Max (1999), which are exact where the vertices lie on a sphere.

use glam::{DVec3, Vec3};

use super::{ids::VertexId, smooth_normal::CreaseAngle, topology::SurfaceTopology};

/// A face at one of its corners: unit normal times weight.
fn weighted(positions: &[Vec3], corners: [u32; 3], corner: usize) -> DVec3 {
    let at = |place: usize| positions[corners[place % 3] as usize].as_dvec3();
    let (u, v) = (at(corner + 1) - at(corner), at(corner + 2) - at(corner));
    let normal = u.cross(v) / (u.length_squared() * v.length_squared());
    if normal.is_finite() { normal } else { DVec3::ZERO }
}

/// Computes one normal per vertex of the mesh. A vertex has the mean normal of its own faces and of those faces around
/// the vertices welded to it that are bent against its own by less than the crease angle. Zero for a vertex without
/// faces, or whose faces have no area.
///
/// A crease can only be split where the mesh has one vertex for each side of it.
pub fn vertex_normals(topology: &SurfaceTopology, positions: &[Vec3], crease: CreaseAngle, normals: &mut Vec<Vec3>) {
    let welded = topology.welded_triangles();
    normals.clear();
    normals.extend((0..topology.vertex_count() as u32).map(|vertex| {
        let weld = topology.weld()[vertex as usize];
        let around = topology.triangles_of_vertex(VertexId(vertex)).iter().map(|&triangle| {
            let corners = topology.triangles()[triangle as usize];
            let corner = welded[triangle as usize].iter().position(|&other| other == weld).unwrap_or_default();
            (corners.contains(&vertex), weighted(positions, corners, corner))
        });
        let own = around.clone().filter(|&(is_own, _)| is_own).map(|(_, normal)| normal).sum::<DVec3>();
        let Some(direction) = own.try_normalize() else { return Vec3::ZERO };
        let others = around
            .filter(|&(is_own, _)| !is_own)
            .filter_map(|(_, normal)| Some(normal * crease.softness(direction, normal.try_normalize()?)));
        (own + others.sum::<DVec3>()).normalize_or_zero().as_vec3()
    }));
}
