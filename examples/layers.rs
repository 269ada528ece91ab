//! Ten sheets of cloth fall onto each other and the ground.
//!
//! `cargo run --release --example layers -- [options]`; `--help` lists the options.

#[expect(dead_code, reason = "scenes advance the clock")]
mod headless;
#[path = "headless/method.rs"]
mod method;
#[expect(dead_code, reason = "each program plays one scene")]
mod scenes;

use std::process::ExitCode;

use clap::Parser;
use scenes::{Shot, options::SceneOptions, program::run};

/// Drop ten sheets of cloth onto each other.
#[derive(Parser, Debug)]
#[command(name = "layers")]
struct Options {
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    run("layers", &Options::parse().scene, Shot::default())
}
