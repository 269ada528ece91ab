//! Shapes follow the colliders of both engines, and reactions reach their bodies.

use bevy::{ecs::system::RunSystemOnce, prelude::*};
use bevy_circumsphere::{
    prelude::*,
    response::{RigidMass, XpbdBody, XpbdMaterial},
};
use circumsphere_interop::scenes::{Avian, Engine, Rapier, app_in};
use circumsphere_support::scenes::cloth;

fn app<E: Engine>() -> App {
    let mut app = app_in::<E>(FixedPostUpdate, Vec3::ZERO);
    // No time has passed yet, so nothing has run.
    app.update();
    app
}

fn run(app: &mut App, ticks: usize) {
    (0..ticks).for_each(|_| app.update());
}

/// What a ray straight down from `height` over a place hits first, and how high that is.
fn under(app: &mut App, x: f32, z: f32) -> Option<(Entity, f32)> {
    let cast = move |surfaces: SurfaceQuery| {
        let filter = SurfaceQueryFilter::default();
        surfaces.cast_ray(Vec3::new(x, 50.0, z), Vec3::NEG_Y, 100.0, &filter).map(|hit| (hit.entity, hit.point.y))
    };
    app.world_mut().run_system_once(cast).expect("it runs")
}

#[track_caller]
fn assert_height(app: &mut App, [x, z]: [f32; 2], entity: Entity, expected: f32) {
    let Some((hit, height)) = under(app, x, z) else { panic!("nothing at {x}, {z}") };
    assert_eq!(hit, entity);
    assert!((height - expected).abs() < 1.0e-4, "{height} instead of {expected}");
}

fn shapes_follow<E: Engine>() {
    let mut app = app::<E>();
    let world = app.world_mut();
    // Scaled differently along each axis.
    let scaled = Transform::from_xyz(3.0, 1.0, 0.0).with_scale(Vec3::new(1.0, 4.0, 2.0));
    let slab = world.spawn((E::fixed(SharedShape::cuboid(0.5, 0.5, 0.5)), scaled)).id();
    let mover = world.spawn((E::body(SharedShape::ball(0.5), 1.0, Vec3::X), Transform::from_xyz(0.0, 2.0, 0.0))).id();
    // A child of a body: its place is scaled by its parent, and it is turned with it.
    let turned = Transform::from_xyz(0.0, 0.0, -5.0).with_rotation(Quat::from_rotation_z(1.0));
    let parent = world.spawn((E::body_of_parts(Vec3::Y), turned.with_scale(Vec3::splat(2.0)))).id();
    let part = (E::part(SharedShape::ball(0.25)), Transform::from_xyz(1.0, 0.0, 0.0), ChildOf(parent));
    let part = world.spawn(part).id();
    run(&mut app, 1);
    assert_height(&mut app, [3.4, 0.9], slab, 3.0);
    run(&mut app, 63);
    let [place, at] = [mover, parent].map(|entity| app.world().get::<Transform>(entity).expect("there").translation);
    assert!(place.x > 0.9 && at.y > 0.9, "{}: they have moved to {place} and {at}", E::NAME);
    assert_height(&mut app, [place.x, place.z], mover, 2.5);
    let (sin, cos) = bevy::math::ops::sin_cos(1.0);
    assert_height(&mut app, [at.x + 2.0 * cos, at.z], part, at.y + 2.0 * sin + 0.5);
    // A new scale, and a new shape.
    app.world_mut().get_mut::<Transform>(slab).expect("there").scale.y = 2.0;
    run(&mut app, 2);
    assert_height(&mut app, [3.4, 0.9], slab, 2.0);
    app.world_mut().entity_mut(slab).insert(E::part(SharedShape::ball(0.5)));
    app.world_mut().get_mut::<Transform>(slab).expect("there").scale = Vec3::ONE;
    run(&mut app, 2);
    assert_height(&mut app, [3.0, 0.0], slab, 1.5);
    // Solids other than the ball have not been approximated.
    assert_eq!(*app.world().get::<SurfaceStatus>(slab).expect("there"), SurfaceStatus::Active);
}

#[test]
fn shapes_follow_pose_scale_and_shape_of_colliders() {
    shapes_follow::<Avian>();
    shapes_follow::<Rapier>();
}

fn go_away<E: Engine>() {
    let mut app = app::<E>();
    let ball = || E::fixed(SharedShape::ball(0.5));
    let [disabled, sensor, removed, hidden, own] =
        [0.0, 2.0, 4.0, 6.0, 8.0].map(|x| app.world_mut().spawn((ball(), Transform::from_xyz(x, 0.0, 0.0))).id());
    app.world_mut().entity_mut(own).insert(RigidShape(SharedShape::ball(1.0)));
    run(&mut app, 2);
    for (x, entity) in [(0.0, disabled), (2.0, sensor), (4.0, removed), (6.0, hidden)] {
        assert_height(&mut app, [x, 0.0], entity, 0.5);
    }
    assert_height(&mut app, [8.0, 0.0], own, 1.0);
    app.world_mut().entity_mut(disabled).insert(E::disabled());
    app.world_mut().entity_mut(sensor).insert(E::sensor());
    E::remove_collider(&mut app, removed);
    app.world_mut().entity_mut(hidden).insert(SurfaceDisabled);
    run(&mut app, 1);
    for x in [0.0, 2.0, 4.0, 6.0] {
        assert_eq!(under(&mut app, x, 0.0), None, "{}, {x}", E::NAME);
    }
    // The game's own shape stays, whatever becomes of the collider.
    E::remove_collider(&mut app, own);
    run(&mut app, 1);
    assert_height(&mut app, [8.0, 0.0], own, 1.0);
    for entity in [disabled, hidden] {
        app.world_mut().entity_mut(entity).remove_with_requires::<SurfaceDisabled>();
    }
    app.world_mut().entity_mut(removed).insert(ball());
    app.world_mut().despawn(sensor);
    run(&mut app, 1);
    assert_height(&mut app, [4.0, 0.0], removed, 0.5);
    assert_height(&mut app, [6.0, 0.0], hidden, 0.5);
}

#[test]
fn shapes_of_sensors_and_of_what_is_disabled_or_removed_go_away() {
    go_away::<Avian>();
    go_away::<Rapier>();
}

/// A free cloth, which moves down at a speed, 0.3 above a place.
fn spawn_cloth(app: &mut App, place: Vec3, speed: f32) -> Entity {
    let mesh = cloth(15, 0.05);
    let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position) + place).collect();
    let (surface, positions) = DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("valid");
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
    let body = XpbdBody::new(&surface, &positions, material).expect("valid").moving(Vec3::NEG_Y * speed);
    app.world_mut().spawn((surface, positions, body, SurfaceThickness::World(0.01), SweptCollision)).id()
}

fn layers_decide<E: Engine>() {
    for (memberships, filters, is_met) in [(0b01, u32::MAX, true), (0b10, u32::MAX, false), (0b01, 0b10, false)] {
        let mut app = app::<E>();
        let ball = E::body(SharedShape::ball(0.3), 1.0, Vec3::ZERO);
        let ball = app.world_mut().spawn((ball, E::layers(memberships, filters), Transform::default())).id();
        let cloth = spawn_cloth(&mut app, Vec3::new(0.0, 0.4, 0.0), 2.0);
        // In the first group, and meets it alone.
        app.world_mut().entity_mut(cloth).insert(SurfaceLayers { memberships: 0b01, filters: 0b01 });
        run(&mut app, 20);
        let speed = E::velocity(app.world(), ball)[0].length();
        assert_eq!(speed > 0.0, is_met, "{}: {memberships:b} {filters:b}: {speed}", E::NAME);
    }
}

#[test]
fn layers_of_colliders_are_those_of_their_shapes() {
    layers_decide::<Avian>();
    layers_decide::<Rapier>();
}

fn only_dynamic_bodies<E: Engine>() {
    let mut app = app::<E>();
    let shape = || SharedShape::ball(0.3);
    let spawn = |app: &mut App, x: f32| {
        spawn_cloth(app, Vec3::new(x, 0.4, 0.0), 2.0);
        Transform::from_xyz(x, 0.0, 0.0)
    };
    let place = spawn(&mut app, 0.0);
    let fixed = app.world_mut().spawn((E::fixed(shape()), place)).id();
    let place = spawn(&mut app, 2.0);
    let kinematic = app.world_mut().spawn((E::kinematic(shape()), place)).id();
    let place = spawn(&mut app, 4.0);
    let part = app.world_mut().spawn((E::part(shape()), place)).id();
    let place = spawn(&mut app, 6.0);
    let dynamic = app.world_mut().spawn((E::body(shape(), 1.0, Vec3::ZERO), place)).id();
    run(&mut app, 40);
    for (x, entity) in [(0.0, fixed), (2.0, kinematic), (4.0, part)] {
        let world = app.world();
        assert_eq!(world.get::<Transform>(entity).expect("there").translation, Vec3::X * x, "{}", E::NAME);
        assert!(world.get::<RigidMass>(entity).is_none(), "{}: surfaces may sleep on it", E::NAME);
    }
    assert!(app.world().get::<Transform>(dynamic).expect("there").translation.y < -0.01, "{}", E::NAME);
}

#[test]
fn bodies_that_are_static_or_moved_by_the_game_stay_where_they_are() {
    only_dynamic_bodies::<Avian>();
    only_dynamic_bodies::<Rapier>();
}

fn a_sleeper_wakes<E: Engine>() {
    let mut app = app::<E>();
    let ball = E::body(SharedShape::ball(0.3), 1.0, Vec3::ZERO);
    let ball = app.world_mut().spawn((ball, Transform::default())).id();
    spawn_cloth(&mut app, Vec3::new(0.0, 9.0, 0.0), 2.0);
    run(&mut app, 200);
    assert!(E::is_asleep(app.world_mut(), ball), "{}: nothing has happened to it", E::NAME);
    run(&mut app, 200);
    let moved = app.world().get::<Transform>(ball).expect("there").translation;
    assert!(moved.y < -0.01, "{}: it was hit: {moved}", E::NAME);
}

#[test]
fn what_sleeps_wakes_when_a_surface_hits_it() {
    a_sleeper_wakes::<Avian>();
    a_sleeper_wakes::<Rapier>();
}

/// A cloth hits one ball of a dumbbell. Angular momentum about the origin of the world is kept. That takes the right
/// centers of mass and the right moments.
fn a_dumbbell_turns<E: Engine>() {
    const RADIUS: f32 = 0.3;
    const ARM: f32 = 0.4;
    let mut app = app::<E>();
    let turn = Quat::from_rotation_y(0.5);
    let place = Vec3::new(1.0, 0.0, 2.0);
    // Its entity is in one of the balls, not in the center of mass.
    let dumbbell = (E::body_of_parts(Vec3::ZERO), Transform::from_translation(place).with_rotation(turn));
    let dumbbell = app.world_mut().spawn(dumbbell).id();
    for x in [0.0, 2.0 * ARM] {
        let part = (E::part(SharedShape::ball(RADIUS)), Transform::from_xyz(x, 0.0, 0.0), ChildOf(dumbbell));
        app.world_mut().spawn(part);
    }
    let hit = place + turn * Vec3::X * 2.0 * ARM;
    let cloth = spawn_cloth(&mut app, hit + Vec3::Y * 0.4, 2.0);
    let momenta = |app: &App| {
        let world = app.world();
        let (body, positions) = (world.get::<XpbdBody>(cloth), world.get::<SurfacePositions>(cloth));
        let (body, positions) = (body.expect("there"), &positions.expect("there").0);
        let mut of_cloth = [Vec3::ZERO; 2];
        for ((velocity, inverse), position) in body.velocities.iter().zip(&body.inverse_masses).zip(positions) {
            of_cloth[0] += *velocity / *inverse;
            of_cloth[1] += position.cross(*velocity) / *inverse;
        }
        let transform = world.get::<Transform>(dumbbell).expect("there");
        let [linear, angular] = E::velocity(world, dumbbell);
        let half = 4.0 / 3.0 * std::f32::consts::PI * RADIUS.powi(3);
        let center = transform.transform_point(Vec3::X * ARM);
        let about_axis = 2.0 * 0.4 * half * RADIUS * RADIUS;
        let across = about_axis + 2.0 * half * ARM * ARM;
        let own = transform.rotation.inverse() * angular;
        let spin = transform.rotation * (own * Vec3::new(about_axis, across, across));
        let linear = 2.0 * half * linear;
        (of_cloth, [linear, center.cross(linear) + spin])
    };
    run(&mut app, 1);
    let start = momenta(&app).0;
    run(&mut app, 60);
    let (of_cloth, of_body) = momenta(&app);
    for kind in 0..2 {
        let (exchanged, lost) = (of_body[kind].length(), (of_cloth[kind] + of_body[kind] - start[kind]).length());
        println!("{}: {exchanged:.4} exchanged, {lost:.5} lost", E::NAME);
        assert!(exchanged > 0.2 * start[kind].length(), "{}: it was hit", E::NAME);
        assert!(lost < 0.01 * exchanged, "{}: {lost} of {exchanged}", E::NAME);
    }
}

#[test]
fn angular_momentum_is_kept_about_any_center_of_mass() {
    a_dumbbell_turns::<Avian>();
    a_dumbbell_turns::<Rapier>();
}
