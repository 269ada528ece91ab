//! The files of rays and points.

use std::path::{Path, PathBuf};

use csv::{Reader, StringRecord, Trim};
use glam::Vec3;

use super::player::{Point, Ray};

#[derive(Debug, thiserror::Error)]
pub enum InputError {
    #[error("{}: {source}", .file.display())]
    Csv { file: PathBuf, source: csv::Error },
    #[error("{}: the column {column} is missing; expected the header {header}", .file.display())]
    MissingColumn { file: PathBuf, column: &'static str, header: String },
    #[error("{}: the column {column} is there twice", .file.display())]
    SameColumn { file: PathBuf, column: &'static str },
    #[error("{}: row {row} (line {line}), column {column}: '{text}' is not {expected}", .file.display())]
    Value { file: PathBuf, row: usize, line: u64, column: &'static str, text: String, expected: String },
}

const RAY_COLUMNS: [&str; 8] =
    ["frame", "origin_x", "origin_y", "origin_z", "direction_x", "direction_y", "direction_z", "max_distance"];
const POINT_COLUMNS: [&str; 5] = ["frame", "x", "y", "z", "max_distance"];

pub fn read_rays(file: &Path, frames: usize) -> Result<Vec<Ray>, InputError> {
    read(file, &RAY_COLUMNS, |row| {
        Ok(Ray {
            frame: row.frame(frames)?,
            origin: row.vector(1)?,
            direction: row.vector(4)?,
            max_distance: row.distance(7)?,
        })
    })
}

pub fn read_points(file: &Path, frames: usize) -> Result<Vec<Point>, InputError> {
    read(file, &POINT_COLUMNS, |row| {
        Ok(Point { frame: row.frame(frames)?, position: row.vector(1)?, max_distance: row.distance(4)? })
    })
}

/// One row, with its columns in the order of their names.
struct Row<'a> {
    file: &'a Path,
    columns: &'a [&'static str],
    places: &'a [usize],
    record: &'a StringRecord,
    number: usize,
}

impl Row<'_> {
    fn text(&self, column: usize) -> &str {
        self.record.get(self.places[column]).unwrap_or_default()
    }

    fn error(&self, column: usize, expected: impl Into<String>) -> InputError {
        InputError::Value {
            file: self.file.to_path_buf(),
            row: self.number,
            line: self.record.position().map_or(0, csv::Position::line),
            column: self.columns[column],
            text: self.text(column).to_owned(),
            expected: expected.into(),
        }
    }

    fn frame(&self, frames: usize) -> Result<usize, InputError> {
        let frame = self.text(0).parse().ok().filter(|frame| *frame < frames);
        frame.ok_or_else(|| self.error(0, format!("the number of a frame, which are 0 to {}", frames - 1)))
    }

    fn coordinate(&self, column: usize) -> Result<f32, InputError> {
        let number = self.text(column).parse::<f32>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| self.error(column, "a finite number in single precision"))
    }

    fn vector(&self, first: usize) -> Result<Vec3, InputError> {
        Ok(Vec3::new(self.coordinate(first)?, self.coordinate(first + 1)?, self.coordinate(first + 2)?))
    }

    fn distance(&self, column: usize) -> Result<f32, InputError> {
        let number = self.text(column).parse::<f32>().ok().filter(|number| *number >= 0.0);
        number.ok_or_else(|| self.error(column, "a number of 0 or more, or inf"))
    }
}

fn read<T>(
    file: &Path,
    columns: &[&'static str],
    convert: impl Fn(&Row<'_>) -> Result<T, InputError>,
) -> Result<Vec<T>, InputError> {
    let failed = |source| InputError::Csv { file: file.to_path_buf(), source };
    let mut reader: Reader<_> = csv::ReaderBuilder::new().trim(Trim::All).from_path(file).map_err(failed)?;
    let header = reader.headers().map_err(failed)?.clone();
    let mut places = Vec::new();
    for &column in columns {
        let mut found = header.iter().enumerate().filter(|(_, name)| *name == column).map(|(place, _)| place);
        let place = found.next().ok_or_else(|| InputError::MissingColumn {
            file: file.to_path_buf(),
            column,
            header: columns.join(","),
        })?;
        if found.next().is_some() {
            return Err(InputError::SameColumn { file: file.to_path_buf(), column });
        }
        places.push(place);
    }
    let rows = reader.records().enumerate().map(|(number, record)| {
        let record = record.map_err(failed)?;
        convert(&Row { file, columns, places: &places, record: &record, number })
    });
    rows.collect()
}
