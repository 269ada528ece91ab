//! Detects the contacts of a recorded deforming mesh with itself, frame by frame, in a headless app.
//!
//! `cargo run --release --example replay -- [FILES…] [options]`; `--help` lists the options. Without files it plays an
//! embedded scene: a cloth falls over a ball and a deforming torus and folds onto itself.

mod options;
mod output;
mod player;
mod report;

use std::{
    io::{self, Write},
    process::ExitCode,
};

use circumsphere_examples::headless::{
    self, BAD_INPUT,
    embedded::{EMBEDDED_NAME, embedded_scene},
};
use circumsphere_support::{
    recording::{RecordingError, read_recording},
    scenes::CLOTH_FALL_BODIES,
};
use clap::Parser;
use options::{Options, OptionsError};
use output::OutputError;

#[derive(Debug, thiserror::Error)]
enum ReplayError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("{name}: {source}")]
    Mesh { name: String, source: bevy_circumsphere::geometry::TopologyError },
    #[error(transparent)]
    Options(#[from] OptionsError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Rerun(#[from] headless::recording::RecordingError),
}

fn main() -> ExitCode {
    match replay(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn replay(options: &Options) -> Result<(), ReplayError> {
    let name = options.input_name(EMBEDDED_NAME);
    let (recording, names) = if options.files.is_empty() {
        (embedded_scene()?, &CLOTH_FALL_BODIES[..])
    } else {
        (read_recording(&options.files)?, &[][..])
    };
    let scene = player::Scene::new(&recording, options, names)
        .map_err(|source| ReplayError::Mesh { name: name.clone(), source })?;
    let settings = options.settings(scene.mean_edge(), recording.frames.len())?;
    let mut writers = output::Writers::create(options)?;
    let recorder = options.recording.rerun.as_deref().map(|path| options.recording.recorder(path)).transpose()?;
    let played = player::play(&recording, &scene, &settings, recorder.unwrap_or_default(), |frame, contacts| {
        writers.write(frame, contacts)
    })?;
    let report = report::Report::new(name, &recording, &settings, played);
    writers.finish(&report)?;
    // The reader of the table may have closed the pipe.
    let _ = write!(io::stdout(), "{report}");
    Ok(())
}
