//! The options of every example that can record for the Rerun viewer.

use std::path::{Path, PathBuf};

use bevy_app::prelude::*;
use clap::Args;

/// What to record, and where.
#[derive(Args, Clone, Debug)]
pub struct RecordingOptions {
    /// Record every tick for the Rerun viewer into this file (.rrd), or folder where several scenes are played; needs the
    /// feature `rerun`
    #[arg(long, value_name = "PATH")]
    pub rerun: Option<PathBuf>,
    /// Record every layer whole, not only near contacts
    #[arg(long, requires = "rerun")]
    rerun_all: bool,
    /// Megabytes that a recorded tick may take before compression; what exceeds them is thinned
    #[arg(long, value_name = "MB", default_value_t = 4, requires = "rerun")]
    rerun_budget: u32,
}

#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    #[cfg(not(feature = "rerun"))]
    #[error("--rerun {}: this program was built without the feature; add --features rerun to cargo's options", .0.display())]
    WithoutFeature(PathBuf),
    #[cfg(feature = "rerun")]
    #[error(transparent)]
    Rerun(#[from] bevy_circumsphere::debug::RerunError),
}

/// Records an app. The default records nothing.
#[derive(Default)]
pub struct Recorder(Option<Record>);

#[cfg(feature = "rerun")]
type Record = (bevy_circumsphere::debug::DeformableRerunPlugin, bevy_circumsphere::debug::RerunSettings);

/// Without the feature there is no recording.
#[cfg(not(feature = "rerun"))]
type Record = std::convert::Infallible;

impl RecordingOptions {
    /// Opens the file and applies the options.
    pub fn recorder(&self, path: &Path) -> Result<Recorder, RecordingError> {
        open(self, path).map(|record| Recorder(Some(record)))
    }
}

#[cfg(feature = "rerun")]
fn open(options: &RecordingOptions, path: &Path) -> Result<Record, RecordingError> {
    use bevy_circumsphere::debug::{DeformableRerunPlugin, RerunSettings};

    let settings = if options.rerun_all { RerunSettings::everything() } else { RerunSettings::default() };
    let bytes_per_tick = options.rerun_budget as usize * 1_000_000;
    Ok((DeformableRerunPlugin::to_file(path)?, RerunSettings { bytes_per_tick, ..settings }))
}

#[cfg(not(feature = "rerun"))]
fn open(_options: &RecordingOptions, path: &Path) -> Result<Record, RecordingError> {
    Err(RecordingError::WithoutFeature(path.to_owned()))
}

impl Recorder {
    /// Records everything that the app does from now on.
    pub fn add_to(self, app: &mut App) {
        if let Some(record) = self.0 {
            add(record, app);
        }
    }
}

#[cfg(feature = "rerun")]
fn add((plugin, settings): Record, app: &mut App) {
    app.insert_resource(settings);
    app.add_plugins(plugin);
}

#[cfg(not(feature = "rerun"))]
fn add(record: Record, _app: &mut App) {
    match record {}
}
