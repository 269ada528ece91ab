//! Compares times and memory with other libraries on the same input: one table, measured in one run.
//!
//! `cargo run --release --example compare -- [FILES…] [options]`; `--help` lists the options. Without files it uses a
//! crumpled sheet and the embedded scene. All contestants get the same mesh, contact distance, and boxes, and take
//! turns: each is measured once per round. Medians are also given relative to parry's traversal of its tree in the same
//! run, with the faster of its two build strategies.
//!
//! *Cold* is a tick in which the mesh has new positions and [`Teleported`](bevy_circumsphere::Teleported) prevents the
//! reuse of earlier results. In the tick before, the mesh had another shape: the previous frame, or the next one for
//! the first frame. If the mesh never moves, every vertex was a contact distance away. Trees are kept and refitted, as
//! in the other libraries. *Moved* is the mean of the twelve ticks that follow. Every vertex moves by 0.09 contact
//! distances per tick, in its own direction. Ticks that reuse a list of near pairs and ticks that make a new one are
//! also given separately. *Unchanged* is the next tick, in which nothing is written. The time of our methods is that of
//! the whole app update, including the storage of contacts.
//!
//! The table also shows what each contestant found, because the results differ. `box pairs` are pairs of overlapping
//! boxes, including neighbors. They must agree for all contestants. Contestants that disagree are named below the
//! table, and so are exact methods of ours that disagree. Our methods never store neighbors, and their boxes are larger
//! by a thousandth of the contact distance. Therefore `apart`, the box pairs that are not neighbors, differs slightly.
//! `tested` are pairs that reach an exact test in f64, because no slab separates them. `BoundingSphere` and
//! `Circumsphere` define touching differently. parry computes distances in f32 with absolute tolerances, so its
//! `touching` is close to ours but not exact. rapier's contacts are of another kind: see `benches/peers/src/rapier.rs`.
//!
//! Whole steps are another section, see [`steps`]: cloths that fall onto a ball, a mesh of a ball, and hilly ground, moved
//! by the response and by rapier's soft bodies. The time is that of the whole app update, and of rapier's whole step. At
//! the end, the f64 reference counts what crosses. `--no-steps` skips it. A third section has whole steps of tetrahedral
//! bodies, see [`steps::Solids`]. `--no-solids` skips it.
//!
//! Peers that would add dependencies to the crate are separate programs, see [`peers`]. They are downloaded and
//! compiled only when they are compared. obvhs and rapier3d are in a package with its own lock file, which takes about
//! two minutes to build. Embree is called from a C file that links the system's library. The crate's own builds and
//! tests do not depend on them.

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_circumsphere::{ContactMethod, geometry::TopologyError};
use circumsphere_examples::{
    headless::{
        self,
        embedded::{EMBEDDED_NAME, embedded_scene},
        frames::NoSuchFrames,
    },
    scenes::Extent,
};
use circumsphere_reports::BAD_INPUT;
use circumsphere_reports::machine::{self, Machine};
use circumsphere_support::{
    recording::{Recording, RecordingError, read_recording},
    scenes::crumpled_sheet,
};
use clap::Parser;
use headline::Headline;
use indicatif::{ProgressBar, ProgressStyle};
use input::Input;
use measure::Contestant;
use options::Options;
use ours::{Ours, WithPoints};
use peak_alloc::PeakAlloc;
use peers::Peer;
use report::Report;
use scale::{Scale, Sweep};
use serde::Serialize;
use steps::{Solids, Steps};

mod headline;
mod input;
mod measure;
mod options;
mod ours;
mod parry;
mod peers;
mod report;
mod scale;
mod steps;

/// Tracks heap usage, for the memory of surfaces and pairs.
#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

/// A frame of the embedded scene in which the cloth is folded.
const EMBEDDED_FRAME: usize = 100;

/// Phase shift of the waves of the crumpled sheet between its two frames, in radians.
const SHEET_PHASE: f64 = 0.05;

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

/// Contents of the `--json` file.
#[derive(Serialize)]
struct Comparison {
    machine: Machine,
    inputs: Vec<Report>,
    headline: Option<Headline>,
    steps: Option<Steps>,
    solids: Option<Solids>,
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

/// Recordings, each with its name and the frame that is measured by default.
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
        // Ignore errors: the reader of the table may have closed the pipe.
        let _ = write!(io::stdout(), "{report}");
        inputs.push(report);
    }
    let headline = (!options.no_headline).then(Headline::measure);
    if let Some(headline) = &headline {
        let _ = write!(io::stdout(), "{headline}");
    }
    let steps = (!options.no_steps).then(|| {
        let progress = spinner();
        let extent = if options.small_steps { Extent::Small } else { Extent::Usual };
        let with_rapier = options.peers().contains(&Peer::Rapier);
        let steps = Steps::measure(extent, &options.thread_counts(), with_rapier, |message| {
            report_progress(&progress, message);
        });
        progress.finish_and_clear();
        steps
    });
    if let Some(steps) = &steps {
        let _ = write!(io::stdout(), "{steps}");
    }
    let solids = (!options.no_solids).then(|| {
        let progress = spinner();
        let extent = if options.small_steps { Extent::Small } else { Extent::Usual };
        let with_rapier = options.peers().contains(&Peer::Rapier);
        let solids = Solids::measure(extent, &options.thread_counts(), with_rapier, |message| {
            report_progress(&progress, message);
        });
        progress.finish_and_clear();
        solids
    });
    if let Some(solids) = &solids {
        let _ = write!(io::stdout(), "{solids}");
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
        let text = serde_json::to_string_pretty(&Comparison { machine, inputs, headline, steps, solids, scale })
            .expect("numbers and names are JSON");
        fs::write(path, text).map_err(|source| CompareError::Write { path: path.clone(), source })?;
    }
    Ok(())
}

/// Records the measured ticks, one file per method.
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
    let threads = options.thread_counts();
    report_progress(&progress, "building");
    let mut contestants = parry::contestants(input);
    for method in ContactMethod::ALL {
        for &threads in &threads {
            contestants.push(Box::new(Ours::new(input, method, threads)) as Box<dyn Contestant>);
            if !method.is_exact() {
                contestants.push(Box::new(WithPoints(Ours::with_points(input, method, threads))));
            }
        }
    }
    report_progress(&progress, "building and starting peers");
    let (peers, mut faults) = peers::contestants(options.peers(), input, &threads);
    contestants.extend(peers);
    let (log, failed) = measure::play(input, contestants, options.repeat, |message| {
        report_progress(&progress, message);
    });
    progress.finish_and_clear();
    faults.extend(failed);
    Report::new(input, &log, faults)
}
