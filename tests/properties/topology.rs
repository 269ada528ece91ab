//! For any indices and positions, a topology gives the right typed error or correct adjacency.

use std::collections::BTreeSet;

use crate::strategies::{MOST_TRIANGLES, mesh};
use bevy_circumsphere::{
    DeformableSurface,
    geometry::{SurfaceTopology, TopologyError, TriangleId, VertexId},
    kernel::mesh::ids::EdgeId,
};
use glam::Vec3;
use proptest::prelude::*;

use crate::harness::{Count, for_all, points};

/// Positions that may coincide or be non-finite.
fn positions() -> impl Strategy<Value = Vec<Vec3>> {
    let coordinate = prop_oneof![
        6 => (-2i8..3).prop_map(f32::from),
        2 => Just(-0.0),
        2 => any::<f32>(),
        1 => any::<u32>().prop_map(f32::from_bits),
    ];
    let any = prop::collection::vec(prop::array::uniform3(coordinate), 0..20);
    let finite = prop::collection::vec(prop::array::uniform3((-2i8..3).prop_map(f32::from)), 1..20);
    prop_oneof![any, finite].prop_map(|points| points.into_iter().map(Vec3::from_array).collect())
}

/// Triangles of up to `count` vertices, sometimes with an index out of range.
fn triangles(count: u32) -> impl Strategy<Value = Vec<[u32; 3]>> {
    let index = prop_oneof![200 => 0..count.max(1), 1 => Just(count), 1 => any::<u32>()];
    prop::collection::vec(prop::array::uniform3(index), 0..30)
}

#[test]
fn any_indices_and_positions_give_the_right_error_or_a_valid_topology() {
    let (valid, refused) = (Count::default(), Count::default());
    let case = positions().prop_flat_map(|positions| {
        let count = positions.len() as u32;
        (Just(positions), triangles(count))
    });
    for_all(file!(), 20_000, case, |(positions, triangles)| {
        let out_of_range = |vertex: &u32| *vertex as usize >= positions.len();
        match SurfaceTopology::new(&positions, &triangles) {
            Ok(topology) => {
                assert!(!triangles.is_empty() && !triangles.iter().flatten().any(out_of_range));
                assert!(positions.iter().all(|position| position.is_finite()));
                assert_valid(&topology, &positions, &triangles);
                valid.add(1);
            }
            Err(error) => {
                assert!(DeformableSurface::from_mesh(&positions, &triangles).is_err());
                refused.add(1);
                match error {
                    TopologyError::NoTriangles => assert!(triangles.is_empty()),
                    TopologyError::VertexOutOfRange { triangle, vertex, vertices } => {
                        assert!(triangles[triangle].contains(&vertex) && out_of_range(&vertex));
                        assert_eq!(vertices, positions.len());
                    }
                    TopologyError::NonFinitePosition { vertex, position } => {
                        assert!(!position.is_finite());
                        assert_eq!(
                            positions[vertex].to_array().map(f32::to_bits),
                            position.to_array().map(f32::to_bits)
                        );
                    }
                    TopologyError::TooLarge { .. } => panic!("{} positions must be accepted", positions.len()),
                    TopologyError::WeldDistance(distance) => panic!("no weld distance was set: {distance}"),
                    TopologyError::Weld { .. } => panic!("no weld was given: {error}"),
                }
            }
        }
    });
    valid.assert_at_least(4_000, "valid topologies");
    refused.assert_at_least(4_000, "rejected topologies");
}

#[test]
fn adjacency_is_that_of_the_definition_for_any_mesh() {
    let flaws = Count::default();
    for_all(file!(), 2000, mesh(), |mesh| {
        assert!(mesh.triangles.len() <= MOST_TRIANGLES, "{} triangles", mesh.triangles.len());
        let positions = points(&mesh);
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("it is valid");
        assert_valid(&topology, &positions, &mesh.triangles);
        flaws.add(usize::from(!topology.is_closed()));
    });
    flaws.assert_at_least(1000, "meshes that are not closed");
}

/// Compares with a brute-force search over all triangles.
fn assert_valid(topology: &SurfaceTopology, positions: &[Vec3], triangles: &[[u32; 3]]) {
    assert_eq!(topology.triangles(), triangles);
    assert_eq!(topology.vertex_count(), positions.len());
    let first_at = |vertex: u32| positions.iter().position(|other| *other == positions[vertex as usize]);
    for (vertex, &to) in (0..).zip(topology.weld()) {
        assert_eq!(Some(to as usize), first_at(vertex), "vertex {vertex} is welded to {to}");
    }
    let welded: Vec<[u32; 3]> =
        triangles.iter().map(|corners| corners.map(|vertex| topology.weld()[vertex as usize])).collect();
    assert_eq!(topology.welded_triangles(), welded);
    let side = |corners: &[u32; 3], k: usize| {
        let (from, to) = (corners[k], corners[(k + 1) % 3]);
        [from.min(to), from.max(to)]
    };
    let edges: BTreeSet<[u32; 2]> = welded.iter().flat_map(|corners| (0..3).map(|k| side(corners, k))).collect();
    assert!(topology.edges().iter().eq(&edges), "the edges are {:?}", topology.edges());
    let around = |holds: &dyn Fn(&[u32; 3]) -> bool| -> Vec<u32> {
        (0..).zip(&welded).filter(|(_, corners)| holds(corners)).map(|(triangle, _)| triangle).collect()
    };
    for (number, edge) in (0..).zip(&edges) {
        let expected = around(&|corners| (0..3).any(|k| side(corners, k) == *edge));
        assert_eq!(topology.triangles_of_edge(EdgeId(number)), expected);
    }
    for (vertex, welded) in (0..).zip(topology.weld()) {
        assert_eq!(topology.triangles_of_vertex(VertexId(vertex)), around(&|corners| corners.contains(welded)));
    }
    for (triangle, own) in topology.triangle_edges().iter().enumerate() {
        let sides = own.map(|edge| topology.edges()[edge as usize]);
        assert_eq!(sides, [0, 1, 2].map(|k| side(&welded[triangle], k)));
    }
    let boundary = edges.iter().filter(|edge| edge[0] != edge[1]);
    let boundary = boundary.filter(|edge| around(&|corners| (0..3).any(|k| side(corners, k) == **edge)).len() == 1);
    assert_eq!(topology.report().boundary_edges, boundary.count());
    for (first, a) in (0..).zip(&welded).take(12) {
        for (second, b) in (0..).zip(&welded) {
            let shared = a.iter().any(|vertex| b.contains(vertex));
            assert_eq!(topology.share_vertex(TriangleId(first), TriangleId(second)), shared);
        }
    }
}
