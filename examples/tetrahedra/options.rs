//! The command-line options.

use std::{path::PathBuf, str::FromStr};

use circumsphere_examples::headless::recording::RecordingOptions;
use clap::Parser;

/// Find the vertices of two tetrahedral bodies that lie in each other.
#[derive(Parser, Debug)]
#[command(name = "tetrahedra")]
pub struct Options {
    /// The first body: Gmsh .msh (ASCII, version 4.1 or 2.2), or .node or .ele of tetgen; without files: an embedded scene
    #[arg(requires = "second")]
    pub first: Option<PathBuf>,
    /// The second body
    pub second: Option<PathBuf>,
    /// Move the second body, in the unit of the files [default: 0,0,0]
    #[arg(
        long,
        value_name = "X,Y,Z",
        requires = "second",
        allow_hyphen_values = true,
        default_value = "0,0,0",
        hide_default_value = true
    )]
    pub translate: Translation,
    /// Write the contained vertices; of the embedded scene, those of the last tick
    #[arg(long, value_name = "FILE.csv")]
    pub containments: Option<PathBuf>,
    #[command(flatten)]
    pub recording: RecordingOptions,
}

/// Three coordinates in single precision, separated by commas.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Translation(pub [f32; 3]);

#[derive(Debug, thiserror::Error)]
#[error("expected three finite numbers, separated by commas, such as 0.5,0,-1")]
pub struct NoTranslation;

impl FromStr for Translation {
    type Err = NoTranslation;

    fn from_str(text: &str) -> Result<Self, NoTranslation> {
        let coordinates = text.split(',').map(|word| word.trim().parse::<f32>()).collect::<Result<Vec<_>, _>>();
        let coordinates: [f32; 3] = coordinates.map_err(|_| NoTranslation)?.try_into().map_err(|_| NoTranslation)?;
        if coordinates.iter().all(|coordinate| coordinate.is_finite()) {
            Ok(Self(coordinates))
        } else {
            Err(NoTranslation)
        }
    }
}
