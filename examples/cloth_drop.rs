//! A self-colliding cloth falls onto a ball and drapes over it: the stability scene.
//!
//! `cargo run --release --example cloth_drop -- [options]`; `--help` lists the options.

#[expect(dead_code, reason = "scenes advance the clock")]
mod headless;
#[path = "headless/method.rs"]
mod method;
#[expect(dead_code, reason = "each program plays one scene")]
mod scenes;

use std::process::ExitCode;

use clap::Parser;
use scenes::{Shot, options::SceneOptions, program::run};

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
