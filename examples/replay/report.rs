//! The measurements of a replay, as a table and as JSON.

use std::{
    fmt::{self, Display, Formatter},
    time::Duration,
};

use circumsphere_examples::headless::Detection;
use circumsphere_support::recording::Recording;
use serde::Serialize;

use super::{
    options::{BroadPhase, Settings},
    player::{Played, PlayedFrame},
};

#[derive(Serialize)]
pub struct Report {
    input: String,
    settings: Settings,
    triangles: usize,
    vertices: usize,
    threads: usize,
    build_ms: f64,
    /// Peak resident set size of the process; `null` if the system does not report it.
    peak_bytes: Option<u64>,
    frames: Vec<FrameReport>,
}

#[derive(Serialize)]
struct FrameReport {
    frame: usize,
    detect_ms: f64,
    pairs: usize,
    contacts: usize,
    recipes_refreshed: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    cells: Option<Cells>,
    stages: Vec<StageReport>,
}

/// The cells of a spatial hash.
#[derive(Serialize)]
struct Cells {
    occupied: usize,
    crowded: usize,
    large_triangles: usize,
}

#[derive(Serialize)]
struct StageReport {
    name: &'static str,
    ms: f64,
    #[serde(rename = "in")]
    pairs_in: usize,
    #[serde(rename = "out")]
    pairs_out: usize,
}

fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count if count % 2 == 1 => values[count / 2],
        count => 0.5 * (values[count / 2 - 1] + values[count / 2]),
    }
}

fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1.0e3
}

#[cfg(unix)]
fn peak_resident_bytes() -> Option<u64> {
    use nix::sys::resource::{UsageWho, getrusage};
    // In kilobytes, except on Apple's systems.
    let unit = if cfg!(target_vendor = "apple") { 1 } else { 1024 };
    let peak = getrusage(UsageWho::RUSAGE_SELF).ok()?.max_rss();
    u64::try_from(peak).ok().map(|peak| peak * unit)
}

#[cfg(not(unix))]
fn peak_resident_bytes() -> Option<u64> {
    None
}

impl FrameReport {
    fn new(played: &PlayedFrame, has_cells: bool) -> Self {
        let last = played.detections.last().expect("every frame is detected at least once");
        let of_stage = |detection: &Detection, name: &str| {
            detection.stages.iter().find(|stage| stage.name == name).map(|stage| milliseconds(stage.duration))
        };
        Self {
            frame: played.frame,
            detect_ms: median(played.detections.iter().map(|detection| milliseconds(detection.total))),
            pairs: last.pairs,
            contacts: last.contacts,
            recipes_refreshed: last.recipes_refreshed,
            cells: has_cells.then(|| {
                let [occupied, crowded, large_triangles] = last.cells;
                Cells { occupied, crowded, large_triangles }
            }),
            stages: last
                .stages
                .iter()
                .map(|stage| StageReport {
                    name: stage.name,
                    ms: median(played.detections.iter().filter_map(|detection| of_stage(detection, stage.name))),
                    pairs_in: stage.pairs_in,
                    pairs_out: stage.pairs_out,
                })
                .collect(),
        }
    }
}

impl Report {
    pub fn new(input: String, recording: &Recording, settings: &Settings, played: Played) -> Self {
        let has_cells = matches!(settings.broad_phase, BroadPhase::SpatialHash | BroadPhase::HierarchicalHash);
        Self {
            input,
            settings: settings.clone(),
            triangles: recording.triangles.len(),
            vertices: recording.frames[0].len(),
            threads: settings.threads,
            build_ms: median(played.builds.iter().copied().map(milliseconds)),
            peak_bytes: peak_resident_bytes(),
            frames: played.frames.iter().map(|frame| FrameReport::new(frame, has_cells)).collect(),
        }
    }

    /// Median over the frames.
    fn over_frames(&self, value: impl Fn(&FrameReport) -> f64) -> f64 {
        median(self.frames.iter().map(value))
    }

    /// The stages, in the order of their first occurrence.
    fn stage_names(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        for stage in self.frames.iter().flat_map(|frame| &frame.stages) {
            if !names.contains(&stage.name) {
                names.push(stage.name);
            }
        }
        names
    }
}

impl Display for Report {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        writeln!(out, "{}: {} triangles, {} vertices", self.input, self.triangles, self.vertices)?;
        writeln!(
            out,
            "frames {}..{}, contact distance {:.6} ({:.3} mean edges), {} thread(s), built in {:.1} ms",
            self.settings.frames.start,
            self.settings.frames.end,
            self.settings.contact_distance,
            if self.settings.mean_edge > 0.0 { self.settings.contact_distance / self.settings.mean_edge } else { 0.0 },
            self.threads,
            self.build_ms
        )?;
        writeln!(out, "medians over {} frame(s), per frame:\n", self.frames.len())?;
        writeln!(out, "{:<16}{:>12}{:>14}{:>14}{:>12}", "stage", "ms", "pairs in", "pairs out", "refreshed")?;
        for name in self.stage_names() {
            let of_stage = |value: fn(&StageReport) -> f64| {
                let stages =
                    self.frames.iter().filter_map(|frame| frame.stages.iter().find(|stage| stage.name == name));
                median(stages.map(value))
            };
            let refreshed = if name == "refit" {
                format!("{:.0}", self.over_frames(|frame| frame.recipes_refreshed as f64))
            } else {
                String::new()
            };
            writeln!(
                out,
                "{name:<16}{:>12.3}{:>14.0}{:>14.0}{refreshed:>12}",
                of_stage(|stage| stage.ms),
                of_stage(|stage| stage.pairs_in as f64),
                of_stage(|stage| stage.pairs_out as f64),
            )?;
        }
        writeln!(
            out,
            "{:<16}{:>12.3}{:>14}{:>14.0}{:>12.0}",
            "total",
            self.over_frames(|frame| frame.detect_ms),
            "",
            self.over_frames(|frame| frame.pairs as f64),
            self.over_frames(|frame| frame.recipes_refreshed as f64),
        )?;
        if self.frames.iter().any(|frame| frame.cells.is_some()) {
            let cells = |value: fn(&Cells) -> usize| {
                self.over_frames(|frame| frame.cells.as_ref().map_or(0.0, |cells| value(cells) as f64))
            };
            writeln!(
                out,
                "\ncells: {:.0} occupied, {:.0} crowded; {:.0} triangles too large for them",
                cells(|cells| cells.occupied),
                cells(|cells| cells.crowded),
                cells(|cells| cells.large_triangles),
            )?;
        }
        let sum = |value: fn(&FrameReport) -> usize| self.frames.iter().map(value).sum::<usize>();
        let (pairs, contacts) = (sum(|frame| frame.pairs), sum(|frame| frame.contacts));
        writeln!(out, "\ntouching pairs: {:.0} a frame, {pairs} in all", self.over_frames(|frame| frame.pairs as f64))?;
        writeln!(out, "contacts: {:.0} a frame, {contacts} in all", self.over_frames(|frame| frame.contacts as f64))
    }
}
