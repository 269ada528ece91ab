//! The command-line options.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};

/// Repeat the experiments of the source paper, and write tables, plots, and a report.
#[derive(Parser, Debug)]
#[command(name = "experiments")]
pub struct Options {
    /// Folder for the report; created if missing
    #[arg(long, value_name = "DIR", default_value = "experiments")]
    pub out: PathBuf,
    /// Run only these experiments
    #[arg(long, value_enum, value_name = "NAME,…", value_delimiter = ',')]
    pub only: Vec<Experiment>,
    /// Run the fewest settings and ticks, to check that everything works; takes seconds, and the figures mean nothing
    #[arg(long)]
    pub quick: bool,
}

/// An experiment, in the order of the report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Experiment {
    /// Effect of δ on steadiness, speed, and error
    #[value(alias = "a")]
    Delta,
    /// Contact methods at few and many solver iterations
    #[value(alias = "b")]
    Iterations,
    /// Tunnelling against speed
    #[value(alias = "c")]
    Tunnelling,
    /// φ and the curvature threshold
    #[value(alias = "d")]
    Caps,
    /// How much fits into a frame
    #[value(alias = "e")]
    Sizes,
}

impl Experiment {
    /// Section title in the report.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Delta => "How stale may spheres be? δ from 0 to 2",
            Self::Iterations => "Contact methods at few and many solver iterations",
            Self::Tunnelling => "Tunnelling against speed",
            Self::Caps => "φ and the curvature threshold",
            Self::Sizes => "How much fits into a frame",
        }
    }

    /// File name of the table and the plot, without extension.
    pub const fn file(self) -> &'static str {
        match self {
            Self::Delta => "delta",
            Self::Iterations => "iterations",
            Self::Tunnelling => "tunnelling",
            Self::Caps => "caps",
            Self::Sizes => "sizes",
        }
    }
}

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    Quick,
    Full,
}

impl Extent {
    pub fn pick<T>(self, quick: T, full: T) -> T {
        match self {
            Self::Quick => quick,
            Self::Full => full,
        }
    }
}

impl Options {
    pub fn extent(&self) -> Extent {
        if self.quick { Extent::Quick } else { Extent::Full }
    }

    /// The experiments to run, in the order of the report.
    pub fn experiments(&self) -> Vec<Experiment> {
        let wanted = |experiment: &Experiment| self.only.is_empty() || self.only.contains(experiment);
        Experiment::value_variants().iter().copied().filter(wanted).collect()
    }
}
