//! The parts of obvhs and rapier3d in the program `compare`, as a program of their own. What it is started with, reads,
//! and prints is described in `benches/reports/compare/peers.rs`, and for whole steps in `steps/rapier.rs` and `steps/solids.rs` next to it.

mod boxes;
mod rapier;
mod solids;
mod steps;

use std::{
    error::Error,
    io::{self, BufRead, Write},
    path::PathBuf,
    process::ExitCode,
    time::{Duration, Instant},
};

use circumsphere_support::recording::{Recording, read_recording};
use rapier3d::math::Vector;

/// What a row counts; `None` where it does not.
#[derive(Clone, Copy, Default)]
struct Counts {
    box_pairs: Option<u64>,
    contacts: Option<u64>,
}

/// One line of the answer.
struct Row {
    what: &'static str,
    is_whole: bool,
    duration: Duration,
    counts: Counts,
}

/// Who measures a tick: the state before it, and its own.
trait Peer {
    fn name(&self) -> String;
    fn run(&mut self, before: &[[f32; 3]], now: &[[f32; 3]]) -> Vec<Row>;
}

fn vector(position: [f32; 3]) -> Vector {
    Vector::new(position[0], position[1], position[2])
}

/// Runs `operation` and says how long it took.
fn timed<T>(operation: impl FnOnce() -> T) -> (Duration, T) {
    let start = Instant::now();
    let result = std::hint::black_box(operation());
    (start.elapsed(), result)
}

fn main() -> ExitCode {
    match serve() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn serve() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [who, arguments @ ..] = arguments.as_slice()
        && who == "steps"
    {
        return steps::run(arguments);
    }
    if let [who, arguments @ ..] = arguments.as_slice()
        && who == "solids"
    {
        return solids::run(arguments);
    }
    let [who, file, growth, _threads] = arguments.as_slice() else {
        return Err(
            "expected obvhs or rapier, a recording, half the contact distance, and the number of threads".into()
        );
    };
    let recording = read_recording(&[PathBuf::from(file)])?;
    let growth: f32 = growth.parse()?;
    let mut peer: Box<dyn Peer> = match who.as_str() {
        "obvhs" => Box::new(boxes::Obvhs::new(&recording, growth)),
        "rapier" => Box::new(rapier::Rapier::new(&recording, growth)?),
        other => return Err(format!("there is no peer {other:?}").into()),
    };
    let mut output = io::stdout().lock();
    writeln!(output, "peer {}", peer.name())?;
    output.flush()?;
    for line in io::stdin().lock().lines() {
        let place: usize = line?.trim().parse()?;
        let (before, now) = tick(&recording, place).ok_or("there is no such tick")?;
        for Row { what, is_whole, duration, counts } in peer.run(before, now) {
            let level = if is_whole { "whole" } else { "part" };
            let text = |count: Option<u64>| count.map_or_else(|| "-".to_owned(), |count| count.to_string());
            let (box_pairs, contacts) = (text(counts.box_pairs), text(counts.contacts));
            writeln!(output, "row\t{what}\t{level}\t{}\t{box_pairs}\t-\t-\t-\t{contacts}", duration.as_nanos())?;
        }
        writeln!(output, "done")?;
        output.flush()?;
    }
    Ok(())
}

type Frame<'a> = &'a [[f32; 3]];

fn tick(recording: &Recording, place: usize) -> Option<(Frame<'_>, Frame<'_>)> {
    Some((recording.frames.get(2 * place)?, recording.frames.get(2 * place + 1)?))
}
