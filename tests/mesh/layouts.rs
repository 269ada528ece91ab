//! The same triangles in every layout that a mesh may have, and what is refused.

use bevy_app::prelude::*;
use bevy_circumsphere::{geometry::VertexId, prelude::*};
use bevy_ecs::prelude::*;
use bevy_mesh::{Indices, Mesh, PrimitiveTopology, VertexFormat};
use glam::Vec3;

use crate::world::{
    THIN, add, app, contacts_of, empty, failure, floor, indexed, points, positions, sheet, spawn, status,
};

/// The sheet as a strip: all rows in one, with triangles between rows that name a vertex twice, or with restarts.
fn strip(with_restarts: bool) -> (Vec<[f32; 3]>, Vec<u32>) {
    let sheet = sheet();
    let row = 5;
    let mut indices: Vec<u32> = Vec::new();
    for start in (0..4).map(|line| line * row) {
        let corners: Vec<u32> = (start..start + row).flat_map(|vertex| [vertex, vertex + row]).collect();
        if with_restarts && !indices.is_empty() {
            indices.push(u32::MAX);
        } else if let Some(&last) = indices.last() {
            indices.extend([last, corners[0]]);
        }
        indices.extend(corners);
    }
    (sheet.positions, indices)
}

/// The triangles of a surface as sorted lists of corners, in the order in which they turn.
fn corners(app: &App, entity: Entity) -> Vec<[[u32; 3]; 3]> {
    let positions = positions(app, entity);
    let surface = app.world().get::<DeformableSurface>(entity).expect("it is a surface");
    let triangles = surface.topology().triangles().iter().map(|triangle| {
        let mut corners = triangle.map(|vertex| positions[vertex as usize].to_array().map(f32::to_bits));
        let least = (0..3).min_by_key(|&corner| corners[corner]).expect("three");
        corners.rotate_left(least);
        corners
    });
    let mut triangles: Vec<_> = triangles.collect();
    triangles.sort_unstable();
    triangles
}

#[test]
fn lists_give_the_contacts_of_a_surface_made_by_hand() {
    let sheet = sheet();
    let u16_indices = Indices::U16(sheet.triangles.as_flattened().iter().map(|&index| index as u16).collect());
    let unindexed: Vec<[f32; 3]> =
        sheet.triangles.as_flattened().iter().map(|&index| sheet.positions[index as usize]).collect();
    let mut expected = app();
    floor(&mut expected);
    let surface = DeformableSurface::from_mesh(&points(&sheet), &sheet.triangles).expect("it is valid");
    let by_hand = expected.world_mut().spawn((surface, THIN)).id();
    expected.update();
    let expected_contacts = contacts_of(&mut expected, by_hand);
    assert!(expected_contacts.len() >= 25, "every vertex touches the floor: {}", expected_contacts.len());

    for (name, mesh) in [
        ("u32", indexed(&sheet)),
        ("u16", indexed(&sheet).with_inserted_indices(u16_indices)),
        (
            "unindexed",
            empty(PrimitiveTopology::TriangleList).with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, unindexed),
        ),
    ] {
        let mut app = app();
        floor(&mut app);
        let entity = spawn(&mut app, mesh, THIN);
        app.update();
        assert_eq!(corners(&app, entity), corners(&expected, by_hand), "{name}");
        assert_eq!(contacts_of(&mut app, entity), expected_contacts, "{name}");
        let [found, by_hand] = [(&app, entity), (&expected, by_hand)].map(|(app, entity)| {
            let surface = app.world().get::<DeformableSurface>(entity).expect("it is a surface");
            (surface.topology().edges().len(), surface.mean_edge())
        });
        assert_eq!(found, by_hand, "{name}: welded vertices connect");
    }
}

#[test]
fn strips_turn_every_second_triangle_and_leave_out_those_between_rows() {
    for with_restarts in [false, true] {
        let (positions, indices) = strip(with_restarts);
        let expected = {
            // As a graphics card assembles it.
            let mut triangles = Vec::new();
            for strip in indices.split(|&index| index == u32::MAX) {
                for (number, window) in strip.windows(3).enumerate() {
                    let swapped = if number % 2 == 0 { [0, 1, 2] } else { [1, 0, 2] };
                    let [a, b, c] = swapped.map(|corner| window[corner]);
                    if a != b && b != c && c != a {
                        triangles.push([a, b, c]);
                    }
                }
            }
            triangles
        };
        assert_eq!(expected.len(), 32);
        for indices in [
            Indices::U32(indices.clone()),
            Indices::U16(
                indices.iter().map(|&index| if index == u32::MAX { u16::MAX } else { index as u16 }).collect(),
            ),
        ] {
            let mut app = app();
            floor(&mut app);
            let mesh = empty(PrimitiveTopology::TriangleStrip)
                .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions.clone())
                .with_inserted_indices(indices);
            let entity = spawn(&mut app, mesh, THIN);
            app.update();
            let surface = app.world().get::<DeformableSurface>(entity).expect("it is a surface");
            assert_eq!(surface.topology().triangles(), expected);
            assert_eq!(surface.topology().report().inconsistent_edges, 0);
            // All triangles face the same side.
            let facing = expected.iter().map(|triangle| {
                let [a, b, c] = triangle.map(|vertex| Vec3::from_array(positions[vertex as usize]));
                (b - a).cross(c - a).y.signum()
            });
            assert!(facing.clone().all(|side| side == facing.clone().next().expect("one")));
            assert!(contacts_of(&mut app, entity).len() >= 25);
        }
    }
}

#[test]
fn unindexed_strips_are_read_in_order() {
    let mut app = app();
    let corners = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0]];
    let mesh = empty(PrimitiveTopology::TriangleStrip).with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, corners);
    let entity = spawn(&mut app, mesh, ());
    app.update();
    let surface = app.world().get::<DeformableSurface>(entity).expect("it is a surface");
    assert_eq!(surface.topology().triangles(), [[0, 1, 2], [2, 1, 3]]);
}

#[test]
fn vertices_are_welded_exactly_or_within_a_distance_and_the_map_is_kept() {
    // Two triangles with a seam that rounding has opened at one end.
    let corners = vec![
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.000_001, 0.0, 0.0],
        [1.0, 0.0, 1.0],
        [0.0, 0.0, 1.0],
    ];
    for (distance, weld, edges) in [(0.0, [0, 1, 2, 3, 4, 2], 6), (1.0e-5, [0, 1, 2, 1, 4, 2], 5)] {
        let mut app = app();
        let mesh =
            empty(PrimitiveTopology::TriangleList).with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, corners.clone());
        let mesh = add(&mut app, mesh);
        let entity = app.world_mut().spawn((mesh, SurfaceFromMesh::default().weld_within(distance))).id();
        app.update();
        let topology = app.world().get::<DeformableSurface>(entity).expect("it is a surface").topology().clone();
        assert_eq!(topology.weld(), weld, "{distance}");
        assert_eq!(topology.edges().len(), edges, "{distance}");
        assert_eq!(topology.triangles(), [[0, 1, 2], [3, 4, 5]], "vertices keep their numbers");
        assert_eq!(positions(&app, entity).len(), 6);
        assert!(topology.share_vertex(TriangleId(0), TriangleId(1)));
        assert_eq!(topology.triangles_of_vertex(VertexId(5)), [0, 1]);
    }
}

#[test]
fn entities_with_one_mesh_share_its_topology() {
    let mut app = app();
    let mesh = add(&mut app, indexed(&sheet()));
    let [one, other, welded] = [0.0, 0.0, 1.0e-6]
        .map(|distance| app.world_mut().spawn((mesh.clone(), SurfaceFromMesh::default().weld_within(distance))).id());
    app.update();
    let topology = |entity| app.world().get::<DeformableSurface>(entity).expect("it is a surface").topology().as_ref();
    assert!(std::ptr::eq(topology(one), topology(other)));
    assert!(!std::ptr::eq(topology(one), topology(welded)));
}

#[test]
fn what_cannot_be_a_surface_is_quarantined_with_a_message_that_says_what_to_do() {
    let triangle = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let positions = |topology| empty(topology).with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, triangle.clone());
    let mut extracted = positions(PrimitiveTopology::TriangleList);
    extracted.take_gpu_data().expect("it has data");
    let mut compressed = positions(PrimitiveTopology::TriangleList);
    compressed.compress_positions().expect("it can be compressed");
    let cases = [
        (
            positions(PrimitiveTopology::LineList),
            SurfaceMeshError::Topology(PrimitiveTopology::LineList),
            "TriangleList or a TriangleStrip",
        ),
        (
            positions(PrimitiveTopology::PointList),
            SurfaceMeshError::Topology(PrimitiveTopology::PointList),
            "TriangleList or a TriangleStrip",
        ),
        (empty(PrimitiveTopology::TriangleList), SurfaceMeshError::NoPositions, "Vertex_Position"),
        (extracted, SurfaceMeshError::OnlyInRenderWorld, "RenderAssetUsages::MAIN_WORLD"),
        (compressed, SurfaceMeshError::PositionFormat(VertexFormat::Snorm16x4), "use Float32x3"),
        (
            positions(PrimitiveTopology::TriangleList).with_inserted_indices(Indices::U32(vec![0, 1, 7])),
            SurfaceMeshError::Unusable(TopologyError::VertexOutOfRange { triangle: 0, vertex: 7, vertices: 3 }),
            "vertex 7",
        ),
        (
            positions(PrimitiveTopology::TriangleStrip).with_inserted_indices(Indices::U32(vec![0, 1, 1])),
            SurfaceMeshError::Unusable(TopologyError::NoTriangles),
            "no triangles",
        ),
    ];
    for (mesh, expected, advice) in cases {
        let mut app = app();
        app.init_resource::<Heard>().add_observer(|on: On<SurfaceQuarantined>, mut heard: ResMut<Heard>| {
            heard.0.push((on.entity, on.reason.to_string()));
        });
        let broken = spawn(&mut app, mesh, ());
        let sound = spawn(&mut app, indexed(&sheet()), ());
        for _ in 0..3 {
            app.update();
        }
        assert_eq!(failure(&app, broken), expected);
        assert_eq!(status(&app, sound), SurfaceStatus::Active);
        let heard = &app.world().resource::<Heard>().0;
        assert_eq!(heard.len(), 1, "reported once: {heard:?}");
        assert!(heard[0].0 == broken && heard[0].1.contains(advice), "{heard:?}");
    }
}

#[derive(Resource, Default)]
struct Heard(Vec<(Entity, String)>);
