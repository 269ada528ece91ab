//! Pointers over surfaces that deform: what the backend reports, and what becomes of it in the plugins of `bevy_picking`.

use bevy_app::prelude::*;
use bevy_camera::{
    Camera, ComputedCameraValues, NormalizedRenderTarget, RenderTarget, RenderTargetInfo,
    visibility::{InheritedVisibility, RenderLayers},
};
use bevy_circumsphere::{RayHit, SurfacePickingPlugin, prelude::*};
use bevy_ecs::prelude::*;
use bevy_math::Dir3;
use bevy_picking::{
    InteractionPlugin, Pickable, PickingPlugin,
    backend::{
        PointerHits,
        ray::{RayId, RayMap},
    },
    events::{PointerClick, PointerOut, PointerOver},
    pointer::{Location, PointerAction, PointerButton, PointerId, PointerInput},
};
use bevy_shape::Ray3d;
use bevy_time::TimePlugin;
use bevy_transform::components::{GlobalTransform, Transform};
use bevy_window::{PrimaryWindow, Window};
use circumsphere_support::scenes::{Diagonals, grid};
use glam::{UVec2, Vec2, Vec3, camera::rh::proj::directx::perspective_infinite_reverse};

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

/// The pixels of a screen.
const SIZE: UVec2 = UVec2::new(800, 600);

/// What observers of a surface were told: what happened, to whom, and at which height.
#[derive(Resource, Default, Debug)]
struct Told(Vec<(&'static str, Entity, Option<f32>)>);

/// The height at which a hit of our backend is, which comes with the triangle.
fn height(hit: &bevy_picking::backend::HitData) -> Option<f32> {
    hit.extra_as::<RayHit>().map(|hit| hit.point.y)
}

/// From the input of a mouse to the observers: only what a window and a renderer would fill in is made by hand.
#[test]
fn a_mouse_hovers_over_and_clicks_on_a_surface_where_it_is_deformed_to() {
    let mut app = App::new();
    app.add_plugins((TimePlugin, PickingPlugin, InteractionPlugin, SurfacePickingPlugin));
    app.add_plugins(DeformableCollisionPlugins::new(PostUpdate));
    app.init_resource::<Told>();
    app.add_observer(|over: On<PointerOver>, mut told: ResMut<Told>| {
        told.0.push(("over", over.entity, height(&over.hit)));
    });
    app.add_observer(|out: On<PointerOut>, mut told: ResMut<Told>| told.0.push(("out", out.entity, None)));
    app.add_observer(|click: On<PointerClick>, mut told: ResMut<Told>| {
        told.0.push(("click", click.entity, height(&click.hit)));
    });
    app.finish();
    app.cleanup();
    let window = app.world_mut().spawn((Window::default(), PrimaryWindow)).id();
    // Five above the origin, looking down, and seeing 90 degrees.
    let looking = Transform::from_xyz(0.0, 5.0, 0.0).looking_at(Vec3::ZERO, Vec3::NEG_Z);
    let computed = ComputedCameraValues {
        clip_from_view: perspective_infinite_reverse(std::f32::consts::FRAC_PI_2, SIZE.x as f32 / SIZE.y as f32, 0.1),
        target_info: Some(RenderTargetInfo { physical_size: SIZE, scale_factor: 1.0 }),
        ..ComputedCameraValues::default()
    };
    let target = RenderTarget::None { size: SIZE };
    let camera = Camera { computed, ..Camera::default() };
    app.world_mut().spawn((camera, target, looking, GlobalTransform::from(looking)));
    app.world_mut().spawn(PointerId::Mouse);
    let surface = sheet(&mut app, 0.0, ());

    let act = |app: &mut App, pixel: Vec2, actions: &[PointerAction]| -> Vec<(&'static str, Entity, Option<f32>)> {
        let target = NormalizedRenderTarget::None { width: SIZE.x, height: SIZE.y };
        for &action in actions {
            let location = Location { target: target.clone(), position: pixel };
            app.world_mut().write_message(PointerInput::new(PointerId::Mouse, location, action));
        }
        app.update();
        let mut told = std::mem::take(&mut app.world_mut().resource_mut::<Told>().0);
        // The window is below everything.
        told.retain(|(_, entity, _)| *entity != window);
        told
    };
    let moved = [PointerAction::Move { delta: Vec2::ONE }];
    let clicked = [PointerAction::Press(PointerButton::Primary), PointerAction::Release(PointerButton::Primary)];
    app.update();
    // At a height of 0, a pixel is 5 / 300 wide. The sheet is 2 wide: it ends 60 pixels from the middle.
    let (middle, beside) = (Vec2::new(410.0, 290.0), Vec2::new(470.0, 300.0));
    assert_eq!(act(&mut app, beside, &moved), []);
    assert_eq!(act(&mut app, middle, &moved), [("over", surface, Some(0.0))]);
    assert_eq!(act(&mut app, middle, &clicked), [("click", surface, Some(0.0))]);
    assert_eq!(act(&mut app, beside, &moved), [("out", surface, None)]);
    assert_eq!(act(&mut app, beside, &clicked), []);
    // It rises to 2, where a pixel is 3 / 300 wide, and now reaches under the same pixel.
    for position in &mut app.world_mut().get_mut::<SurfacePositions>(surface).expect("it is a surface").0 {
        position.y = 2.0;
    }
    app.update();
    assert_eq!(act(&mut app, beside, &[]), [("over", surface, Some(2.0))]);
    assert_eq!(act(&mut app, beside, &clicked), [("click", surface, Some(2.0))]);
}

#[test]
fn without_its_partners_it_is_idle() {
    for partner in 0..3 {
        let mut app = App::new();
        app.add_plugins(SurfacePickingPlugin);
        app.add_message::<PointerHits>();
        match partner {
            0 => _ = app.init_resource::<RayMap>(),
            1 => _ = app.add_plugins(DeformableCollisionPlugins::new(Update)),
            _ => {}
        }
        app.finish();
        app.cleanup();
        app.update();
    }
}
