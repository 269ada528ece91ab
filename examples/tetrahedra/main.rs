//! Finds the vertices of two tetrahedral bodies that lie in each other, in a headless app.
//!
//! `cargo run --release --example tetrahedra -- A.msh B.msh --translate X,Y,Z --containments FILE.csv`; `--help` lists
//! the options. Without files it plays an embedded scene: two soft bodies fall on each other.

mod options;
mod output;
mod stage;

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_circumsphere::{SurfaceStatus, geometry::TetrahedraError, response::XpbdBodyError};
use circumsphere_examples::headless::{BAD_INPUT, recording::RecordingError};
use circumsphere_support::tetrahedra::{TetrahedralMesh, TetrahedralMeshError, read_tetrahedral_mesh};
use clap::Parser;
use options::{Options, Translation};
use output::OutputError;
use stage::{Part, Stage};

#[derive(Debug, thiserror::Error)]
enum TetrahedraExampleError {
    #[error(transparent)]
    Mesh(#[from] TetrahedralMeshError),
    #[error("{}: {source}", .file.display())]
    Body { file: PathBuf, source: TetrahedraError },
    #[error("{}: vertex {vertex} leaves the range of single precision when it is moved", .file.display())]
    Moved { file: PathBuf, vertex: usize },
    #[error("{name}: cannot be used: {status:?}")]
    Unused { name: String, status: SurfaceStatus },
    #[error("{}: is one of the bodies, and would be overwritten", .file.display())]
    Overwritten { file: PathBuf },
    #[error(transparent)]
    Soft(#[from] XpbdBodyError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Rerun(#[from] RecordingError),
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn run(options: &Options) -> Result<(), TetrahedraExampleError> {
    let meshes = match (&options.first, &options.second) {
        (Some(first), Some(second)) => Some([load(first, Translation::default())?, load(second, options.translate)?]),
        _ => None,
    };
    if let Some(file) = &options.containments {
        let place = |path: &Path| path.canonicalize().ok();
        let bodies = [&options.first, &options.second].into_iter().flatten();
        if place(file).is_some_and(|own| bodies.map(|body| place(body)).any(|body| body.as_ref() == Some(&own))) {
            return Err(TetrahedraExampleError::Overwritten { file: file.clone() });
        }
    }
    let file = options.containments.as_deref().map(output::ContainmentFile::create).transpose()?;
    let recorder = options.recording.rerun.as_deref().map(|path| options.recording.recorder(path)).transpose()?;
    let recorder = recorder.unwrap_or_default();
    let (parts, moves) = meshes.map_or_else(|| (stage::embedded_scene(), true), |meshes| (meshes, false));
    let mut stage = Stage::new(parts, moves, recorder)?;
    let ticks = if moves { stage::TICKS } else { 1 };
    let table = (0..ticks).map(|tick| stage.tick(tick)).collect::<Result<Vec<_>, _>>()?;
    if let Some(file) = file {
        file.write(&stage.rows())?;
    }
    // The reader of the table may have closed the pipe.
    let _ = write!(io::stdout(), "{}", output::Table { bodies: stage.describe(), ticks: &table });
    Ok(())
}

/// Reads a body and moves it, in single precision.
fn load(file: &Path, by: Translation) -> Result<Part, TetrahedraExampleError> {
    let mut mesh: TetrahedralMesh = read_tetrahedral_mesh(file)?;
    for (vertex, position) in mesh.positions.iter_mut().enumerate() {
        for (coordinate, by) in position.iter_mut().zip(by.0) {
            *coordinate += by;
        }
        if !position.iter().all(|coordinate| coordinate.is_finite()) {
            return Err(TetrahedraExampleError::Moved { file: file.to_path_buf(), vertex });
        }
    }
    Ok(Part { name: file.display().to_string(), mesh })
}
