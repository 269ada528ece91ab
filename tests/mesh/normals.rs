//! Normals for the renderer, against closed forms and Bevy's own.

use bevy_circumsphere::{
    geometry::{CreaseAngle, SurfaceTopology},
    kernel::mesh::vertex_normals::vertex_normals,
};
use circumsphere_support::scenes::{self, cuboid, icosphere};
use glam::Vec3;

use crate::world::points;

fn normals(mesh: &scenes::Mesh, crease: f32) -> Vec<Vec3> {
    let positions = points(mesh);
    let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("it is valid");
    let mut normals = vec![Vec3::NAN; 3];
    vertex_normals(&topology, &positions, CreaseAngle::new(crease), &mut normals);
    normals
}

/// The mesh with three vertices for each triangle.
fn unindexed(mesh: &scenes::Mesh) -> scenes::Mesh {
    let corners = mesh.triangles.as_flattened();
    let positions = corners.iter().map(|&corner| mesh.positions[corner as usize]).collect();
    let triangles = (0..mesh.triangles.len() as u32).map(|triangle| [0, 1, 2].map(|k| 3 * triangle + k)).collect();
    scenes::Mesh { positions, triangles }
}

#[test]
fn normals_of_a_ball_are_exact_whatever_its_vertices_share() {
    let ball = icosphere(2, 0.5);
    for mesh in [unindexed(&ball), ball] {
        for (normal, position) in normals(&mesh, 1.0).iter().zip(points(&mesh)) {
            // The weights are exact on a sphere; vertices are rounded by an ulp of 0.5 on edges of 0.13.
            assert!(normal.distance(position.normalize()) < 1.0e-5, "{normal} at {position}");
        }
    }
}

#[test]
fn creases_are_split_where_the_mesh_has_a_vertex_for_each_side() {
    let cube = unindexed(&cuboid([1.0; 3], 2));
    let flat = |corners: &[Vec3]| (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
    for (triangle, normals) in normals(&cube, 1.0).as_chunks::<3>().0.iter().enumerate() {
        let positions = points(&cube);
        let expected = flat(&positions[3 * triangle..3 * triangle + 3]);
        assert!(normals.iter().all(|normal| normal.distance(expected) < 1.0e-6), "{normals:?}");
    }
    // With a crease angle beyond twice the right angle, corners are round.
    let corner = points(&cube).iter().position(|point| *point == Vec3::ONE).expect("a corner");
    let round = normals(&cube, core::f32::consts::PI)[corner];
    assert!(round.distance(Vec3::ONE.normalize()) < 0.1, "{round}");
    // A vertex that all three sides share has their mean.
    let shared = cuboid([1.0; 3], 2);
    let topology_has_one = shared.positions.iter().filter(|point| **point == [1.0; 3]).count() == 1;
    if topology_has_one {
        let corner = shared.positions.iter().position(|point| *point == [1.0; 3]).expect("a corner");
        assert!(normals(&shared, 0.1)[corner].distance(Vec3::ONE.normalize()) < 1.0e-6);
    }
}

#[test]
fn vertices_without_area_have_no_normal_and_no_nan() {
    let mesh = scenes::Mesh {
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [9.0, 9.0, 9.0], [0.0, 0.0, -1.0]],
        triangles: vec![[0, 1, 2], [0, 1, 4]],
    };
    assert_eq!(normals(&mesh, 1.0), [Vec3::Y, Vec3::Y, Vec3::ZERO, Vec3::ZERO, Vec3::Y]);
}
