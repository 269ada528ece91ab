//! What the copy of the history costs in each tick.

use std::time::{Duration, Instant};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    RollbackPlugin,
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use circumsphere_support::scenes::{Diagonals, Mesh, crumpled_sheet, grid};

use crate::game::{points, surface};

const TICKS: usize = 60;

/// A game, and what it writes before each tick.
type Scene = (App, fn(&mut World, usize));

fn app(has_rollback: bool) -> App {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update))).init_resource::<Time>();
    if has_rollback {
        app.add_plugins(RollbackPlugin::new(Update));
    }
    app.insert_resource(CircumsphereSettings { threads: 1, ..Default::default() });
    app
}

fn crumpled(time: f32) -> Mesh {
    crumpled_sheet(10_000, f64::from(time))
}

/// A sheet that crumples, and is swept against itself.
fn sheet(has_rollback: bool) -> Scene {
    let mut app = app(has_rollback);
    app.world_mut().spawn((surface(&crumpled(0.0)), SelfCollision, SweptCollision));
    let write = |world: &mut World, tick: usize| {
        let mut sheets = world.query_filtered::<&mut SurfacePositions, With<DeformableSurface>>();
        sheets.single_mut(world).expect("there is one").0 = points(&crumpled(0.01 * tick as f32));
    };
    (app, write)
}

/// A cloth that falls onto a ball.
fn cloth(has_rollback: bool) -> Scene {
    let mut app = app(has_rollback);
    let (surface, positions) = surface(&grid(40, 40, 2.0, 2.0, Diagonals::Alternating).translate([0.0, 0.52, 0.0]));
    let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH).expect("a body");
    app.world_mut().spawn((surface, positions, body, SelfCollision, SweptCollision));
    app.world_mut().spawn(RigidShape(SharedShape::ball(0.5)));
    (app, |_, _| {})
}

/// Medians of the time of a tick with and without the plugin, which take turns.
fn medians(scene: fn(bool) -> Scene) -> [Duration; 2] {
    let mut both = [true, false].map(|has_rollback| (scene(has_rollback), Vec::new()));
    for tick in 0..TICKS {
        for ((app, write), times) in &mut both {
            write(app.world_mut(), tick);
            app.world_mut().resource_mut::<Time>().advance_by(Duration::from_micros(16_667));
            let start = Instant::now();
            app.update();
            times.push(start.elapsed());
        }
    }
    both.map(|(_, mut times)| {
        times.sort_unstable();
        times[TICKS / 2]
    })
}

#[test]
#[ignore = "measures time: cargo test --release --test rollback price -- --ignored --nocapture"]
fn the_price_of_a_tick_is_less_than_a_tenth_of_it() {
    for (name, scene) in [("sheet of 10,000 triangles", sheet as fn(bool) -> Scene), ("cloth of 3,200", cloth)] {
        let [with, without] = medians(scene);
        eprintln!("{name}: {with:.2?} with RollbackPlugin, {without:.2?} without");
        assert!(with.as_secs_f64() < 1.1 * without.as_secs_f64(), "{name}: {with:?} instead of {without:?}");
    }
}
