//! Times of the kernel's stages, one by one: `cargo bench --bench stages`.
//!
//! `-- --once [TRIANGLES]` instead runs every stage a single time, and `-- --tick METHOD [TRIANGLES]` runs one cold
//! tick of the whole plugin. `benches/instructions.sh` uses these to count instructions, because times on a shared
//! machine are noisy.

mod kernel;
mod response;
mod tetrahedra;

use std::{process::ExitCode, sync::LazyLock};

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, prelude::*};
use circumsphere_examples::headless::{detect, headless_app, move_surface, recording::Recorder};
use circumsphere_support::scenes::crumpled_sheet;
use divan::Bencher;
use glam::Vec3;

use self::kernel::{STAGES, Sheet, Stages};

/// Triangles of the sheet: too many for the processor's private caches, and few enough for a run in seconds.
const TRIANGLES: usize = 90_000;

/// Phase shift of the sheet's waves from one state to the next, in radians.
const PHASE: f64 = 0.05;

/// The sheet, with the results of every stage.
static MADE: LazyLock<(Sheet, Stages)> = LazyLock::new(|| {
    let sheet = Sheet::new(TRIANGLES);
    let mut stages = Stages::default();
    for (_, stage) in STAGES {
        stage(&sheet, &mut stages);
    }
    (sheet, stages)
});

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    if run(&arguments).is_some() {
        return ExitCode::SUCCESS;
    }
    let methods = ContactMethod::ALL;
    eprintln!("error: expected --once [TRIANGLES] or --tick METHOD [TRIANGLES], METHOD one of {methods:?}");
    ExitCode::from(2)
}

/// Runs what the arguments ask for. `None` if they are invalid.
fn run(arguments: &[&str]) -> Option<()> {
    let triangles = |rest: &[&str]| match rest {
        [] => Some(TRIANGLES),
        [number] => number.parse().ok().filter(|&number| number > 0),
        _ => None,
    };
    match arguments {
        ["--once", rest @ ..] => run_stages_once(triangles(rest)?),
        ["--tick", method, rest @ ..] => {
            let method = ContactMethod::ALL.into_iter().find(|known| format!("{known:?}") == *method)?;
            run_tick(method, triangles(rest)?);
        }
        _ => divan::main(),
    }
    Some(())
}

fn run_stages_once(triangles: usize) {
    let sheet = Sheet::new(triangles);
    let mut stages = Stages::default();
    for (_, stage) in STAGES {
        stage(&sheet, &mut stages);
    }
    println!("{triangles} triangles, {} candidates, {} past slabs", stages.candidates.len(), stages.past_slabs.len());
}

fn run_tick(method: ContactMethod, triangles: usize) {
    let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
    let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
    let state = |phase: f64| {
        let mesh = crumpled_sheet(triangles, phase);
        (mesh.positions.into_iter().map(Vec3::from_array).collect::<Vec<_>>(), mesh.triangles)
    };
    let (positions, corners) = state(PHASE);
    let (surface, positions) = DeformableSurface::from_mesh(&positions, &corners).expect("the sheet is a valid mesh");
    let surface = app.world_mut().spawn((surface, positions, SelfCollision, method)).id();
    detect(&mut app);
    move_surface(&mut app, surface, state(0.0).0);
    app.world_mut().entity_mut(surface).insert(Teleported);
    cold_tick(&mut app);
    println!("{triangles} triangles, {method:?}");
}

/// Instruction counters look for this function.
#[inline(never)]
fn cold_tick(app: &mut App) {
    app.update();
}

#[divan::bench(args = STAGES.map(|(name, _)| name))]
fn stage(bencher: Bencher, name: &str) {
    let (_, stage) = STAGES.into_iter().find(|(known, _)| *known == name).expect("it is one of them");
    let (sheet, made) = &*MADE;
    let mut stages = made.clone();
    bencher.bench_local(|| stage(sheet, &mut stages));
}
