//! Plays the game without a window, and counts what is in each other.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use bevy::{
    animation::AnimationPlugin,
    app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy},
    gltf::GltfPlugin,
    image::ImagePlugin,
    mesh::MeshPlugin,
    prelude::*,
    world_serialization::WorldSerializationPlugin,
};
use bevy_circumsphere::{ContactStore, detection::DetectionDiagnostics, prelude::*, response::XpbdDiagnostics};

use crate::{
    Options,
    balls::Ball,
    crossings::{self, Crossings},
    game::{GamePlugin, Pace, RATE, Ready},
};

/// Updates after which a file that has not been loaded never will be.
const PATIENCE: usize = 20_000;

/// The folder of the character.
pub fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets")
}

/// Task pools of a number of threads.
pub fn pools(threads: Option<usize>) -> TaskPoolPlugin {
    let mut options = TaskPoolOptions::default();
    if let Some(threads) = threads {
        let none = TaskPoolThreadAssignmentPolicy { max_threads: 1, ..options.io.clone() };
        options =
            TaskPoolOptions { io: none.clone(), async_compute: none, ..TaskPoolOptions::with_num_threads(threads) };
        options.compute = TaskPoolThreadAssignmentPolicy {
            min_threads: threads,
            max_threads: threads,
            percent: 1.0,
            ..options.compute
        };
    }
    TaskPoolPlugin { task_pool_options: options }
}

/// What happened between balls and cloth.
#[derive(Resource, Default)]
struct Heard {
    by_balls: usize,
    others: usize,
}

fn hear(mut starts: MessageReader<SurfaceContactStart>, balls: Query<(), With<Ball>>, mut heard: ResMut<Heard>) {
    for start in starts.read() {
        if balls.contains(start.entity) || balls.contains(start.other) {
            heard.by_balls += 1;
        } else {
            heard.others += 1;
        }
    }
}

/// Plays the game, and prints figures.
pub fn play(options: &Options) -> Result<(), String> {
    let mut app = App::new();
    let plugins = MinimalPlugins.build().set(pools(options.threads));
    app.add_plugins((plugins, TransformPlugin, AssetPlugin { file_path: assets().display().to_string(), ..default() }))
        .add_plugins((WorldSerializationPlugin, MeshPlugin, ImagePlugin::default(), AnimationPlugin))
        .add_plugins((GltfPlugin::default(), GamePlugin(Pace::Even)))
        .init_resource::<Heard>()
        .add_systems(PostUpdate, hear.after(DeformableSystems::Events));
    app.finish();
    app.cleanup();
    let mut impacts = 0;
    for _ in 0..PATIENCE {
        app.update();
        if app.world().resource::<Ready>().0 {
            // The first tick.
            impacts += app.world().resource::<XpbdDiagnostics>().impacts_remaining;
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    if !app.world().resource::<Ready>().0 {
        return Err(format!("the person in {} was not dressed", assets().display()));
    }

    let frames = options.frames.unwrap_or(600);
    let (mut times, mut parts) = (Vec::new(), [Duration::ZERO; 2]);
    let (mut found, mut checks, mut contacts) = (Crossings::default(), 0, 0);
    for frame in 1..=frames {
        let start = Instant::now();
        app.update();
        times.push(start.elapsed());
        let world = app.world();
        let response = world.resource::<XpbdDiagnostics>();
        parts[0] += world.resource::<DetectionDiagnostics>().total();
        parts[1] += response.gathering + response.solving + response.guarding;
        contacts += world.resource::<ContactStore>().contact_count();
        impacts += response.impacts_remaining;
        if response.impacts_remaining > 0 {
            println!("tick {frame}: {} impacts could not be prevented", response.impacts_remaining);
        }
        if options.check > 0 && frame % options.check == 0 {
            checks += 1;
            let now = crossings::count(app.world_mut());
            if now != Crossings::default() {
                println!("tick {frame}: {now}");
            }
            found += now;
        }
    }

    let sum = times.iter().sum::<Duration>().as_secs_f64();
    times.sort_unstable();
    let milliseconds = |time: f64| 1.0e3 * time;
    let at = |percent: usize| times.get(percent * times.len() / 100).map_or(0.0, Duration::as_secs_f64);
    let heard = app.world().resource::<Heard>();
    println!("{frames} ticks of 1/{RATE} s, {:.0} contacts a tick", contacts as f64 / f64::from(frames.max(1)));
    println!("contacts that started: {} of balls, {} others", heard.by_balls, heard.others);
    println!("impacts that could not be prevented: {impacts}");
    println!(
        "a tick: median {:.2} ms, 95th percentile {:.2} ms, longest {:.2} ms; of the mean of {:.2} ms, {:.2} ms detection and \
         {:.2} ms response",
        milliseconds(at(50)),
        milliseconds(at(95)),
        milliseconds(times.last().map_or(0.0, Duration::as_secs_f64)),
        milliseconds(sum / f64::from(frames.max(1))),
        milliseconds(parts[0].as_secs_f64() / f64::from(frames.max(1))),
        milliseconds(parts[1].as_secs_f64() / f64::from(frames.max(1))),
    );
    println!("ticks a second: {:.0}", f64::from(frames) / sum);
    if checks > 0 {
        println!("crossings in {checks} ticks: {}; {found}", found.total());
    }
    Ok(())
}
