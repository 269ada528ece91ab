//! A hundred soft bodies of mixed shapes drop into a ribbed tray: the efficiency scene.
//!
//! `cargo run --release --example pile -- [options]`; `--help` lists the options.

#[expect(dead_code, reason = "scenes advance the clock")]
mod headless;
#[path = "headless/method.rs"]
mod method;
#[expect(dead_code, reason = "each program plays one scene")]
mod scenes;

use std::process::ExitCode;

use clap::Parser;
use scenes::{Shot, options::SceneOptions, program::run};

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
