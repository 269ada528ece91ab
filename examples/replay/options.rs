//! The command-line options, and the settings derived from them for a given recording.

use std::{ops::Range, path::PathBuf};

use bevy_circumsphere::{CircumsphereSettings, geometry::CurvatureEstimator};
use circumsphere_examples::headless::{
    frames::{FrameRange, NoSuchFrames},
    method::Method,
    recording::RecordingOptions,
};
use clap::{ArgAction, Parser, ValueEnum};
use serde::Serialize;

/// Default contact distance, in mean edges.
const DEFAULT_DISTANCE_EDGES: f64 = 0.1;

/// Detect the contacts of a recorded deforming mesh with itself, frame by frame.
#[derive(Parser, Debug)]
#[command(name = "replay", allow_negative_numbers = true)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
pub struct Options {
    /// The frames of one mesh in order (PLY or OBJ), or one .bin recording; without files: an embedded scene
    pub files: Vec<PathBuf>,
    /// Contact method
    #[arg(long, value_enum, default_value_t = Method::Exact)]
    pub method: Method,
    /// Collide like the smooth surface that the vertices lie on
    #[arg(long)]
    pub smooth: bool,
    /// Broad phase that finds candidate pairs of triangles
    #[arg(long, value_enum, default_value_t = BroadPhase::Tree)]
    pub broad_phase: BroadPhase,
    /// One self-colliding surface, or one per connected component; both find the same pairs
    #[arg(long, value_enum, default_value_t = Surfaces::Whole)]
    pub surfaces: Surfaces,
    /// Contact distance, in the unit of the file
    #[arg(long, value_name = "X", conflicts_with = "contact_distance_edges")]
    pub contact_distance: Option<f64>,
    /// Contact distance, in mean unique welded edges of the first frame [default: 0.1]
    #[arg(long, value_name = "X")]
    pub contact_distance_edges: Option<f64>,
    /// Height of a flat triangle's sphere center below its plane, in radii of the triangle
    #[arg(long, default_value_t = CircumsphereSettings::default().sphere_offset)]
    pub sphere_offset: f32,
    /// Shape change beyond which a triangle's sphere is made anew
    #[arg(long, default_value_t = CircumsphereSettings::default().refit_threshold)]
    pub refit_threshold: f32,
    /// Curvature times radius at which a sphere is no longer offset
    #[arg(long, default_value_t = CircumsphereSettings::default().curvature_threshold)]
    pub curvature_threshold: f32,
    /// Drop pairs of caps if a plane separates their triangles
    #[arg(long, value_name = "BOOL", default_value_t = CircumsphereSettings::default().plane_cull, action = ArgAction::Set)]
    pub plane_cull: bool,
    /// Widen safety cones by the angle to the neighbors
    #[arg(long, value_name = "BOOL", default_value_t = CircumsphereSettings::default().widen_cones, action = ArgAction::Set)]
    pub widen_cones: bool,
    /// Curvature estimator
    #[arg(long, value_enum, default_value_t = Estimator::SignedEdge)]
    pub estimator: Estimator,
    /// Frames to play, counted from 0, B excluded; either end may be omitted
    #[arg(long, value_name = "A..B", default_value = "..")]
    pub frames: FrameRange,
    /// Play everything N times, each time in a fresh app, and report medians
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub repeat: u32,
    /// Detect each frame N times in a row in one app, with the trees and buffers of the previous detection, as if it
    /// had moved
    #[arg(long)]
    pub warm: bool,
    /// Threads that may work on one frame; 1 uses no task pool
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: u16,
    /// Write the touching pairs of triangles
    #[arg(long, value_name = "FILE.csv")]
    pub pairs: Option<PathBuf>,
    /// Write the contacts
    #[arg(long, value_name = "FILE.csv")]
    pub contacts: Option<PathBuf>,
    #[command(flatten)]
    pub recording: RecordingOptions,
    /// Write times and counts as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum BroadPhase {
    Tree,
    SpatialHash,
    HierarchicalHash,
    BruteForce,
    Parry,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Surfaces {
    Whole,
    Components,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    SignedEdge,
    DualAngleDeficit,
}

impl From<Estimator> for CurvatureEstimator {
    fn from(estimator: Estimator) -> Self {
        match estimator {
            Estimator::SignedEdge => Self::SignedEdge,
            Estimator::DualAngleDeficit => Self::DualAngleDeficit,
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum OptionsError {
    #[error(transparent)]
    NoSuchFrames(#[from] NoSuchFrames),
    #[error("{option} {value}: a contact distance of {distance} is beyond single precision")]
    TooFar { option: &'static str, value: f64, distance: f64 },
    #[error("{option} {value}: expected a finite number, {least}")]
    OutOfRange { option: &'static str, value: f64, least: &'static str },
}

/// The options as they apply to a recording.
#[derive(Clone, Debug, Serialize)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
pub struct Settings {
    pub method: Method,
    pub smooth: bool,
    pub broad_phase: BroadPhase,
    pub surfaces: Surfaces,
    pub contact_distance: f64,
    pub mean_edge: f64,
    pub sphere_offset: f32,
    pub refit_threshold: f32,
    pub curvature_threshold: f32,
    pub plane_cull: bool,
    pub widen_cones: bool,
    pub estimator: Estimator,
    pub frames: Range<usize>,
    pub repeat: u32,
    pub warm: bool,
    #[serde(skip)]
    pub threads: usize,
}

impl Options {
    /// The name of the input for the report.
    pub fn input_name(&self, embedded: &str) -> String {
        match self.files.as_slice() {
            [] => embedded.to_owned(),
            [file] => file.display().to_string(),
            [first, .., last] => format!("{} … {} ({} files)", first.display(), last.display(), self.files.len()),
        }
    }

    pub fn settings(&self, mean_edge: f64, frame_count: usize) -> Result<Settings, OptionsError> {
        let edges = self.contact_distance_edges.unwrap_or(DEFAULT_DISTANCE_EDGES);
        let at_least_0 = [
            ("--contact-distance", self.contact_distance.unwrap_or(0.0)),
            ("--contact-distance-edges", edges),
            ("--sphere-offset", f64::from(self.sphere_offset)),
            ("--refit-threshold", f64::from(self.refit_threshold)),
        ];
        for (option, value) in at_least_0 {
            if !(value >= 0.0 && value <= f64::from(f32::MAX)) {
                return Err(OptionsError::OutOfRange { option, value, least: "0 or more" });
            }
        }
        let contact_distance = self.contact_distance.unwrap_or(edges * mean_edge);
        if contact_distance > f64::from(f32::MAX) {
            let option = "--contact-distance-edges";
            return Err(OptionsError::TooFar { option, value: edges, distance: contact_distance });
        }
        let threshold = f64::from(self.curvature_threshold);
        if !(threshold > 0.0 && threshold.is_finite()) {
            return Err(OptionsError::OutOfRange {
                option: "--curvature-threshold",
                value: threshold,
                least: "more than 0",
            });
        }
        let frames = self.frames.of(frame_count)?;
        Ok(Settings {
            method: self.method,
            smooth: self.smooth,
            broad_phase: self.broad_phase,
            surfaces: self.surfaces,
            contact_distance,
            mean_edge,
            sphere_offset: self.sphere_offset,
            refit_threshold: self.refit_threshold,
            curvature_threshold: self.curvature_threshold,
            plane_cull: self.plane_cull,
            widen_cones: self.widen_cones,
            estimator: self.estimator,
            frames,
            repeat: self.repeat,
            warm: self.warm,
            threads: usize::from(self.threads),
        })
    }
}
