//! The report. For each experiment: what was done, its plot, its table, and its sentence.

use std::{fmt::Write, fs};

use bevy_circumsphere::{ContactMethod, response::XpbdSettings};
use circumsphere_reports::{
    OutputError,
    drawing::Sheet,
    finding::{Finding, figure},
    machine::Machine,
    tables::write_csv,
};
use serde::{Serialize, Serializer};

use super::{
    ReportError,
    caps::{self, CapsRow},
    delta::{self, DeltaRow},
    iterations::{self, IterationsRow, SUBSTEPS},
    options::{Experiment, Options},
    plots,
    sizes::{self, SizesRow},
    tunnelling::{self, TunnellingRow},
};

/// All results.
#[derive(Default)]
pub struct Study {
    pub delta: Vec<DeltaRow>,
    pub iterations: Vec<IterationsRow>,
    pub tunnelling: Vec<TunnellingRow>,
    pub caps: Vec<CapsRow>,
    pub sizes: Vec<SizesRow>,
    pub seconds: f64,
    /// Load of the machine, before and after.
    pub load: [Option<f64>; 2],
}

/// Serializes the name of a method for a table.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde requires a reference")]
pub fn name_of_method<S: Serializer>(method: &ContactMethod, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{method:?}"))
}

/// Writes tables, plots, and the report.
pub fn write(options: &Options, study: &Study) -> Result<(), ReportError> {
    let mut text = head(options, study);
    let mut section = |experiment: Experiment| -> Result<(), ReportError> {
        let (finding, table, sheet) = match experiment {
            Experiment::Delta => {
                written(options, experiment, &study.delta, delta::finding, delta::tables, plots::delta)
            }
            Experiment::Iterations => {
                let rows = &study.iterations;
                written(options, experiment, rows, iterations::finding, iterations::tables, plots::iterations)
            }
            Experiment::Tunnelling => {
                let rows = &study.tunnelling;
                written(options, experiment, rows, tunnelling::finding, tunnelling::tables, plots::tunnelling)
            }
            Experiment::Caps => written(options, experiment, &study.caps, caps::finding, caps::tables, plots::caps),
            Experiment::Sizes => {
                written(options, experiment, &study.sizes, sizes::finding, sizes::tables, plots::sizes)
            }
        }?;
        let (title, file) = (experiment.title(), experiment.file());
        sheet.write(&options.out, file)?;
        write!(
            text,
            "\n## {title}\n\n{}\n\n![{title}]({file}.png)\n\nThe plot as [SVG]({file}.svg), all figures as \
             [CSV]({file}.csv).\n\n<details><summary>Table</summary>\n\n{table}\n</details>\n\n{finding}\n",
            how(experiment)
        )
        .expect("strings take everything");
        Ok(())
    };
    for experiment in options.experiments() {
        section(experiment)?;
    }
    let path = options.out.join("report.md");
    Ok(fs::write(&path, text).map_err(|source| OutputError::File { path, source })?)
}

/// Writes the CSV file of an experiment, and returns its sentence, table, and plot.
fn written<Row: Serialize>(
    options: &Options,
    experiment: Experiment,
    rows: &[Row],
    finding: fn(&[Row]) -> Finding,
    table: fn(&[Row]) -> String,
    sheet: fn(&[Row]) -> Sheet,
) -> Result<(Finding, String, Sheet), ReportError> {
    write_csv(&options.out, &format!("{}.csv", experiment.file()), rows)?;
    Ok((finding(rows), table(rows), sheet(rows)))
}

fn head(options: &Options, study: &Study) -> String {
    let machine = Machine::new(study.load);
    let only: Vec<&str> = options.only.iter().map(|experiment| experiment.file()).collect();
    let only = if only.is_empty() { String::new() } else { format!(" --only {}", only.join(",")) };
    let quick = if options.quick { " --quick" } else { "" };
    let load = machine.load.map(|load| load.map_or_else(|| "unknown".to_owned(), |load| format!("{load:.1}")));
    format!(
        "# The source paper's experiments, repeated\n\n\
         The paper describes its experiments in words. Here they are as figures: what was done, a plot, a table, and in one \
         sentence the claim, what was found, and whether the claim holds. No word of those sentences is written by hand: the \
         program makes them from the figures.\n\n\
         ```sh\ncargo run --release --example experiments --{only}{quick} --out experiments\n```\n\n\
         Made in {} seconds on {} ({} processors, load {} before and {} after), {}, {}; every detection and response on one \
         thread. Times are medians, and compare with one another, not with another machine's. Everything else is the same \
         in every run on one machine; where another's instructions round differently, a scene that goes on from its own results \
         becomes another one.{}\n\n\
         *Trembling* is the mean second difference of the positions of all free vertices in the ticks in which a scene has \
         settled, in mean edges a tick: what of their motion is not steady. *Churn* is the share of contacts that come or go in a \
         tick. A run *flew apart* if a vertex became faster than 30 m/s, where nothing should exceed 5; it ends there, and no \
         figure but its times is taken from it. `Exact` and `Polygon` find the same: where a line is missing, it lies under the other.\n",
        figure(study.seconds),
        machine.processor,
        machine.processors,
        load[0],
        load[1],
        machine.rustc,
        machine.profile,
        if options.quick {
            " **A quick run: too few ticks and settings for its figures to mean anything.**"
        } else {
            ""
        },
    )
}

/// Describes what was done.
fn how(experiment: Experiment) -> String {
    let XpbdSettings { substeps, iterations, .. } = XpbdSettings::default();
    match experiment {
        Experiment::Delta => format!(
            "Three scenes, in their small versions: `cloth_drop` (stable), `soft_tissue` (precision) and `pile` (efficiency), \
             played with the `Circumsphere` method at every δ, each three times from starts that differ by a hundred-thousandth of an edge, so \
             that what is chance can be told from what is δ. No continuous detection; {substeps} substeps of {iterations} iteration. \
             *Refresh* is curvature, spheres and cones of a tick, which surfaces at rest keep. The surface that the caps make is compared with that of caps \
             made anew from the same positions, as δ = 0 does: how far the tops of the caps are away, and how much \
             higher or lower they bulge."
        ),
        Experiment::Iterations => format!(
            "The same scenes by four methods, with {SUBSTEPS} substeps a tick, so that iterations count, and 1 to 32 of these; no continuous \
             detection; two runs each from starts that differ a little. What is left of penetration is measured at the end of the settled ticks by the exact method, \
             whatever method has played: how much nearer than the contact distance contacts are, in contact distances (1: \
             surfaces meet), the mean of those that are, and the most."
        ),
        Experiment::Tunnelling => format!(
            "A ball at a pinned sheet, a sheet at a pinned sheet, a needle at a closed surface that stands: the small `bullet_cloth`, without gravity, at \
             0.5 to 1,000 thicknesses a tick of {} ms. Ten shots each (with continuous detection two), from a fixed seed: turned, moved aside, and begun at another \
             moment of a tick; the same for every method. A shot tunnels if after 30 ticks one vertex is on the \
             wrong side, judged in f64: behind the sheet, or inside or behind the closed surface.",
            figure(1.0e3 * tunnelling::seconds_per_tick())
        ),
        Experiment::Caps => "The `Circumsphere` method with φ from 0 to 5 and curvature thresholds from 0.5 to 4. Tunnelling: the ball shot \
             at the sheet without continuous detection, at 10 to 100 thicknesses a tick, five shots each. Misses and needless \
             tests: against the exact method, pair of triangles by pair, over six scenes that move by closed forms (a beam lowered edge first onto \
             a mattress, whole and cut in 40; boxes on edge and corner, soft spheres, a ribbed panel, cloth over a ball). A pair is examined \
             if its spheres overlap."
            .to_owned(),
        Experiment::Sizes => "A cloth of 3,000 vertices that meets itself lies down on hilly ground of 100,000 triangles that stands; then more of \
             both in the same proportion, until a tick takes longer than a frame of 16.7 ms. *Detection alone* is that of the same motion \
             with nothing to answer it and no margin; with the response, detection looks farther, and the response solves."
            .to_owned(),
    }
}
