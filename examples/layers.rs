//! Ten sheets of cloth fall on each other and on the ground.
//!
//! `cargo run --release --example layers -- [options]`; `--help` lists the options.

#[expect(dead_code, reason = "scenes advance the clock themselves")]
mod headless;
#[path = "headless/method.rs"]
mod method;
#[expect(dead_code, reason = "a program plays one of them")]
mod scenes;

use std::process::ExitCode;

use clap::Parser;
use scenes::{Shot, options::SceneOptions, program::run};

/// Drop ten sheets of cloth on each other.
#[derive(Parser, Debug)]
#[command(name = "layers")]
struct Options {
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    run("layers", &Options::parse().scene, Shot::default())
}
