//! Adjacency, welding, and the report of unusual meshes, against known counts.

use std::collections::{BTreeMap, BTreeSet};

use bevy_circumsphere::kernel::mesh::{
    ids::{EdgeId, TriangleId, VertexId},
    topology::{SurfaceTopology, TopologyReport},
    validation::{MAX_ELEMENTS, TopologyError},
};
use circumsphere_support::scenes::{
    Diagonals, Mesh, cuboid, duplicate_vertices, grid, icosphere, merge, ragged_slivers, torus,
};
use glam::Vec3;

use crate::{common::Random, truth::positions};

fn topology(mesh: &Mesh) -> SurfaceTopology {
    SurfaceTopology::new(&positions(mesh), &mesh.triangles).expect("the mesh is valid")
}

fn closed_report() -> TopologyReport {
    TopologyReport::default()
}

#[test]
fn every_unusable_mesh_is_refused_by_name() {
    let points = [Vec3::ZERO, Vec3::X, Vec3::Y];
    assert_eq!(SurfaceTopology::new(&points, &[]).unwrap_err(), TopologyError::NoTriangles);
    assert_eq!(SurfaceTopology::new(&[], &[]).unwrap_err(), TopologyError::NoTriangles);
    assert_eq!(
        SurfaceTopology::new(&points, &[[0, 1, 2], [0, 3, 1]]).unwrap_err(),
        TopologyError::VertexOutOfRange { triangle: 1, vertex: 3, vertices: 3 }
    );
    assert_eq!(
        SurfaceTopology::new(&[], &[[0, 0, 0]]).unwrap_err(),
        TopologyError::VertexOutOfRange { triangle: 0, vertex: 0, vertices: 0 }
    );
    assert_eq!(
        SurfaceTopology::new(&points, &[[0, 1, u32::MAX]]).unwrap_err(),
        TopologyError::VertexOutOfRange { triangle: 0, vertex: u32::MAX, vertices: 3 }
    );
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        // Unused vertices count, too.
        let points = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(0.0, bad, 0.0)];
        let error = SurfaceTopology::new(&points, &[[0, 1, 2]]).unwrap_err();
        assert!(matches!(error, TopologyError::NonFinitePosition { vertex: 3, .. }), "{error}");
    }
    let text = SurfaceTopology::new(&points, &[[0, 3, 1]]).unwrap_err().to_string();
    assert!(text.contains("triangle 0") && text.contains("vertex 3"), "{text}");
}

/// Untouched zeroed pages use no memory. The count is rejected before anything is read.
#[test]
#[cfg(target_os = "linux")]
fn more_triangles_than_a_key_can_number_are_refused() {
    let triangles = vec![[0u32; 3]; MAX_ELEMENTS + 1];
    assert_eq!(
        SurfaceTopology::new(&[Vec3::ZERO], &triangles).unwrap_err(),
        TopologyError::TooLarge { element: "triangles", count: MAX_ELEMENTS + 1 }
    );
}

#[test]
fn closed_shapes_have_two_triangles_at_every_edge() {
    let shapes = [
        ("icosphere", icosphere(2, 1.0), 2),
        ("box", cuboid([1.0, 2.0, 3.0], 3), 2),
        ("torus", torus(1.0, 0.3, 12, 8), 0),
    ];
    for (name, mesh, euler) in shapes {
        let topology = topology(&mesh);
        assert_eq!(topology.report(), closed_report(), "{name}");
        assert!(topology.is_closed());
        assert_eq!(topology.edges().len() * 2, mesh.triangles.len() * 3, "{name}");
        // Euler characteristic: vertices plus faces are edges plus 2, or equal to edges with one hole.
        assert_eq!(mesh.positions.len() + mesh.triangles.len(), topology.edges().len() + euler, "{name}");
        assert_eq!(topology.vertex_count(), mesh.positions.len());
        assert_eq!(topology.triangles(), &mesh.triangles[..]);
        assert_eq!(topology.components().1, 1);
    }
}

#[test]
fn a_sheet_is_open_along_its_border() {
    let mesh = grid(7, 4, 1.0, 1.0, Diagonals::Alternating);
    let topology = topology(&mesh);
    assert_eq!(topology.report(), TopologyReport { boundary_edges: 2 * (7 + 4), ..closed_report() });
    assert!(!topology.is_closed());
    assert_eq!(topology.edges().len(), 7 * 5 + 8 * 4 + 7 * 4, "across, along, and diagonals");
}

#[test]
fn welding_restores_the_adjacency_of_a_mesh_with_split_vertices() {
    for mesh in [icosphere(1, 1.0), cuboid([1.0; 3], 2), torus(1.0, 0.3, 9, 6)] {
        let (whole, split) = (topology(&mesh), duplicate_vertices(&mesh));
        let welded = topology(&split);
        assert_eq!(welded.report().welded_vertices, split.positions.len() - mesh.positions.len());
        assert!(welded.is_closed());
        assert_eq!(welded.edges().len(), whole.edges().len());
        assert_eq!(welded.triangles(), &split.triangles[..], "the caller's vertex numbers stay");
        let reference = circumsphere_truth::exact_weld(
            &positions(&split).iter().map(|position| position.as_dvec3()).collect::<Vec<_>>(),
        );
        assert_eq!(welded.weld(), &reference[..]);
        for (own, corners) in welded.welded_triangles().iter().zip(&split.triangles) {
            for k in 0..3 {
                assert_eq!(own[k], reference[corners[k] as usize]);
            }
        }
        for a in 0..mesh.triangles.len() as u32 {
            for b in 0..mesh.triangles.len() as u32 {
                let expected = mesh.triangles[a as usize].iter().any(|v| mesh.triangles[b as usize].contains(v));
                assert_eq!(welded.share_vertex(TriangleId(a), TriangleId(b)), expected);
                assert_eq!(whole.share_vertex(TriangleId(a), TriangleId(b)), expected);
            }
        }
        assert_eq!(welded.components().1, 1);
    }
}

#[test]
fn zero_is_one_place_whatever_its_sign() {
    let points = [Vec3::new(0.0, 1.0, 0.0), Vec3::X, Vec3::Z, Vec3::new(-0.0, 1.0, -0.0), Vec3::X * 1.000_000_1];
    let topology = SurfaceTopology::new(&points, &[[0, 1, 2], [3, 2, 4]]).expect("valid");
    assert_eq!(topology.weld(), [0, 1, 2, 0, 4], "only equal positions are welded, not near ones");
    assert_eq!(topology.report().welded_vertices, 1);
    assert_eq!(topology.report().boundary_edges, 4);
    assert_eq!(topology.triangles_of_vertex(VertexId(3)), [0, 1]);
}

#[test]
fn unusual_meshes_are_reported_as_what_they_are() {
    let points: Vec<Vec3> = (0..8).map(|k| Vec3::new(k as f32, (k * k) as f32, (k % 3) as f32)).collect();
    let report = |triangles: &[[u32; 3]]| SurfaceTopology::new(&points, triangles).expect("valid").report();
    // A fan of three pages on one edge.
    let fan = report(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
    assert_eq!(fan, TopologyReport { boundary_edges: 6, non_manifold_edges: 1, ..closed_report() });
    // Two neighbors, one with reversed winding.
    let flipped = report(&[[0, 1, 2], [0, 1, 3]]);
    assert_eq!(flipped, TopologyReport { boundary_edges: 4, inconsistent_edges: 1, ..closed_report() });
    // A repeated index makes a triangle with a single edge that is used twice.
    let collapsed = report(&[[0, 1, 1]]);
    assert_eq!(collapsed.collapsed_triangles, 1);
    assert_eq!(report(&[[2, 2, 2]]).collapsed_triangles, 1);
    // The same triangle twice.
    let doubled = report(&[[0, 1, 2], [0, 1, 2]]);
    assert_eq!(doubled, TopologyReport { inconsistent_edges: 3, ..closed_report() });
    assert_eq!(report(&[[0, 1, 2], [2, 1, 0]]), closed_report(), "a pillow without height");

    let mut mesh = icosphere(1, 1.0);
    mesh.triangles[7].swap(0, 1);
    let topology = topology(&mesh);
    assert_eq!(topology.report(), TopologyReport { inconsistent_edges: 3, ..closed_report() });
    assert!(!topology.is_closed());
}

/// Edges and incidence against a map built by hand.
#[test]
fn edges_and_incidence_equal_a_plain_map() {
    let mut random = Random::new(1);
    let mut meshes = vec![
        icosphere(2, 1.0),
        cuboid([1.0; 3], 3),
        grid(5, 9, 1.0, 1.0, Diagonals::Uniform),
        duplicate_vertices(&torus(1.0, 0.3, 8, 6)),
        ragged_slivers(3),
        merge(&[icosphere(0, 1.0), icosphere(1, 0.5).translate([3.0, 0.0, 0.0])]),
    ];
    for _ in 0..40 {
        // Anything is allowed: repeated indices, many triangles at an edge, coincident vertices.
        let count = 3 + random.below(12);
        let positions = (0..count).map(|_| random.grid_point(1).as_vec3().to_array()).collect();
        let corner = |random: &mut Random| random.below(count) as u32;
        let triangles =
            (0..=random.below(30)).map(|_| [corner(&mut random), corner(&mut random), corner(&mut random)]).collect();
        meshes.push(Mesh { positions, triangles });
    }
    let mut non_manifold = 0;
    for mesh in &meshes {
        let topology = topology(mesh);
        let weld = |vertex: u32| {
            mesh.positions.iter().position(|&p| p == mesh.positions[vertex as usize]).expect("it is there") as u32
        };
        let mut of_edge: BTreeMap<[u32; 2], BTreeSet<u32>> = BTreeMap::new();
        let mut of_vertex: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            for k in 0..3 {
                let (from, to) = (weld(corners[k]), weld(corners[(k + 1) % 3]));
                let edge = [from.min(to), from.max(to)];
                of_edge.entry(edge).or_default().insert(triangle as u32);
                of_vertex.entry(from).or_default().insert(triangle as u32);
                assert_eq!(topology.edges()[topology.triangle_edges()[triangle][k] as usize], edge);
            }
        }
        assert_eq!(topology.edges(), of_edge.keys().copied().collect::<Vec<_>>());
        for (edge, around) in of_edge.values().enumerate() {
            let found = topology.triangles_of_edge(EdgeId(edge as u32));
            assert_eq!(found, around.iter().copied().collect::<Vec<_>>());
            non_manifold += usize::from(found.len() > 2);
        }
        for vertex in 0..mesh.positions.len() as u32 {
            let expected: Vec<u32> =
                of_vertex.get(&weld(vertex)).map(|around| around.iter().copied().collect()).unwrap_or_default();
            assert_eq!(topology.triangles_of_vertex(VertexId(vertex)), expected);
        }
        // Finds components by spreading the smallest number until nothing changes.
        let mut component: Vec<usize> = (0..mesh.triangles.len()).collect();
        loop {
            let before = component.clone();
            for around in of_vertex.values() {
                let least = around.iter().map(|&triangle| component[triangle as usize]).min().expect("not empty");
                for &triangle in around {
                    component[triangle as usize] = least;
                }
            }
            if component == before {
                break;
            }
        }
        let distinct: BTreeSet<usize> = component.iter().copied().collect();
        let (found, count) = topology.components();
        assert_eq!(count, distinct.len());
        for (triangle, least) in component.iter().enumerate() {
            let rank = distinct.iter().position(|other| other == least).expect("it is one of them");
            assert_eq!(found[triangle] as usize, rank, "numbered in the order of their first triangle");
        }
    }
    assert!(non_manifold > 20);
}

#[test]
fn the_mean_edge_counts_every_edge_once() {
    // A unit square of two triangles with one diagonal.
    let square = grid(1, 1, 1.0, 1.0, Diagonals::Uniform);
    let expected = (4.0 + 2f64.sqrt()) / 5.0;
    for mesh in [square.clone(), duplicate_vertices(&square)] {
        assert!((topology(&mesh).mean_edge_length(&positions(&mesh)) - expected).abs() < 1.0e-12);
    }
    for mesh in [icosphere(2, 1.0), ragged_slivers(1), duplicate_vertices(&cuboid([1.0, 0.2, 3.0], 2))] {
        let points = positions(&mesh);
        let exact: Vec<_> = points.iter().map(|point| point.as_dvec3()).collect();
        let expected =
            circumsphere_truth::mean_edge_length(&exact, &mesh.triangles, &circumsphere_truth::exact_weld(&exact));
        assert!((topology(&mesh).mean_edge_length(&points) - expected).abs() < 1.0e-12 * expected);
    }
    let point = SurfaceTopology::new(&[Vec3::X], &[[0, 0, 0]]).expect("valid");
    assert_eq!(point.mean_edge_length(&[Vec3::X]), 0.0);
}

#[test]
fn separate_parts_are_separate_components() {
    let parts = [
        icosphere(1, 1.0),
        torus(1.0, 0.2, 8, 5).translate([5.0, 0.0, 0.0]),
        cuboid([1.0; 3], 1).translate([0.0, 9.0, 0.0]),
    ];
    let mesh = merge(&parts);
    let mesh = topology(&mesh);
    let (components, count) = mesh.components();
    assert_eq!(count, 3);
    let expected: Vec<u32> =
        parts.iter().enumerate().flat_map(|(part, mesh)| vec![part as u32; mesh.triangles.len()]).collect();
    assert_eq!(components, expected);
    // A common vertex connects components.
    let points = [Vec3::ZERO, Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y];
    let bow = SurfaceTopology::new(&points, &[[0, 1, 2], [0, 3, 4]]).expect("valid");
    assert_eq!(bow.components(), (&[0, 0][..], 1));
}

/// A cube of six faces with separate vertices, as exporters write it. Each vertex is displaced by up to `by`.
fn cube_of_faces(by: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mesh = cuboid([0.5; 3], 1);
    let mut random = Random::new(7);
    let mut corners = Vec::new();
    for triangle in &mesh.triangles {
        corners.extend(triangle.map(|vertex| {
            let jitter = Vec3::from_array(std::array::from_fn(|_| (2.0 * random.unit() - 1.0) as f32));
            Vec3::from_array(mesh.positions[vertex as usize]) + by * jitter
        }));
    }
    let triangles = (0..mesh.triangles.len() as u32).map(|triangle| [0, 1, 2].map(|k| 3 * triangle + k)).collect();
    (corners, triangles)
}

#[test]
fn seams_that_differ_by_rounding_are_closed_within_a_distance() {
    let (corners, triangles) = cube_of_faces(1.0e-6);
    let open = SurfaceTopology::new(&corners, &triangles).expect("it is valid");
    assert!(!open.is_closed() && open.edges().len() == 36);
    let closed = SurfaceTopology::welded_within(&corners, &triangles, 1.0e-5).expect("it is valid");
    assert_eq!((closed.triangles().len(), closed.edges().len()), (12, 18));
    assert!(closed.is_closed() && closed.report().welded_vertices == 36 - 8);
    // Every corner is named by the first vertex at its place, and no vertex by a later one.
    for (vertex, &weld) in closed.weld().iter().enumerate() {
        assert!(weld as usize <= vertex && closed.weld()[weld as usize] == weld);
        assert!(corners[vertex].distance(corners[weld as usize]) < 1.0e-5);
    }
    // Far from the origin, and far below and above the size of a cell.
    for (scale, offset) in [(1.0e-3, Vec3::ZERO), (1.0e6, Vec3::ZERO), (1.0, Vec3::new(100.0, -7.0, 3.0e3))] {
        let (corners, triangles) = cube_of_faces(1.0e-4);
        let moved: Vec<Vec3> = corners.iter().map(|&corner| corner * scale + offset).collect();
        let closed = SurfaceTopology::welded_within(&moved, &triangles, 2.0e-3 * scale).expect("it is valid");
        assert!(closed.is_closed() && closed.edges().len() == 18, "{scale}, {offset}");
    }
}

#[test]
fn welding_within_a_distance_joins_what_brute_force_joins() {
    let mut random = Random::new(11);
    let mut chains = 0;
    for distance in [0.01_f32, 0.03, 0.1] {
        let positions: Vec<Vec3> = (0..400)
            .map(|_| Vec3::from_array(std::array::from_fn(|_| (2.0 * random.unit() - 1.0) as f32 * 0.3)))
            .collect();
        let triangles: Vec<[u32; 3]> = (0..398).map(|first| [first, first + 1, first + 2]).collect();
        let found = SurfaceTopology::welded_within(&positions, &triangles, distance).expect("it is valid");
        let mut expected: Vec<u32> = (0..400).collect();
        // Spreads names until nothing changes.
        loop {
            let before = expected.clone();
            for a in 0..400 {
                for b in 0..400 {
                    if positions[a].as_dvec3().distance(positions[b].as_dvec3()) <= f64::from(distance) {
                        expected[a] = expected[a].min(expected[b]);
                    }
                }
            }
            if before == expected {
                break;
            }
        }
        assert_eq!(found.weld(), expected);
        chains += expected.iter().enumerate().filter(|&(vertex, &weld)| vertex as u32 != weld).count();
    }
    assert!(chains > 100, "too few vertices are joined");
}

#[test]
fn a_distance_to_weld_within_is_checked_and_may_collapse_triangles() {
    let points = [Vec3::ZERO, Vec3::X, Vec3::Y];
    for bad in [-1.0e-6, f32::NAN, f32::INFINITY] {
        let error = SurfaceTopology::welded_within(&points, &[[0, 1, 2]], bad).unwrap_err();
        assert!(matches!(error, TopologyError::WeldDistance(_)) && error.to_string().contains("finite"), "{error}");
    }
    let zero = SurfaceTopology::welded_within(&points, &[[0, 1, 2]], 0.0).expect("0 is exact");
    assert_eq!(zero.weld(), [0, 1, 2]);
    let collapsed = SurfaceTopology::welded_within(&points, &[[0, 1, 2]], 1.0).expect("triangles may collapse");
    assert_eq!((collapsed.weld(), collapsed.report().collapsed_triangles), (&[0, 0, 0][..], 1));
}
