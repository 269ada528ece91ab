//! Surfaces follow their meshes: assets that come late, change, and go, entities that are paused and despawned.

use bevy_app::prelude::*;
use bevy_asset::{AssetPlugin, Assets};
use bevy_circumsphere::prelude::*;
use bevy_ecs::{message::MessageCursor, prelude::*};
use bevy_mesh::{Indices, Mesh, Mesh3d, MeshPlugin, VertexAttributeValues};
use bevy_time::{TimePlugin, TimeUpdateStrategy};
use bevy_transform::components::Transform;
use glam::Vec3;

use crate::world::{
    THIN, add, app, changes, contacts_of, count_changes, failure, floor, indexed, points, positions, sheet, spawn,
    status,
};

fn raise(mesh: &mut Mesh, height: f32) {
    let Some(VertexAttributeValues::Float32x3(positions)) = mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION) else {
        panic!("the mesh has positions");
    };
    for position in positions {
        position[1] += height;
    }
}

fn modify(app: &mut App, entity: Entity, modify: impl FnOnce(&mut Mesh)) {
    let mesh = app.world().get::<Mesh3d>(entity).expect("it has one").0.clone();
    let mut meshes = app.world_mut().resource_mut::<Assets<Mesh>>();
    modify(&mut meshes.get_mut(&mesh).expect("it is loaded"));
}

fn touches(app: &mut App, entity: Entity) -> bool {
    !contacts_of(app, entity).is_empty()
}

#[test]
fn a_surface_waits_for_its_mesh() {
    let mut app = app();
    floor(&mut app);
    let handle = app.world().resource::<Assets<Mesh>>().reserve_handle();
    let entity = app.world_mut().spawn((Mesh3d(handle.clone()), SurfaceFromMesh::default(), THIN)).id();
    let other = app.world_mut().spawn((SurfaceFromMesh::default(), THIN)).id();
    for _ in 0..3 {
        app.update();
        assert_eq!(status(&app, entity), SurfaceStatus::Waiting);
    }
    app.world_mut().resource_mut::<Assets<Mesh>>().insert(&handle, indexed(&sheet())).expect("reserved");
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
    assert!(touches(&mut app, entity));
    assert_eq!(status(&app, other), SurfaceStatus::Waiting, "it has no mesh");
    app.world_mut().entity_mut(other).insert(Mesh3d(handle));
    app.update();
    assert!(touches(&mut app, other));
}

#[test]
fn changed_positions_are_seen_in_the_same_tick() {
    let mut app = app();
    floor(&mut app);
    let entity = spawn(&mut app, indexed(&sheet()), THIN);
    count_changes(&mut app);
    app.update();
    assert!(touches(&mut app, entity));
    for (height, expected) in [(2.0, false), (-2.0, true), (3.0, false)] {
        modify(&mut app, entity, |mesh| raise(mesh, height));
        app.update();
        assert_eq!(touches(&mut app, entity), expected, "{height}");
    }
    let expected: Vec<Vec3> =
        points(&sheet()).iter().map(|point| *point + 2.0 * Vec3::Y - 2.0 * Vec3::Y + 3.0 * Vec3::Y).collect();
    assert_eq!(positions(&app, entity), expected);
    app.update();
    changes(&mut app);
    app.update();
    assert_eq!(changes(&mut app), (0, 0), "nothing is written while the mesh stays");
    // Another mesh changes, or this one in what a surface does not have.
    let other = spawn(&mut app, indexed(&sheet()), (THIN, Transform::from_xyz(9.0, 9.0, 0.0)));
    app.update();
    app.update();
    changes(&mut app);
    modify(&mut app, other, |mesh| raise(mesh, 1.0));
    modify(&mut app, entity, |mesh| {
        mesh.remove_attribute(Mesh::ATTRIBUTE_NORMAL);
    });
    app.update();
    assert_eq!(changes(&mut app), (2, 1));
}

#[test]
fn changed_triangles_make_the_surface_anew() {
    let mut app = app();
    floor(&mut app);
    let entity = spawn(&mut app, indexed(&sheet()), THIN);
    app.update();
    let before = contacts_of(&mut app, entity).len();
    let half = sheet().triangles[..16].as_flattened().to_vec();
    modify(&mut app, entity, |mesh| mesh.insert_indices(Indices::U32(half.clone())));
    app.update();
    let surface = app.world().get::<DeformableSurface>(entity).expect("it is a surface");
    assert_eq!(surface.topology().triangles().as_flattened(), half);
    assert!((1..before).contains(&contacts_of(&mut app, entity).len()));
    // As does another mesh, and another weld distance.
    let whole = add(&mut app, indexed(&sheet()));
    app.world_mut().entity_mut(entity).insert(whole);
    app.update();
    assert_eq!(contacts_of(&mut app, entity).len(), before);
    app.world_mut().get_mut::<SurfaceFromMesh>(entity).expect("it has one").weld_distance = 0.6;
    app.update();
    let surface = app.world().get::<DeformableSurface>(entity).expect("it is a surface");
    assert!(surface.topology().report().collapsed_triangles > 0);
    // A mesh that becomes unusable, and is repaired.
    modify(&mut app, entity, |mesh| mesh.insert_indices(Indices::U32(vec![0, 1, 99])));
    app.update();
    assert!(matches!(failure(&app, entity), SurfaceMeshError::Unusable(_)));
    assert!(contacts_of(&mut app, entity).is_empty());
    modify(&mut app, entity, |mesh| mesh.insert_indices(Indices::U32(half)));
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
}

#[test]
fn contacts_end_with_the_mesh_or_the_entity() {
    type End = fn(&mut App, Entity);
    let ends: [(&str, End, bool); 4] = [
        ("the component is removed", |app, entity| _ = app.world_mut().entity_mut(entity).remove::<Mesh3d>(), true),
        (
            "the asset is removed",
            |app, entity| {
                let mesh = app.world().get::<Mesh3d>(entity).expect("it has one").0.clone();
                app.world_mut().resource_mut::<Assets<Mesh>>().remove(&mesh).expect("it is there");
            },
            true,
        ),
        ("the surface is disabled", |app, entity| _ = app.world_mut().entity_mut(entity).insert(SurfaceDisabled), true),
        ("the entity is despawned", |app, entity| _ = app.world_mut().despawn(entity), false),
    ];
    for (name, end, stays) in ends {
        let mut app = app();
        let floor = floor(&mut app);
        let entity = spawn(&mut app, indexed(&sheet()), (THIN, ContactEventsEnabled));
        app.update();
        assert!(touches(&mut app, entity), "{name}");
        let mut cursor = MessageCursor::<SurfaceContactEnd>::default();
        end(&mut app, entity);
        app.update();
        assert!(contacts_of(&mut app, floor).is_empty(), "{name}");
        let messages = app.world().resource::<Messages<SurfaceContactEnd>>();
        assert_eq!(cursor.read(messages).count(), 1, "{name}");
        if stays {
            let expected = if name.ends_with("disabled") { SurfaceStatus::Disabled } else { SurfaceStatus::Waiting };
            assert_eq!(status(&app, entity), expected, "{name}");
            let mesh = add(&mut app, indexed(&sheet()));
            app.world_mut().entity_mut(entity).insert(mesh).remove::<SurfaceDisabled>();
            app.update();
            assert!(touches(&mut app, entity), "{name}: it comes back");
        }
    }
}

#[test]
fn a_disabled_surface_is_posed_when_it_is_enabled() {
    let mut app = app();
    floor(&mut app);
    let entity = spawn(&mut app, indexed(&sheet()), THIN);
    app.update();
    app.world_mut().entity_mut(entity).insert(SurfaceDisabled);
    modify(&mut app, entity, |mesh| raise(mesh, 1.0));
    app.update();
    assert_eq!(positions(&app, entity), points(&sheet()), "no work while it is disabled");
    app.world_mut().entity_mut(entity).remove::<SurfaceDisabled>();
    app.update();
    assert_eq!(positions(&app, entity)[0], points(&sheet())[0] + Vec3::Y);
    assert!(!touches(&mut app, entity));
}

#[test]
fn without_the_component_the_surface_stays_where_it_is() {
    let mut app = app();
    floor(&mut app);
    let entity = spawn(&mut app, indexed(&sheet()), THIN);
    app.update();
    app.world_mut().entity_mut(entity).remove::<SurfaceFromMesh>();
    modify(&mut app, entity, |mesh| raise(mesh, 1.0));
    app.update();
    assert!(touches(&mut app, entity));
    assert_eq!(positions(&app, entity), points(&sheet()));
}

#[test]
fn what_the_game_moves_is_not_moved_back() {
    let mut app = app();
    let entity = spawn(&mut app, indexed(&sheet()), THIN);
    app.update();
    app.world_mut().get_mut::<SurfacePositions>(entity).expect("it is a surface").0[3].y = 5.0;
    app.update();
    app.update();
    assert_eq!(positions(&app, entity)[3].y, 5.0);
}

#[test]
fn the_order_of_contacts_is_that_of_spawning_not_of_loading() {
    let mut app = app();
    let [first, second] = [0, 1].map(|_| app.world().resource::<Assets<Mesh>>().reserve_handle());
    let spawn = |app: &mut App, mesh: &bevy_asset::Handle<Mesh>| {
        app.world_mut().spawn((Mesh3d(mesh.clone()), SurfaceFromMesh::default(), THIN)).id()
    };
    let (a, b) = (spawn(&mut app, &first), spawn(&mut app, &second));
    app.world_mut().resource_mut::<Assets<Mesh>>().insert(&second, indexed(&sheet())).expect("reserved");
    app.update();
    app.world_mut().resource_mut::<Assets<Mesh>>().insert(&first, indexed(&sheet())).expect("reserved");
    app.update();
    let order: Vec<Entity> = app
        .world()
        .resource::<bevy_circumsphere::ActiveSurfaces>()
        .surfaces
        .iter()
        .map(|surface| surface.entity)
        .collect();
    assert_eq!(order, [a, b]);
}

#[test]
fn settings_are_inserted_when_the_surface_is_made() {
    let mut app = app();
    let settings = SurfaceSettings {
        thickness: Some(THIN),
        method: Some(ContactMethod::Closest),
        sidedness: Some(Sidedness::TwoSided),
        self_collision: true,
        contact_events: true,
        ..SurfaceSettings::default()
    };
    let layers = SurfaceLayers { memberships: 4, filters: 2 };
    let mesh = add(&mut app, indexed(&sheet()));
    let from_mesh = SurfaceFromMesh::default().with_settings(settings);
    let entity = app.world_mut().spawn((mesh, from_mesh, layers, SurfaceThickness::World(9.0))).id();
    app.update();
    let entity = app.world().entity(entity);
    assert_eq!(entity.get::<SurfaceThickness>(), Some(&THIN));
    assert_eq!(entity.get::<ContactMethod>(), Some(&ContactMethod::Closest));
    assert_eq!(entity.get::<Sidedness>(), Some(&Sidedness::TwoSided));
    assert_eq!(entity.get::<SurfaceLayers>(), Some(&layers), "what is not set stays");
    assert!(entity.contains::<SelfCollision>() && entity.contains::<ContactEventsEnabled>());
    assert!(!entity.contains::<SweptCollision>());
}

#[test]
fn an_app_without_mesh_assets_is_told_what_to_add() {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let entity = app.world_mut().spawn((Mesh3d::default(), SurfaceFromMesh::default())).id();
    app.update();
    let reason = failure(&app, entity);
    assert_eq!(reason, SurfaceMeshError::NoAssets("Mesh"));
    assert!(reason.to_string().contains("add AssetPlugin and MeshPlugin"));
    // The resource is enough, and may come later.
    app.init_resource::<Assets<Mesh>>();
    let mesh = add(&mut app, indexed(&sheet()));
    app.world_mut().entity_mut(entity).insert(mesh);
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
}

#[test]
fn plugins_may_be_added_in_any_order_and_schedule() {
    for fixed in [false, true] {
        for assets_first in [false, true] {
            let mut app = App::new();
            app.add_plugins(TaskPoolPlugin::default());
            let assets = (AssetPlugin::default(), MeshPlugin);
            if assets_first {
                app.add_plugins(assets);
            }
            if fixed {
                app.add_plugins((TimePlugin, DeformableCollisionPlugins::default()));
                app.insert_resource(TimeUpdateStrategy::FixedTimesteps(2));
            } else {
                app.add_plugins(DeformableCollisionPlugins::new(Update));
            }
            if !assets_first {
                app.add_plugins((AssetPlugin::default(), MeshPlugin));
            }
            app.finish();
            app.cleanup();
            floor(&mut app);
            let entity = spawn(&mut app, indexed(&sheet()), THIN);
            app.update();
            app.update();
            assert!(touches(&mut app, entity), "{fixed} {assets_first}");
            modify(&mut app, entity, |mesh| raise(mesh, 1.0));
            app.update();
            assert!(!touches(&mut app, entity), "{fixed} {assets_first}");
        }
    }
}
