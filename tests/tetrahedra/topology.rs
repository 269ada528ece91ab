//! The surface of tetrahedra, and what is reported of them.

use bevy_circumsphere::geometry::{
    SurfaceTopology, TetrahedraError, TetrahedralTopology, TetrahedronId, TopologyError,
};
use circumsphere_support::{
    random::Random,
    tetrahedra::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box},
};
use glam::{DVec3, Vec3};

fn positions(mesh: &TetrahedralMesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

fn volume_within(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let corner = |vertex: u32| positions[vertex as usize].as_dvec3();
    triangles.iter().map(|&[a, b, c]| corner(a).dot(corner(b).cross(corner(c))) / 6.0).sum()
}

/// Swaps corners of some tetrahedra.
fn rewound(mesh: &TetrahedralMesh, seed: u64) -> Vec<[u32; 4]> {
    let mut random = Random::new(seed);
    let mut tetrahedra = mesh.tetrahedra.clone();
    for corners in &mut tetrahedra {
        for _ in 0..3 {
            corners.swap(random.below(4) as usize, random.below(4) as usize);
        }
    }
    tetrahedra
}

#[test]
fn the_surface_of_one_tetrahedron_faces_outward_for_every_winding() {
    let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    for corners in [[0, 1, 2, 3], [1, 0, 2, 3], [3, 1, 0, 2], [2, 3, 1, 0]] {
        let topology = TetrahedralTopology::new(&positions, &[corners]).expect("valid");
        assert_eq!(topology.surface().len(), 4);
        let volume = volume_within(&positions, topology.surface());
        assert!((volume - 1.0 / 6.0).abs() < 1.0e-15, "{corners:?}: {volume}");
        assert!(topology.report().inverted.is_empty(), "a winding is no inversion");
    }
}

#[test]
fn surfaces_are_closed_and_outward_whatever_the_windings() {
    for (mesh, triangles) in
        [(tetrahedral_box([3, 4, 5], [1.0; 3]), 4 * (12 + 15 + 20)), (tetrahedral_ball(5, 1.0), 300)]
    {
        let positions = positions(&mesh);
        let volume: f64 = mesh
            .tetrahedra
            .iter()
            .map(|corners| {
                let [a, b, c, d] = corners.map(|corner| positions[corner as usize].as_dvec3());
                ((b - a).dot((c - a).cross(d - a)) / 6.0).abs()
            })
            .sum();
        for seed in 0..4 {
            let topology = TetrahedralTopology::new(&positions, &rewound(&mesh, seed)).expect("valid");
            assert_eq!(topology.surface().len(), triangles);
            let surface = SurfaceTopology::new(&positions, topology.surface()).expect("valid");
            assert!(surface.is_closed());
            let within = volume_within(&positions, topology.surface());
            assert!((within - volume).abs() < 1.0e-12 * volume, "{within} {volume}");
            let report = topology.report();
            assert!(report.degenerate.is_empty() && report.inverted.is_empty(), "{report:?}");
            assert_eq!((report.crowded_faces, report.unused_vertices), (0, 0));
        }
    }
}

#[test]
fn generated_tetrahedra_have_positive_volume() {
    for cubes in [1, 2, 5, 12] {
        let mesh = tetrahedral_ball(cubes, 1.0);
        let positions = positions(&mesh);
        for corners in &mesh.tetrahedra {
            let [a, b, c, d] = corners.map(|corner| positions[corner as usize].as_dvec3());
            assert!((b - a).dot((c - a).cross(d - a)) > 0.0, "{cubes} cubes, {corners:?}");
        }
        let far = mesh.positions.iter().map(|&position| Vec3::from_array(position).length()).fold(0.0, f32::max);
        assert!((far - 1.0).abs() < 1.0e-6, "{far}");
    }
}

#[test]
fn inverted_and_degenerate_tetrahedra_are_reported_and_do_not_turn_the_surface() {
    let mesh = tetrahedral_box([3; 3], [1.0; 3]);
    let mut positions = positions(&mesh);
    // A vertex inside moves through the faces opposite it.
    let inner = positions.iter().position(|position| position.abs().max_element() < 0.5).expect("some are inside");
    positions[inner] += Vec3::new(1.2, 0.9, 1.1);
    for seed in 0..4 {
        let tetrahedra = rewound(&mesh, seed);
        let topology = TetrahedralTopology::new(&positions, &tetrahedra).expect("valid");
        let report = topology.report();
        let expected = mesh.tetrahedra.iter().zip(0..).filter(|(corners, _)| {
            let [a, b, c, d] = corners.map(|corner| positions[corner as usize].as_dvec3());
            (b - a).dot((c - a).cross(d - a)) < 0.0
        });
        assert_eq!(report.inverted, expected.map(|(_, number)| TetrahedronId(number)).collect::<Vec<_>>());
        assert!(!report.inverted.is_empty());
        assert!((volume_within(&positions, topology.surface()) - 8.0).abs() < 1.0e-6);
    }
    // One in a plane, between two others.
    let flat = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X + Vec3::Y, Vec3::Z];
    let topology = TetrahedralTopology::new(&flat, &[[0, 1, 2, 4], [0, 1, 2, 3]]).expect("valid");
    assert_eq!(topology.report().degenerate, [TetrahedronId(1)]);
    let surface = SurfaceTopology::new(&flat, topology.surface()).expect("valid");
    assert!(surface.is_closed(), "the faces of the flat one follow from its neighbor");
    assert!((volume_within(&flat, topology.surface()) - 1.0 / 6.0).abs() < 1.0e-15);
    // One that names a vertex twice has no faces.
    let topology = TetrahedralTopology::new(&flat, &[[0, 1, 2, 4], [0, 1, 1, 3]]).expect("valid");
    assert_eq!((topology.report().degenerate.len(), topology.surface().len()), (1, 4));
}

#[test]
fn crowded_faces_and_unused_vertices_are_counted() {
    let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Z, 2.0 * Vec3::Z, Vec3::ONE];
    let topology = TetrahedralTopology::new(&positions, &[[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]]).expect("valid");
    assert_eq!((topology.report().crowded_faces, topology.report().unused_vertices), (1, 1));
    assert_eq!(topology.surface().len(), 9);
    assert_eq!(topology.vertex_count(), 7);
}

#[test]
fn what_cannot_be_used_is_refused_by_name() {
    let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    let error = |positions: &[Vec3], tetrahedra: &[[u32; 4]]| {
        TetrahedralTopology::new(positions, tetrahedra).expect_err("this cannot be used")
    };
    assert_eq!(error(&positions, &[]), TetrahedraError::NoTetrahedra);
    assert_eq!(
        error(&positions, &[[0, 1, 2, 3], [0, 1, 2, 4]]),
        TetrahedraError::VertexOutOfRange { tetrahedron: 1, vertex: 4, vertices: 4 }
    );
    let mut broken = positions;
    broken[2].y = f32::INFINITY;
    let found = error(&broken, &[[0, 1, 2, 3]]);
    assert!(matches!(found, TetrahedraError::NonFinitePosition { vertex: 2, .. }), "{found}");
    assert_eq!(error(&positions, &[[0, 1, 2, 3]; 2]), TetrahedraError::NoSurface);
    assert_eq!(error(&positions, &[[0, 1, 1, 3]]), TetrahedraError::NoSurface);
    let surface = TetrahedraError::from(TopologyError::NoTriangles);
    assert_eq!(surface.to_string(), TopologyError::NoTriangles.to_string());
}

#[test]
fn volumes_keep_their_sign_far_from_the_origin() {
    let far = Vec3::splat(1.0e6);
    let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z].map(|position| position + far);
    let topology = TetrahedralTopology::new(&positions, &[[1, 0, 2, 3]]).expect("valid");
    let near: Vec<Vec3> =
        positions.iter().map(|&position| (position.as_dvec3() - DVec3::splat(1.0e6)).as_vec3()).collect();
    assert!(volume_within(&near, topology.surface()) > 0.16);
}
