//! What the response or the game has moved is written to the mesh.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_asset::{Assets, Handle};
use bevy_circumsphere::{
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_ecs::prelude::*;
use bevy_mesh::{Mesh, Mesh3d, VertexAttributeValues, morph::MeshMorphWeights, skinning::SkinnedMesh};
use bevy_time::Time;
use bevy_transform::components::Transform;
use glam::Vec3;

use crate::world::{THIN, app, changes, count_changes, floor, indexed, points, positions, sheet, spawn, status};

fn handle(app: &App, entity: Entity) -> Handle<Mesh> {
    app.world().get::<Mesh3d>(entity).expect("it has one").0.clone()
}

fn attribute(app: &App, entity: Entity, name: bevy_mesh::MeshVertexAttribute) -> Vec<Vec3> {
    let mesh = app.world().resource::<Assets<Mesh>>().get(&handle(app, entity)).expect("it is there");
    let Some(VertexAttributeValues::Float32x3(values)) = mesh.attribute(name) else { panic!("no {name:?}") };
    values.iter().copied().map(Vec3::from_array).collect()
}

fn move_vertex(app: &mut App, entity: Entity, height: f32) {
    app.world_mut().get_mut::<SurfacePositions>(entity).expect("it is a surface").0[12].y = height;
}

#[derive(Resource, Default)]
struct Heard(Vec<(Entity, SurfaceMeshError)>);

/// An app that also keeps what could not be written.
fn listening() -> App {
    let mut app = app();
    app.init_resource::<Heard>().add_observer(|on: On<SurfaceMeshNotWritten>, mut heard: ResMut<Heard>| {
        heard.0.push((on.entity, on.reason.clone()));
    });
    count_changes(&mut app);
    app
}

fn heard(app: &mut App) -> Vec<(Entity, SurfaceMeshError)> {
    std::mem::take(&mut app.world_mut().resource_mut::<Heard>().0)
}

/// The asset events of a frame are counted in the next one.
fn settle(app: &mut App) {
    app.update();
    app.update();
    changes(app);
}

#[test]
fn a_cloth_that_falls_is_written_until_it_rests() {
    let mut app = app();
    app.add_plugins(XpbdResponsePlugin::new(PostUpdate)).init_resource::<Time>();
    count_changes(&mut app);
    floor(&mut app);
    let mut cloth = sheet();
    for position in &mut cloth.positions {
        position[1] += 0.6;
    }
    let entity = spawn(&mut app, indexed(&cloth), (THIN, WriteSurfaceToMesh::default()));
    let asset = handle(&app, entity);
    app.update();
    let surface = app.world().get::<DeformableSurface>(entity).expect("it is a surface").clone();
    let body = XpbdBody::new(&surface, &SurfacePositions(positions(&app, entity)), XpbdMaterial::CLOTH);
    app.world_mut().entity_mut(entity).insert(body.expect("it is valid"));
    for _ in 0..20 {
        app.world_mut().resource_mut::<Time>().advance_by(Duration::from_millis(16));
        app.update();
        assert_eq!(attribute(&app, entity, Mesh::ATTRIBUTE_POSITION), positions(&app, entity));
    }
    let fallen = points(&cloth).iter().zip(positions(&app, entity)).all(|(start, now)| now.y < start.y - 0.1);
    assert!(fallen, "it falls");
    let (modified, changed) = changes(&mut app);
    assert!((19..=20).contains(&modified) && (20..=22).contains(&changed), "once a tick: {modified} {changed}");
    for _ in 0..200 {
        app.world_mut().resource_mut::<Time>().advance_by(Duration::from_millis(16));
        app.update();
    }
    changes(&mut app);
    for _ in 0..20 {
        app.world_mut().resource_mut::<Time>().advance_by(Duration::from_millis(16));
        app.update();
    }
    assert_eq!(changes(&mut app).0, 0, "it sleeps");
    assert_eq!(attribute(&app, entity, Mesh::ATTRIBUTE_POSITION), positions(&app, entity));
    assert_eq!(handle(&app, entity), asset, "no new asset");
    assert_eq!(app.world().resource::<Assets<Mesh>>().len(), 1);
    for normal in attribute(&app, entity, Mesh::ATTRIBUTE_NORMAL) {
        assert!((normal.length() - 1.0).abs() < 1.0e-6 && normal.y.abs() > 0.5, "{normal}");
    }
}

#[test]
fn nothing_is_written_unless_something_else_than_the_mesh_moves_the_surface() {
    let mut app = listening();
    let entity = spawn(&mut app, indexed(&sheet()), (THIN, WriteSurfaceToMesh::default()));
    settle(&mut app);
    app.update();
    assert_eq!(changes(&mut app), (0, 0));
    // The mesh moves.
    let mesh = handle(&app, entity);
    let mut raised = points(&sheet());
    raised[3].y = 0.5;
    let values: Vec<[f32; 3]> = raised.iter().map(Vec3::to_array).collect();
    let mut meshes = app.world_mut().resource_mut::<Assets<Mesh>>();
    meshes.get_mut(&mesh).expect("it is there").insert_attribute(Mesh::ATTRIBUTE_POSITION, values);
    app.update();
    app.update();
    assert_eq!(changes(&mut app), (1, 1), "the game's own change, and the read of it");
    assert_eq!(positions(&app, entity), raised);
    // The surface moves.
    move_vertex(&mut app, entity, 0.25);
    app.update();
    app.update();
    assert_eq!(changes(&mut app), (1, 1), "the game's own change, and the write of it");
    raised[12].y = 0.25;
    assert_eq!(attribute(&app, entity, Mesh::ATTRIBUTE_POSITION), raised);
    // A change that changes nothing.
    app.world_mut().get_mut::<SurfacePositions>(entity).expect("it is a surface").set_changed();
    app.update();
    app.update();
    assert_eq!(changes(&mut app), (0, 1));
    // While it is paused or quarantined, it is not written.
    app.world_mut().entity_mut(entity).insert(SurfaceDisabled);
    move_vertex(&mut app, entity, 0.75);
    app.update();
    app.world_mut().entity_mut(entity).remove::<SurfaceDisabled>();
    app.world_mut().get_mut::<SurfacePositions>(entity).expect("it is a surface").0[0].x = f32::NAN;
    app.update();
    assert_eq!(attribute(&app, entity, Mesh::ATTRIBUTE_POSITION), raised);
    assert!(matches!(status(&app, entity), SurfaceStatus::Quarantined(_)));
    assert!(heard(&mut app).is_empty());
}

#[test]
fn normals_follow_the_positions() {
    let mut app = listening();
    let entity = spawn(&mut app, indexed(&sheet()), (THIN, WriteSurfaceToMesh::default()));
    app.update();
    // Turned on its side.
    for position in &mut app.world_mut().get_mut::<SurfacePositions>(entity).expect("it is a surface").0 {
        *position = Vec3::new(-position.y, position.x, position.z);
    }
    app.update();
    for normal in attribute(&app, entity, Mesh::ATTRIBUTE_NORMAL) {
        assert!(normal.distance(Vec3::NEG_X) < 0.2, "{normal}");
    }
    // A mesh without normals gets none.
    let mut bare = indexed(&sheet());
    bare.remove_attribute(Mesh::ATTRIBUTE_NORMAL);
    let bare = spawn(&mut app, bare, (THIN, WriteSurfaceToMesh::default()));
    app.update();
    move_vertex(&mut app, bare, 0.5);
    app.update();
    let mesh = app.world().resource::<Assets<Mesh>>().get(&handle(&app, bare)).expect("it is there");
    assert!(!mesh.contains_attribute(Mesh::ATTRIBUTE_NORMAL));
    assert_eq!(attribute(&app, bare, Mesh::ATTRIBUTE_POSITION)[12].y, 0.5);
}

#[test]
fn a_mesh_that_others_draw_is_not_written_until_the_entity_has_its_own() {
    let mut app = listening();
    let entity = spawn(&mut app, indexed(&sheet()), (THIN, WriteSurfaceToMesh::default()));
    let mesh = Mesh3d(handle(&app, entity));
    let drawn = app.world_mut().spawn((mesh, Transform::default())).id();
    settle(&mut app);
    move_vertex(&mut app, entity, 0.5);
    for _ in 0..3 {
        app.update();
    }
    assert_eq!(heard(&mut app), [(entity, SurfaceMeshError::Shared(drawn))], "once");
    assert_eq!(attribute(&app, entity, Mesh::ATTRIBUTE_POSITION), points(&sheet()));
    let copy = app.world().resource::<Assets<Mesh>>().get(&handle(&app, entity)).expect("it is there").clone();
    let copy = crate::world::add(&mut app, copy);
    app.world_mut().entity_mut(drawn).insert(copy);
    app.update();
    assert_eq!(attribute(&app, entity, Mesh::ATTRIBUTE_POSITION)[12].y, 0.5);
    assert_eq!(attribute(&app, drawn, Mesh::ATTRIBUTE_POSITION), points(&sheet()));

    // Two that both want to write.
    let mesh = Mesh3d(handle(&app, entity));
    let other = app.world_mut().spawn((mesh, WriteSurfaceToMesh::default())).id();
    app.update();
    move_vertex(&mut app, entity, 0.75);
    move_vertex(&mut app, other, 0.25);
    app.update();
    let mut found = heard(&mut app);
    found.sort_by_key(|(entity, _)| *entity);
    let mut expected = vec![(entity, SurfaceMeshError::Shared(other)), (other, SurfaceMeshError::Shared(entity))];
    expected.sort_by_key(|(entity, _)| *entity);
    assert_eq!(found, expected);
}

#[test]
fn meshes_that_are_deformed_when_drawn_or_gone_are_not_written() {
    let mut app = listening();
    let entity = spawn(&mut app, indexed(&sheet()), (THIN, WriteSurfaceToMesh::default()));
    app.update();
    app.world_mut().entity_mut(entity).insert(MeshMorphWeights::Value { weights: Vec::new() });
    move_vertex(&mut app, entity, 0.5);
    app.update();
    assert_eq!(heard(&mut app), [(entity, SurfaceMeshError::Deformed)]);
    app.world_mut().entity_mut(entity).remove::<MeshMorphWeights>();
    app.update();
    assert!(heard(&mut app).is_empty());
    assert_eq!(attribute(&app, entity, Mesh::ATTRIBUTE_POSITION)[12].y, 0.5);
    assert!(app.world().get::<SkinnedMesh>(entity).is_none());

    // The renderer takes the data of a mesh without MAIN_WORLD.
    let mesh = handle(&app, entity);
    app.world_mut()
        .resource_mut::<Assets<Mesh>>()
        .get_mut_untracked(&mesh)
        .expect("it is there")
        .take_gpu_data()
        .expect("data");
    move_vertex(&mut app, entity, 0.25);
    for _ in 0..3 {
        app.update();
    }
    let found = heard(&mut app);
    assert_eq!(found, [(entity, SurfaceMeshError::OnlyInRenderWorld)]);
    assert!(found[0].1.to_string().contains("RenderAssetUsages::MAIN_WORLD"));
    assert_eq!(status(&app, entity), SurfaceStatus::Active, "contacts go on");
}
