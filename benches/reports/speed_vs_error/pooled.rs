//! Results over all scenes. Each scene has the same weight, regardless of its number of pairs.

use circumsphere_reports::statistics::mean;
use serde::Serialize;

use super::{configurations::Configuration, measure::Measured};

/// One line of `pooled.csv`: a configuration over all scenes. Rates are means of the rates of the scenes.
#[derive(Clone, Debug, Serialize)]
pub struct PooledRow {
    pub configuration: String,
    pub method: String,
    pub contact_distance_edges: f64,
    /// Scenes in which anything touches.
    pub scenes: usize,
    pub true_pairs: usize,
    pub missed_pairs: usize,
    pub false_pairs: usize,
    pub pair_miss_rate: Option<f64>,
    pub pair_false_rate: Option<f64>,
    pub pair_error: Option<f64>,
    pub triangle_miss_rate: Option<f64>,
    pub triangle_false_rate: Option<f64>,
    pub object_miss_rate: Option<f64>,
    /// Largest share of missed pairs in a scene.
    pub worst_pair_miss_rate: Option<f64>,
    pub contact_churn: Option<f64>,
    pub recipes_refreshed_share: Option<f64>,
    /// Geometric mean over scenes of the time relative to `Exact` at the same contact distance.
    pub time_ratio: Option<f64>,
}

pub struct Pooled {
    pub configuration: Configuration,
    pub row: PooledRow,
}

/// One entry per configuration, in the order of their first occurrence.
pub fn pooled(measured: &[Measured]) -> Vec<Pooled> {
    let mut configurations: Vec<&Configuration> = Vec::new();
    for one in measured {
        if !configurations.contains(&&one.configuration) {
            configurations.push(&one.configuration);
        }
    }
    configurations.into_iter().map(|configuration| pool(configuration, measured)).collect()
}

/// Time of `Exact` in a scene.
fn refined_time(measured: &[Measured], scene: &str, distance_edges: f64) -> Option<f64> {
    measured
        .iter()
        .find(|one| {
            one.row.scene == scene
                && one.row.configuration == "Exact"
                && one.row.contact_distance_edges == distance_edges
        })
        .map(|one| one.row.time_ms)
}

fn pool(configuration: &Configuration, measured: &[Measured]) -> Pooled {
    let ours: Vec<&Measured> = measured.iter().filter(|one| one.configuration == *configuration).collect();
    let touching = || ours.iter().filter(|one| one.row.true_pairs > 0);
    let mean_of = |value: fn(&Measured) -> Option<f64>| mean(touching().filter_map(|one| value(one)));
    let total = |value: fn(&Measured) -> usize| ours.iter().map(|one| value(one)).sum();
    let distance = configuration.distance_edges;
    let logs = ours.iter().filter_map(|one| {
        let refined = refined_time(measured, &one.row.scene, distance)?;
        (refined > 0.0 && one.row.time_ms > 0.0).then(|| (one.row.time_ms / refined).ln())
    });
    let row = PooledRow {
        configuration: configuration.name.clone(),
        method: format!("{:?}", configuration.method),
        contact_distance_edges: distance,
        scenes: touching().count(),
        true_pairs: total(|one| one.row.true_pairs),
        missed_pairs: total(|one| one.row.missed_pairs),
        false_pairs: total(|one| one.row.false_pairs),
        pair_miss_rate: mean_of(|one| one.row.pair_miss_rate),
        // If nothing is found, nothing is false.
        pair_false_rate: mean_of(|one| Some(one.row.pair_false_rate.unwrap_or(0.0))),
        pair_error: mean_of(|one| one.row.pair_error),
        triangle_miss_rate: mean_of(|one| one.row.triangle_miss_rate),
        triangle_false_rate: mean_of(|one| Some(one.row.triangle_false_rate.unwrap_or(0.0))),
        object_miss_rate: mean_of(|one| one.row.object_miss_rate),
        worst_pair_miss_rate: touching().filter_map(|one| one.row.pair_miss_rate).reduce(f64::max),
        contact_churn: mean_of(|one| one.row.contact_churn),
        recipes_refreshed_share: mean_of(|one| one.row.recipes_refreshed_share),
        time_ratio: mean(logs).map(f64::exp),
    };
    Pooled { configuration: configuration.clone(), row }
}
