//! Measures flat and smooth surfaces against the bodies on which the vertices of their meshes lie: error against time
//! at several resolutions, and ripple under a rolling ball. Writes a report.
//!
//! `cargo run --release --example smooth_bodies -- [options]`; `--help` lists the options.

mod bodies;
mod equal_error;
mod measure;
mod options;
mod plots;
mod report;
mod rolling;
mod scenes;

use std::{process::ExitCode, time::Instant};

use circumsphere_reports::{
    BAD_INPUT, OutputError,
    machine::{self, Machine},
};
use clap::Parser;
use equal_error::{AtTarget, EqualError};
use indicatif::{ProgressBar, ProgressStyle};
use measure::Cell;
use options::{Options, OptionsError};
use rolling::RollingRow;
use serde::Serialize;

#[derive(Debug, thiserror::Error)]
enum ReportError {
    #[error(transparent)]
    Options(#[from] OptionsError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// All results, as `report.json` has them.
#[derive(Serialize)]
struct Study {
    machine: Machine,
    seconds: f64,
    cells: Vec<Cell>,
    /// Flat surfaces at the errors of smooth ones.
    equal_errors: Vec<EqualError>,
    /// Both at given errors.
    at_targets: Vec<AtTarget>,
    rolling: Vec<RollingRow>,
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
    let scenes = options.chosen_scenes()?;
    let methods = options.contact_methods();
    // Create the folder first, so that errors appear before anything is measured.
    std::fs::create_dir_all(&options.out).map_err(|source| OutputError::File { path: options.out.clone(), source })?;
    let (load, start) = (machine::load(), Instant::now());
    let steps = methods.len() * (scenes.len() * options.levels().len() + rolling::GROUNDS.len());
    let progress = ProgressBar::new(steps as u64).with_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} {msg}, {eta} left").expect("the template is well formed"),
    );
    let (mut cells, mut rolling) = (Vec::new(), Vec::new());
    for &method in &methods {
        for scene in &scenes {
            for &level in options.levels() {
                progress.set_message(format!("{}, level {level}, {method:?}", scene.name));
                cells.extend(measure::measure(scene, options.poses_per_gap(), options.timed_ticks(), level, method));
                progress.inc(1);
            }
        }
        for ground in &rolling::GROUNDS {
            progress.set_message(format!("rolling over a coarse {}, {method:?}", ground.0));
            rolling.extend(rolling::measure(ground, options.rolling_ticks(), method));
            progress.inc(1);
        }
    }
    progress.finish_and_clear();
    Ok(Study {
        machine: Machine::new([load, machine::load()]),
        seconds: start.elapsed().as_secs_f64(),
        equal_errors: equal_error::equal_errors(&cells),
        at_targets: equal_error::at_targets(&cells),
        cells,
        rolling,
    })
}
