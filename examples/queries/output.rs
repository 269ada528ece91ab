//! The files of hits and closest points.

use std::{
    fs::File,
    io::{self, BufWriter},
    path::{Path, PathBuf},
};

use bevy_circumsphere::{ClosestPoint, RayHit};
use csv::Writer;
use glam::Vec3;

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("cannot write {}: {source}", .path.display())]
    Create { path: PathBuf, source: io::Error },
    #[error("cannot write {}: {source}", .path.display())]
    Csv { path: PathBuf, source: csv::Error },
}

/// An open file.
pub struct Output(PathBuf, Writer<BufWriter<File>>);

const HIT_COLUMNS: [&str; 9] = [
    "ray",
    "triangle",
    "distance",
    "barycentric_0",
    "barycentric_1",
    "barycentric_2",
    "normal_x",
    "normal_y",
    "normal_z",
];
const CLOSEST_COLUMNS: [&str; 9] =
    ["point", "triangle", "distance", "barycentric_0", "barycentric_1", "barycentric_2", "x", "y", "z"];

pub fn create_hits(path: &Path) -> Result<Output, OutputError> {
    create(path, HIT_COLUMNS)
}

pub fn create_closest(path: &Path) -> Result<Output, OutputError> {
    create(path, CLOSEST_COLUMNS)
}

fn create(path: &Path, header: [&str; 9]) -> Result<Output, OutputError> {
    let file = File::create(path).map_err(|source| OutputError::Create { path: path.to_path_buf(), source })?;
    let mut writer = Writer::from_writer(BufWriter::new(file));
    writer.write_record(header).map_err(|source| OutputError::Csv { path: path.to_path_buf(), source })?;
    Ok(Output(path.to_path_buf(), writer))
}

pub fn write_hits(output: Output, hits: &[Option<RayHit>]) -> Result<(), OutputError> {
    let row =
        |hit: &RayHit| Row::new(hit.triangle.map(|triangle| triangle.0), hit.distance, hit.barycentric, hit.normal);
    write(output, hits.iter().map(|hit| hit.as_ref().map(row)))
}

pub fn write_closest(output: Output, closest: &[Option<ClosestPoint>]) -> Result<(), OutputError> {
    let row = |found: &ClosestPoint| {
        Row::new(found.triangle.map(|triangle| triangle.0), found.distance, found.barycentric, found.point)
    };
    write(output, closest.iter().map(|found| found.as_ref().map(row)))
}

/// What stands after the number of a row.
struct Row([String; 8]);

impl Row {
    fn new(triangle: Option<u32>, distance: f32, [u, v, w]: [f32; 3], Vec3 { x, y, z }: Vec3) -> Self {
        let triangle = triangle.map(|triangle| triangle.to_string()).unwrap_or_default();
        let [distance, u, v, w, x, y, z] = [distance, u, v, w, x, y, z].map(|number| number.to_string());
        Self([triangle, distance, u, v, w, x, y, z])
    }
}

fn write(Output(path, mut writer): Output, rows: impl Iterator<Item = Option<Row>>) -> Result<(), OutputError> {
    let failed = |source| OutputError::Csv { path: path.clone(), source };
    for (number, row) in rows.enumerate() {
        let Row(fields) = row.unwrap_or_else(|| Row(Default::default()));
        writer.write_record(std::iter::once(number.to_string()).chain(fields)).map_err(failed)?;
    }
    writer.flush().map_err(|source| OutputError::Create { path: path.clone(), source })
}
