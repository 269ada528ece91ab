//! Ten sheets of cloth fall onto each other and the ground.
//!
//! `cargo run --release --example layers -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{Shot, options::SceneOptions, program::run};
use clap::Parser;

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
