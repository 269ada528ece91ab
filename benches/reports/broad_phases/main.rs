//! Times the broad phases on four scenes and prints a table.
//!
//! `cargo run --release --example broad_phases`; `--help` lists the options.

mod scenes;

use std::{
    io::{self, Write},
    time::Duration,
};

use bevy_app::{PluginGroupBuilder, prelude::*};
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    detection::{
        BroadPhasePlugin, BruteForceBroadPhasePlugin, DetectionDiagnostics, HierarchicalSpatialHashBroadPhasePlugin,
        SpatialHashBroadPhasePlugin, TreeBroadPhasePlugin,
    },
    prelude::*,
};
use bevy_ecs::prelude::*;
use circumsphere_examples::headless::{headless_app, move_surface, recording::Recorder};
use clap::Parser;
use glam::Vec3;
use scenes::{Scene, scenes};

/// Time the broad phases on four scenes, on one thread by default.
#[derive(Parser, Debug)]
#[command(name = "broad_phases")]
struct Options {
    /// About how many triangles each scene has
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1_000..=1_000_000))]
    triangles: u32,
    /// Ticks that are measured
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..))]
    ticks: u32,
    /// Threads that may work on one tick
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    threads: u16,
    /// Leave out brute force
    #[arg(long)]
    no_brute_force: bool,
}

/// Ticks before the measured ones, in which trees are built and buffers grow.
const WARM: usize = 3;

/// The most ticks of brute force.
const BRUTE_FORCE_TICKS: usize = 3;

/// How far vertices move per tick, in mean edges, with its name. The contact distance is 0.1 mean edges.
const MOTIONS: [(&str, f32); 2] = [("fast", 0.5), ("slow", 0.01)];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BroadPhase {
    Tree,
    SpatialHash,
    HierarchicalHash,
    BruteForce,
}

impl BroadPhase {
    const ALL: [Self; 4] = [Self::Tree, Self::SpatialHash, Self::HierarchicalHash, Self::BruteForce];

    fn plugins(self) -> PluginGroupBuilder {
        let plugins = DeformableCollisionPlugins::new(Update).build();
        let without_tree = |plugins: PluginGroupBuilder| plugins.disable::<TreeBroadPhasePlugin>();
        match self {
            Self::Tree => plugins,
            Self::SpatialHash => {
                without_tree(plugins).add_after::<BroadPhasePlugin>(SpatialHashBroadPhasePlugin::default())
            }
            Self::HierarchicalHash => {
                without_tree(plugins).add_after::<BroadPhasePlugin>(HierarchicalSpatialHashBroadPhasePlugin::default())
            }
            Self::BruteForce => without_tree(plugins).add_after::<BroadPhasePlugin>(BruteForceBroadPhasePlugin),
        }
    }
}

/// Medians over the ticks, and the touching pairs of all ticks.
struct Measured {
    broad_phase: Duration,
    whole: Duration,
    touching: Vec<usize>,
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times[times.len() / 2]
}

fn measure(scene: &Scene, motion: f32, broad_phase: BroadPhase, options: &Options) -> Measured {
    let settings = CircumsphereSettings { threads: usize::from(options.threads), ..CircumsphereSettings::default() };
    let mut app = headless_app(broad_phase.plugins(), settings, Recorder::default());
    let entities: Vec<Entity> = scene
        .bodies
        .iter()
        .map(|body| {
            let (surface, positions) =
                DeformableSurface::from_mesh(&body.positions, &body.triangles).expect("scenes are valid");
            let entity =
                app.world_mut().spawn((surface, positions, SurfaceThickness::MeanEdges(0.05), body.place)).id();
            if scene.meets_itself {
                app.world_mut().entity_mut(entity).insert(SelfCollision);
            }
            entity
        })
        .collect();
    let ticks = if broad_phase == BroadPhase::BruteForce {
        BRUTE_FORCE_TICKS.min(options.ticks as usize)
    } else {
        options.ticks as usize
    };
    let (mut times, mut wholes, mut touching) = (Vec::new(), Vec::new(), Vec::new());
    for tick in 0..WARM + ticks {
        for (body, entity) in scene.bodies.iter().zip(&entities) {
            let moved: Vec<Vec3> = body.moved(motion, tick).collect();
            move_surface(&mut app, *entity, moved);
        }
        app.update();
        touching.push(app.world().resource::<ContactStore>().touching_count());
        if tick < WARM {
            continue;
        }
        let diagnostics = app.world().resource::<DetectionDiagnostics>();
        let stages = diagnostics.stages.iter().filter(|stage| matches!(stage.name, "tree update" | "broad phase"));
        times.push(stages.map(|stage| stage.duration).sum());
        wholes.push(diagnostics.total());
    }
    Measured { broad_phase: median(times), whole: median(wholes), touching }
}

fn main() -> io::Result<()> {
    let options = Options::parse();
    let mut out = io::stdout().lock();
    writeln!(
        out,
        "Milliseconds of the broad phase, and in parentheses of the whole detection, {} thread(s).\n",
        options.threads
    )?;
    writeln!(out, "| scene | triangles | motion | tree | spatial hash | hierarchical hash | brute force |")?;
    writeln!(out, "|---|---:|---|---:|---:|---:|---:|")?;
    for scene in scenes(options.triangles as usize) {
        let triangles: usize = scene.bodies.iter().map(|body| body.triangles.len()).sum();
        for (name, motion) in MOTIONS {
            write!(out, "| {} | {triangles} | {name} |", scene.name)?;
            let mut expected: Option<Vec<usize>> = None;
            for broad_phase in BroadPhase::ALL {
                if options.no_brute_force && broad_phase == BroadPhase::BruteForce {
                    write!(out, " |")?;
                    continue;
                }
                let Measured { broad_phase: time, whole, touching } = measure(&scene, motion, broad_phase, &options);
                let expected = expected.get_or_insert_with(|| touching.clone());
                assert!(expected.starts_with(&touching), "{broad_phase:?} finds other touching pairs than the tree");
                let milliseconds = |time: Duration| time.as_secs_f64() * 1e3;
                write!(out, " {:.2} ({:.2}) |", milliseconds(time), milliseconds(whole))?;
                out.flush()?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}
