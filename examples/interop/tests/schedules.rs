//! Engines and surfaces live in one app, in any schedule and whatever the order of their plugins.

use bevy::{ecs::schedule::ScheduleLabel, prelude::*};
use bevy_circumsphere::{
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin, XpbdSettings},
};
use circumsphere_interop::scenes::{Avian, Engine, Rapier, app_in, start};
use circumsphere_support::scenes::cloth;

/// A schedule of the game's own, run in each fixed step.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Simulation;

const FALLING: Vec3 = Vec3::new(0.0, -2.0, 0.0);

fn spawn_cloth(app: &mut App) -> Entity {
    let mesh = cloth(15, 0.1);
    let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
    let (surface, positions) = DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("valid");
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
    let body = XpbdBody::new(&surface, &positions, material).expect("valid");
    app.world_mut().spawn((surface, positions, body, SurfaceThickness::World(0.01), SweptCollision)).id()
}

fn spawn_ball<E: Engine>(app: &mut App, x: f32) -> Entity {
    let ball = E::body(SharedShape::ball(0.2), 1.0, FALLING);
    app.world_mut().spawn((ball, Transform::from_xyz(x, 0.4, 0.1))).id()
}

/// The momentum of the cloth and of balls of 1 kg.
fn assert_pushed(app: &App, cloth: Entity, balls: &[Vec3], what: &str) {
    let cloth = app.world().get::<XpbdBody>(cloth).expect("there");
    let given: Vec3 = cloth.velocities.iter().zip(&cloth.inverse_masses).map(|(velocity, mass)| velocity / mass).sum();
    assert!(given.y < -0.1, "{what}: the cloth was pushed: {given}");
    let lost: Vec3 = balls.iter().map(|velocity| FALLING - velocity).sum();
    assert!(given.distance(lost) < 0.01 * given.length(), "{what}: {given} of {lost}");
}

fn lives_in<E: Engine>(schedule: impl ScheduleLabel + Clone) {
    let what = format!("{} in {schedule:?}", E::NAME);
    let mut app = app_in::<E>(schedule, Vec3::ZERO);
    app.add_systems(FixedUpdate, |world: &mut World| drop(world.try_run_schedule(Simulation)));
    let (cloth, ball) = (spawn_cloth(&mut app), spawn_ball::<E>(&mut app, 0.1));
    (0..40).for_each(|_| app.update());
    assert_pushed(&app, cloth, &[E::velocity(app.world(), ball)[0]], &what);
}

#[test]
fn engines_and_surfaces_share_any_schedule() {
    lives_in::<Avian>(FixedUpdate);
    lives_in::<Avian>(FixedPostUpdate);
    lives_in::<Avian>(Simulation);
    lives_in::<Rapier>(FixedUpdate);
    lives_in::<Rapier>(FixedPostUpdate);
    lives_in::<Rapier>(Simulation);
}

/// The positions of a cloth that a ball has hit, with the plugins in an order.
fn hit<E: Engine>(order: [usize; 3]) -> Vec<Vec3> {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin));
    for plugin in order {
        match plugin {
            0 => E::add(&mut app, FixedPostUpdate, Vec3::ZERO),
            1 => E::couple(&mut app, FixedPostUpdate),
            _ => {
                app.add_plugins((DeformableCollisionPlugins::default(), XpbdResponsePlugin::default()));
            }
        }
    }
    start(&mut app);
    let cloth = spawn_cloth(&mut app);
    spawn_ball::<E>(&mut app, 0.1);
    (0..40).for_each(|_| app.update());
    app.world().get::<SurfacePositions>(cloth).expect("there").0.clone()
}

fn any_order<E: Engine>() {
    let expected = hit::<E>([0, 1, 2]);
    for order in [[0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        assert!(hit::<E>(order) == expected, "{}: {order:?}", E::NAME);
    }
}

#[test]
fn the_order_of_plugins_does_not_matter() {
    any_order::<Avian>();
    any_order::<Rapier>();
}

#[test]
fn both_engines_in_one_app_push_one_cloth() {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin));
    Avian::add(&mut app, FixedPostUpdate, Vec3::ZERO);
    Avian::couple(&mut app, FixedPostUpdate);
    Rapier::add(&mut app, FixedPostUpdate, Vec3::ZERO);
    Rapier::couple(&mut app, FixedPostUpdate);
    app.add_plugins((DeformableCollisionPlugins::default(), XpbdResponsePlugin::default()));
    app.world_mut().resource_mut::<XpbdSettings>().gravity = Vec3::ZERO;
    start(&mut app);
    let cloth = spawn_cloth(&mut app);
    let balls = [spawn_ball::<Avian>(&mut app, -0.3), spawn_ball::<Rapier>(&mut app, 0.3)];
    (0..40).for_each(|_| app.update());
    let velocities = [Avian::velocity(app.world(), balls[0])[0], Rapier::velocity(app.world(), balls[1])[0]];
    assert!(velocities.iter().all(|velocity| velocity.y > FALLING.y + 0.02), "both were slowed: {velocities:?}");
    assert_pushed(&app, cloth, &velocities, "both");
}
