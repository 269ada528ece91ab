//! Times of the kernel's stages, one by one: `cargo bench --bench stages`.
//!
//! `-- --once [TRIANGLES]` runs every stage a single time instead, and `-- --tick METHOD [TRIANGLES]` one cold tick of the
//! whole plugin: for `benches/instructions.sh`, which counts instructions, since times on a shared machine are noisy.

#[expect(dead_code, reason = "nothing is recorded where instructions are counted")]
#[path = "../../examples/headless/mod.rs"]
mod headless;
mod kernel;

use std::{process::ExitCode, sync::LazyLock};

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, prelude::*};
use circumsphere_support::scenes::crumpled_sheet;
use divan::Bencher;
use glam::Vec3;

use self::{
    headless::{detect, headless_app, move_surface, recording::Recorder},
    kernel::{STAGES, Sheet, Stages},
};

/// Triangles of the sheet: more than fit into a processor's own caches, few enough for a run in seconds.
const TRIANGLES: usize = 20_000;

/// How far the sheet's waves move from one state to the next, in radians.
const PHASE: f64 = 0.05;

/// The sheet, and what every stage makes of it.
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
    let number = |text: Option<&str>| text.map_or(Ok(TRIANGLES), str::parse);
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["--once", rest @ ..] if rest.len() <= 1 => number(rest.first().copied()).map(run_stages_once).is_ok(),
        ["--tick", method, rest @ ..] if rest.len() <= 1 => {
            let method = ContactMethod::ALL.into_iter().find(|known| format!("{known:?}") == *method);
            method.zip(number(rest.first().copied()).ok()).map(|(method, triangles)| run_tick(method, triangles)).is_some()
        }
        _ => {
            divan::main();
            true
        }
    }
    .then_some(ExitCode::SUCCESS)
    .unwrap_or_else(|| {
        eprintln!("error: expected --once [TRIANGLES] or --tick METHOD [TRIANGLES], METHOD one of {:?}", ContactMethod::ALL);
        ExitCode::from(2)
    })
}

fn run_stages_once(triangles: usize) {
    let sheet = Sheet::new(triangles);
    let mut stages = Stages::default();
    for (_, stage) in STAGES {
        stage(&sheet, &mut stages);
    }
    println!("{triangles} triangles, {} candidates, {} past planes", stages.candidates.len(), stages.past_planes.len());
}

fn run_tick(method: ContactMethod, triangles: usize) {
    let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
    let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
    let state = |phase: f64| {
        let mesh = crumpled_sheet(triangles, phase);
        (mesh.positions.into_iter().map(Vec3::from_array).collect::<Vec<_>>(), mesh.triangles)
    };
    let (positions, corners) = state(PHASE);
    let (surface, positions) = DeformableSurface::from_mesh(&positions, &corners).expect("the sheet is a mesh");
    let surface = app.world_mut().spawn((surface, positions, SelfCollision, method)).id();
    detect(&mut app);
    move_surface(&mut app, surface, state(0.0).0);
    app.world_mut().entity_mut(surface).insert(Teleported);
    cold_tick(&mut app);
    println!("{triangles} triangles, {method:?}");
}

/// What an instruction counter looks for.
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
