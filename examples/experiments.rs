//! Repeats the experiments of the source paper, which describes them only in words, as numbers and plots.
//!
//! `cargo run --release --example experiments -- [options]`; `--help` lists the options. Writes tables (CSV), plots,
//! and `report.md`, in which every experiment ends with one sentence: the claim, the result, and whether the claim
//! holds.

#[path = "experiments/caps.rs"]
mod caps;
#[path = "experiments/delta.rs"]
mod delta;
mod drawing;
#[path = "experiments/finding.rs"]
mod finding;
#[expect(dead_code, reason = "this example uses the contacts of a detection, not its statistics")]
mod headless;
#[path = "experiments/iterations.rs"]
mod iterations;
#[path = "compare/machine.rs"]
mod machine;
#[path = "headless/method.rs"]
mod method;
#[path = "experiments/options.rs"]
mod options;
#[path = "experiments/player.rs"]
mod player;
#[path = "experiments/plots.rs"]
mod plots;
#[path = "experiments/report.rs"]
mod report;
#[path = "experiments/residual.rs"]
mod residual;
#[expect(dead_code, reason = "experiments use their own player")]
mod scenes;
#[path = "experiments/sizes.rs"]
mod sizes;
#[expect(dead_code, reason = "only the example `speed_vs_error` uses the rest")]
#[path = "speed_vs_error/statistics.rs"]
mod statistics;
#[path = "speed_vs_error/tables.rs"]
mod tables;
#[path = "experiments/tunnelling.rs"]
mod tunnelling;

use std::{path::PathBuf, process::ExitCode, time::Instant};

use circumsphere_support::recording::RecordingError;
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use options::{Experiment, Options};
use report::Study;

/// Exit status for any bad input, by the shell's convention for wrong usage.
const BAD_INPUT: u8 = 2;

#[derive(Debug, thiserror::Error)]
enum ReportError {
    #[error(transparent)]
    Scene(#[from] RecordingError),
    #[error("cannot write {}: {source}", .path.display())]
    Write { path: PathBuf, source: std::io::Error },
    #[error("cannot write {}: {source}", .path.display())]
    Csv { path: PathBuf, source: csv::Error },
    #[error("cannot draw {}: {reason}", .path.display())]
    Draw { path: PathBuf, reason: String },
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
    // Create the folder first, so that an error shows before anything is measured.
    std::fs::create_dir_all(&options.out).map_err(|source| ReportError::Write { path: options.out.clone(), source })?;
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
