//! The file of contained vertices, and the table.

use std::{
    fmt::{self, Display, Formatter},
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    time::Duration,
};

use serde::Serialize;

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("cannot write {}: {source}", .path.display())]
    File { path: PathBuf, source: io::Error },
    #[error("cannot write {}: {source}", .path.display())]
    Csv { path: PathBuf, source: csv::Error },
}

/// Written separately, so that a file without rows has one too.
const HEADER: [&str; 11] = [
    "vertex_body",
    "vertex",
    "tetrahedron",
    "barycentric_0",
    "barycentric_1",
    "barycentric_2",
    "barycentric_3",
    "depth",
    "direction_x",
    "direction_y",
    "direction_z",
];

/// A vertex of one body in a tetrahedron of the other.
#[derive(Serialize)]
pub struct Row {
    pub vertex_body: usize,
    pub vertex: u32,
    pub tetrahedron: u32,
    pub barycentric: [f64; 4],
    pub depth: f64,
    pub direction: [f64; 3],
}

/// Opened before any computation, so that a wrong path is reported at once.
pub struct ContainmentFile {
    path: PathBuf,
    writer: csv::Writer<BufWriter<File>>,
}

impl ContainmentFile {
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        let path = path.to_path_buf();
        match File::create(&path) {
            Ok(file) => {
                let writer = csv::WriterBuilder::new().has_headers(false).from_writer(BufWriter::new(file));
                Ok(Self { path, writer })
            }
            Err(source) => Err(OutputError::File { path, source }),
        }
    }

    pub fn write(self, rows: &[Row]) -> Result<(), OutputError> {
        let Self { path, mut writer } = self;
        let written = writer.write_record(HEADER).and_then(|()| rows.iter().try_for_each(|row| writer.serialize(row)));
        written.map_err(|source| OutputError::Csv { path: path.clone(), source })?;
        let flushed = writer.into_inner().map_err(csv::IntoInnerError::into_error).and_then(|mut file| file.flush());
        flushed.map_err(|source| OutputError::File { path, source })
    }
}

/// The results of one tick.
pub struct Tick {
    pub number: usize,
    /// Vertices of one body in the other.
    pub in_other: usize,
    /// Vertices in their own body.
    pub in_own: usize,
    pub deepest: f64,
    /// The least volume of a tetrahedron relative to that at rest. `None` if nothing moves.
    pub least_volume: Option<f32>,
    /// The time to find containments.
    pub duration: Duration,
}

/// How many ticks one line of the table stands for.
const TICKS_OF_LINE: usize = 12;

pub struct Table<'a> {
    pub bodies: Vec<String>,
    pub ticks: &'a [Tick],
}

impl Display for Table<'_> {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        for body in &self.bodies {
            writeln!(out, "{body}")?;
        }
        writeln!(
            out,
            "\n{:>6}{:>12}{:>12}{:>14}{:>14}{:>12}",
            "tick", "in other", "in own", "deepest", "least volume", "ms"
        )?;
        let last = self.ticks.len().saturating_sub(1);
        for Tick { number, in_other, in_own, deepest, least_volume, duration } in
            self.ticks.iter().filter(|tick| tick.number % TICKS_OF_LINE == 0 || tick.number == last)
        {
            let milliseconds = duration.as_secs_f64() * 1.0e3;
            let volume = least_volume.map_or_else(|| "-".to_owned(), |volume| format!("{volume:.3}"));
            writeln!(out, "{number:>6}{in_other:>12}{in_own:>12}{deepest:>14.6}{volume:>14}{milliseconds:>12.3}")?;
        }
        let mut durations: Vec<Duration> = self.ticks.iter().map(|tick| tick.duration).collect();
        durations.sort_unstable();
        if let Some(median) = durations.get(durations.len() / 2) {
            writeln!(out, "\nmedian {:.3} ms over {} tick(s)", median.as_secs_f64() * 1.0e3, durations.len())?;
        }
        Ok(())
    }
}
