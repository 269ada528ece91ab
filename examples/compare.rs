//! What others need for the same input, and what we need: one table, measured in one run.
//!
//! `cargo run --release --example compare -- [FILES…] [options]`; `--help` lists the options. Without files: a crumpled
//! sheet, and the embedded scene. Everyone is given the same mesh, the same contact distance and the same boxes, and in
//! every round everyone is measured once, in turn; medians are stated against parry's traversal of its tree in the same
//! run, with the faster of its two build strategies.
//!
//! *Cold* is a tick at which the mesh has new positions, the tick before was of another shape (the frame before; the one
//! after for the first; of a mesh that never moves, one with every vertex a contact distance away), and
//! [`Teleported`](bevy_circumsphere::Teleported) forbids the use of anything remembered. Trees stay and are refitted, as the
//! others' are. *Moved* is the mean of twelve ticks that follow, in each of which every vertex moves by 0.09 contact distances,
//! each in a direction of its own; those that go by a list of an earlier tick, and those that make one, are stated beside it;
//! *unchanged* is the tick after that, to which nothing is written. Ours are timed from outside:
//! the whole update of the app, contacts stored.
//!
//! The table says what everyone found, since not everyone finds the same. `box pairs` are pairs of boxes that overlap,
//! neighbors included: everyone's must agree, and whoever's do not is named below the table, as are exact methods of ours that
//! disagree. Ours never stores neighbors, and its boxes are larger by a thousandth of the contact
//! distance, so `apart`, those of them that are no neighbors, differs by that. `tested` are pairs that reach an
//! exact test in f64: those that no slab has parted.
//! `BoundingSphere` and `Circumsphere` touch by another definition. parry's distance is f32 with absolute tolerances: its
//! `touching` is near ours, and not exact. rapier has other contacts: see `benches/peers/src/rapier.rs`.
//!
//! Peers that would make the crate heavier than it is are programs of their own, see [`peers`]: nothing of them is compiled, nor
//! downloaded, unless somebody compares with them. obvhs and rapier3d are a package with its own lock file (some two minutes to
//! build), Embree is a C file against the library of the system. The crate's own tests and builds do not know them.

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_circumsphere::{ContactMethod, kernel::mesh::topology::TopologyError};
use circumsphere_support::{
    recording::{Recording, RecordingError, read_recording},
    scenes::crumpled_sheet,
};
use clap::Parser;
use embedded::{EMBEDDED_NAME, embedded_scene};
use frames::NoSuchFrames;
use headline::Headline;
use indicatif::{ProgressBar, ProgressStyle};
use input::Input;
use machine::Machine;
use measure::Contestant;
use options::Options;
use ours::{Ours, Reader};
use peak_alloc::PeakAlloc;
use report::Report;
use scale::{Scale, Sweep};
use serde::Serialize;

#[path = "headless/embedded.rs"]
mod embedded;
#[path = "headless/frames.rs"]
mod frames;
#[expect(dead_code, reason = "what a detection did is read from the diagnostics here")]
mod headless;
#[path = "compare/headline.rs"]
mod headline;
#[path = "compare/input.rs"]
mod input;
#[path = "compare/machine.rs"]
mod machine;
#[path = "compare/measure.rs"]
mod measure;
#[path = "compare/options.rs"]
mod options;
#[path = "compare/ours.rs"]
mod ours;
#[path = "compare/parry.rs"]
mod parry;
#[path = "compare/peers.rs"]
mod peers;
#[path = "compare/report.rs"]
mod report;
#[path = "compare/scale/mod.rs"]
mod scale;
#[expect(dead_code, reason = "spreads and fronts are for reports of errors")]
#[path = "speed_vs_error/statistics.rs"]
mod statistics;

/// Counts what is on the heap, for the memory that surfaces and pairs take.
#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

/// A frame of the embedded scene in which the cloth lies in folds.
const EMBEDDED_FRAME: usize = 100;

/// How far the waves of the crumpled sheet move from one frame to the other, in radians.
const SHEET_PHASE: f64 = 0.05;

/// Bad input of any kind: the shell's convention for a wrong call.
const BAD_INPUT: u8 = 2;

#[derive(Debug, thiserror::Error)]
enum CompareError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("{name}: {source}")]
    Mesh { name: String, source: TopologyError },
    #[error(transparent)]
    Frames(#[from] NoSuchFrames),
    #[error(transparent)]
    Rerun(#[from] headless::recording::RecordingError),
    #[error("{}: {source}", .path.display())]
    Write { path: PathBuf, source: io::Error },
}

/// Everything that `--json` writes.
#[derive(Serialize)]
struct Comparison {
    machine: Machine,
    inputs: Vec<Report>,
    headline: Option<Headline>,
    scale: Option<Scale>,
}

fn main() -> ExitCode {
    match compare(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// A recording, its name, and the first frame to measure where none is asked for.
fn recordings(options: &Options) -> Result<Vec<(String, Recording, usize)>, CompareError> {
    if options.files.is_empty() {
        let states = [0.0, SHEET_PHASE].map(|phase| crumpled_sheet(options.sheet as usize, phase));
        let triangles = states[0].triangles.clone();
        let sheet = Recording { triangles, frames: states.into_iter().map(|state| state.positions).collect() };
        let scene = (EMBEDDED_NAME.to_owned(), embedded_scene()?, EMBEDDED_FRAME);
        return Ok(vec![("a crumpled sheet".to_owned(), sheet, 0), scene]);
    }
    let is_recording = |file: &Path| file.extension().is_some_and(|extension| extension == "bin");
    let name = |file: &Path| file.file_stem().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
    if options.files.iter().all(|file| is_recording(file)) {
        let read = |file: &PathBuf| Ok((name(file), read_recording(std::slice::from_ref(file))?, 0));
        return options.files.iter().map(read).collect();
    }
    Ok(vec![(name(&options.files[0]), read_recording(&options.files)?, 0)])
}

fn compare(options: &Options) -> Result<(), CompareError> {
    let load = machine::load();
    let mut inputs = Vec::new();
    for (name, recording, first) in recordings(options)? {
        let frames = match options.frames {
            Some(frames) => frames.of(recording.frames.len())?,
            None => first..first + 1,
        };
        let input = Input::new(name.clone(), &recording, frames, options.contact_distance_edges)
            .map_err(|source| CompareError::Mesh { name, source })?;
        if let Some(folder) = &options.recording.rerun {
            record(&input, options, folder)?;
        }
        let report = measure(&input, options);
        // Whoever reads the table may stop reading.
        let _ = write!(io::stdout(), "{report}");
        inputs.push(report);
    }
    let headline = (!options.no_headline).then(Headline::measure);
    if let Some(headline) = &headline {
        let _ = write!(io::stdout(), "{headline}");
    }
    let sweep = if options.scale { Sweep::Long } else { Sweep::Short };
    let scale = (!options.no_scale).then(|| {
        let progress = spinner();
        let scale = Scale::measure(sweep, |message| report_progress(&progress, message));
        progress.finish_and_clear();
        scale
    });
    if let Some(scale) = &scale {
        let _ = write!(io::stdout(), "{scale}");
    }
    let machine = Machine::new([load, machine::load()]);
    let _ = write!(io::stdout(), "\n{machine}");
    if let Some(path) = &options.json {
        let text = serde_json::to_string_pretty(&Comparison { machine, inputs, headline, scale })
            .expect("numbers and names are JSON");
        fs::write(path, text).map_err(|source| CompareError::Write { path: path.clone(), source })?;
    }
    Ok(())
}

/// Records what is measured, each method into a file of its own.
fn record(input: &Input, options: &Options, folder: &Path) -> Result<(), CompareError> {
    fs::create_dir_all(folder).map_err(|source| CompareError::Write { path: folder.to_owned(), source })?;
    for method in ContactMethod::ALL {
        let path = folder.join(format!("{}_{method:?}.rrd", input.name.replace(' ', "_")));
        Ours::record(input, method, options.recording.recorder(&path)?);
    }
    Ok(())
}

fn spinner() -> ProgressBar {
    ProgressBar::new_spinner()
        .with_style(ProgressStyle::with_template("{elapsed} {msg}").expect("the template is well formed"))
}

fn report_progress(progress: &ProgressBar, message: &str) {
    progress.set_message(message.to_owned());
    progress.tick();
}

fn measure(input: &Input, options: &Options) -> Report {
    let progress = spinner();
    let mut threads = vec![1, usize::from(options.threads)];
    threads.dedup();
    report_progress(&progress, "building");
    let mut contestants = parry::contestants(input);
    for method in ContactMethod::ALL {
        for &threads in &threads {
            contestants.push(Box::new(Ours::new(input, method, threads)) as Box<dyn Contestant>);
            if !method.is_exact() {
                contestants.push(Box::new(Reader(Ours::new(input, method, threads))));
            }
        }
    }
    report_progress(&progress, "building and starting peers");
    let (peers, mut faults) = peers::contestants(if options.no_peers { &[] } else { &options.peers }, input, &threads);
    contestants.extend(peers);
    let (log, failed) = measure::play(input, contestants, options.repeat, |message| {
        report_progress(&progress, message);
    });
    progress.finish_and_clear();
    faults.extend(failed);
    Report::new(input, &log, faults)
}
