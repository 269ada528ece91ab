//! Measures the time and the errors of each contact method against the f64 reference, and writes a report.
//!
//! `cargo run --release --example speed_vs_error -- [FOLDER] [options]`; `--help` lists the options. Without a folder
//! of recordings it plays generated scenes.

mod configurations;
mod measure;
mod options;
mod player;
mod plots;
mod pooled;
mod report;
mod scaling;
mod scene;
mod sliding;
mod truth;

use std::{path::Path, process::ExitCode, time::Instant};

use circumsphere_examples::headless;
use circumsphere_reports::{BAD_INPUT, OutputError};
use clap::Parser;
use configurations::{Configuration, DEFAULT_DISTANCE};
use indicatif::{ProgressBar, ProgressStyle};
use measure::Measured;
use options::{Extent, Options, OptionsError};
use peak_alloc::PeakAlloc;
use report::Study;
use scaling::ScalingRow;
use scene::{Scene, SceneError};
use sliding::SlidingRow;

/// Tracks heap usage, so that the report can state the memory per triangle.
#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

#[derive(Debug, thiserror::Error)]
enum ReportError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Options(#[from] OptionsError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Rerun(#[from] headless::recording::RecordingError),
}

fn main() -> ExitCode {
    let options = Options::parse();
    match study(&options).and_then(|study| report::write(&options, &study)) {
        Ok(()) => {
            println!("wrote {}", options.out.join("report.md").display());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Measures everything that the options ask for.
fn study(options: &Options) -> Result<Study, ReportError> {
    let distances = options.contact_distances()?;
    let scenes = scene::scenes(options)?;
    let configurations = configurations::configurations(&distances, options.extent());
    // Create the folder first, so that errors appear before anything is measured.
    std::fs::create_dir_all(&options.out).map_err(|source| OutputError::File { path: options.out.clone(), source })?;
    let start = Instant::now();
    let farthest = distances[distances.len() - 1];
    let sizes = if options.folder.is_some() { &[][..] } else { scaling::sizes(options.extent()) };
    let steps = scenes.len() * (configurations.len() + 1) + sizes.len() + usize::from(options.folder.is_none());
    let progress = ProgressBar::new(steps as u64).with_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} {msg}, {eta} left").expect("the template is well formed"),
    );

    if let Some(folder) = &options.recording.rerun {
        progress.set_message("recordings for the Rerun viewer");
        let distance = if distances.contains(&DEFAULT_DISTANCE) { DEFAULT_DISTANCE } else { distances[0] };
        let recorded = configurations.iter().filter(|one| one.is_default() && one.distance_edges == distance);
        record(options, folder, &scenes, recorded)?;
    }
    let mut measured: Vec<Measured> = Vec::new();
    for scene in &scenes {
        progress.set_message(format!("{}: truth", scene.name));
        let truth = truth::truth(scene, farthest);
        progress.inc(1);
        for configuration in &configurations {
            progress.set_message(format!("{}: {}", scene.name, configuration.name));
            measured.push(measure::measure(scene, &truth, configuration));
            progress.inc(1);
        }
        // The configurations take turns, so that a disturbance does not affect all times of one of them.
        let of_scene = measured.len() - configurations.len();
        for _ in 1..measure::rounds(scene, options.extent()) {
            progress.set_message(format!("{}: times", scene.name));
            measured[of_scene..].iter_mut().for_each(|one| one.time_again(scene));
        }
    }
    let mut scaling: Vec<ScalingRow> = Vec::new();
    for &size in sizes {
        progress.set_message(format!("{size} triangles"));
        scaling.extend(scaling::measure_size(size)?);
        progress.inc(1);
    }
    let mut sliding: Vec<SlidingRow> = Vec::new();
    if options.folder.is_none() {
        progress.set_message("sliding bodies");
        sliding = sliding::measure(options.extent() < Extent::Full);
        progress.inc(1);
    }
    progress.finish_and_clear();
    let pooled = pooled::pooled(&measured);
    let scenes = scenes.iter().map(report::SceneFacts::new).collect();
    Ok(Study { scenes, configurations, measured, pooled, scaling, sliding, seconds: start.elapsed().as_secs_f64() })
}

/// Records every scene with each configuration, in one file each.
fn record<'a>(
    options: &Options,
    folder: &Path,
    scenes: &[Scene],
    configurations: impl Iterator<Item = &'a Configuration> + Clone,
) -> Result<(), ReportError> {
    std::fs::create_dir_all(folder).map_err(|source| OutputError::File { path: folder.to_owned(), source })?;
    for scene in scenes {
        for configuration in configurations.clone() {
            let path = folder.join(format!("{}_{}.rrd", scene.name, configuration.name));
            player::record(scene, configuration, options.recording.recorder(&path)?);
        }
    }
    Ok(())
}
