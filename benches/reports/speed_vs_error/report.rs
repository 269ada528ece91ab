//! The text and tables of the report. Every sentence about a figure is generated from that figure.

use std::{
    fmt::{self, Write},
    fs,
    path::Path,
};

use bevy_circumsphere::{CircumsphereSettings, ContactMethod};
use circumsphere_reports::{
    OutputError,
    statistics::{mean, pareto_front},
    tables::write_csv,
};
use serde::Deserialize;

use super::{
    ReportError,
    configurations::{Configuration, DEFAULT_DISTANCE, estimator_name},
    measure::Measured,
    options::Options,
    plots::{self, Drawn},
    pooled::{Pooled, PooledRow},
    scaling::{self, ScalingRow},
    scene::Scene,
    sliding::SlidingRow,
    truth::BAND,
};

/// Results on random pairs of triangles, computed once by a test that takes too long to be part of every run.
const RANDOM_PAIRS: &str = include_str!("random_pairs.json");

/// Facts about a scene for the report.
pub struct SceneFacts {
    pub name: String,
    pub what: String,
    pub deforms: bool,
    pub bodies: usize,
    pub triangles: usize,
    pub ticks: usize,
    pub measured: usize,
    pub mean_edge: f64,
}

impl SceneFacts {
    pub fn new(scene: &Scene) -> Self {
        Self {
            name: scene.name.clone(),
            what: scene.what.clone(),
            deforms: scene.deforms,
            bodies: scene.bodies.len(),
            triangles: scene.triangles(),
            ticks: scene.ticks(),
            measured: scene.measured.len(),
            mean_edge: scene.mean_edge(),
        }
    }
}

/// All results.
pub struct Study {
    pub scenes: Vec<SceneFacts>,
    pub configurations: Vec<Configuration>,
    pub measured: Vec<Measured>,
    pub pooled: Vec<Pooled>,
    pub scaling: Vec<ScalingRow>,
    pub sliding: Vec<SlidingRow>,
    pub seconds: f64,
}

impl Study {
    /// Contact distances in mean edges, ascending.
    pub fn distances(&self) -> Vec<f64> {
        let mut distances: Vec<f64> = self.configurations.iter().map(|one| one.distance_edges).collect();
        distances.sort_by(f64::total_cmp);
        distances.dedup();
        distances
    }

    /// The contact distance at which single factors vary.
    pub fn center_distance(&self) -> f64 {
        let distances = self.distances();
        if distances.contains(&DEFAULT_DISTANCE) { DEFAULT_DISTANCE } else { distances[0] }
    }

    /// A scene under `Circumsphere` with all settings but δ at their defaults.
    pub fn delta_series<'a>(&'a self, scene: &'a str) -> impl Iterator<Item = &'a Measured> {
        self.measured.iter().filter(move |one| {
            one.row.scene == scene
                && one.configuration.distance_edges == self.center_distance()
                && one
                    .configuration
                    .is_default_but(|settings, default| settings.refit_threshold = default.refit_threshold)
        })
    }

    /// A method with default settings, over all scenes.
    fn pooled_default(&self, method: ContactMethod, distance: f64) -> Option<&PooledRow> {
        self.pooled
            .iter()
            .find(|all| {
                all.configuration.method == method
                    && all.configuration.is_default()
                    && all.configuration.distance_edges == distance
            })
            .map(|all| &all.row)
    }

    /// `Circumsphere` at the center distance with all settings at their defaults, except those that `put_back` resets.
    fn pooled_but(
        &self,
        put_back: impl Fn(&mut CircumsphereSettings, &CircumsphereSettings) + Copy,
    ) -> impl Iterator<Item = &Pooled> {
        self.pooled.iter().filter(move |all| {
            all.configuration.distance_edges == self.center_distance() && all.configuration.is_default_but(put_back)
        })
    }
}

#[derive(Deserialize)]
struct RandomPairs {
    command: Option<String>,
    seed: Option<u64>,
    pairs: Option<u64>,
    missed: Option<u64>,
    #[serde(rename = "false")]
    made_up: Option<u64>,
    worst_separation_error: Option<f64>,
}

/// Writes tables, plots, and the report.
pub fn write(options: &Options, study: &Study) -> Result<(), ReportError> {
    let folder = &options.out;
    write_csv(folder, "measures.csv", study.measured.iter().map(|one| &one.row))?;
    write_csv(folder, "stages.csv", study.measured.iter().flat_map(|one| &one.stages))?;
    write_csv(folder, "pooled.csv", study.pooled.iter().map(|all| &all.row))?;
    if !study.scaling.is_empty() {
        write_csv(folder, "scaling.csv", &study.scaling)?;
    }
    if !study.sliding.is_empty() {
        write_csv(folder, "sliding.csv", &study.sliding)?;
    }
    let drawn = plots::draw(folder, study)?;
    let text = Text { options, study, drawn: &drawn }.to_string();
    let path = folder.join("report.md");
    Ok(fs::write(&path, text).map_err(|source| OutputError::File { path, source })?)
}

/// Percentage with two decimals, or a dash. A positive value never shows as 0.
fn percent(share: Option<f64>) -> String {
    match share {
        None => "–".to_owned(),
        Some(share) if share > 0.0 && share < 0.5e-4 => "<0.01 %".to_owned(),
        Some(share) => format!("{:.2} %", 100.0 * share),
    }
}

fn fixed(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.decimals$}"))
}

/// Number in scientific notation.
fn scientific(value: Option<f64>) -> String {
    match value {
        None => "–".to_owned(),
        Some(0.0) => "0".to_owned(),
        Some(value) => format!("{value:.1e}"),
    }
}

struct Table {
    text: String,
}

impl Table {
    fn new(columns: &[&str]) -> Self {
        let mut table = Self { text: String::new() };
        table.row(columns.iter().map(|&column| column.to_owned()));
        let rule: Vec<&str> = (0..columns.len()).map(|column| if column == 0 { "---" } else { "--:" }).collect();
        table.row(rule.into_iter().map(str::to_owned));
        table
    }

    fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.text.push('|');
        for cell in cells {
            let _ = write!(self.text, " {cell} |");
        }
        self.text.push('\n');
    }
}

impl fmt::Display for Table {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "{}", self.text)
    }
}

struct Text<'a> {
    options: &'a Options,
    study: &'a Study,
    drawn: &'a [Drawn],
}

impl fmt::Display for Text<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.head(out)?;
        self.what_was_run(out)?;
        self.which_method(out)?;
        self.by_distance(out)?;
        self.by_scene(out)?;
        self.phi(out)?;
        self.curvature(out)?;
        self.delta(out)?;
        self.further(out)?;
        self.scaling(out)?;
        self.stages(out)?;
        self.memory(out)?;
        self.steadiness(out)?;
        self.smooth_normals(out)?;
        self.random_pairs(out)?;
        self.not_measured(out)
    }
}

impl Text<'_> {
    fn command(&self) -> String {
        let options = self.options;
        // Leave out the local path of an absolute folder.
        let show = |path: &Path| {
            if path.is_absolute() { path.file_name().map_or(path, Path::new) } else { path }.display().to_string()
        };
        let mut words = vec!["cargo run --release --example speed_vs_error --".to_owned()];
        words.extend(options.folder.as_deref().map(show));
        words.extend(options.quick.then(|| "--quick".to_owned()));
        words.extend(options.smoke.then(|| "--smoke".to_owned()));
        words.extend((!options.scenes.is_empty()).then(|| format!("--scenes {}", options.scenes.join(","))));
        words.extend(options.frames.map(|frames| format!("--frames {frames}")));
        let distances: Vec<String> = options.distances.iter().map(f64::to_string).collect();
        words.extend((!distances.is_empty()).then(|| format!("--distances {}", distances.join(","))));
        words.push(format!("--out {}", show(&options.out)));
        words.join(" ")
    }

    fn plot(&self, out: &mut fmt::Formatter<'_>, name: &str) -> fmt::Result {
        match self.drawn.iter().find(|drawn| drawn.name == name) {
            Some(drawn) => writeln!(out, "![{}]({name}.png)\n\n([SVG]({name}.svg))\n", drawn.shows),
            None => writeln!(out, "(Too few settings were measured for a plot.)\n"),
        }
    }

    fn head(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "# Speed against error\n\n\
             The time and the errors of each contact method, compared with an f64 reference. This report \
             was written by\n\n    {}\n\nin {:.0} s.\n\n\
             Times are measured on one thread of one machine. Only their ratios carry over to other machines. All \
             other figures are the same in every run. A time covers a whole tick, including reading its contacts. If \
             contacts are not read, `Circumsphere` and `BoundingSphere` take less time, because they write no points \
             and no normals.\n",
            self.command(),
            self.study.seconds
        )
    }

    fn what_was_run(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        writeln!(out, "## What was run\n")?;
        let mut table =
            Table::new(&["scene", "what happens", "bodies", "triangles", "ticks", "measured ticks", "mean edge"]);
        for scene in &study.scenes {
            table.row([
                scene.name.clone(),
                scene.what.clone(),
                scene.bodies.to_string(),
                scene.triangles.to_string(),
                scene.ticks.to_string(),
                scene.measured.to_string(),
                format!("{:.4}", scene.mean_edge),
            ]);
        }
        write!(out, "{table}")?;
        let distances: Vec<String> = study.distances().iter().map(f64::to_string).collect();
        let unique = study.configurations.len();
        writeln!(
            out,
            "{unique} configurations run through the plugin in a headless app. All methods run at contact distances of \
             {} mean edges, where the mean edge of a scene is the median of its bodies' mean edges. `Circumsphere` \
             also runs with φ × plane cull at {}. At {} edges, it runs with one factor at a time around the defaults: \
             φ with narrow cones, estimator × threshold, and δ. Costs, churn, and jumps are measured in every tick, \
             and errors in the measured ticks. Closed bodies are one-sided; sheets and recordings are two-sided. A \
             time is the median over ticks of each tick's fastest round.\n",
            distances.join(", "),
            if self.options.quick || distances.len() == 1 { "the default distance" } else { "each distance" },
            study.center_distance()
        )?;
        writeln!(
            out,
            "A *missed* pair of triangles is closer than the contact distance and not reported. A *false* pair is \
             reported and farther apart. For pairs within {BAND:e} of the contact distance, relative to it, either \
             answer is right. *1 − F1* combines both errors: F1 is the harmonic mean of recall (1 − missed) and \
             precision (1 − false). Rates over several scenes are means of the scenes' rates. *Separation error* is \
             relative to the contact distance or the pair's longest edge, whichever is larger. *Normal error* is the \
             angle between the normal and the direction between the pair's closest features. Crossing pairs have no \
             such direction and are left out.\n\n\
             Tables: [measures.csv](measures.csv) (everything, by scene), [pooled.csv](pooled.csv) (over all scenes), \
             [stages.csv](stages.csv) (time and pairs by stage){}.\n",
            if study.scaling.is_empty() { "" } else { ", [scaling.csv](scaling.csv) (time against triangles)" }
        )
    }

    fn which_method(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        let distance = study.center_distance();
        writeln!(out, "## Choosing a method\n")?;
        self.plot(out, "speed_vs_error")?;
        for method in ContactMethod::ALL {
            let Some(row) = study.pooled_default(method, distance) else { continue };
            writeln!(
                out,
                "- `{method:?}` {}. It misses {} of the pairs ({} in its worst scene) and {} of the touching pairs of \
                 bodies. Of the pairs that it reports, {} are false.",
                match row.time_ratio {
                    _ if method == ContactMethod::Exact => "is the unit of time".to_owned(),
                    Some(ratio) => format!("takes {ratio:.2} times as long as `Exact`"),
                    None => "was not timed together with `Exact`".to_owned(),
                },
                percent(row.pair_miss_rate),
                percent(row.worst_pair_miss_rate),
                percent(row.object_miss_rate),
                percent(row.pair_false_rate)
            )?;
        }
        for (what, value) in [
            ("missed pairs", (|row| row.pair_miss_rate) as fn(&PooledRow) -> Option<f64>),
            ("1 − F1", |row| row.pair_error),
        ] {
            let all: Vec<(&Pooled, f64, f64)> = study
                .pooled
                .iter()
                .filter(|all| all.configuration.distance_edges == distance)
                .filter_map(|all| Some((all, all.row.time_ratio?, value(&all.row)?)))
                .collect();
            let points: Vec<(f64, f64)> = all.iter().map(|&(_, time, error)| (time, error)).collect();
            let front: Vec<String> = pareto_front(&points)
                .into_iter()
                .map(|place| {
                    let (all, time, error) = all[place];
                    format!("`{}` ({time:.2}, {})", all.row.configuration, percent(Some(error)))
                })
                .collect();
            writeln!(out, "- Pareto front of time and {what} (time of `Exact` = 1): {}.", front.join(", "))?;
        }
        writeln!(out)
    }

    fn by_distance(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = Table::new(&[
            "method (defaults)",
            "contact distance (edges)",
            "true pairs",
            "missed",
            "false",
            "1 − F1",
            "triangles missed",
            "triangles false",
            "body pairs missed",
            "time (Exact = 1)",
        ]);
        for method in ContactMethod::ALL {
            for distance in self.study.distances() {
                let Some(row) = self.study.pooled_default(method, distance) else { continue };
                table.row([
                    format!("{method:?}"),
                    distance.to_string(),
                    row.true_pairs.to_string(),
                    percent(row.pair_miss_rate),
                    percent(row.pair_false_rate),
                    percent(row.pair_error),
                    percent(row.triangle_miss_rate),
                    percent(row.triangle_false_rate),
                    percent(row.object_miss_rate),
                    fixed(row.time_ratio, 2),
                ]);
            }
        }
        write!(out, "{table}")
    }

    fn by_scene(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        writeln!(out, "## Scene by scene\n")?;
        self.plot(out, "speed_vs_error_by_scene")?;
        writeln!(out, "All methods with default settings at {} edges.\n", study.center_distance())?;
        let mut pairs = Table::new(&[
            "scene",
            "method",
            "true pairs",
            "missed pairs",
            "false pairs",
            "missed",
            "false",
            "triangles missed",
            "triangles false",
            "vertices missed",
            "body pairs missed",
            "ms per tick",
        ]);
        let mut accuracy = Table::new(&[
            "scene",
            "method",
            "separation error: median",
            "99 %",
            "max",
            "crossing pairs",
            "their error: median",
            "max",
            "normal error (°): median",
            "99 %",
            "max",
        ]);
        for one in self.defaults() {
            let row = &one.row;
            pairs.row([
                row.scene.clone(),
                row.method.clone(),
                row.true_pairs.to_string(),
                row.missed_pairs.to_string(),
                row.false_pairs.to_string(),
                percent(row.pair_miss_rate),
                percent(row.pair_false_rate),
                percent(row.triangle_miss_rate),
                percent(row.triangle_false_rate),
                percent(row.vertex_miss_rate),
                percent(row.object_miss_rate),
                format!("{:.2}", row.time_ms),
            ]);
            accuracy.row([
                row.scene.clone(),
                row.method.clone(),
                scientific(row.separation_error_median),
                scientific(row.separation_error_p99),
                scientific(row.separation_error_max),
                row.crossing_pairs_found.to_string(),
                scientific(row.crossing_separation_error_median),
                scientific(row.crossing_separation_error_max),
                fixed(row.normal_error_median, 3),
                fixed(row.normal_error_p99, 2),
                fixed(row.normal_error_max, 1),
            ]);
        }
        write!(out, "{pairs}{accuracy}")?;
        let exact = || study.measured.iter().filter(|one| one.configuration.method.is_exact()).map(|one| &one.row);
        let worst = exact().filter_map(|row| row.separation_error_max).fold(0.0, f64::max);
        writeln!(
            out,
            "`Closest`, `Exact`, and `Polygon`, over all scenes and distances: {} true pairs, {} missed, {} false, \
             largest separation error {}.\n",
            exact().map(|row| row.true_pairs).sum::<usize>(),
            exact().map(|row| row.missed_pairs).sum::<usize>(),
            exact().map(|row| row.false_pairs).sum::<usize>(),
            scientific(Some(worst))
        )
    }

    /// All scenes under all methods with default settings, at the center distance.
    fn defaults(&self) -> impl Iterator<Item = &Measured> {
        let distance = self.study.center_distance();
        self.study
            .measured
            .iter()
            .filter(move |one| one.configuration.is_default() && one.configuration.distance_edges == distance)
    }

    /// States which setting has the smallest 1 − F1, and how the default compares.
    fn best<'a>(
        out: &mut fmt::Formatter<'_>,
        among: impl Iterator<Item = &'a Pooled>,
        name: impl Fn(&Configuration) -> String,
    ) -> fmt::Result {
        let among: Vec<&Pooled> = among.collect();
        let error = |all: &Pooled| all.row.pair_error.unwrap_or(f64::INFINITY);
        let Some(best) = among.iter().min_by(|a, b| error(a).total_cmp(&error(b))) else { return Ok(()) };
        let say = |all: &Pooled| {
            format!(
                "{} (1 − F1 {}, missed {}, false {}, {} times the time of `Exact`)",
                name(&all.configuration),
                percent(all.row.pair_error),
                percent(all.row.pair_miss_rate),
                percent(all.row.pair_false_rate),
                fixed(all.row.time_ratio, 2)
            )
        };
        let Some(default) = among.iter().find(|all| all.configuration.is_default()) else {
            return writeln!(out, "1 − F1 over all scenes is smallest with {}.\n", say(best));
        };
        if error(default) <= error(best) {
            writeln!(out, "1 − F1 over all scenes is smallest with the default: {}.\n", say(default))
        } else {
            writeln!(out, "1 − F1 over all scenes is smallest with {}. The default is {}.\n", say(best), say(default))
        }
    }

    fn phi(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        writeln!(out, "## φ and the plane cull\n")?;
        self.plot(out, "error_vs_phi")?;
        let among = study.pooled_but(|settings, default| {
            settings.sphere_offset = default.sphere_offset;
            settings.plane_cull = default.plane_cull;
        });
        Self::best(out, among, |configuration| {
            let settings = &configuration.settings;
            format!(
                "φ = {} {} the plane cull",
                settings.sphere_offset,
                if settings.plane_cull { "with" } else { "without" }
            )
        })?;
        let with = |plane_cull: bool| {
            let rows: Vec<&PooledRow> = study
                .pooled_but(|settings, default| {
                    settings.sphere_offset = default.sphere_offset;
                    settings.plane_cull = default.plane_cull;
                })
                .filter(|all| all.configuration.settings.plane_cull == plane_cull)
                .map(|all| &all.row)
                .collect();
            let of = |value: fn(&PooledRow) -> Option<f64>| mean(rows.iter().filter_map(|row| value(row)));
            (of(|row| row.pair_miss_rate), of(|row| row.pair_false_rate), of(|row| row.time_ratio))
        };
        let (on, off) = (with(true), with(false));
        writeln!(
            out,
            "Mean over φ at {} edges: with the plane cull, {} missed and {} false at {} times the time of `Exact`; \
             without it, {} missed and {} false at {} times the time of `Exact`.\n",
            study.center_distance(),
            percent(on.0),
            percent(on.1),
            fixed(on.2, 2),
            percent(off.0),
            percent(off.1),
            fixed(off.2, 2)
        )
    }

    fn curvature(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "## Curvature: estimator and threshold\n")?;
        self.plot(out, "error_vs_curvature")?;
        let among = self.study.pooled_but(|settings, default| {
            settings.estimator = default.estimator;
            settings.curvature_threshold = default.curvature_threshold;
        });
        Self::best(out, among, |configuration| {
            let settings = &configuration.settings;
            format!("{}, threshold {}", estimator_name(settings.estimator), settings.curvature_threshold)
        })
    }

    fn delta(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        writeln!(out, "## δ: how stale spheres may be\n")?;
        self.plot(out, "error_vs_delta")?;
        let among = study.pooled_but(|settings, default| settings.refit_threshold = default.refit_threshold);
        Self::best(out, among, |configuration| format!("δ = {}", configuration.settings.refit_threshold))?;
        let mut table = Table::new(&[
            "scene",
            "δ",
            "missed",
            "false",
            "spheres refreshed per tick",
            "share refreshed",
            "normal jump 99 % (°)",
            "contact churn",
            "ms per tick",
        ]);
        for scene in study.scenes.iter().filter(|scene| scene.deforms) {
            let mut series: Vec<&Measured> = study.delta_series(&scene.name).collect();
            series.sort_by(|a, b| {
                a.configuration.settings.refit_threshold.total_cmp(&b.configuration.settings.refit_threshold)
            });
            for one in series {
                table.row([
                    scene.name.clone(),
                    one.configuration.settings.refit_threshold.to_string(),
                    percent(one.row.pair_miss_rate),
                    percent(one.row.pair_false_rate),
                    fixed(one.row.recipes_refreshed_per_tick, 1),
                    percent(one.row.recipes_refreshed_share),
                    fixed(one.row.normal_jump_p99, 2),
                    percent(one.row.contact_churn),
                    format!("{:.2}", one.row.time_ms),
                ]);
            }
        }
        write!(out, "{table}")
    }

    /// A table of all settings of `Circumsphere` at the center distance.
    fn further(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        writeln!(out, "## All settings of `Circumsphere` at {} edges\n", study.center_distance())?;
        let mut rows: Vec<&PooledRow> = study
            .pooled
            .iter()
            .filter(|all| {
                all.configuration.method == ContactMethod::Circumsphere
                    && all.configuration.distance_edges == study.center_distance()
            })
            .map(|all| &all.row)
            .collect();
        rows.sort_by(|a, b| {
            a.pair_error
                .unwrap_or(2.0)
                .total_cmp(&b.pair_error.unwrap_or(2.0))
                .then_with(|| a.configuration.cmp(&b.configuration))
        });
        let mut table = Table::new(&[
            "setting (best first)",
            "missed",
            "worst scene",
            "false",
            "1 − F1",
            "triangles missed",
            "triangles false",
            "body pairs missed",
            "time (Exact = 1)",
        ]);
        for row in rows {
            table.row([
                row.configuration.clone(),
                percent(row.pair_miss_rate),
                percent(row.worst_pair_miss_rate),
                percent(row.pair_false_rate),
                percent(row.pair_error),
                percent(row.triangle_miss_rate),
                percent(row.triangle_false_rate),
                percent(row.object_miss_rate),
                fixed(row.time_ratio, 2),
            ]);
        }
        write!(out, "{table}")
    }

    fn scaling(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        writeln!(out, "## Time against number of triangles\n")?;
        let (Some(first), Some(last)) = (study.scaling.first(), study.scaling.last()) else {
            return writeln!(out, "Only measured with generated scenes.\n");
        };
        self.plot(out, "time_vs_triangles")?;
        writeln!(
            out,
            "Two undulating sheets of {} to {} triangles, without self-collision, at a contact distance of \
             {DEFAULT_DISTANCE} edges. The share of touching triangles is the same at every size. Slopes of \
             least-squares lines in the log-log plot, where 1 means proportional to the number of triangles: {}.\n",
            first.triangles,
            last.triangles,
            ContactMethod::ALL
                .iter()
                .map(|&method| format!("`{method:?}` {}", fixed(scaling::slope(&study.scaling, method), 3)))
                .collect::<Vec<_>>()
                .join(", ")
        )?;
        let times: Vec<String> = ContactMethod::ALL.iter().map(|method| format!("`{method:?}` (ms)")).collect();
        let columns = ["triangles", "candidates per triangle", "touching pairs per triangle (`Exact`)"];
        let mut table = Table::new(&columns.into_iter().chain(times.iter().map(String::as_str)).collect::<Vec<_>>());
        for rows in study.scaling.chunks(ContactMethod::ALL.len()) {
            let refined = rows.iter().find(|row| row.method == "Exact").unwrap_or(&rows[0]);
            let per_triangle = |count: usize| format!("{:.3}", count as f64 / refined.triangles as f64);
            let cells = [
                refined.triangles.to_string(),
                per_triangle(refined.candidates_per_tick),
                per_triangle(refined.touching_pairs_per_tick),
            ];
            table.row(cells.into_iter().chain(rows.iter().map(|row| format!("{:.2}", row.time_ms))));
        }
        write!(out, "{table}")
    }

    fn stages(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let study = self.study;
        writeln!(out, "## Time by stage\n")?;
        self.plot(out, "time_by_stage")?;
        let names: Vec<&str> = plots::stage_group_names().collect();
        let mut table = Table::new(&[&["ms per 1000 triangles"], names.as_slice()].concat());
        for method in ContactMethod::ALL {
            let times: Vec<f64> = (0..names.len()).map(|group| plots::stage_time(study, method, group)).collect();
            table.row([format!("`{method:?}`")].into_iter().chain(times.iter().map(|time| format!("{time:.4}"))));
            let whole: f64 = times.iter().sum();
            let longest = (0..names.len()).max_by(|&a, &b| times[a].total_cmp(&times[b]));
            if let Some(longest) = longest.filter(|_| whole > 0.0) {
                writeln!(
                    out,
                    "- `{method:?}` spends the largest share of its time, {:.0} %, in {}.",
                    100.0 * times[longest] / whole,
                    names[longest]
                )?;
            }
        }
        write!(out, "\n{table}")
    }

    fn memory(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "## Memory\n\n\
             Bytes that the app holds after the last tick, mean of all scenes at {} edges. *Bytes per candidate* \
             covers the lists of pairs that stages pass on, including capacity that is kept for the next tick. *Bytes \
             per contact* covers the contacts of this tick and the previous one. *Bytes per triangle* covers \
             everything else: topology, positions, boxes, trees, and spheres.\n",
            self.study.center_distance()
        )?;
        let mut table = Table::new(&["method", "bytes per triangle", "bytes per candidate", "bytes per contact"]);
        for method in ContactMethod::ALL {
            let of = |value: fn(&Measured) -> Option<f64>| {
                fixed(mean(self.defaults().filter(|one| one.configuration.method == method).filter_map(value)), 0)
            };
            table.row([
                format!("`{method:?}`"),
                of(|one| Some(one.row.bytes_per_triangle)),
                of(|one| one.row.bytes_per_candidate),
                of(|one| one.row.bytes_per_contact),
            ]);
        }
        write!(out, "{table}")
    }

    fn steadiness(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "## From tick to tick\n\n\
             Churn is 1 − |contacts of both ticks| / |contacts of either tick|. A jump is the angle by which the \
             normal of a lasting contact turns in a tick; crossings are listed separately. Bodies move, so part of the \
             churn and the jumps is real: the pairs of `Exact` are the true ones.\n"
        )?;
        let mut table = Table::new(&[
            "scene",
            "method",
            "contact churn",
            "pair churn",
            "normal jump (°): median",
            "99 %",
            "max",
            "crossing: 99 %",
            "contacts per tick",
        ]);
        for one in self.defaults().filter(|one| one.configuration.method != ContactMethod::Polygon) {
            table.row([
                one.row.scene.clone(),
                one.row.method.clone(),
                percent(one.row.contact_churn),
                percent(one.row.pair_churn),
                fixed(one.row.normal_jump_median, 2),
                fixed(one.row.normal_jump_p99, 1),
                fixed(one.row.normal_jump_max, 1),
                fixed(one.row.crossing_normal_jump_p99, 1),
                format!("{:.0}", one.row.contacts_per_tick),
            ]);
        }
        write!(out, "{table}")
    }

    fn smooth_normals(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "## Smooth normals: sliding over inner edges\n")?;
        let rows = &self.study.sliding;
        if rows.is_empty() {
            return writeln!(out, "Only measured with generated scenes.\n");
        }
        writeln!(
            out,
            "A ball and a box, as rigid shapes and as meshes, are guided over irregularly triangulated ground at a \
             constant true distance. On flat ground they are also pushed, supported only by their contacts. For the \
             deepest contact and for the mean of all contacts, the table gives the maximum and the root mean square \
             (rms) of the normal's jump per tick and of its error against the true normal, in degrees. A bump is a \
             tick of the pushed motion after which the velocity is off by more than a hundredth of the speed. All \
             values are in [sliding.csv](sliding.csv).\n"
        )?;
        for (name, peer) in [("smooth", "exact"), ("smooth", "parry, fixed edges"), ("exact", "parry, fixed edges")] {
            type Measure = (&'static str, fn(&SlidingRow) -> Option<f64>);
            const MEASURES: [Measure; 4] = [
                ("largest jump of the deepest contact", |row| Some(row.deepest_jump_max)),
                ("root mean square jump of the mean normal", |row| Some(row.mean_jump_rms)),
                ("root mean square error of the mean normal", |row| Some(row.mean_error_rms)),
                ("share of ticks with a bump", |row| row.bump_share),
            ];
            let mut words = Vec::new();
            for (what, value) in MEASURES {
                let pairs: Vec<(f64, f64)> = rows
                    .iter()
                    .filter(|row| row.normals == name)
                    .filter_map(|row| {
                        let is_peer = |other: &&SlidingRow| {
                            (other.ground, other.body, other.normals) == (row.ground, row.body, peer)
                        };
                        Some((value(row)?, value(rows.iter().find(is_peer)?)?))
                    })
                    .collect();
                let count =
                    |holds: fn(f64, f64) -> bool| pairs.iter().filter(|(own, other)| holds(*own, *other)).count();
                words.push(format!(
                    "{what} is smaller in {} and larger in {} of {} cases",
                    count(|own, other| own < other),
                    count(|own, other| own > other),
                    pairs.len()
                ));
            }
            writeln!(out, "- *{name}* compared with *{peer}*: {}.", words.join("; "))?;
        }
        let mut table = Table::new(&[
            "ground",
            "body",
            "normals",
            "contacts",
            "deepest: jump max",
            "jump rms",
            "error max",
            "error rms",
            "mean: jump max",
            "jump rms",
            "error max",
            "error rms",
            "ticks with a bump",
            "largest loss of speed",
            "height range (edges)",
        ]);
        for row in rows {
            table.row([
                row.ground.to_owned(),
                row.body.to_owned(),
                row.normals.to_owned(),
                format!("{:.1}", row.contacts),
                format!("{:.2}", row.deepest_jump_max),
                format!("{:.3}", row.deepest_jump_rms),
                format!("{:.2}", row.deepest_error_max),
                format!("{:.3}", row.deepest_error_rms),
                format!("{:.2}", row.mean_jump_max),
                format!("{:.3}", row.mean_jump_rms),
                format!("{:.2}", row.mean_error_max),
                format!("{:.3}", row.mean_error_rms),
                percent(row.bump_share),
                percent(row.speed_loss_max),
                fixed(row.height_range, 4),
            ]);
        }
        write!(out, "\n{table}")
    }

    #[expect(clippy::unused_self, reason = "same signature as the other sections")]
    fn random_pairs(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(out, "## Random pairs\n")?;
        let once: RandomPairs = serde_json::from_str(RANDOM_PAIRS).expect("the file beside this one is well formed");
        match once {
            RandomPairs {
                command: Some(command),
                seed: Some(seed),
                pairs: Some(pairs),
                missed: Some(missed),
                made_up: Some(made_up),
                worst_separation_error,
            } => writeln!(
                out,
                "The narrow phase tested {pairs} pairs of random and degenerate triangles with seed {seed}: {missed} \
                 missed, {made_up} false, largest separation error {}. This was measured once, by `{command}`.\n",
                scientific(worst_separation_error)
            ),
            _ => writeln!(out, "Not measured yet.\n"),
        }
    }

    #[expect(clippy::unused_self, reason = "same signature as the other sections")]
    fn not_measured(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "## Not measured here\n\n\
             Residual penetration, jitter, and tunnelling depend on the response. The example `experiments` and the \
             example scenes measure them. The tests of swept collision measure times of impact."
        )
    }
}
