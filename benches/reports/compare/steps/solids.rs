//! Whole steps of tetrahedral bodies: ten bodies fall into a pit, ours and rapier's.
//!
//! Both get the same meshes, density, Young's modulus, Poisson's ratio, contact distance, and duration of a step, collide
//! with themselves, and never fall asleep. Everything else is their default. rapier has two models of elastic
//! tetrahedra; ours is the second.
//!
//! rapier's steps are in a program of their own, see `benches/peers/src/solids.rs`. It is started with `solids` and seven
//! arguments: the model, Young's modulus, Poisson's ratio, the density, the thickness, the number of threads, and the
//! number of steps. After each step it prints a line with `step`, nanoseconds, and the number of inverted tetrahedra,
//! separated by tabs.

use std::{
    fmt::{self, Display, Formatter},
    io::{BufRead, BufReader},
    process::{Command, Stdio},
};

use bevy_circumsphere::{
    CircumsphereSettings,
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdSettings},
};
use bevy_transform::components::Transform;
use circumsphere_examples::{
    headless::recording::Recorder,
    scenes::{Extent, Stage, Variation},
};
use circumsphere_reports::statistics::median;
use circumsphere_support::tetrahedra::{HALF_WIDTH_OF_PIT, TetrahedralMesh, WALLS_OF_PIT, tetrahedral_pile};
use glam::Vec3;
use serde::Serialize;

use super::super::{
    measure::timed,
    peers::build_package,
    report::{Bar, short, write_bars},
};

const MATERIAL: XpbdMaterial = XpbdMaterial::SOLID;

/// Half the contact distance, in meters.
const THICKNESS: f32 = 0.002;

/// Steps until the bodies have met, and steps that are measured.
const FALL: usize = 30;
const MEASURED: usize = 270;

/// The least number of our ticks that fit into one of rapier's steps.
const LEAST_RATIO: f64 = 10.0;

const OURS: &str = "ours";
const MODELS: [(&str, &str); 2] =
    [("rapier3d, corotational", "corotational"), ("rapier3d, Neo-Hookean", "neo-hookean")];

#[derive(Serialize)]
pub struct Solids {
    pub bodies: usize,
    pub tetrahedra: usize,
    pub vertices: usize,
    pub rows: Vec<SolidsRow>,
    pub bars: Vec<Bar>,
    /// Contestants that are missing or failed, with the reasons.
    pub faults: Vec<String>,
}

#[derive(Serialize)]
pub struct SolidsRow {
    pub who: &'static str,
    pub threads: usize,
    pub ticks: usize,
    pub median_ms: f64,
    pub least_ms: f64,
    /// The most inverted tetrahedra in any step, those of the fall included.
    pub inverted: usize,
}

/// Milliseconds and inverted tetrahedra of every step.
type Steps = Vec<(f64, usize)>;

impl SolidsRow {
    fn new(who: &'static str, threads: usize, steps: &Steps) -> Self {
        let measured: Vec<f64> = steps.iter().skip(FALL).map(|&(milliseconds, _)| milliseconds).collect();
        Self {
            who,
            threads,
            ticks: measured.len(),
            least_ms: measured.iter().copied().fold(f64::INFINITY, f64::min),
            median_ms: median(measured).unwrap_or_default(),
            inverted: steps.iter().map(|&(_, inverted)| inverted).max().unwrap_or_default(),
        }
    }
}

impl Solids {
    /// Measures with every number of threads. `report` receives progress messages.
    pub fn measure(extent: Extent, threads: &[usize], with_rapier: bool, mut report: impl FnMut(&str)) -> Self {
        let meshes = tetrahedral_pile();
        let steps = FALL + extent.pick(10, MEASURED);
        let (mut rows, mut faults) = (Vec::new(), Vec::new());
        for &threads in threads {
            report(&format!("whole steps of tetrahedra, {threads} threads: {OURS}"));
            rows.push(SolidsRow::new(OURS, threads, &play(&meshes, threads, steps)));
            for (who, model) in MODELS.into_iter().filter(|_| with_rapier) {
                let name = format!("whole steps of tetrahedra, {threads} threads: {who}");
                report(&format!("{name}, building"));
                match play_rapier(model, threads, steps, |step| report(&format!("{name}, step {step}"))) {
                    Ok(played) => rows.push(SolidsRow::new(who, threads, &played)),
                    Err(fault) => faults.push(format!("{name}: {fault}")),
                }
            }
        }
        let bars = threads.iter().map(|&threads| bar(threads, &rows)).collect();
        let sum = |of: fn(&TetrahedralMesh) -> usize| meshes.iter().map(of).sum();
        Self {
            bodies: meshes.len(),
            tetrahedra: sum(|mesh| mesh.tetrahedra.len()),
            vertices: sum(|mesh| mesh.positions.len()),
            rows,
            bars,
            faults,
        }
    }
}

/// Whether the step of rapier's faster model takes long enough, and no tetrahedron of ours is ever inverted.
fn bar(threads: usize, rows: &[SolidsRow]) -> Bar {
    let (ours, rapier): (Vec<_>, Vec<_>) =
        rows.iter().filter(|row| row.threads == threads).partition(|row| row.who == OURS);
    let rapier = rapier.into_iter().min_by(|a, b| a.median_ms.total_cmp(&b.median_ms));
    let both = rapier.zip(ours.first().copied());
    let ratio = both.map(|(rapier, ours)| rapier.median_ms / ours.median_ms);
    Bar {
        what: format!("rapier's step / ours, tetrahedra, threads {threads}"),
        limit: format!("≥ {LEAST_RATIO}, none inverted"),
        ratio,
        least_ratio: both.map(|(rapier, ours)| rapier.least_ms / ours.least_ms),
        holds: both.zip(ratio).map(|((_, ours), ratio)| ratio >= LEAST_RATIO && ours.inverted == 0),
    }
}

fn play(meshes: &[TetrahedralMesh], threads: usize, steps: usize) -> Steps {
    let detection = CircumsphereSettings { threads, ..CircumsphereSettings::default() };
    let response = XpbdSettings { sleep_speed: 0.0, ..XpbdSettings::default() };
    let variation = Variation { detection, response, ..Variation::default() };
    let mut stage = Stage::new(&variation, Recorder::default());
    stage.add_shape("ground", SharedShape::halfspace(Vec3::Y), Transform::IDENTITY);
    for normal in WALLS_OF_PIT.map(Vec3::from_array) {
        let at = Transform::from_translation(normal * -(HALF_WIDTH_OF_PIT as f32));
        stage.add_shape("wall", SharedShape::halfspace(normal), at);
    }
    let spawn = |mesh: &TetrahedralMesh| {
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let (inside, surface, positions) =
            TetrahedralBody::from_mesh(&positions, &mesh.tetrahedra).expect("the bodies are valid");
        let body = XpbdBody::tetrahedral(&inside, &surface, &positions, MATERIAL).expect("the bodies are valid");
        let extra = (SurfaceThickness::World(THICKNESS), SelfCollision);
        stage.app.world_mut().spawn((inside, surface, positions, body, extra)).id()
    };
    let bodies: Vec<_> = meshes.iter().map(spawn).collect();
    let step = |_| {
        let (duration, ()) = timed(|| stage.tick());
        let now = |body| stage.positions(body).iter().map(Vec3::to_array).collect::<Vec<_>>();
        let inverted = meshes.iter().zip(&bodies).map(|(mesh, &body)| mesh.inverted(&now(body))).sum();
        (duration.as_secs_f64() * 1.0e3, inverted)
    };
    (0..steps).map(step).collect()
}

/// Milliseconds and inverted tetrahedra of a line that the program has printed.
fn parse(line: &str) -> Option<(f64, usize)> {
    let (nanoseconds, inverted) = line.strip_prefix("step\t")?.split_once('\t')?;
    Some((nanoseconds.parse::<f64>().ok()? * 1.0e-6, inverted.parse().ok()?))
}

fn play_rapier(model: &str, threads: usize, steps: usize, mut report: impl FnMut(usize)) -> Result<Steps, String> {
    let mut command = Command::new(build_package()?);
    let numbers = [MATERIAL.young_modulus, MATERIAL.poisson_ratio, MATERIAL.density, THICKNESS];
    command.args(["solids", model]).args(numbers.map(|number| format!("{number:.9e}")));
    let mut child = command
        .args([threads.to_string(), steps.to_string()])
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| error.to_string())?;
    let output = child.stdout.take().ok_or("the program has no output")?;
    let mut played = Vec::new();
    for line in BufReader::new(output).lines() {
        let line = line.map_err(|error| error.to_string())?;
        played.push(parse(&line).ok_or_else(|| format!("unexpected output {line:?}"))?);
        report(played.len());
    }
    let status = child.wait().map_err(|error| error.to_string())?;
    if !status.success() || played.len() != steps {
        return Err(format!("the program ended after {} of {steps} steps", played.len()));
    }
    Ok(played)
}

impl Display for Solids {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let Self { bodies, tetrahedra, vertices, .. } = self;
        writeln!(
            out,
            "\nWhole steps of {bodies} bodies that fall into a pit: {tetrahedra} tetrahedra, {vertices} vertices"
        )?;
        writeln!(out, "{:26} {:>3} {:>9} {:>9} {:>4} {:>14}", "", "thr", "median", "min ms", "n", "most inverted")?;
        for row in &self.rows {
            let times = [short(row.median_ms), short(row.least_ms)];
            let SolidsRow { who, threads, ticks, inverted, .. } = row;
            writeln!(out, "{who:26} {threads:>3} {:>9} {:>9} {ticks:>4} {inverted:>14}", times[0], times[1])?;
        }
        writeln!(out)?;
        write_bars(out, &self.bars)?;
        self.faults.iter().try_for_each(|fault| writeln!(out, "{fault}"))
    }
}
