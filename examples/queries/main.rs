//! Casts rays at a recorded deforming mesh and finds closest points on it, frame by frame, in a headless app.
//!
//! `cargo run --release --example queries -- [FILES…] [--rays RAYS.csv --hits HITS.csv] [--points POINTS.csv --closest
//! CLOSEST.csv]`. Without files of queries, random rays and points go around the mesh, and a table says how long they take.
//! Without files of frames it plays an embedded scene.

mod input;
mod output;
mod player;
mod report;

use std::{
    io::{self, Write},
    path::PathBuf,
    process::ExitCode,
};

use circumsphere_examples::headless::{
    BAD_INPUT,
    embedded::{EMBEDDED_NAME, embedded_scene},
};
use circumsphere_support::recording::{RecordingError, read_recording};
use clap::Parser;

/// Cast rays at a recorded deforming mesh and find closest points on it, frame by frame.
#[derive(Parser, Debug)]
#[command(name = "queries")]
struct Options {
    /// The frames of one mesh in order (PLY or OBJ), or one .bin recording; without files: an embedded scene
    files: Vec<PathBuf>,
    /// Read rays, with the columns frame, `origin_x`, `origin_y`, `origin_z`, `direction_x`, `direction_y`, `direction_z`, and
    /// `max_distance` (in lengths of the direction; may be inf)
    #[arg(long, value_name = "RAYS.csv", requires = "hits")]
    rays: Option<PathBuf>,
    /// Write where they hit: one row for each ray, empty after its number where it hits nothing
    #[arg(long, value_name = "HITS.csv", requires = "rays")]
    hits: Option<PathBuf>,
    /// Read points, with the columns frame, x, y, z, and `max_distance` (may be inf)
    #[arg(long, value_name = "POINTS.csv", requires = "closest")]
    points: Option<PathBuf>,
    /// Write the closest points of the mesh: one row for each point, empty after its number where none is in reach
    #[arg(long, value_name = "CLOSEST.csv", requires = "points")]
    closest: Option<PathBuf>,
}

#[derive(Debug, thiserror::Error)]
enum QueriesError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("{name}: {source}")]
    Mesh { name: String, source: bevy_circumsphere::geometry::TopologyError },
    #[error(transparent)]
    Input(#[from] input::InputError),
    #[error(transparent)]
    Output(#[from] output::OutputError),
}

fn main() -> ExitCode {
    match answer(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn answer(options: &Options) -> Result<(), QueriesError> {
    let (name, recording) = match options.files.as_slice() {
        [] => (EMBEDDED_NAME.to_owned(), embedded_scene()?),
        files => (files[0].display().to_string(), read_recording(files)?),
    };
    let frames = recording.frames.len();
    let mut queries = player::Queries {
        rays: options.rays.as_deref().map(|path| input::read_rays(path, frames)).transpose()?.unwrap_or_default(),
        points: options.points.as_deref().map(|path| input::read_points(path, frames)).transpose()?.unwrap_or_default(),
    };
    if options.rays.is_none() && options.points.is_none() {
        queries = player::Queries::around(&recording);
    }
    // Opened before anything is computed, so that a wrong path is reported at once.
    let hits = options.hits.as_deref().map(output::create_hits).transpose()?;
    let closest = options.closest.as_deref().map(output::create_closest).transpose()?;
    let answers =
        player::play(&recording, &queries).map_err(|source| QueriesError::Mesh { name: name.clone(), source })?;
    if let Some(hits) = hits {
        output::write_hits(hits, &answers.hits)?;
    }
    if let Some(closest) = closest {
        output::write_closest(closest, &answers.closest)?;
    }
    let report = report::Report::new(name, &recording, &answers);
    // The reader of the table may have closed the pipe.
    let _ = write!(io::stdout(), "{report}");
    Ok(())
}
