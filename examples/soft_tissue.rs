//! An instrument presses into a soft organ, slides over it, and lifts: the precision scene.
//!
//! `cargo run --release --example soft_tissue -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{Shot, options::SceneOptions, program::run};
use clap::Parser;

/// Press an instrument into a soft organ and slide it across.
#[derive(Parser, Debug)]
#[command(name = "soft_tissue")]
struct Options {
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    run("soft_tissue", &Options::parse().scene, Shot::default())
}
