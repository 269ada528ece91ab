//! Time against the number of triangles: the same scene at every size, and the slope in a log-log plot.

use bevy_circumsphere::{CircumsphereSettings, ContactMethod};
use circumsphere_reports::statistics::log_slope;
use circumsphere_support::scenes::growing_sheets;
use serde::Serialize;

use super::{
    configurations::DEFAULT_DISTANCE,
    measure::milliseconds,
    options::Extent,
    player::Stage,
    scene::{Scene, SceneError},
};

const SIZES: [usize; 7] = [1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000];

/// One line of `scaling.csv`.
#[derive(Clone, Debug, Serialize)]
pub struct ScalingRow {
    pub method: String,
    pub triangles: usize,
    pub candidates_per_tick: usize,
    pub touching_pairs_per_tick: usize,
    pub time_ms: f64,
}

/// The sizes to measure for an extent.
pub fn sizes(extent: Extent) -> &'static [usize] {
    match extent {
        Extent::Smoke => &SIZES[..2],
        Extent::Quick => &SIZES[..4],
        Extent::Full => &SIZES,
    }
}

/// Measures every method at one size.
pub fn measure_size(triangles: usize) -> Result<Vec<ScalingRow>, SceneError> {
    // The first tick makes every recipe and is not counted.
    let ticks = if triangles > 100_000 { 4 } else { 8 };
    let scene = Scene::of_moving(growing_sheets(triangles, ticks))?;
    Ok(ContactMethod::ALL
        .iter()
        .map(|&method| {
            let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
            let mut stage = Stage::new(&scene, method, settings, DEFAULT_DISTANCE);
            let costs: Vec<_> = (0..ticks).map(|tick| stage.tick(&scene, tick)).collect();
            ScalingRow {
                method: format!("{method:?}"),
                triangles: scene.triangles(),
                candidates_per_tick: costs[ticks - 1].candidates,
                touching_pairs_per_tick: costs[ticks - 1].touching_pairs,
                // All ticks do the same work, so the fastest one is the least disturbed.
                time_ms: costs[1..].iter().map(|cost| milliseconds(cost.total)).fold(f64::INFINITY, f64::min),
            }
        })
        .collect())
}

/// The exponent k in time ~ triangles^k for a method.
pub fn slope(rows: &[ScalingRow], method: ContactMethod) -> Option<f64> {
    let name = format!("{method:?}");
    let points: Vec<(f64, f64)> =
        rows.iter().filter(|row| row.method == name).map(|row| (row.triangles as f64, row.time_ms)).collect();
    log_slope(&points)
}
