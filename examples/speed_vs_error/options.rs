//! What the command line may ask for, and what it amounts to.

use std::path::PathBuf;

use circumsphere_support::scenes::{Fineness, MOVING_SCENES};
use clap::Parser;

use super::{
    configurations::{ALL_DISTANCES, DEFAULT_DISTANCE},
    headless::recording::RecordingOptions,
};

/// Measure what each contact method costs and what it gets wrong, and write a report.
#[derive(Parser, Debug)]
#[command(name = "speed_vs_error", allow_negative_numbers = true)]
pub struct Options {
    /// A folder of recordings (.bin, .ply, .obj) to measure on; none: scenes of the project's own making
    pub folder: Option<PathBuf>,
    /// Where the report goes; made where it is missing
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub out: PathBuf,
    /// Smaller scenes and fewer settings: under a minute
    #[arg(long)]
    pub quick: bool,
    /// The smallest scenes and the fewest settings: a few seconds, to see that everything works
    #[arg(long)]
    pub smoke: bool,
    /// Only these scenes, by name; of a folder the files' names without their extension
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Ticks of each scene, or frames of each recording, to play [default: 16; of recordings 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: Option<u32>,
    /// Contact distances in mean edges [default: 0.02,0.1,0.5; of recordings 0.1]
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
    #[error("--scenes {name}: expected some of {known}")]
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

    /// Ticks of a generated scene.
    pub fn ticks(&self) -> usize {
        let default = match self.extent() {
            Extent::Smoke => 4,
            Extent::Quick => 8,
            Extent::Full => 16,
        };
        self.frames.map_or(default, |frames| frames as usize)
    }

    /// Frames of a recording at most.
    pub fn recording_frames(&self) -> usize {
        self.frames.map_or(3, |frames| frames as usize)
    }

    /// The generated scenes to play, in their order.
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
