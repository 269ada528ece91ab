//! A character from a glTF file walks in its skirt: loaded and animated by Bevy, headless, with contacts in every tick.
//!
//! `cargo run --release --manifest-path examples/gltf/Cargo.toml -- [FILE] [options]`; `--help`
//! lists the options.

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    process::ExitCode,
    time::{Duration, Instant},
};

use bevy_circumsphere::{ContactStore, detection::DetectionDiagnostics, prelude::*, response::XpbdDiagnostics};
use bevy_ecs::prelude::*;
use circumsphere_gltf::{Cast, character_app, file, load, shoot};
use clap::Parser;

/// Exit status for bad input: the shell's convention for wrong usage.
const BAD_INPUT: u8 = 2;

/// Ticks between the rows of the table.
const ROW: usize = 30;

/// Where a bullet is shot at the character in one row after the other, in parts of its height.
const HEIGHTS: [f32; 3] = [0.9, 0.1, 0.5];

/// Let a character from a glTF file walk in its skirt.
#[derive(Parser, Debug)]
#[command(name = "circumsphere_gltf")]
struct Options {
    /// A .glb or .gltf file, whose first animation is played; without it: assets/character.glb
    file: Option<PathBuf>,
    /// Ticks to play, 60 per second
    #[arg(long, value_name = "N", default_value_t = 300)]
    ticks: usize,
    /// The mesh that wears the garment
    #[arg(long, value_name = "NAME", default_value = file::SKIN)]
    skin: String,
    /// The mesh that becomes a garment, if the file has it
    #[arg(long, value_name = "NAME", default_value = file::SKIRT)]
    garment: String,
    /// Write the embedded character to a file, and play nothing
    #[arg(long, value_name = "FILE.glb")]
    make: Option<PathBuf>,
    /// Write the person of the demo to a file, and play nothing
    #[arg(long, value_name = "FILE.glb")]
    make_person: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn run(options: &Options) -> Result<(), String> {
    let makes: [(_, fn() -> Vec<u8>); 2] =
        [(&options.make, file::character_file), (&options.make_person, circumsphere_gltf::person_file)];
    if let Some((path, make)) = makes.iter().find_map(|(path, make)| Some((path.as_ref()?, make))) {
        return fs::write(path, make()).map_err(|error| format!("{}: {error}", path.display()));
    }
    let path = options
        .file
        .clone()
        .unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/character.glb"));
    let path = path.canonicalize().map_err(|error| format!("{}: {error}", path.display()))?;
    let (Some(folder), Some(name)) = (path.parent(), path.file_name().and_then(|name| name.to_str())) else {
        return Err(format!("{}: is no file", path.display()));
    };
    let cast = Cast { skin: options.skin.clone(), garment: Some(options.garment.clone()) };
    let mut app = character_app(folder, cast);
    load(&mut app, name)?;
    let mut out = io::stdout().lock();
    let mut surfaces = app.world_mut().query::<(Option<&Name>, &DeformableSurface, &SurfaceStatus)>();
    for (name, surface, status) in surfaces.iter(app.world()) {
        let name = name.map_or("unnamed", Name::as_str);
        let topology = surface.topology();
        let (vertices, triangles) = (topology.vertex_count(), topology.triangles().len());
        // The reader of the table may have closed the pipe, here and below.
        let _ = writeln!(out, "{name}: {vertices} vertices, {triangles} triangles, {status:?}");
    }
    let _ = writeln!(
        out,
        "{:>6} {:>9} {:>9} {:>12} {:>11}  bullet hits",
        "tick", "touching", "contacts", "detection ms", "tick ms"
    );
    let mut times = Vec::new();
    for tick in 1..=options.ticks {
        let start = Instant::now();
        app.update();
        times.push(start.elapsed());
        if tick % ROW == 0 || tick == options.ticks {
            let elapsed = start.elapsed();
            let shot = shoot(&mut app, &options.skin, HEIGHTS[tick / ROW % HEIGHTS.len()]);
            let world = app.world();
            let hit = shot.map_or_else(
                || "nothing".to_owned(),
                |shot| {
                    let target = world.get::<Name>(shot.hit.entity).map_or("unnamed", Name::as_str);
                    shot.joint.map_or_else(|| target.to_owned(), |joint| format!("{target}, moved by {joint}"))
                },
            );
            let (store, detection) =
                (world.resource::<ContactStore>(), world.resource::<DetectionDiagnostics>().total());
            let milliseconds = [detection, elapsed].map(|time| 1.0e3 * time.as_secs_f64());
            let _ = writeln!(
                out,
                "{tick:>6} {:>9} {:>9} {:>12.2} {:>11.2}  {hit}",
                store.touching_count(),
                store.contact_count(),
                milliseconds[0],
                milliseconds[1]
            );
        }
    }
    times.sort_unstable();
    let median = times.get(times.len() / 2).copied().unwrap_or(Duration::ZERO);
    let stopped = app.world().resource::<XpbdDiagnostics>().refused.len();
    let _ =
        writeln!(out, "median tick: {:.2} ms; bodies that could not be moved: {stopped}", 1.0e3 * median.as_secs_f64());
    Ok(())
}
