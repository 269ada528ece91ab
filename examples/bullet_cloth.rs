//! Tunnelling test: a ball is shot at a pinned sheet, a sheet at a sheet, or a needle at a closed surface.
//!
//! `cargo run --release --example bullet_cloth -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{
    Shot,
    bullet_cloth::Target,
    options::{SceneOptions, speed_up_to},
    program::run,
};
use clap::Parser;

/// Shoot an object at a target that should stop it.
#[derive(Parser, Debug)]
#[command(name = "bullet_cloth", allow_negative_numbers = true)]
struct Options {
    /// Object and target
    #[arg(long, value_enum, default_value_t = Shot::default().target)]
    target: Target,
    /// Speed of the object, in thicknesses of 2 mm per tick
    #[arg(long, value_name = "X", default_value_t = Shot::default().speed, value_parser = speed_up_to(FASTEST))]
    speed: f32,
    #[command(flatten)]
    scene: SceneOptions,
}

/// Highest speed. Beyond it, single precision cannot resolve the position of the object in flight.
const FASTEST: f32 = 100_000.0;

fn main() -> ExitCode {
    let Options { target, speed, scene } = Options::parse();
    run("bullet_cloth", &scene, Shot { target, speed })
}
