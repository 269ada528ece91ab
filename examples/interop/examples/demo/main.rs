//! A person in a cape walks over steps and a ramp, and balls fly into a flag in the wind: cloth of `bevy_circumsphere` beside
//! avian's bodies and a character that Bevy animates.
//!
//! `cargo run --release --manifest-path examples/interop/Cargo.toml --example demo --features window`; `--help` lists the
//! options. With `--headless`, it needs no window and no renderer, and counts in f64 what crosses.

mod balls;
mod character;
mod crossings;
mod flag;
mod game;
mod headless;
mod level;
#[cfg(feature = "window")]
mod window;

use std::{path::PathBuf, process::ExitCode};

use clap::Parser;

/// Exit status for bad input: the shell's convention for wrong usage.
const BAD_INPUT: u8 = 2;

/// Watch cloth beside rigid bodies and an animated character.
#[derive(Parser, Debug)]
#[command(name = "demo")]
struct Options {
    /// Play without a window, as fast as it goes, and count what crosses
    #[arg(long)]
    headless: bool,
    /// Ticks to play, 60 per second; in a window, one for each frame, then it closes
    #[arg(long, value_name = "N")]
    frames: Option<u32>,
    /// Threads of the task pools; without it: as many as there are cores
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Ticks from one count of crossings to the next, headless; 0 counts nothing, to measure time
    #[arg(long, value_name = "N", default_value_t = 5)]
    check: u32,
    /// Save pictures of the window to this folder
    #[arg(long, value_name = "FOLDER", requires = "frames")]
    screenshots: Option<PathBuf>,
    /// Frames from one picture to the next
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Width and height of the window, in pixels
    #[arg(long, value_name = "PIXELS", num_args = 2, default_values_t = [1280, 720])]
    size: Vec<u32>,
    /// Layers to start with: digits of the keys that switch them, as in `--layers 12`
    #[arg(long, value_name = "KEYS", default_value = "")]
    layers: String,
    /// Start without the line of figures
    #[arg(long)]
    no_text: bool,
}

fn main() -> ExitCode {
    let options = Options::parse();
    let played = if options.headless { headless::play(&options) } else { show(&options) };
    match played {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

#[cfg(feature = "window")]
fn show(options: &Options) -> Result<(), String> {
    window::show(options)
}

#[cfg(not(feature = "window"))]
fn show(_: &Options) -> Result<(), String> {
    Err("built without a window: add `--features window`, or play with `--headless`".to_owned())
}
