//! A skirt hangs from the waist of a figure that begins to walk: cloth on a character.
//!
//! `cargo run --release --example skirt -- [options]`; `--help` lists the options.

#[expect(dead_code, reason = "scenes advance the clock")]
mod headless;
#[path = "headless/method.rs"]
mod method;
#[expect(dead_code, reason = "each program plays one scene")]
mod scenes;

use std::process::ExitCode;

use clap::Parser;
use scenes::{Shot, options::SceneOptions, program::run};

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
