//! A skirt hangs from the waist of a figure that begins to walk: cloth on a character.
//!
//! `cargo run --release --example skirt -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{Shot, options::SceneOptions, program::run};
use clap::Parser;

/// Let a figure walk in a skirt.
#[derive(Parser, Debug)]
#[command(name = "skirt")]
struct Options {
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    run("skirt", &Options::parse().scene, Shot::default())
}
