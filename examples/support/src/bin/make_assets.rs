//! Writes the embedded scene to a path: `make_assets assets/cloth_fall.bin`.

use std::path::PathBuf;
use std::process::ExitCode;

use circumsphere_support::recording::write_recording;
use circumsphere_support::scenes::cloth_fall;

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: make_assets PATH, where PATH is the recording to write");
        return ExitCode::FAILURE;
    };
    match write_recording(&path, &cloth_fall()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
