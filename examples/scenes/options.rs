//! What the command line of every scene may ask for.

use bevy_circumsphere::{CircumsphereSettings, response::XpbdSettings};
use clap::Args;

use super::{Extent, Variation};
use crate::{headless::recording::RecordingOptions, method::Method};

#[derive(Args, Clone, Debug)]
pub struct SceneOptions {
    /// How many ticks of a sixtieth of a second to play [default: as many as show what the scene is about]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub ticks: Option<u32>,
    /// How a pair of triangles is tested
    #[arg(long, value_enum, default_value_t = Method::Refined)]
    pub method: Method,
    /// Threads that may work on one tick; 1 bypasses any pool
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: u16,
    /// Into how many steps a tick is cut
    #[arg(long, value_name = "N", default_value_t = XpbdSettings::default().substeps, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub substeps: u32,
    /// How often a step goes over all constraints
    #[arg(long, value_name = "N", default_value_t = XpbdSettings::default().iterations, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub iterations: u32,
    /// Detect only where things are when a tick begins, not on their way
    #[arg(long)]
    pub no_continuous: bool,
    /// A small version of the scene
    #[arg(long)]
    pub small: bool,
    #[command(flatten)]
    pub recording: RecordingOptions,
}

impl SceneOptions {
    pub fn variation(&self) -> Variation {
        let detection = CircumsphereSettings { threads: usize::from(self.threads), ..CircumsphereSettings::default() };
        let response = XpbdSettings { substeps: self.substeps, iterations: self.iterations, ..XpbdSettings::default() };
        Variation {
            method: self.method.into(),
            detection,
            response,
            continuous: !self.no_continuous,
            extent: if self.small { Extent::Small } else { Extent::Usual },
            ..Variation::default()
        }
    }
}
