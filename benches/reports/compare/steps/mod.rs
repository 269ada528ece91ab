//! Whole steps, with the response: our ticks and rapier's steps of the same cloths.
//!
//! Both get the same mesh, masses, contact distance, and duration of a step, and their own defaults otherwise. On one
//! thread, rapier also plays with its default thickness of the cloth, which is far larger than ours. A cloth falls for
//! some ticks, and the ticks after that are measured. Then the f64 reference judges where its vertices are.

mod ours;
mod rapier;
mod solids;

use std::fmt::{self, Display, Formatter};

use circumsphere_examples::scenes::Extent;
use circumsphere_reports::{
    cloth_scenes::ClothScene,
    cloth_truth::Crossings,
    statistics::{mean, median},
};
use serde::Serialize;

use rapier::Radius;
pub use solids::Solids;

use super::report::{Bar, grouped, short, write_bars};

const OURS: &str = "ours";
const RAPIER: &str = "rapier3d";
const RAPIER_DEFAULT: &str = "rapier3d, default radius";

/// The least number of our ticks that fit into one of rapier's steps.
const LEAST_RATIO: f64 = 60.0;

#[derive(Serialize)]
pub struct Steps {
    pub scenes: Vec<StepsOfScene>,
    pub bars: Vec<Bar>,
    /// Contestants that are missing or failed, with the reasons.
    pub faults: Vec<String>,
}

#[derive(Serialize)]
pub struct StepsOfScene {
    pub scene: &'static str,
    pub vertices: usize,
    /// Triangles of the obstacle. 0 for a ball without a mesh.
    pub static_triangles: usize,
    /// Thickness of the cloth, and of the obstacle if it is a mesh, in meters.
    pub thickness: f32,
    /// Number of ticks before the measured ones.
    pub fall: usize,
    pub rows: Vec<StepsRow>,
}

#[derive(Serialize)]
pub struct StepsRow {
    pub who: &'static str,
    pub threads: usize,
    /// Number of measured ticks.
    pub ticks: usize,
    pub median_ms: f64,
    pub least_ms: f64,
    /// Substeps per tick, mean of the measured ticks.
    pub substeps: f64,
    /// Median of the measured ticks, in microseconds.
    pub per_vertex_and_substep_us: f64,
    /// At the end.
    pub crossings: Crossings,
}

/// The measured ticks of one contestant in one scene, and the vertices at the end.
#[derive(Default)]
struct Played {
    milliseconds: Vec<f64>,
    /// Number of substeps of each tick.
    substeps: Vec<u32>,
    end: Vec<[f32; 3]>,
}

impl StepsRow {
    fn new(who: &'static str, threads: usize, scene: &ClothScene, played: Played) -> Self {
        let shares = played.milliseconds.iter().zip(&played.substeps).map(|(milliseconds, &substeps)| {
            1.0e3 * milliseconds / (scene.cloth.positions.len() as f64 * f64::from(substeps))
        });
        Self {
            who,
            threads,
            ticks: played.milliseconds.len(),
            substeps: mean(played.substeps.iter().copied().map(f64::from)).unwrap_or_default(),
            per_vertex_and_substep_us: median(shares.collect()).unwrap_or_default(),
            crossings: Crossings::of(scene, &played.end),
            least_ms: played.milliseconds.iter().copied().fold(f64::INFINITY, f64::min),
            median_ms: median(played.milliseconds).unwrap_or_default(),
        }
    }
}

impl Steps {
    /// Measures every scene with every number of threads. `report` receives progress messages.
    pub fn measure(extent: Extent, threads: &[usize], with_rapier: bool, mut report: impl FnMut(&str)) -> Self {
        let (mut scenes, mut bars, mut faults) = (Vec::new(), Vec::new(), Vec::new());
        for scene in [ClothScene::on_ball(extent), ClothScene::on_ball_mesh(extent), ClothScene::on_hills(extent)] {
            let mut rows = Vec::new();
            for &threads in threads {
                report(&format!("whole steps, {}, {threads} threads: {OURS}", scene.name));
                rows.push(StepsRow::new(OURS, threads, &scene, ours::play(&scene, threads)));
            }
            let same = threads.iter().map(|&threads| (RAPIER, Radius::OfScene, threads));
            let contestants = same.chain([(RAPIER_DEFAULT, Radius::Default, 1)]);
            for (who, radius, threads) in contestants.filter(|_| with_rapier) {
                let name = format!("whole steps, {}, {threads} threads: {who}", scene.name);
                report(&format!("{name}, building"));
                match rapier::play(&scene, threads, radius, |step| report(&format!("{name}, step {step}"))) {
                    Ok(played) => rows.push(StepsRow::new(who, threads, &scene, played)),
                    Err(fault) => faults.push(format!("{name}: {fault}")),
                }
            }
            bars.extend(threads.iter().map(|&threads| answer_bar(scene.name, threads, &rows)));
            scenes.push(StepsOfScene {
                scene: scene.name,
                vertices: scene.cloth.positions.len(),
                static_triangles: scene.obstacle.mesh().map_or(0, |mesh| mesh.triangles.len()),
                thickness: scene.thickness,
                fall: scene.fall,
                rows,
            });
        }
        Self { scenes, bars, faults }
    }
}

/// Whether rapier's step takes long enough, with the faster of its two thicknesses, and our cloth neither crosses
/// anything nor is inside.
fn answer_bar(scene: &str, threads: usize, rows: &[StepsRow]) -> Bar {
    let (ours, rapier): (Vec<_>, Vec<_>) =
        rows.iter().filter(|row| row.threads == threads).partition(|row| row.who == OURS);
    let rapier = rapier.into_iter().min_by(|a, b| a.median_ms.total_cmp(&b.median_ms));
    let both = rapier.zip(ours.first().copied());
    let ratio = both.map(|(rapier, ours)| rapier.median_ms / ours.median_ms);
    Bar {
        what: format!("rapier's step / ours, {scene}, threads {threads}"),
        limit: format!("≥ {LEAST_RATIO}, no crossing"),
        ratio,
        least_ratio: both.map(|(rapier, ours)| rapier.least_ms / ours.least_ms),
        holds: both.zip(ratio).map(|((_, ours), ratio)| ratio >= LEAST_RATIO && ours.crossings.is_none()),
    }
}

impl Display for StepsOfScene {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let obstacle = match self.static_triangles {
            0 => String::new(),
            count => format!(", {} static triangles", grouped(count as u64)),
        };
        writeln!(
            out,
            "{}: {} vertices{obstacle}, thickness {} m, after {} ticks",
            self.scene,
            grouped(self.vertices as u64),
            self.thickness,
            self.fall
        )?;
        writeln!(
            out,
            "{:26} {:>3} {:>9} {:>9} {:>4} {:>8} {:>20} {:>14} {:>18} {:>15}",
            "",
            "thr",
            "median",
            "min ms",
            "n",
            "substeps",
            "µs/vertex/substep",
            "crosses itself",
            "crosses obstacle",
            "vertices inside"
        )?;
        for row in &self.rows {
            writeln!(
                out,
                "{:26} {:>3} {:>9} {:>9} {:>4} {:>8.1} {:>20.3} {:>14} {:>18} {:>15}",
                row.who,
                row.threads,
                short(row.median_ms),
                short(row.least_ms),
                row.ticks,
                row.substeps,
                row.per_vertex_and_substep_us,
                row.crossings.with_itself,
                row.crossings.with_obstacle,
                row.crossings.vertices_inside
            )?;
        }
        Ok(())
    }
}

impl Display for Steps {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "\nWhole steps of cloth with self-collision, a sixtieth of a second each, and what crosses at the end"
        )?;
        for scene in &self.scenes {
            write!(out, "\n{scene}")?;
        }
        writeln!(out)?;
        write_bars(out, &self.bars)?;
        for fault in &self.faults {
            writeln!(out, "{fault}")?;
        }
        Ok(())
    }
}
