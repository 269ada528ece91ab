//! Repeats the experiments of the source paper in numbers and plots. The paper describes them only in words.
//!
//! `cargo run --release --example experiments -- [options]`; `--help` lists the options. Writes tables (CSV), plots,
//! and `report.md`. In the report, every experiment ends with one sentence: the claim, the result, and whether the
//! claim holds.

mod caps;
mod delta;
mod iterations;
mod options;
mod player;
mod plots;
mod report;
mod residual;
mod sizes;
mod tested;
mod tunnelling;

use std::{process::ExitCode, time::Instant};

use circumsphere_reports::machine;
use circumsphere_reports::{BAD_INPUT, OutputError};
use circumsphere_support::recording::RecordingError;
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use options::{Experiment, Options};
use report::Study;

#[derive(Debug, thiserror::Error)]
enum ReportError {
    #[error(transparent)]
    Scene(#[from] RecordingError),
    #[error(transparent)]
    Output(#[from] OutputError),
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

/// Runs the requested experiments.
fn study(options: &Options) -> Result<Study, ReportError> {
    // Create the folder first, so that errors appear before anything is measured.
    std::fs::create_dir_all(&options.out).map_err(|source| OutputError::File { path: options.out.clone(), source })?;
    let extent = options.extent();
    let load = machine::load();
    let start = Instant::now();
    let mut study = Study::default();
    for experiment in options.experiments() {
        let progress = ProgressBar::new(0).with_style(
            ProgressStyle::with_template("{prefix} {bar:40} {pos}/{len}, {eta} left")
                .expect("the template is well formed"),
        );
        progress.set_prefix(experiment.title());
        match experiment {
            Experiment::Delta => study.delta = delta::measure(extent, &progress),
            Experiment::Iterations => study.iterations = iterations::measure(extent, &progress),
            Experiment::Tunnelling => study.tunnelling = tunnelling::measure(extent, &progress),
            Experiment::Caps => study.caps = caps::measure(extent, &progress)?,
            Experiment::Sizes => study.sizes = sizes::measure(extent, &progress),
        }
        progress.finish_and_clear();
    }
    study.seconds = start.elapsed().as_secs_f64();
    study.load = [load, machine::load()];
    Ok(study)
}
