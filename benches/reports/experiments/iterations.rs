//! Contact methods at few and many solver iterations: time per tick, steadiness of the scenes, and residual penetration
//! measured with the exact method.

use bevy_circumsphere::response::XpbdSettings;
use circumsphere_examples::scenes::{self, Variation};
use circumsphere_reports::{
    finding::{Finding, Outcome, figure, geometric_mean, optional, percent, table},
    statistics::median,
};
use indicatif::ProgressBar;
use serde::Serialize;

use super::{
    options::Extent,
    player::{KINDS, Player, Steadiness, variation},
    residual::Residual,
    tested::Tested,
};

const ITERATIONS: [u32; 6] = [1, 2, 4, 8, 16, 32];

/// Few substeps, as in a game that relies on iterations. With the default number, iterations would be superfluous.
pub const SUBSTEPS: u32 = 2;

/// Up to this number, iterations count as few.
const FEW: u32 = 4;

const LEAST_TREMBLING: f64 = 1.0e-8;

/// Results of one method in one scene: medians over the repetitions.
#[derive(Clone, Debug, Serialize)]
pub struct IterationsRow {
    pub kind: &'static str,
    pub scene: &'static str,
    #[serde(serialize_with = "super::report::name_of_method")]
    pub method: Tested,
    pub substeps: u32,
    pub iterations: u32,
    pub repetitions: usize,
    /// Repetitions that flew apart. Only times include them.
    pub broken: usize,
    /// Median time per tick, in milliseconds.
    pub time_detection_ms: f64,
    pub time_response_ms: f64,
    pub trembling: Option<f64>,
    pub jitter: Option<f64>,
    pub churn: Option<f64>,
    /// Mean and largest overlap of contacts at the end, in contact distances.
    pub residual_mean: Option<f64>,
    pub residual_deepest: Option<f64>,
    /// Edges that pierce a face at the end.
    pub residual_crossings: Option<f64>,
    /// Vertices inside another body at the end.
    pub residual_inside: Option<f64>,
}

struct Run {
    detection: f64,
    response: f64,
    quiet: Option<(Steadiness, Residual)>,
}

/// Plays every scene with every method and every number of iterations, one repetition after the other.
pub fn measure(extent: Extent, progress: &ProgressBar) -> Vec<IterationsRow> {
    let iterations = extent.pick(&ITERATIONS[1..3], &ITERATIONS[..]);
    let (repetitions, ticks) = extent.pick((1, 20), (2, 360));
    let settings: Vec<_> = KINDS
        .into_iter()
        .flat_map(|kind| {
            Tested::ALL.into_iter().flat_map(move |method| iterations.iter().map(move |&one| (kind, method, one)))
        })
        .collect();
    progress.set_length((settings.len() * repetitions) as u64);
    let mut runs: Vec<Vec<Run>> = settings.iter().map(|_| Vec::new()).collect();
    for repetition in 0..repetitions {
        for (&((_, scene), method, iterations), runs) in settings.iter().zip(&mut runs) {
            runs.push(run(scene, method, iterations, repetition as u64, ticks));
            progress.inc(1);
        }
    }
    settings
        .into_iter()
        .zip(&runs)
        .map(|((kind, method, iterations), runs)| row(kind, method, iterations, runs))
        .collect()
}

fn run(scene: &str, method: Tested, iterations: u32, repetition: u64, ticks: usize) -> Run {
    let response = XpbdSettings { substeps: SUBSTEPS, iterations, ..XpbdSettings::default() };
    let mut player = Player::new(scene, &Variation { response, ..variation(method) }, repetition);
    // Stop at the end of the settled ticks. After that, the instrument is lifted and nothing is in contact.
    let settled = player.scene.settled.end as usize;
    player.play(ticks.min(settled), |_| ());
    let milliseconds = |time: fn(&scenes::measure::Tick) -> std::time::Duration| {
        median(player.ticks.iter().map(|tick| 1.0e3 * time(tick).as_secs_f64()).collect()).unwrap_or_default()
    };
    let quiet = player.steadiness().map(|steadiness| (steadiness, Residual::of(&player.scene.stage)));
    Run { detection: milliseconds(|tick| tick.detection), response: milliseconds(|tick| tick.response), quiet }
}

fn row((kind, scene): (&'static str, &'static str), method: Tested, iterations: u32, runs: &[Run]) -> IterationsRow {
    let time = |value: fn(&Run) -> f64| median(runs.iter().map(value).collect()).unwrap_or_default();
    let of_quiet = |value: fn(&Steadiness, &Residual) -> f64| {
        let quiet = runs.iter().filter_map(|run| run.quiet.as_ref());
        median(quiet.map(|(steadiness, residual)| value(steadiness, residual)).collect())
    };
    IterationsRow {
        kind,
        scene,
        method,
        substeps: SUBSTEPS,
        iterations,
        repetitions: runs.len(),
        broken: runs.iter().filter(|run| run.quiet.is_none()).count(),
        time_detection_ms: time(|run| run.detection),
        time_response_ms: time(|run| run.response),
        trembling: of_quiet(|steadiness, _| steadiness.trembling),
        jitter: of_quiet(|steadiness, _| steadiness.jitter),
        churn: of_quiet(|steadiness, _| steadiness.churn),
        residual_mean: of_quiet(|_, residual| residual.depth),
        residual_deepest: of_quiet(|_, residual| residual.deepest),
        residual_crossings: of_quiet(|_, residual| residual.crossings as f64),
        residual_inside: of_quiet(|_, residual| residual.inside as f64),
    }
}

/// Steadiness compared with polygons at few iterations.
struct Compared {
    /// Settings in which it trembles less, of all.
    steadier: usize,
    settings: usize,
    /// Geometric mean of the trembling relative to that of polygons, over settings in which neither flew apart.
    mean: Option<f64>,
    broken: usize,
}

impl Compared {
    fn new(rows: &[IterationsRow], tested: Tested) -> Self {
        let few = |tested: Tested| rows.iter().filter(move |row| row.method == tested && row.iterations <= FEW);
        let (mut ratios, mut steadier, mut settings) = (Vec::new(), 0, 0);
        for (own, other) in few(tested).zip(few(Tested::Polygon)) {
            settings += 1;
            match (own.trembling, other.trembling) {
                (Some(own), Some(other)) => {
                    let ratio = own.max(LEAST_TREMBLING) / other.max(LEAST_TREMBLING);
                    steadier += usize::from(ratio < 1.0);
                    ratios.push(ratio);
                }
                (Some(_), None) => steadier += 1,
                (None, _) => (),
            }
        }
        let mean = geometric_mean(ratios.iter().copied(), f64::MIN_POSITIVE);
        Self { steadier, settings, mean, broken: few(tested).map(|row| row.broken).sum() }
    }

    fn outcome(&self) -> Outcome {
        let is_mostly = 2 * self.steadier > self.settings;
        match self.mean {
            _ if self.settings == 0 => Outcome::Undecided,
            Some(mean) if mean < 1.0 && is_mostly => Outcome::Holds,
            None if is_mostly => Outcome::Holds,
            Some(mean) if mean < 1.0 || is_mostly => Outcome::HoldsInPart,
            _ => Outcome::Fails,
        }
    }

    fn told(&self) -> String {
        let Self { steadier, settings, mean, .. } = self;
        let mean = mean.map_or_else(
            || "no setting has a trembling for both".to_owned(),
            |mean| format!("its trembling is {} times that of polygons", figure(mean)),
        );
        format!("it is steadier in {steadier} of {settings} settings, and {mean}")
    }
}

/// Compares circumspheres with polygons at few iterations: their trembling, and how often scenes flew apart.
pub fn finding(rows: &[IterationsRow]) -> Finding {
    let [own, osculating, polygons] =
        [Tested::Circumsphere, Tested::Osculating, Tested::Polygon].map(|tested| Compared::new(rows, tested));
    let few = rows.iter().filter(|row| row.method == Tested::Polygon && row.iterations <= FEW);
    let runs = few.map(|row| row.repetitions).sum::<usize>();
    Finding {
        claim: "the circumsphere method is steadier than polygons at few iterations".to_owned(),
        found: format!(
            "at up to {FEW} iterations, {} (geometric mean over settings in which neither flew apart); with osculating \
             spheres on smooth surfaces, {}; of {runs} runs each, {}, {}, and {} flew apart with the two and with \
             polygons",
            own.told(),
            osculating.told(),
            own.broken,
            osculating.broken,
            polygons.broken
        ),
        outcome: own.outcome(),
    }
}

/// One table per measure and scene: a row for each number of iterations, and a column for each method.
pub fn tables(rows: &[IterationsRow]) -> String {
    let measures: [(&str, fn(&IterationsRow) -> String); 5] = [
        ("detection + response (ms)", |row| {
            format!("{} + {}", figure(row.time_detection_ms), figure(row.time_response_ms))
        }),
        ("trembling (edges per tick)", |row| optional(row.trembling)),
        ("contact churn", |row| row.churn.map_or_else(|| "–".to_owned(), percent)),
        ("residual penetration (contact distances): mean, maximum", |row| {
            format!("{}, {}", optional(row.residual_mean), optional(row.residual_deepest))
        }),
        ("flew apart", |row| format!("{} of {}", row.broken, row.repetitions)),
    ];
    let mut header = vec!["scene".to_owned(), "measure".to_owned(), "iterations".to_owned()];
    header.extend(Tested::ALL.map(|method| format!("{method:?}")));
    let mut lines = Vec::new();
    for (_, scene) in KINDS {
        for (name, measure) in &measures {
            let own = |method: Tested| rows.iter().filter(move |row| row.scene == scene && row.method == method);
            for first in own(Tested::ALL[0]) {
                let cell = |method| {
                    own(method).find(|row| row.iterations == first.iterations).map_or_else(String::new, measure)
                };
                let mut line = vec![scene.to_owned(), (*name).to_owned(), first.iterations.to_string()];
                line.extend(Tested::ALL.map(cell));
                lines.push(line);
            }
        }
    }
    table(&header, lines)
}
