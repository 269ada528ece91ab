//! The command-line options and the values derived from them.

use std::path::PathBuf;

use circumsphere_examples::headless::recording::RecordingOptions;
use circumsphere_support::scenes::{Fineness, MOVING_SCENES};
use clap::Parser;

use super::configurations::{ALL_DISTANCES, DEFAULT_DISTANCE};

/// Measure the time and the errors of each contact method, and write a report.
#[derive(Parser, Debug)]
#[command(name = "speed_vs_error", allow_negative_numbers = true)]
pub struct Options {
    /// Folder of recordings (.bin, .ply, .obj) to measure; without it, generated scenes are measured
    pub folder: Option<PathBuf>,
    /// Folder for the report; created if missing
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub out: PathBuf,
    /// Use smaller scenes and fewer settings; takes less than a minute
    #[arg(long)]
    pub quick: bool,
    /// Use the smallest scenes and the fewest settings, to check that everything works; takes a few seconds
    #[arg(long)]
    pub smoke: bool,
    /// Measure only these scenes, by name; for a folder, by file name without extension
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Number of ticks to play per scene, or frames per recording [default: 16; 3 for recordings]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: Option<u32>,
    /// Contact distances in mean edges [default: 0.02,0.1,0.5; 0.1 for recordings]
    #[arg(long, value_name = "X,…", value_delimiter = ',')]
    pub distances: Vec<f64>,
    #[command(flatten)]
    pub recording: RecordingOptions,
}

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Extent {
    Smoke,
    Quick,
    Full,
}

#[derive(Debug, thiserror::Error)]
pub enum OptionsError {
    #[error("--scenes {name}: expected one or more of {known}")]
    NoSuchScene { name: String, known: String },
    #[error("--distances {value}: expected a number above 0 and at most 10")]
    Distance { value: f64 },
}

impl Options {
    pub fn extent(&self) -> Extent {
        match (self.smoke, self.quick) {
            (true, _) => Extent::Smoke,
            (false, true) => Extent::Quick,
            (false, false) => Extent::Full,
        }
    }

    pub fn fineness(&self) -> Fineness {
        match self.extent() {
            Extent::Smoke => Fineness::Coarse,
            Extent::Quick => Fineness::Middle,
            Extent::Full => Fineness::Fine,
        }
    }

    /// Number of ticks of a generated scene.
    pub fn ticks(&self) -> usize {
        let default = match self.extent() {
            Extent::Smoke => 4,
            Extent::Quick => 8,
            Extent::Full => 16,
        };
        self.frames.map_or(default, |frames| frames as usize)
    }

    /// Largest number of frames of a recording.
    pub fn recording_frames(&self) -> usize {
        self.frames.map_or(3, |frames| frames as usize)
    }

    /// Names of the generated scenes to play, in order.
    pub fn scene_names(&self) -> Result<Vec<&'static str>, OptionsError> {
        if let Some(name) = self.scenes.iter().find(|name| !MOVING_SCENES.contains(&name.as_str())) {
            return Err(OptionsError::NoSuchScene { name: name.clone(), known: MOVING_SCENES.join(", ") });
        }
        let wanted = |name: &&str| self.scenes.is_empty() || self.scenes.iter().any(|scene| scene == name);
        Ok(MOVING_SCENES.into_iter().filter(wanted).collect())
    }

    /// Contact distances in mean edges, ascending.
    pub fn contact_distances(&self) -> Result<Vec<f64>, OptionsError> {
        if let Some(&value) = self.distances.iter().find(|&&distance| !(distance > 0.0 && distance <= 10.0)) {
            return Err(OptionsError::Distance { value });
        }
        let mut distances = if !self.distances.is_empty() {
            self.distances.clone()
        } else if self.folder.is_some() || self.extent() == Extent::Smoke {
            vec![DEFAULT_DISTANCE]
        } else {
            ALL_DISTANCES.to_vec()
        };
        distances.sort_by(f64::total_cmp);
        distances.dedup();
        Ok(distances)
    }
}
