//! The report. For each experiment: the procedure, a plot, a table, and the finding.

use std::{fmt::Write, fs};

use bevy_circumsphere::response::XpbdSettings;
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
    tested::Tested,
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
    /// Machine load before and after.
    pub load: [Option<f64>; 2],
}

/// Serializes the name of a method for a table.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde requires a reference")]
pub fn name_of_method<S: Serializer>(method: &Tested, serializer: S) -> Result<S::Ok, S::Error> {
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
            "\n## {title}\n\n{}\n\n![{title}]({file}.png)\n\nThe plot is also available as [SVG]({file}.svg), \
             and all figures as [CSV]({file}.csv).\n\n\
             <details><summary>Table</summary>\n\n{table}\n</details>\n\n{finding}\n",
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

/// Writes the CSV file of an experiment, and returns its finding, table, and plot.
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
         The paper describes its experiments only in words. This report repeats them in figures. For each experiment \
         it gives the procedure, a plot, a table, and one sentence with the claim, the result, and whether the claim \
         holds. The program generates those sentences from the figures.\n\n\
         ```sh\ncargo run --release --example experiments --{only}{quick} --out experiments\n```\n\n\
         Written in {} seconds on {} ({} processors, load {} before and {} after), {}, {}. Detection and response ran \
         on one thread. Times are medians. Compare them with each other, but not with times of another machine. All \
         other figures are the same in every run on one machine. On a machine that rounds differently, a scene that \
         builds on its own results takes another course.{}\n\n\
         *Trembling* is the mean second difference of the positions of all free vertices, in mean edges per tick, over \
         the ticks in which a scene has settled. It measures the unsteady part of their motion. *Churn* is the share \
         of contacts that come or go in a tick. A run *flew apart* if a vertex became faster than 30 m/s; nothing \
         should exceed 5 m/s. Such a run ends there, and only its times are used. `Exact` and `Polygon` find the same \
         contacts, so one line may hide the other.\n",
        figure(study.seconds),
        machine.processor,
        machine.processors,
        load[0],
        load[1],
        machine.rustc,
        machine.profile,
        if options.quick {
            " **This is a quick run, with too few ticks and settings for its figures to mean anything.**"
        } else {
            ""
        },
    )
}

/// Describes the procedure.
fn how(experiment: Experiment) -> String {
    let XpbdSettings { substeps, iterations, .. } = XpbdSettings::default();
    match experiment {
        Experiment::Delta => format!(
            "Three scenes in their small versions: `cloth_drop` (stable), `soft_tissue` (precision), and `pile` \
             (efficiency). Each scene is played with the `Circumsphere` method at every δ, three times, from starts \
             that differ by a hundred-thousandth of an edge. The repetitions separate the effect of δ from chance. \
             There is no continuous detection, and a tick has {substeps} substeps of {iterations} iteration. *Refresh* \
             is the time for curvature, spheres, and cones in a tick; surfaces at rest keep theirs. Caps are compared \
             with caps made anew from the same positions, as with δ = 0: by the distance of their tops, and by the \
             difference of their bulges."
        ),
        Experiment::Iterations => format!(
            "The same scenes with four methods, `Circumsphere` also with osculating spheres on smooth surfaces, and 1 to 32 iterations. A tick has {SUBSTEPS} substeps, so that \
             iterations matter. There is no continuous detection. Each setting runs twice, from starts that differ \
             slightly. Residual penetration is measured with the exact method at the end of the settled ticks, \
             regardless of the method that played the scene. It is how much closer than the contact distance contacts \
             are, in contact distances (1: the surfaces meet). The mean over such contacts and the maximum are given."
        ),
        Experiment::Tunnelling => format!(
            "A ball is shot at a pinned sheet, a sheet at a pinned sheet, and a needle at a static closed surface: the \
             small version of `bullet_cloth`, without gravity, at 0.5 to 1,000 thicknesses per tick of {} ms. There \
             are ten shots each, or two with continuous detection. From a fixed seed, each shot gets another rotation, \
             sideways displacement, and start within a tick. All methods get the same shots. A shot tunnels if, after \
             30 ticks, at least one vertex is on the wrong side: behind the sheet, or inside or behind the closed \
             surface. This is decided in f64.",
            figure(1.0e3 * tunnelling::seconds_per_tick())
        ),
        Experiment::Caps => "The `Circumsphere` method with φ from 0 to 5 and curvature thresholds from 0.5 to 4. For \
             tunnelling, the ball is shot at the sheet without continuous detection, at 10 to 100 thicknesses per \
             tick, with five shots each. Missed pairs and needless tests are counted by comparison with the exact \
             method, for each pair of triangles. There are six scenes with motions in closed form: a beam lowered edge \
             first onto a mattress, in one part and in 40; boxes on edge and corner; soft spheres; a ribbed panel; and \
             cloth over a ball. A pair is examined if its spheres overlap."
            .to_owned(),
        Experiment::Sizes => "A cloth of 3,000 vertices with self-collision settles on static hilly ground of 100,000 \
             triangles. Then both are enlarged in the same proportion, until a tick takes longer than a frame of 16.7 \
             ms. *Detection alone* is the time to detect the same motion without a response and without a margin. With \
             the response, detection has a margin, and the response solves."
            .to_owned(),
    }
}
