//! The command-line options.

use std::path::PathBuf;

use circumsphere_examples::headless::{frames::FrameRange, recording::RecordingOptions};
use clap::Parser;

use super::peers::Peer;

/// Time our methods and other libraries on the same mesh in one run, and print one table.
#[derive(Parser, Debug)]
#[command(name = "compare")]
#[expect(clippy::struct_excessive_bools, reason = "each flag is an independent option")]
pub struct Options {
    /// Frames of one mesh in order (PLY or OBJ), or .bin recordings, each compared separately; without files, a
    /// crumpled sheet and the embedded scene
    pub files: Vec<PathBuf>,
    /// Contact distance, in mean edges of the first frame
    #[arg(long, value_name = "X", default_value_t = 0.1, value_parser = positive)]
    pub contact_distance_edges: f64,
    /// Number of rounds; contestants that take seconds run in at most seven of them
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..))]
    pub repeat: u32,
    /// Largest number of threads for our methods, Embree, and rapier's whole steps, which are also measured on one thread
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: u16,
    /// Frames to measure, counted from 0, B excluded [default: the first]
    #[arg(long, value_name = "A..B")]
    pub frames: Option<FrameRange>,
    /// Number of triangles of the crumpled sheet
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub sheet: u32,
    /// Peers besides parry, built on demand: obvhs and rapier with cargo (some minutes the first time), Embree with the
    /// system's C compiler
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = Peer::ALL)]
    pub peers: Vec<Peer>,
    /// Compare with parry only
    #[arg(long, conflicts_with = "peers")]
    pub no_peers: bool,
    /// Skip the scene of the source paper's headline: 3,000 deforming vertices against 100,000 static triangles
    #[arg(long)]
    pub no_headline: bool,
    /// Skip whole steps of cloth, with the response: ours and rapier's, unless rapier is not among the peers
    #[arg(long)]
    pub no_steps: bool,
    /// Skip whole steps of tetrahedral bodies, with the response: ours and rapier's, unless rapier is not among the peers
    #[arg(long)]
    pub no_solids: bool,
    /// Measure whole steps in small scenes, to check that everything works; the figures mean nothing
    #[arg(long)]
    pub small_steps: bool,
    /// Measure the growth of time and memory up to 1,000,000 triangles instead of 100,000; takes minutes
    #[arg(long)]
    pub scale: bool,
    /// Skip the growth of time and memory
    #[arg(long, conflicts_with = "scale")]
    pub no_scale: bool,
    /// Write all measurements as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    #[command(flatten)]
    pub recording: RecordingOptions,
}

impl Options {
    /// The peers to compare with.
    pub fn peers(&self) -> &[Peer] {
        if self.no_peers { &[] } else { &self.peers }
    }

    /// The numbers of threads to measure: one, and the largest.
    pub fn thread_counts(&self) -> Vec<usize> {
        let mut threads = vec![1, usize::from(self.threads)];
        threads.dedup();
        threads
    }
}

/// Largest contact distance, in mean edges. Nearly all pairs of triangles touch at far smaller distances. parry cannot
/// build a tree over infinite boxes.
const MOST_EDGES: f64 = 1.0e3;

fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    let is_within = value > 0.0 && value <= MOST_EDGES;
    if is_within { Ok(value) } else { Err(format!("expected more than 0 and at most {MOST_EDGES}")) }
}
