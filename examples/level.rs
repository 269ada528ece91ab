//! Cloths, a flag, and soft balls on a level of rigid shapes, with moving platforms and a fast ball.
//!
//! `cargo run --release --example level -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{
    Variation,
    options::{SceneOptions, speed_up_to},
    program::run_varied,
};
use clap::Parser;

/// Drop cloths, a flag, and soft balls onto a level.
#[derive(Parser, Debug)]
#[command(name = "level", allow_negative_numbers = true)]
struct Options {
    /// Speed of the ball that flies into the flag, in meters per second, from 0 to 1000
    #[arg(long, value_name = "X", default_value_t = Variation::default().ball_speed, value_parser = speed_up_to(1000.0))]
    speed: f64,
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    let Options { speed, scene } = Options::parse();
    run_varied("level", &scene, &Variation { ball_speed: speed, ..scene.variation() })
}
