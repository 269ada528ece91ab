//! The command-line options that all scenes share.

use std::{fmt::Display, str::FromStr};

use bevy_circumsphere::{CircumsphereSettings, response::XpbdSettings};
use clap::Args;

use super::{Extent, Variation};
use crate::headless::{method::Method, recording::RecordingOptions};

#[derive(Args, Clone, Debug)]
pub struct SceneOptions {
    /// Number of ticks to play, of a sixtieth of a second each [default: enough to show the point of the scene]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub ticks: Option<u32>,
    /// Contact method
    #[arg(long, value_enum, default_value_t = Method::Exact)]
    pub method: Method,
    /// Threads that may work on one tick; 1 uses no task pool
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: u16,
    /// Substeps per tick
    #[arg(long, value_name = "N", default_value_t = XpbdSettings::default().substeps, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub substeps: u32,
    /// Passes over all constraints per substep
    #[arg(long, value_name = "N", default_value_t = XpbdSettings::default().iterations, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub iterations: u32,
    /// Let bodies sleep that are slower than this, in meters per second; 0 keeps them awake, to measure how they rest
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    pub sleep_speed: f32,
    /// Detect only at the beginning of each tick, without sweeping the motion
    #[arg(long)]
    pub no_continuous: bool,
    /// Play a small version of the scene
    #[arg(long)]
    pub small: bool,
    #[command(flatten)]
    pub recording: RecordingOptions,
}

/// Parses a speed from 0 to `most`.
pub fn speed_up_to<T>(most: T) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: FromStr + PartialOrd + Default + Display + Copy,
{
    move |text| {
        let speed: T = text.parse().map_err(|_| format!("'{text}' is not a number"))?;
        if (T::default()..=most).contains(&speed) { Ok(speed) } else { Err(format!("expected 0 to {most}")) }
    }
}

impl SceneOptions {
    pub fn variation(&self) -> Variation {
        let detection = CircumsphereSettings { threads: usize::from(self.threads), ..CircumsphereSettings::default() };
        let response = XpbdSettings {
            substeps: self.substeps,
            iterations: self.iterations,
            sleep_speed: self.sleep_speed,
            ..XpbdSettings::default()
        };
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
