//! An instrument presses into a soft organ, slides over it, and lifts: the precision scene.
//!
//! `cargo run --release --example soft_tissue -- [options]`; `--help` lists the options.

#[expect(dead_code, reason = "scenes advance the clock")]
mod headless;
#[path = "headless/method.rs"]
mod method;
#[expect(dead_code, reason = "each program plays one scene")]
mod scenes;

use std::process::ExitCode;

use clap::Parser;
use scenes::{Shot, options::SceneOptions, program::run};

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
