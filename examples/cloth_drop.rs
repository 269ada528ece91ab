//! A self-colliding cloth falls onto a ball and drapes over it: the stability scene.
//!
//! `cargo run --release --example cloth_drop -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{Shot, options::SceneOptions, program::run};
use clap::Parser;

/// Drop a cloth onto a ball and let it come to rest.
#[derive(Parser, Debug)]
#[command(name = "cloth_drop")]
struct Options {
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    run("cloth_drop", &Options::parse().scene, Shot::default())
}
