//! How stale may spheres be? δ from 0 to 2 in the three kinds of scenes: cost of the refresh, error of the caps, and
//! steadiness of the scenes.

use bevy_circumsphere::{
    CircumsphereSettings, Circumspheres, TriangleCones, TriangleCurvature,
    detection::DetectionDiagnostics,
    kernel::spheres::{
        circumsphere::{OffsetSpheres, RecipeSettings},
        cone::SafetyCones,
    },
};
use circumsphere_examples::scenes::Variation;
use circumsphere_reports::{
    finding::{Finding, Outcome, figure, geometric_mean, optional, percent, table},
    statistics::{mean, median},
};
use glam::Vec3;
use indicatif::ProgressBar;
use serde::Serialize;

use super::{
    options::Extent,
    player::{KINDS, Player, variation},
    tested::Tested,
};

/// Values of δ, from a refresh in every tick to almost none.
const DELTAS: [f32; 9] = [0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.2, 1.6, 2.0];

/// The values of δ that the paper recommends for steadiness and for speed.
const STEADIEST: f32 = 0.7;
const FASTEST: f32 = 0.9;

/// Trembling below this is within the rounding of positions.
const LEAST_TREMBLING: f64 = 1.0e-8;

/// Number of ticks between comparisons of the caps with fresh ones.
const LOOK_EVERY: usize = 5;

/// Results of one δ in one scene: medians over the repetitions.
#[derive(Clone, Debug, Serialize)]
pub struct DeltaRow {
    pub kind: &'static str,
    pub scene: &'static str,
    pub delta: f32,
    pub repetitions: usize,
    /// Repetitions that flew apart. Steadiness is measured on the others.
    pub broken: usize,
    /// Time to refresh curvature, spheres, and cones in a tick, in microseconds.
    pub time_refresh_us: f64,
    /// Time for the whole detection in a tick, in milliseconds.
    pub time_detection_ms: f64,
    /// Largest divided by smallest value of the repetitions.
    pub time_detection_spread: f64,
    /// Share of spheres whose recipe is made anew in a tick.
    pub refreshed_share: f64,
    /// Mean distance of the tops of the caps from those of fresh ones, in mean edges.
    pub surface_error_edges: f64,
    /// Difference of the bulge of caps from that of fresh ones, relative to the latter.
    pub surface_error_relative: f64,
    pub trembling: Option<f64>,
    /// Largest divided by smallest value of the repetitions.
    pub trembling_spread: Option<f64>,
    pub jitter: Option<f64>,
    pub churn: Option<f64>,
}

/// One run.
#[derive(Default)]
struct Run {
    refresh: Vec<f64>,
    detection: Vec<f64>,
    refreshed: Vec<f64>,
    errors: Vec<[f64; 2]>,
    steadiness: Option<super::player::Steadiness>,
}

/// Plays every scene at every δ, one repetition after the other, so that a disturbance of the machine does not affect
/// only one δ.
pub fn measure(extent: Extent, progress: &ProgressBar) -> Vec<DeltaRow> {
    let deltas = extent.pick(&DELTAS[4..6], &DELTAS[..]);
    let (repetitions, ticks) = extent.pick((1, 30), (3, 360));
    progress.set_length((repetitions * KINDS.len() * deltas.len()) as u64);
    let mut runs: Vec<Vec<Run>> = (0..KINDS.len() * deltas.len()).map(|_| Vec::new()).collect();
    for repetition in 0..repetitions {
        for (place, (_, scene)) in KINDS.into_iter().enumerate() {
            for (number, &delta) in deltas.iter().enumerate() {
                runs[place * deltas.len() + number].push(run(scene, delta, repetition as u64, ticks));
                progress.inc(1);
            }
        }
    }
    let settings = KINDS.into_iter().flat_map(|kind| deltas.iter().map(move |&delta| (kind, delta)));
    settings.zip(&runs).map(|((kind, delta), runs)| row(kind, delta, runs)).collect()
}

fn run(scene: &str, delta: f32, repetition: u64, ticks: usize) -> Run {
    let settings = Variation::default().detection;
    let variation = Variation {
        detection: CircumsphereSettings { refit_threshold: delta, ..settings },
        ..variation(Tested::Circumsphere)
    };
    let mut player = Player::new(scene, &variation, repetition);
    let mut run = Run::default();
    player.play(ticks, |player| {
        let stage = &player.scene.stage;
        let diagnostics = stage.app.world().resource::<DetectionDiagnostics>();
        let stages = diagnostics.stages.iter().filter(|stage| ["curvature", "refit"].contains(&stage.name));
        let time: f64 = stages.map(|stage| stage.duration.as_secs_f64()).sum();
        if time > 0.0 {
            run.refresh.push(1.0e6 * time);
        }
        run.detection.push(1.0e3 * diagnostics.total().as_secs_f64());
        run.refreshed.push(diagnostics.recipes_refreshed as f64 / stage.triangle_count() as f64);
        if player.ticks.len() % LOOK_EVERY == 0 {
            run.errors.extend((0..stage.bodies.len()).filter_map(|body| surface_error(player, body)));
        }
    });
    run.steadiness = player.steadiness();
    run
}

/// Error of a body's caps compared with fresh ones: of their tops in mean edges, and of their bulges. `None` if the
/// body's spheres are not up to date with the last tick.
fn surface_error(player: &Player, body: usize) -> Option<[f64; 2]> {
    let stage = &player.scene.stage;
    let (world, entity) = (stage.app.world(), stage.bodies[body]);
    let positions = player.detected_positions(body);
    let surface = stage.surface(entity);
    let triangles = surface.topology().triangles();
    let spheres = &world.get::<Circumspheres>(entity)?;
    let curvature = &world.get::<TriangleCurvature>(entity)?;
    let axes = &world.get::<TriangleCones>(entity)?.axes;
    if spheres.centers.len() != triangles.len() || !follows(spheres, positions, triangles) {
        return None;
    }
    let settings = world.resource::<CircumsphereSettings>();
    let always = RecipeSettings {
        sphere_offset: settings.sphere_offset,
        curvature_threshold: settings.curvature_threshold,
        refit_threshold: 0.0,
    };
    let (mut fresh, mut cones) = (OffsetSpheres::default(), SafetyCones::default());
    fresh.refit(positions, triangles, &curvature.curvatures, &curvature.dihedrals, always, &mut cones);
    let top = |spheres: &OffsetSpheres, axes: &[Vec3], triangle: usize| {
        (spheres.centers[triangle] + axes[triangle] * spheres.radii[triangle]).as_dvec3()
    };
    let bulge =
        |spheres: &OffsetSpheres, triangle: usize| f64::from(spheres.radii[triangle] - spheres.heights[triangle]);
    let (mut away, mut higher, mut bulges) = (0.0, 0.0, 0.0);
    for triangle in 0..triangles.len() {
        away += top(spheres, axes, triangle).distance(top(&fresh, &cones.axes, triangle));
        higher += (bulge(spheres, triangle) - bulge(&fresh, triangle)).abs();
        bulges += bulge(&fresh, triangle);
    }
    Some([away / (triangles.len() as f64 * f64::from(surface.mean_edge())), higher / bulges])
}

/// Whether every sphere reaches exactly to its triangle's farthest corner. Then it was refitted to these positions.
fn follows(spheres: &OffsetSpheres, positions: &[Vec3], triangles: &[[u32; 3]]) -> bool {
    const ROUNDING: f32 = 1.0e-4;
    triangles.iter().zip(spheres.centers.iter().zip(&spheres.radii)).all(|(corners, (&center, &radius))| {
        let reach = corners.iter().map(|&corner| positions[corner as usize].distance(center)).fold(0.0, f32::max);
        (radius - reach).abs() <= ROUNDING * radius
    })
}

fn row((kind, scene): (&'static str, &'static str), delta: f32, runs: &[Run]) -> DeltaRow {
    let refresh = median(runs.iter().filter_map(|run| median(run.refresh.clone())).collect());
    let error =
        |which: usize| mean(runs.iter().flat_map(|run| &run.errors).map(|errors| errors[which])).unwrap_or_default();
    let steady: Vec<_> = runs.iter().filter_map(|run| run.steadiness).collect();
    let trembling: Vec<f64> = steady.iter().map(|steady| steady.trembling).collect();
    let detection: Vec<f64> = runs.iter().filter_map(|run| median(run.detection.clone())).collect();
    DeltaRow {
        kind,
        scene,
        delta,
        repetitions: runs.len(),
        broken: runs.len() - steady.len(),
        time_refresh_us: refresh.unwrap_or_default(),
        time_detection_spread: spread(&detection, f64::MIN_POSITIVE),
        time_detection_ms: median(detection).unwrap_or_default(),
        refreshed_share: mean(runs.iter().filter_map(|run| mean(run.refreshed.iter().copied()))).unwrap_or_default(),
        surface_error_edges: error(0),
        surface_error_relative: error(1),
        trembling_spread: (!trembling.is_empty()).then(|| spread(&trembling, LEAST_TREMBLING)),
        trembling: median(trembling),
        jitter: median(steady.iter().map(|steady| steady.jitter).collect()),
        churn: median(steady.iter().map(|steady| steady.churn).collect()),
    }
}

/// Largest divided by smallest value. Numbers below `least` count as `least`.
fn spread(values: &[f64], least: f64) -> f64 {
    let (low, high) =
        values.iter().fold((f64::INFINITY, least), |(low, high), &value| (low.min(value), high.max(value)));
    high / low.max(least)
}

/// A measure over all scenes at each δ, as a multiple of the smallest value. Covers each δ for which every scene has a
/// value.
fn pooled(rows: &[DeltaRow], value: impl Fn(&DeltaRow) -> Option<f64>, least: f64) -> Vec<(f32, f64)> {
    let mut deltas: Vec<f32> = rows.iter().map(|row| row.delta).collect();
    deltas.sort_by(f32::total_cmp);
    deltas.dedup();
    let of_delta = |delta: f32| {
        let values: Option<Vec<f64>> = rows.iter().filter(|row| row.delta == delta).map(&value).collect();
        geometric_mean(values?, least)
    };
    let means: Vec<(f32, f64)> = deltas.iter().filter_map(|&delta| Some((delta, of_delta(delta)?))).collect();
    let best = means.iter().map(|one| one.1).fold(f64::INFINITY, f64::min);
    means.into_iter().map(|(delta, mean)| (delta, mean / best)).collect()
}

/// Whether the recommended δ is best, in words and as an outcome. Values within a factor of `noise` of the best count
/// as equal.
fn advised(what: &str, pooled: &[(f32, f64)], advised: f32, noise: f64) -> (String, Outcome) {
    let best = pooled.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let (Some(&(best, _)), Some(&(_, ratio))) = (best, pooled.iter().find(|one| one.0 == advised)) else {
        return (format!("{what} could not be compared, because scenes flew apart"), Outcome::Undecided);
    };
    let worst = pooled.iter().map(|one| one.1).fold(1.0, f64::max);
    let told = if best == advised {
        format!("{what} is smallest at δ = {best} ({} times that at the worst δ)", figure(worst))
    } else {
        format!(
            "{what} is smallest at δ = {best} ({} times that at δ = {advised}, {} times that at the worst δ)",
            figure(ratio),
            figure(worst)
        )
    };
    let outcome = if worst <= noise {
        Outcome::Undecided
    } else if best == advised {
        Outcome::Holds
    } else if ratio <= noise {
        Outcome::Undecided
    } else {
        Outcome::Fails
    };
    (format!("{told}, and repetitions of one δ differ by a factor of {}", figure(noise)), outcome)
}

pub fn finding(rows: &[DeltaRow]) -> Finding {
    let steady = pooled(rows, |row| row.trembling, LEAST_TREMBLING);
    let noise = geometric_mean(rows.iter().filter_map(|row| row.trembling_spread), 1.0).unwrap_or(1.0);
    let (told, steadiest) = advised("trembling", &steady, STEADIEST, noise);
    let fast = pooled(rows, |row| Some(row.time_detection_ms), f64::MIN_POSITIVE);
    let noise = geometric_mean(rows.iter().map(|row| row.time_detection_spread), 1.0).unwrap_or(1.0);
    let (told_of_speed, fastest) = advised("the time of detection", &fast, FASTEST, noise);
    Finding {
        claim: format!("δ = {STEADIEST} gives the best stability and δ = {FASTEST} the best speed"),
        found: format!("over the three scenes, {told}; {told_of_speed}"),
        outcome: Outcome::all(&[steadiest, fastest]),
    }
}

pub fn tables(rows: &[DeltaRow]) -> String {
    let header = [
        "scene",
        "δ",
        "refresh (µs)",
        "detection (ms)",
        "refreshed per tick",
        "error of tops (edges)",
        "error of bulges",
        "trembling (edges per tick)",
        "factor between repetitions",
        "churn",
        "flew apart",
    ];
    table(
        &header.map(str::to_owned),
        rows.iter().map(|row| {
            vec![
                row.scene.to_owned(),
                row.delta.to_string(),
                figure(row.time_refresh_us),
                figure(row.time_detection_ms),
                percent(row.refreshed_share),
                figure(row.surface_error_edges),
                percent(row.surface_error_relative),
                optional(row.trembling),
                optional(row.trembling_spread),
                row.churn.map_or_else(|| "–".to_owned(), percent),
                format!("{} of {}", row.broken, row.repetitions),
            ]
        }),
    )
}
