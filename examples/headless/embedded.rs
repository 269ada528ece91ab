//! A scene of the project's own making, so that the first run needs no data.

use std::path::Path;

use circumsphere_support::recording::{Recording, RecordingError};

pub const EMBEDDED_NAME: &str = "the embedded scene";

pub fn embedded_scene() -> Result<Recording, RecordingError> {
    Recording::from_bytes(include_bytes!("../../assets/cloth_fall.bin"), Path::new(EMBEDDED_NAME))
}
