//! The text and tables of the report. Every sentence about a figure is generated from that figure.

use std::{fmt::Write, fs, path::Path};

use circumsphere_reports::{
    OutputError,
    bounded::{Bound, Bounded},
    finding::{figure, geometric_mean, optional, percent, table},
    statistics::mean,
};
use clap::ValueEnum;

use super::{
    ReportError, Study,
    equal_error::{EqualError, Measure, TARGETS, curve_of},
    measure::{Cell, DEFAULT_DISTANCE},
    options::Options,
    plots::{self, Drawn},
    rolling,
    scenes::{GAPS, Kind, SCENES, Scene},
};

impl Study {
    /// The method that the sentences and plots are about.
    fn method(&self) -> &str {
        &self.cells[0].method
    }

    /// The scenes that were measured.
    pub fn scenes(&self) -> Vec<&'static Scene> {
        SCENES.iter().filter(|scene| self.cells.iter().any(|cell| cell.scene == scene.name)).collect()
    }

    /// Levels of refinement, coarse to fine.
    pub fn levels(&self) -> Vec<u32> {
        let mut levels: Vec<u32> = self.cells.iter().map(|cell| cell.level).collect();
        levels.sort_unstable();
        levels.dedup();
        levels
    }

    /// The cells of one scene and shape with the first method, coarse to fine.
    pub fn curve<'a>(&'a self, scene: &'a str, shape: &'a str) -> impl Iterator<Item = &'a Cell> {
        curve_of(&self.cells, scene, self.method(), shape)
    }

    /// Geometric mean over the scenes with the first method. `None` if a scene has no value.
    pub fn mean(&self, level: u32, shape: &str, value: fn(&Cell) -> Option<f64>) -> Option<f64> {
        let cells =
            self.cells.iter().filter(|cell| cell.level == level && cell.shape == shape && cell.method == self.method());
        let values: Option<Vec<f64>> = cells.map(value).collect();
        geometric_mean(values?, f64::MIN_POSITIVE)
    }

    /// Smooth over flat, geometric mean over the scenes.
    fn ratio(&self, level: u32, value: fn(&Cell) -> Option<f64>) -> Option<f64> {
        Some(self.mean(level, "Smooth", value)? / self.mean(level, "Flat", value)?)
    }

    /// The comparisons at the errors of one shape at one level, with the first method.
    fn at(&self, shape: &str, level: u32, measure: Measure) -> impl Iterator<Item = &EqualError> {
        self.equal_errors.iter().filter(move |one| {
            one.at == shape && one.level == level && one.measure == measure && one.method == self.method()
        })
    }

    /// Factors at equal error, geometric mean over the scenes: triangles and time.
    fn factors(&self, shape: &str, level: u32, measure: Measure) -> Option<[Bounded; 2]> {
        let of = |factor: fn(&EqualError) -> Bounded| {
            Bounded::geometric_mean(&self.at(shape, level, measure).map(factor).collect::<Vec<_>>())
        };
        Some([of(|one| one.triangles_factor)?, of(|one| one.time_factor)?])
    }

    /// Triangles per body at a level, geometric mean over the scenes.
    fn triangles(&self, level: u32) -> String {
        optional(self.mean(level, "Flat", |cell| Some(cell.triangles)).map(f64::round))
    }
}

/// Writes the plots, the figures as JSON, and the report.
pub fn write(options: &Options, study: &Study) -> Result<(), ReportError> {
    let folder = &options.out;
    let drawn = plots::draw(folder, study)?;
    let json = serde_json::to_string_pretty(study).expect("numbers and names are JSON");
    for (name, text) in [("report.json", json + "\n"), ("report.md", text(options, study, &drawn))] {
        let path = folder.join(name);
        fs::write(&path, text).map_err(|source| OutputError::File { path, source })?;
    }
    Ok(())
}

/// The command that writes this report, without local paths.
fn command(options: &Options) -> String {
    let out = &options.out;
    let out = if out.is_absolute() { out.file_name().map_or(out.as_path(), Path::new) } else { out };
    let mut words = vec!["cargo run --release --example smooth_bodies --".to_owned()];
    words.extend(options.quick.then(|| "--quick".to_owned()));
    words.extend((!options.scenes.is_empty()).then(|| format!("--scenes {}", options.scenes.join(","))));
    let methods: Vec<String> =
        options.methods.iter().filter_map(|method| Some(method.to_possible_value()?.get_name().to_owned())).collect();
    words.extend((methods != ["exact"]).then(|| format!("--methods {}", methods.join(","))));
    words.extend(options.poses.map(|poses| format!("--poses {poses}")));
    words.push(format!("--out {}", out.display()));
    words.join(" ")
}

fn header<const N: usize>(columns: [&str; N]) -> Vec<String> {
    columns.map(str::to_owned).into()
}

fn bounded(value: Option<Bounded>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| value.to_string())
}

fn picture(text: &mut String, drawn: &[Drawn], name: &str) {
    if let Some(drawn) = drawn.iter().find(|drawn| drawn.name == name) {
        let _ = writeln!(text, "![{}]({name}.png)\n\n([SVG]({name}.svg))\n", drawn.shows);
    }
}

fn text(options: &Options, study: &Study, drawn: &[Drawn]) -> String {
    let mut text = String::new();
    head(&mut text, options, study);
    summary(&mut text, study, drawn);
    equal_error(&mut text, study);
    for kind in Kind::ALL {
        by_scene(&mut text, study, drawn, kind);
    }
    rolling_ball(&mut text, study, drawn);
    let _ = write!(text, "## The machine\n\n```text\n{}```\n", study.machine);
    text
}

fn head(text: &mut String, options: &Options, study: &Study) {
    let _ = writeln!(
        text,
        "# Flat and smooth surfaces against the bodies that they stand for\n\n\
         The vertices of every mesh lie on a body that is known in closed form. Errors are differences from the \
         distance and the normal of the bodies, not of the meshes. This report was written by\n\n    {}\n\nin {:.0} s. \
         All figures are in [report.json](report.json).\n\n\
         - **Poses.** Each scene has {} random poses, the same at every resolution. In half of them the bodies are {} \
         mesh edges apart, in the others {}.\n\
         - **Size** is half of the longest extent of a scene's first body. Every first body has a size of 1, so its \
         positions in single precision are off by up to {} of it.\n\
         - **Error of distance** is the absolute error of the least distance; **error of normal** is the angle between \
         the normal of that contact and the true one.\n\
         - **Times** are times of the processor for ticks on one thread of one machine, in which every vertex of both surfaces is written and all \
         contacts are read: the median over poses of the mean of {} ticks, after one to warm up. Flat and smooth \
         surfaces take turns, pose by pose. Only ratios of times carry over to other machines. All other figures are \
         the same in every run.\n",
        command(options),
        study.seconds,
        options.poses_per_gap() * GAPS.len(),
        GAPS[0],
        GAPS[1],
        figure(f64::from(f32::EPSILON) / 2.0),
        options.timed_ticks()
    );
}

fn summary(text: &mut String, study: &Study, drawn: &[Drawn]) {
    let _ = writeln!(text, "## Error against time\n");
    picture(text, drawn, "error_vs_time");
    let _ = writeln!(text, "Geometric means of {} scenes:\n", study.scenes().len());
    let measures: [fn(&Cell) -> Option<f64>; 3] =
        [|cell| cell.error_mean, |cell| cell.normal_mean_degrees, |cell| Some(cell.time_ms)];
    let rows = study.levels().into_iter().map(|level| {
        let mut row = vec![optional(study.mean(level, "Flat", |cell| Some(cell.triangles)).map(f64::round))];
        for (number, measure) in measures.into_iter().enumerate() {
            let scale = if number == 0 { 100.0 } else { 1.0 };
            row.extend(
                ["Flat", "Smooth"].map(|shape| optional(study.mean(level, shape, measure).map(|it| it * scale))),
            );
            row.push(optional(study.ratio(level, measure)));
        }
        row
    });
    let columns = header([
        "triangles per body",
        "flat: error of distance (% of size)",
        "smooth",
        "ratio",
        "flat: error of normal (°)",
        "smooth",
        "ratio",
        "flat: time (ms)",
        "smooth",
        "ratio",
    ]);
    let _ = writeln!(text, "{}", table(&columns, rows));
    for at in ["Smooth", "Flat"] {
        for level in study.levels() {
            // Where every scene has but a bound, the curves do not overlap and nothing is compared.
            let is_known = study
                .at(at, level, Measure::Distance)
                .any(|one| one.triangles_factor.bound == Bound::Exactly && one.time_factor.bound == Bound::Exactly);
            let (true, Some([triangles, time])) = (is_known, study.factors(at, level, Measure::Distance)) else {
                continue;
            };
            let _ = writeln!(
                text,
                "- At the error of distance of {} surfaces of {} triangles, flat surfaces need {triangles} times as \
                 many triangles as smooth ones and {time} times the time.",
                at.to_lowercase(),
                study.triangles(level),
            );
        }
    }
    let _ = writeln!(text);
    let share = |shape: &str| {
        let cells = study.cells.iter().filter(|cell| cell.shape == shape && cell.method == study.method());
        mean(cells.filter_map(|cell| cell.missed_share))
    };
    if let [Some(flat), Some(smooth)] = ["Flat", "Smooth"].map(share) {
        let _ = writeln!(
            text,
            "Of the poses in which the bodies are {} edges apart, the default contact distance of {DEFAULT_DISTANCE} \
             edges finds no contact in {} with flat surfaces, and in {} with smooth ones.\n",
            GAPS[0],
            percent(flat),
            percent(smooth)
        );
    }
    let lost: usize = study.cells.iter().map(|cell| cell.lost_poses).sum();
    let poses: usize = study.cells.iter().map(|cell| cell.poses).sum();
    let _ = writeln!(text, "Without any contact, and therefore without an error, are {lost} of {poses} poses.\n");
}

/// Tables of how much more flat surfaces need for the same error.
fn equal_error(text: &mut String, study: &Study) {
    let _ = writeln!(
        text,
        "## Equal error\n\n\
         How many times as many triangles and as much time flat surfaces need as smooth ones of the same error. Between \
         measured resolutions, errors and times are interpolated as straight lines in logarithms. *More than* and *less \
         than* are bounds, from where the curve that is read has ended. Means are geometric.\n"
    );
    for (measure, name) in [(Measure::Distance, "distance"), (Measure::Normal, "normal")] {
        for at in ["Smooth", "Flat"] {
            let levels = study.levels();
            let mut columns = vec!["scene".to_owned()];
            for &level in &levels {
                columns.extend(["triangles", "time"].map(|what| format!("{}: {what}", study.triangles(level))));
            }
            let factors_of_scene = |scene: &Scene| {
                let mut row = vec![scene.name.to_owned()];
                for &level in &levels {
                    let found = study.at(at, level, measure).find(|one| one.scene == scene.name);
                    row.push(bounded(found.map(|found| found.triangles_factor)));
                    row.push(bounded(found.map(|found| found.time_factor)));
                }
                row
            };
            let mut rows: Vec<Vec<String>> = study.scenes().into_iter().map(factors_of_scene).collect();
            let mut means = vec!["**mean**".to_owned()];
            for &level in &levels {
                let factors = study.factors(at, level, measure);
                means.extend([0, 1].map(|place| bounded(factors.map(|factors| factors[place]))));
            }
            rows.push(means);
            let at = at.to_lowercase();
            let _ = writeln!(text, "At the error of {name} of {at} surfaces:\n\n{}", table(&columns, rows));
        }
    }
    at_targets(text, study);
}

fn at_targets(text: &mut String, study: &Study) {
    let _ = writeln!(
        text,
        "What both need for a given error of distance. *Less than* means that the coarsest resolution has a smaller \
         error, *more than* that the finest has a larger one.\n"
    );
    let columns = header([
        "scene",
        "error (% of size)",
        "flat: triangles",
        "smooth",
        "flat / smooth",
        "flat: time (ms)",
        "smooth",
        "flat / smooth",
    ]);
    let mut rows = Vec::new();
    for error in TARGETS {
        let found: Vec<_> =
            study.at_targets.iter().filter(|one| one.error == error && one.method == study.method()).collect();
        rows.extend(found.iter().map(|one| {
            vec![
                one.scene.to_owned(),
                figure(100.0 * error),
                one.flat_triangles.to_string(),
                one.smooth_triangles.to_string(),
                bounded(one.triangles_factor),
                one.flat_time_ms.to_string(),
                one.smooth_time_ms.to_string(),
                bounded(one.time_factor),
            ]
        }));
    }
    let _ = writeln!(text, "{}", table(&columns, rows));
}

/// Figures of the scenes of one kind.
fn by_scene(text: &mut String, study: &Study, drawn: &[Drawn], kind: Kind) {
    let scenes: Vec<&Scene> = study.scenes().into_iter().filter(|scene| scene.kind == kind).collect();
    if scenes.is_empty() {
        return;
    }
    let name = kind.name();
    let _ = writeln!(text, "## {}{}\n", name[..1].to_uppercase(), &name[1..]);
    for scene in &scenes {
        let _ = writeln!(text, "- `{}`: {}.", scene.name, scene.what);
    }
    let _ = writeln!(text);
    picture(text, drawn, kind.file());
    let columns = header([
        "scene",
        "method",
        "triangles per body",
        "shape",
        "error of distance (% of size): mean",
        "median",
        "95 %",
        "in edges: mean",
        "95 %",
        "error of normal (°): mean",
        "median",
        "95 %",
        "missed at the default distance",
        "time (ms)",
    ]);
    let is_of_kind = |cell: &&Cell| scenes.iter().any(|scene| scene.name == cell.scene);
    let rows = study.cells.iter().filter(is_of_kind).map(|cell| {
        vec![
            cell.scene.to_owned(),
            cell.method.clone(),
            figure(cell.triangles.round()),
            cell.shape.clone(),
            optional(cell.error_mean.map(|error| 100.0 * error)),
            optional(cell.error_median.map(|error| 100.0 * error)),
            optional(cell.error_p95.map(|error| 100.0 * error)),
            optional(cell.error_mean_edges),
            optional(cell.error_p95_edges),
            optional(cell.normal_mean_degrees),
            optional(cell.normal_median_degrees),
            optional(cell.normal_p95_degrees),
            cell.missed_share.map_or_else(|| "–".to_owned(), percent),
            figure(cell.time_ms),
        ]
    });
    let _ = writeln!(text, "{}", table(&columns, rows));
}

fn rolling_ball(text: &mut String, study: &Study, drawn: &[Drawn]) {
    let _ = writeln!(
        text,
        "## Rolling\n\nA ball of radius {} rolls over a body of size 1 at a constant distance of {} edges. Its own mesh \
         and the body's are both coarse. *Ripple* is the standard deviation of the error along the path: of the \
         distance, and of the normal's angle towards the direction of travel.\n",
        rolling::BALL,
        rolling::GAP
    );
    picture(text, drawn, "rolling");
    let columns = header([
        "over",
        "method",
        "triangles per body",
        "shape",
        "ripple of distance (% of size)",
        "in edges",
        "mean error of distance (edges)",
        "ripple of normal (°)",
        "largest error of normal (°)",
        "ticks without contact",
    ]);
    let rows = study.rolling.iter().map(|row| {
        vec![
            row.ground.to_owned(),
            row.method.clone(),
            figure(row.triangles.round()),
            row.shape.clone(),
            optional(row.ripple.map(|ripple| 100.0 * ripple)),
            optional(row.ripple_edges),
            optional(row.offset_edges),
            optional(row.normal_ripple_degrees),
            optional(row.normal_max_degrees),
            format!("{} of {}", row.lost_ticks, row.ticks),
        ]
    });
    let _ = writeln!(text, "{}", table(&columns, rows));
    for (ground, _) in rolling::GROUNDS {
        let of_shape = |shape: &str| {
            study.rolling.iter().find(|row| row.ground == ground && row.shape == shape && row.method == study.method())
        };
        let (Some(flat), Some(smooth)) = (of_shape("Flat"), of_shape("Smooth")) else { continue };
        if let (Some(flat_ripple), Some(ripple), Some(flat_normal), Some(normal)) =
            (flat.ripple, smooth.ripple, flat.normal_ripple_degrees, smooth.normal_ripple_degrees)
        {
            let _ = writeln!(
                text,
                "- Over the {ground}, the distance of smooth surfaces ripples {} times as much as that of flat ones, and \
                 the normal {} times.",
                figure(ripple / flat_ripple),
                figure(normal / flat_normal)
            );
        }
    }
    let _ = writeln!(text);
}
