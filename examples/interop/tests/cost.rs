//! What the coupling costs.

use std::time::{Duration, Instant};

use avian3d::prelude::PhysicsSystems;
use bevy::{ecs::schedule::ScheduleLabel, prelude::*};
use bevy_circumsphere::prelude::*;
use bevy_rapier3d::prelude::PhysicsSet;
use circumsphere_interop::{
    avian::AvianSurfacesSystems,
    rapier::RapierSurfacesSystems,
    scenes::{Avian, Engine, Rapier, ball_on_cloth},
};

/// When the system before began, and the time that was spent between pairs of these.
#[derive(Resource)]
struct Stopwatch(Instant, Duration);

fn begin(mut watch: ResMut<Stopwatch>) {
    watch.0 = Instant::now();
}

fn end(mut watch: ResMut<Stopwatch>) {
    let spent = watch.0.elapsed();
    watch.1 += spent;
}

/// A cloth, a ball on it, and 200 more colliders. 100 of them are dynamic bodies on a floor.
fn share_of_tick<E: Engine>(last: impl SystemSet, follow: impl SystemSet + Clone, push: impl SystemSet + Clone) -> f64 {
    let mut scene = ball_on_cloth::<E>(0.5);
    let app = &mut scene.app;
    let floor = (E::fixed(SharedShape::halfspace(Vec3::Y)), Transform::from_xyz(0.0, -2.0, 0.0));
    app.world_mut().spawn(floor);
    for number in 0..100 {
        let place = Transform::from_xyz((number % 10) as f32 - 5.0, -1.5, (number / 10) as f32 - 5.0);
        app.world_mut().spawn((E::body(SharedShape::cuboid(0.2, 0.2, 0.2), 1.0, Vec3::ZERO), place));
        app.world_mut().spawn((E::fixed(SharedShape::ball(0.3)), place.with_translation(place.translation * 3.0)));
    }
    app.insert_resource(Stopwatch(Instant::now(), Duration::ZERO));
    let schedule = FixedPostUpdate.intern();
    app.add_systems(
        schedule,
        (
            begin.after(last).before(follow.clone()),
            end.after(follow).before(DeformableSystems::Prepare),
            begin.after(DeformableSystems::Respond).before(push.clone()),
            end.after(push).before(DeformableSystems::Writeback),
        ),
    );
    // Until the ball lies on the cloth.
    (0..200).for_each(|_| app.update());
    app.world_mut().resource_mut::<Stopwatch>().1 = Duration::ZERO;
    let start = Instant::now();
    (0..400).for_each(|_| app.update());
    let (all, spent) = (start.elapsed(), app.world().resource::<Stopwatch>().1);
    let share = spent.as_secs_f64() / all.as_secs_f64();
    println!(
        "{}: {:.1} µs of {:.0} µs a tick, {:.2} %",
        E::NAME,
        2.5e3 * spent.as_secs_f64(),
        2.5e3 * all.as_secs_f64(),
        100.0 * share
    );
    share
}

/// The bar is 5 % in release. Here the library and the engines are optimised, and the plugin is not.
#[test]
fn coupling_costs_little() {
    let shares = [
        share_of_tick::<Avian>(PhysicsSystems::Last, AvianSurfacesSystems::Follow, AvianSurfacesSystems::Push),
        share_of_tick::<Rapier>(PhysicsSet::Writeback, RapierSurfacesSystems::Follow, RapierSurfacesSystems::Push),
    ];
    assert!(shares.iter().all(|share| *share < 0.2), "{shares:?}");
}
