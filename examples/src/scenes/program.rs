//! The main program of every scene: plays it as the command line asks, and prints the results.

use std::{
    fmt::{self, Display, Formatter},
    io::{self, Write},
    process::ExitCode,
    time::Duration,
};

use indicatif::{ProgressBar, ProgressStyle};

use super::{
    Scene, Shot, Variation,
    measure::{Jitter, Measure, Tick, settled},
    options::SceneOptions,
    scene, truth,
};
use crate::headless::{BAD_INPUT, recording::RecordingError};

/// Plays the scene with that name, prints a table, and returns the exit status.
pub fn run(name: &str, options: &SceneOptions, shot: Shot) -> ExitCode {
    run_varied(name, options, &Variation { shot, ..options.variation() })
}

/// Like [`run`], for any variation.
pub fn run_varied(name: &str, options: &SceneOptions, variation: &Variation) -> ExitCode {
    match play(name, options, variation) {
        Ok(outcome) => {
            // The reader of the table may have closed the pipe.
            let _ = write!(io::stdout(), "{name}: {outcome}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn play(name: &str, options: &SceneOptions, variation: &Variation) -> Result<Outcome, RecordingError> {
    let recorder = options.recording.rerun.as_deref().map(|path| options.recording.recorder(path)).transpose()?;
    let mut scene = scene(name, variation, recorder.unwrap_or_default()).expect("every program names a scene");
    let ticks = options.ticks.unwrap_or(scene.ticks);
    // Only drawn on a terminal.
    let progress = ProgressBar::new(u64::from(ticks)).with_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} ticks, {eta} left").expect("the template is well formed"),
    );
    let mut measure = Measure::default();
    let mut worst = None;
    let played = (0..ticks).map(|number| {
        progress.inc(1);
        let tick = measure.tick(&mut scene);
        if scene.is_judged {
            let judged = (scene.tunnelled(), number + 1);
            // Keep the first of the worst ticks.
            worst = Some(worst.map_or(judged, |worst: (usize, u32)| if judged.0 > worst.0 { judged } else { worst }));
        }
        tick
    });
    let played = played.collect();
    progress.finish_and_clear();
    Ok(Outcome {
        bodies: scene.stage.bodies.len(),
        triangles: scene.stage.triangle_count(),
        threads: options.threads,
        crossing: truth::crossing_pairs(&scene.stage),
        tunnelled: scene.tunnelled(),
        worst,
        hash: scene.stage.hash(),
        scene,
        ticks: played,
    })
}

/// The results of playing a scene.
struct Outcome {
    scene: Scene,
    bodies: usize,
    triangles: usize,
    threads: u16,
    ticks: Vec<Tick>,
    crossing: usize,
    tunnelled: usize,
    /// Number of tunnelled vertices in the worst tick, and the number of that tick.
    worst: Option<(usize, u32)>,
    hash: u64,
}

impl Display for Outcome {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let ticks = self.ticks.len();
        let mean = |time: fn(&Tick) -> Duration| {
            self.ticks.iter().map(time).sum::<Duration>().as_secs_f64() * 1.0e3 / ticks.max(1) as f64
        };
        let millimeters = 1.0e3;
        let most =
            |length: fn(&Tick) -> f64, ticks: &[Tick]| ticks.iter().map(length).fold(0.0, f64::max) * millimeters;
        let deepest = |ticks: &[Tick]| most(|tick| tick.deepest, ticks);
        let settled = settled(&self.scene, ticks);
        let (first, last) = (&self.ticks[0], &self.ticks[ticks - 1]);
        let quiet = &self.ticks[settled.clone()];
        let jitter: Jitter = quiet.iter().map(|tick| tick.jitter).sum();
        let churn = quiet.iter().map(|tick| tick.churn).sum::<f64>() / quiet.len().max(1) as f64;
        let Self { bodies, triangles, threads, crossing, tunnelled, hash, .. } = self;
        writeln!(out, "{bodies} bodies, {triangles} triangles, {ticks} ticks on {threads} thread(s)\n")?;
        let mut row = |name: &str, value: String| writeln!(out, "{name:<34}{value}");
        let [detection, response, whole] =
            [mean(|tick| tick.detection), mean(|tick| tick.response), mean(|tick| tick.whole)];
        row("time of a tick", format!("{whole:.2} ms: detection {detection:.2}, response {response:.2}"))?;
        let most_contacts = self.ticks.iter().map(|tick| tick.contacts).max().unwrap_or(0);
        row("contacts", format!("{} at the end, at most {most_contacts}", last.contacts))?;
        let watched = self.ticks.iter().map(|tick| tick.watched).sum::<usize>() as f64 / ticks.max(1) as f64;
        if watched > 0.0 {
            row(
                "response to a contact",
                format!("{:.2} µs a tick, of {watched:.0} watched", 1.0e3 * response / watched),
            )?;
        }
        let depths = [deepest(&self.ticks[ticks - 1..]), deepest(&self.ticks)];
        row("contact distance", format!("{:.3} mm", most(|tick| tick.contact_distance, &self.ticks)))?;
        row("too near, the nearest", format!("{:.3} mm at the end, at most {:.3} mm", depths[0], depths[1]))?;
        row("triangles that cross at the end", format!("{crossing} pairs"))?;
        row("vertices that have tunnelled", tunnelled.to_string())?;
        if let Some((worst, tick)) = self.worst {
            let when = if worst > 0 { format!(", in tick {tick}") } else { String::new() };
            row("the most of them in any tick", format!("{worst}{when}"))?;
            let mut times: Vec<Duration> = self.ticks.iter().skip(1).map(|tick| tick.whole).collect();
            times.sort_unstable();
            if let Some(slowest) = times.last() {
                let [slowest, median] = [*slowest, times[times.len() / 2]].map(|time| time.as_secs_f64() * 1.0e3);
                row(
                    "slowest tick but the first",
                    format!("{slowest:.1} ms, {:.1} times the median", slowest / median),
                )?;
            }
        }
        row(
            "jitter",
            format!(
                "{:.1e} edges a tick, second difference {:.1e} (ticks {} to {})",
                jitter.step(),
                jitter.second_difference(),
                settled.start + 1,
                settled.end
            ),
        )?;
        row("contacts that come or go a tick", format!("{:.1} %", 100.0 * churn))?;
        row(
            "energy",
            format!(
                "{:.4} J to {:.4} J, {:.1e} J of it motion",
                first.energy.total(),
                last.energy.total(),
                last.energy.kinetic
            ),
        )?;
        row("hash of the end", format!("{hash:016x}"))
    }
}
