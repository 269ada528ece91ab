//! Pointers over surfaces that deform.

use bevy_app::prelude::*;
use bevy_camera::{
    Camera,
    visibility::{InheritedVisibility, RenderLayers},
};
use bevy_circumsphere::{RayHit, SurfacePickingPlugin, prelude::*};
use bevy_ecs::prelude::*;
use bevy_math::Dir3;
use bevy_picking::{
    Pickable,
    backend::{
        PointerHits,
        ray::{RayId, RayMap},
    },
    pointer::PointerId,
};
use bevy_shape::Ray3d;
use circumsphere_support::scenes::{Diagonals, grid};
use glam::Vec3;

#[derive(Resource, Default)]
struct Heard(Vec<PointerHits>);

/// An app with a camera at a height of 5 that looks down at the origin.
fn app() -> (App, Entity) {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), SurfacePickingPlugin));
    app.add_message::<PointerHits>().init_resource::<RayMap>().init_resource::<Heard>();
    app.add_systems(Last, |mut hits: MessageReader<PointerHits>, mut heard: ResMut<Heard>| {
        heard.0.extend(hits.read().cloned());
    });
    app.finish();
    app.cleanup();
    let camera = app.world_mut().spawn(Camera { order: 3, ..Camera::default() }).id();
    let ray = Ray3d { origin: Vec3::new(0.1, 5.0, 0.2), direction: Dir3::NEG_Y };
    app.world_mut().resource_mut::<RayMap>().map.insert(RayId::new(camera, PointerId::Mouse), ray);
    (app, camera)
}

fn sheet(app: &mut App, height: f32, extra: impl Bundle) -> Entity {
    let sheet = grid(4, 4, 2.0, 2.0, Diagonals::Uniform);
    let positions: Vec<Vec3> = sheet.positions.iter().map(|&[x, y, z]| Vec3::new(x, y + height, z)).collect();
    let (surface, positions) = DeformableSurface::from_mesh(&positions, &sheet.triangles).expect("it is valid");
    app.world_mut().spawn((surface, positions, extra)).id()
}

/// The entities that the pointer hits, with the heights where it does.
fn picked(app: &mut App) -> Vec<(Entity, f32)> {
    // Pointers see what the update before has detected.
    app.update();
    app.world_mut().resource_mut::<Heard>().0.clear();
    app.update();
    let heard = &app.world().resource::<Heard>().0;
    heard
        .iter()
        .flat_map(|hits| &hits.picks)
        .map(|(entity, data)| (*entity, data.position.expect("it has one").y))
        .collect()
}

#[test]
fn the_nearest_surface_is_hit_where_it_is_deformed_to() {
    let (mut app, camera) = app();
    let lower = sheet(&mut app, 0.0, ());
    let upper = sheet(&mut app, 1.0, ());
    assert_eq!(picked(&mut app), [(upper, 1.0)]);
    let heard = &app.world().resource::<Heard>().0;
    let (_, data) = &heard[0].picks[0];
    assert_eq!((heard[0].pointer, heard[0].order, data.camera, data.depth), (PointerId::Mouse, 3.0, camera, 4.0));
    let hit: &RayHit = data.extra_as().expect("a hit of the query");
    assert!(hit.triangle.is_some() && hit.entity == upper && data.normal.expect("it has one").y.abs() == 1.0);
    // It sags below the other.
    let mut positions = app.world_mut().get_mut::<SurfacePositions>(upper).expect("it is a surface");
    for position in &mut positions.0 {
        position.y = -0.5;
    }
    assert_eq!(picked(&mut app), [(lower, 0.0)]);
    app.world_mut().entity_mut(lower).insert(SurfaceDisabled);
    assert_eq!(picked(&mut app), [(upper, -0.5)]);
}

#[test]
fn what_cannot_be_picked_is_passed_through() {
    let (mut app, camera) = app();
    let lower = sheet(&mut app, 0.0, ());
    let upper = sheet(&mut app, 1.0, Pickable { should_block_lower: false, is_hoverable: true });
    assert_eq!(picked(&mut app), [(upper, 1.0), (lower, 0.0)]);
    app.world_mut().entity_mut(upper).insert(Pickable::IGNORE);
    assert_eq!(picked(&mut app), [(lower, 0.0)]);
    app.world_mut().entity_mut(upper).remove::<Pickable>().insert(RenderLayers::layer(2));
    assert_eq!(picked(&mut app), [(lower, 0.0)]);
    app.world_mut().entity_mut(camera).insert(RenderLayers::layer(2));
    assert_eq!(picked(&mut app), [(upper, 1.0)]);
    app.world_mut().entity_mut(upper).insert(InheritedVisibility::HIDDEN);
    assert_eq!(picked(&mut app), []);
    app.world_mut().entity_mut(upper).insert(InheritedVisibility::VISIBLE);
    assert_eq!(picked(&mut app), [(upper, 1.0)]);
    app.world_mut().despawn(camera);
    assert_eq!(picked(&mut app), []);
}
