//! Surfaces of all meshes below a root.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::{entity_disabling::Disabled, prelude::*};
use bevy_transform::components::Transform;

use crate::world::{THIN, add, app, contacts_of, floor, indexed, sheet, status};

fn settings(method: ContactMethod) -> SurfaceFromMesh {
    let settings = SurfaceSettings { thickness: Some(THIN), method: Some(method), ..SurfaceSettings::default() };
    SurfaceFromMesh::default().with_settings(settings)
}

/// A node with a mesh below it, as in a glTF scene. The mesh entity is the second one.
fn node(app: &mut App, name: &'static str, parent: Option<Entity>) -> [Entity; 2] {
    let mesh = add(app, indexed(&sheet()));
    let node = app.world_mut().spawn((Name::new(name), Transform::default())).id();
    let primitive = app.world_mut().spawn((mesh, Name::new(format!("{name}.material")), ChildOf(node))).id();
    if let Some(parent) = parent {
        app.world_mut().entity_mut(node).insert(ChildOf(parent));
    }
    [node, primitive]
}

fn method(app: &App, entity: Entity) -> Option<ContactMethod> {
    app.world().get::<DeformableSurface>(entity)?;
    app.world().get::<ContactMethod>(entity).copied()
}

#[test]
fn meshes_below_a_root_become_surfaces_by_name() {
    let mut app = app();
    floor(&mut app);
    let hierarchy = SurfaceFromMeshHierarchy::new(settings(ContactMethod::Exact))
        .with_name("Skirt", settings(ContactMethod::Closest))
        .with_name("Body.material", settings(ContactMethod::Polygon))
        .without_name("Eyes");
    let mesh = add(&mut app, indexed(&sheet()));
    let root = app.world_mut().spawn((hierarchy, Transform::default(), mesh, Name::new("Skirt"))).id();
    let [_, body] = node(&mut app, "Body", Some(root));
    let [skirt_node, skirt] = node(&mut app, "Skirt", Some(root));
    let [_, eyes] = node(&mut app, "Eyes", Some(root));
    let [_, hem] = node(&mut app, "Hem", Some(skirt_node));
    let [outside_node, outside] = node(&mut app, "Outside", None);
    app.update();
    assert_eq!(method(&app, body), Some(ContactMethod::Polygon), "by the name of the mesh entity");
    assert_eq!(method(&app, skirt), Some(ContactMethod::Closest), "by the name of its node");
    assert_eq!(method(&app, hem), Some(ContactMethod::Closest), "by the nearest name in the list");
    assert_eq!(method(&app, eyes), None);
    assert_eq!(method(&app, outside), None);
    assert_eq!(method(&app, root), None, "only descendants");
    assert!(!contacts_of(&mut app, body).is_empty());

    // Loaded later, and moved below the root later.
    let [_, late] = node(&mut app, "Late", Some(root));
    app.world_mut().entity_mut(outside_node).insert(ChildOf(root));
    app.update();
    assert_eq!(method(&app, late), Some(ContactMethod::Exact));
    assert_eq!(method(&app, outside), Some(ContactMethod::Exact));
    // What the game has removed stays removed.
    app.world_mut().entity_mut(late).remove::<(SurfaceFromMesh, DeformableSurface)>();
    app.update();
    app.update();
    assert_eq!(method(&app, late), None);
    // With the root, everything goes.
    app.world_mut().entity_mut(root).despawn();
    app.update();
    assert!(app.world().get_entity(body).is_err());
}

#[test]
fn without_a_default_only_listed_meshes_become_surfaces() {
    let mut app = app();
    let root = app.world_mut().spawn(Transform::default()).id();
    let [_, body] = node(&mut app, "Body", Some(root));
    let [_, skirt] = node(&mut app, "Skirt", Some(root));
    app.update();
    // The component may come after the meshes.
    let hierarchy = SurfaceFromMeshHierarchy::new(None).with_name("Skirt", settings(ContactMethod::Closest));
    app.world_mut().entity_mut(root).insert(hierarchy);
    app.update();
    assert_eq!(method(&app, skirt), Some(ContactMethod::Closest));
    assert_eq!(method(&app, body), None);
    assert_eq!(status(&app, skirt), SurfaceStatus::Active);
}

#[test]
fn the_nearest_root_decides_and_components_of_the_game_stay() {
    let mut app = app();
    let outer = SurfaceFromMeshHierarchy::new(settings(ContactMethod::Exact));
    let inner = SurfaceFromMeshHierarchy::new(settings(ContactMethod::Closest));
    let outer = app.world_mut().spawn((outer, Transform::default())).id();
    let inner = app.world_mut().spawn((inner, Transform::default(), ChildOf(outer))).id();
    let [_, mesh] = node(&mut app, "Body", Some(inner));
    let [_, own] = node(&mut app, "Own", Some(inner));
    app.world_mut().entity_mut(own).insert(settings(ContactMethod::Polygon));
    app.update();
    assert_eq!(method(&app, mesh), Some(ContactMethod::Closest));
    assert_eq!(method(&app, own), Some(ContactMethod::Polygon));
}

#[test]
fn by_default_all_meshes_become_surfaces() {
    let mut app = app();
    let root = app.world_mut().spawn((SurfaceFromMeshHierarchy::default(), Transform::default())).id();
    let [_, body] = node(&mut app, "Body", Some(root));
    app.update();
    assert_eq!(status(&app, body), SurfaceStatus::Active);
}

#[test]
fn what_was_loaded_into_a_pool_becomes_a_surface_when_it_is_taken_out() {
    let mut app = app();
    // Another root, which keeps the search for meshes going.
    app.world_mut().spawn((SurfaceFromMeshHierarchy::default(), Transform::default()));
    let pooled = (SurfaceFromMeshHierarchy::default(), Transform::default(), Disabled);
    let root = app.world_mut().spawn(pooled).id();
    let [body_node, body] = node(&mut app, "Body", Some(root));
    app.world_mut().entity_mut(root).insert_recursive::<Children>(Disabled);
    app.update();
    app.update();
    assert_eq!(app.world().get::<DeformableSurface>(body).map(|_| ()), None, "it takes no part");
    for entity in [root, body_node, body] {
        app.world_mut().entity_mut(entity).remove::<Disabled>();
    }
    app.update();
    assert_eq!(status(&app, body), SurfaceStatus::Active);
}
