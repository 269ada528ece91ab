//! Peers that run as separate programs, so that the crate does not depend on their libraries: Embree through a small C
//! file, and obvhs and rapier through the package `benches/peers`.
//!
//! A peer is started with three arguments: a recording, half the contact distance, and the number of threads. The
//! recording has two frames for each tick: the state before it, and the state to measure. The peer prints a line
//! `peer NAME`. Then it reads lines with the number of a tick. It answers each with lines `row`, followed by a line
//! `done`. A row has these fields, separated by tabs: a name, `whole` or `part`, nanoseconds, and the counts of box
//! pairs, pairs apart, tested pairs, touching pairs, and contacts. A count that the peer does not have is `-`. Between
//! requests a peer does nothing, so that it does not disturb other measurements.

use std::{
    fs,
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    time::Duration,
};

use circumsphere_support::recording::{Recording, write_recording};
use tempfile::TempDir;

use super::{
    input::{Input, Tick},
    measure::{Contestant, Counts, Level, Log},
};

/// The rows with only Embree's traversal, and with only rapier's narrow phase.
pub const EMBREE_COLLIDE: (&str, &str) = ("Embree", "rtcCollide, counting pairs of boxes");
pub const RAPIER_NARROW_PHASE: (&str, &str) = ("rapier3d", "narrow phase (self-contacts of the soft body)");

/// The folder with the sources of the peers, fixed when this program is compiled.
const SOURCES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// The available peers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Peer {
    Obvhs,
    Rapier,
    Embree,
}

impl Peer {
    pub const ALL: [Self; 3] = [Self::Obvhs, Self::Rapier, Self::Embree];

    /// Builds the peer if necessary, and returns the command that runs it.
    fn build(self, folder: &Path) -> Result<Command, String> {
        match self {
            Self::Embree => build_embree(folder).map(Command::new),
            Self::Obvhs | Self::Rapier => build_package().map(|program| {
                let mut command = Command::new(program);
                command.arg(if self == Self::Obvhs { "obvhs" } else { "rapier" });
                command
            }),
        }
    }
}

fn run_builder(command: &mut Command) -> Result<(), String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| format!("{program} does not start: {error}"))?;
    if output.status.success() {
        return Ok(());
    }
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    let line = message.lines().find(|line| line.contains("error")).unwrap_or("it failed").trim().to_owned();
    Err(format!("{program}: {line}"))
}

/// Builds the package of Rust peers, which has its own lock file. The first build takes about two minutes.
pub fn build_package() -> Result<PathBuf, String> {
    let own = std::env::current_exe().map_err(|error| error.to_string())?;
    // This program is in TARGET/PROFILE/examples.
    let target = own.ancestors().nth(3).ok_or("this program is not in a target folder")?.join("peers");
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let manifest = Path::new(SOURCES).join("peers/Cargo.toml");
    let mut command = Command::new(cargo);
    command.args(["build", "--release", "--locked", "--manifest-path"]).arg(manifest).arg("--target-dir").arg(&target);
    run_builder(&mut command)?;
    Ok(target.join(format!("release/circumsphere_peers{}", std::env::consts::EXE_SUFFIX)))
}

/// Compiles the C file and links the system's library.
fn build_embree(folder: &Path) -> Result<PathBuf, String> {
    let program = folder.join(format!("embree{}", std::env::consts::EXE_SUFFIX));
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let source = Path::new(SOURCES).join("embree/collide.c");
    let mut command = Command::new(compiler);
    command.args(["-std=c11", "-O3", "-march=native", "-Wall", "-Werror", "-o"]).arg(&program).arg(source);
    command.args(["-lembree3", "-lm"]);
    run_builder(&mut command).map_err(|error| format!("{error} (it needs a C compiler and libembree-dev 3)"))?;
    Ok(program)
}

/// A running peer.
struct Program {
    name: String,
    threads: usize,
    child: Child,
    questions: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    _folder: TempDir,
}

impl Drop for Program {
    fn drop(&mut self) {
        // The peer exits at the end of its input.
        drop(self.questions.take());
        let _ = self.child.wait();
    }
}

/// Builds and starts the requested peers, once for each number of threads that they support. Also returns which peers
/// are missing, and why.
pub fn contestants(peers: &[Peer], input: &Input, threads: &[usize]) -> (Vec<Box<dyn Contestant>>, Vec<String>) {
    let (mut all, mut faults): (Vec<Box<dyn Contestant>>, _) = (Vec::new(), Vec::new());
    for &peer in peers {
        // The Rust peers run on one thread.
        let threads = if peer == Peer::Embree { threads } else { &[1] };
        for &threads in threads {
            match start(peer, input, threads) {
                Ok(program) => all.push(Box::new(program)),
                Err(fault) => faults.push(format!("{peer:?} is missing: {fault}")),
            }
        }
    }
    (all, faults)
}

fn start(peer: Peer, input: &Input, threads: usize) -> Result<Program, String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let scene = folder.path().join("ticks.bin");
    let frames = input
        .ticks
        .iter()
        .flat_map(|tick| [&tick.before, &tick.now])
        .map(|positions| positions.iter().map(glam::Vec3::to_array).collect())
        .collect();
    // Neighbors are triangles that share a vertex, so the peer gets the welded mesh.
    let recording = Recording { triangles: input.welded.clone(), frames };
    write_recording(&scene, &recording).map_err(|error| error.to_string())?;
    let mut child = peer
        .build(folder.path())?
        .arg(&scene)
        .arg(format!("{:.9e}", input.thickness()))
        .arg(threads.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| error.to_string())?;
    let questions = child.stdin.take();
    let answers = BufReader::new(child.stdout.take().ok_or("the program has no output")?);
    let mut program = Program { name: String::new(), threads, child, questions, answers, _folder: folder };
    let line = program.line()?;
    let name = line.strip_prefix("peer ").ok_or_else(|| format!("unexpected output {line:?}"))?;
    name.clone_into(&mut program.name);
    let _ = fs::remove_file(&scene);
    Ok(program)
}

impl Program {
    fn line(&mut self) -> Result<String, String> {
        let mut line = String::new();
        match self.answers.read_line(&mut line) {
            Ok(0) => Err("the program ended".to_owned()),
            Ok(_) => Ok(line.trim_end().to_owned()),
            Err(error) => Err(error.to_string()),
        }
    }
}

/// Parses a row that a peer has printed.
fn parse(line: &str) -> Option<(&str, Level, Duration, Counts)> {
    let fields: Vec<&str> = line.strip_prefix("row\t")?.split('\t').collect();
    let &[what, level, nanoseconds, box_pairs, apart, tested, touching, contacts] = fields.as_slice() else {
        return None;
    };
    let level = match level {
        "whole" => Level::Whole,
        "part" => Level::Part,
        _ => return None,
    };
    let count = |text: &str| if text == "-" { Some(None) } else { text.parse().ok().map(Some) };
    let counts = Counts {
        box_pairs: count(box_pairs)?,
        apart: count(apart)?,
        tested: count(tested)?,
        touching: count(touching)?,
        contacts: count(contacts)?,
    };
    Some((what, level, Duration::from_nanos(nanoseconds.parse().ok()?), counts))
}

impl Contestant for Program {
    fn name(&self) -> String {
        format!("{} ({} threads)", self.name, self.threads)
    }

    fn run(&mut self, place: usize, _: &Tick, log: &mut Log) -> Result<(), String> {
        let questions = self.questions.as_mut().ok_or("the program has no input")?;
        writeln!(questions, "{place}").and_then(|()| questions.flush()).map_err(|error| error.to_string())?;
        loop {
            let line = self.line()?;
            if line == "done" {
                return Ok(());
            }
            let (what, level, duration, counts) = parse(&line).ok_or_else(|| format!("unexpected output {line:?}"))?;
            log.add(&self.name, what, self.threads, level, duration, counts);
        }
    }
}
