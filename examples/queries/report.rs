//! How many queries there were, and how long they took.

use std::{
    fmt::{self, Display, Formatter},
    time::Duration,
};

use circumsphere_support::recording::Recording;

use super::player::Answers;

pub struct Report {
    name: String,
    triangles: usize,
    frames: usize,
    rays: Row,
    points: Row,
}

/// The queries of one kind.
#[derive(Default)]
struct Row {
    asked: usize,
    found: usize,
    /// Median over the frames, in microseconds.
    each: f64,
}

impl Row {
    /// From counts of queries and answers, and from the time of each frame.
    fn new(asked: usize, found: usize, frames: impl Iterator<Item = (usize, Duration)>) -> Self {
        let mut times: Vec<f64> = frames
            .filter(|(count, _)| *count > 0)
            .map(|(count, time)| time.as_secs_f64() * 1.0e6 / count as f64)
            .collect();
        times.sort_by(f64::total_cmp);
        Self { asked, found, each: times.get(times.len() / 2).copied().unwrap_or_default() }
    }
}

impl Report {
    pub fn new(name: String, recording: &Recording, answers: &Answers) -> Self {
        let Answers { hits, closest, frames } = answers;
        Self {
            name,
            triangles: recording.triangles.len(),
            frames: frames.len(),
            rays: Row::new(
                hits.len(),
                frames.iter().map(|frame| frame.hits).sum(),
                frames.iter().map(|frame| (frame.rays, frame.ray_time)),
            ),
            points: Row::new(
                closest.len(),
                closest.iter().flatten().count(),
                frames.iter().map(|frame| (frame.points, frame.point_time)),
            ),
        }
    }
}

impl Display for Report {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        writeln!(out, "{}: {} triangles, {} ticks with queries\n", self.name, self.triangles, self.frames)?;
        writeln!(out, "{:<16}{:>12}{:>12}{:>12}{:>12}", "query", "per tick", "in all", "hits", "µs each")?;
        for (name, row) in [("ray", &self.rays), ("closest point", &self.points)] {
            let per_tick = row.asked as f64 / self.frames.max(1) as f64;
            writeln!(out, "{name:<16}{per_tick:>12.0}{:>12}{:>12}{:>12.2}", row.asked, row.found, row.each)?;
        }
        writeln!(out, "\nµs each: median over the ticks; that of rays includes the update of the tree")
    }
}
