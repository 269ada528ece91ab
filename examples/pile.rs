//! A hundred soft bodies of mixed shapes drop into a ribbed tray: the efficiency scene.
//!
//! `cargo run --release --example pile -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{Shot, options::SceneOptions, program::run};
use clap::Parser;

/// Drop a hundred soft bodies into a ribbed tray.
#[derive(Parser, Debug)]
#[command(name = "pile")]
struct Options {
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    run("pile", &Options::parse().scene, Shot::default())
}
