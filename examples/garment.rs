//! A two-bone character of 10,000 triangles walks in a circle in a garment of 2,000 vertices that is tethered to its skin.
//!
//! `cargo run --release --example garment -- [options]`; `--help` lists the options.

use std::process::ExitCode;

use circumsphere_examples::scenes::{
    Variation,
    options::{SceneOptions, speed_up_to},
    program::run_varied,
};
use clap::Parser;

/// Let a character walk across the world in a tethered garment.
#[derive(Parser, Debug)]
#[command(name = "garment", allow_negative_numbers = true)]
struct Options {
    /// Walking speed, in meters per second, from 0 to 10
    #[arg(long, value_name = "X", default_value_t = Variation::default().walking_speed, value_parser = speed_up_to(10.0))]
    speed: f64,
    #[command(flatten)]
    scene: SceneOptions,
}

fn main() -> ExitCode {
    let Options { speed, scene } = Options::parse();
    run_varied("garment", &scene, &Variation { walking_speed: speed, ..scene.variation() })
}
