//! The output files of a replay.

use std::{
    collections::HashMap,
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use bevy_circumsphere::{Contact, geometry::VertexId};
use bevy_ecs::entity::Entity;
use csv::Writer;
use glam::Vec3;
use serde::Serialize;

use super::{
    options::Options,
    player::{FrameContacts, Part},
    report::Report,
};

#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("cannot write {}: {source}", .path.display())]
    Create { path: PathBuf, source: io::Error },
    #[error("cannot write {}: {source}", .path.display())]
    Csv { path: PathBuf, source: csv::Error },
    #[error("cannot write {}: {source}", .path.display())]
    Json { path: PathBuf, source: serde_json::Error },
}

type CsvFile = (PathBuf, Writer<BufWriter<File>>);

/// The open files. They are opened before any computation, so that a wrong path is reported at once.
pub struct Writers {
    pairs: Option<CsvFile>,
    contacts: Option<CsvFile>,
    json: Option<(PathBuf, BufWriter<File>)>,
}

#[derive(Serialize)]
struct PairRow {
    frame: usize,
    triangle_a: u32,
    triangle_b: u32,
    distance: f64,
}

#[derive(Serialize)]
struct ContactRow {
    frame: usize,
    triangle_a: u32,
    triangle_b: u32,
    kind: &'static str,
    feature_a: String,
    feature_b: String,
    barycentric_a_0: f32,
    barycentric_a_1: f32,
    barycentric_a_2: f32,
    barycentric_b_0: f32,
    barycentric_b_1: f32,
    barycentric_b_2: f32,
    point_a_x: f32,
    point_a_y: f32,
    point_a_z: f32,
    point_b_x: f32,
    point_b_y: f32,
    point_b_z: f32,
    normal_x: f32,
    normal_y: f32,
    normal_z: f32,
    distance: f32,
    separation: f32,
}

/// Headers are written separately, so that files without rows have one too.
const PAIR_HEADER: [&str; 4] = ["frame", "triangle_a", "triangle_b", "distance"];
const CONTACT_HEADER: [&str; 23] = [
    "frame",
    "triangle_a",
    "triangle_b",
    "kind",
    "feature_a",
    "feature_b",
    "barycentric_a_0",
    "barycentric_a_1",
    "barycentric_a_2",
    "barycentric_b_0",
    "barycentric_b_1",
    "barycentric_b_2",
    "point_a_x",
    "point_a_y",
    "point_a_z",
    "point_b_x",
    "point_b_y",
    "point_b_z",
    "normal_x",
    "normal_y",
    "normal_z",
    "distance",
    "separation",
];

fn create(path: &Path) -> Result<BufWriter<File>, OutputError> {
    File::create(path).map(BufWriter::new).map_err(|source| OutputError::Create { path: path.to_path_buf(), source })
}

fn create_csv(path: Option<&PathBuf>, header: &[&str]) -> Result<Option<CsvFile>, OutputError> {
    let Some(path) = path else { return Ok(None) };
    let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(create(path)?);
    writer.write_record(header).map_err(|source| OutputError::Csv { path: path.clone(), source })?;
    Ok(Some((path.clone(), writer)))
}

fn write_rows<Row: Serialize>(
    (path, writer): &mut CsvFile,
    rows: impl IntoIterator<Item = Row>,
) -> Result<(), OutputError> {
    for row in rows {
        writer.serialize(row).map_err(|source| OutputError::Csv { path: path.clone(), source })?;
    }
    Ok(())
}

impl Writers {
    pub fn create(options: &Options) -> Result<Self, OutputError> {
        let json = match &options.json {
            Some(path) => Some((path.clone(), create(path)?)),
            None => None,
        };
        Ok(Self {
            pairs: create_csv(options.pairs.as_ref(), &PAIR_HEADER)?,
            contacts: create_csv(options.contacts.as_ref(), &CONTACT_HEADER)?,
            json,
        })
    }

    pub fn write(&mut self, frame: usize, contacts: &FrameContacts) -> Result<(), OutputError> {
        if let Some(file) = &mut self.pairs {
            write_rows(file, pair_rows(frame, contacts))?;
        }
        if let Some(file) = &mut self.contacts {
            let rows = contacts.contacts.iter().map(|contact| contact_row(frame, contacts.parts, &contact));
            write_rows(file, rows)?;
        }
        Ok(())
    }

    pub fn finish(mut self, report: &Report) -> Result<(), OutputError> {
        for (path, writer) in [self.pairs.as_mut(), self.contacts.as_mut()].into_iter().flatten() {
            writer.flush().map_err(|source| OutputError::Create { path: path.clone(), source })?;
        }
        if let Some((path, mut file)) = self.json {
            serde_json::to_writer_pretty(&mut file, report)
                .map_err(|source| OutputError::Json { path: path.clone(), source })?;
            file.write_all(b"\n").and_then(|()| file.flush()).map_err(|source| OutputError::Create { path, source })?;
        }
        Ok(())
    }
}

fn pair_rows(frame: usize, contacts: &FrameContacts) -> Vec<PairRow> {
    let mut rows = Vec::new();
    for pair in contacts.store.pairs() {
        let (part_a, part_b) = (contacts.parts[&pair.a.entity()], contacts.parts[&pair.b.entity()]);
        rows.extend(pair.touching.iter().map(|touching| {
            let first = part_a.triangles[touching.triangle_a as usize];
            let second = part_b.triangles[touching.triangle_b as usize];
            PairRow { frame, triangle_a: first.min(second), triangle_b: first.max(second), distance: touching.distance }
        }));
    }
    rows.sort_unstable_by_key(|row| (row.triangle_a, row.triangle_b));
    rows
}

/// A vertex as `v7`, an edge as `e7-9`, or a face as `f12`, with the numbers of the file.
fn feature_name(part: &Part, triangle: u32, vertices: &[VertexId]) -> String {
    let number = |vertex: &VertexId| part.vertices[vertex.index()];
    match vertices {
        [vertex] => format!("v{}", number(vertex)),
        [from, to] => format!("e{}-{}", number(from).min(number(to)), number(from).max(number(to))),
        _ => format!("f{triangle}"),
    }
}

fn contact_row(frame: usize, parts: &HashMap<Entity, &Part>, contact: &Contact) -> ContactRow {
    let (part_a, part_b) = (parts[&contact.a().entity()], parts[&contact.b().entity()]);
    let (Some(own), Some(other)) = contact.triangles() else {
        unreachable!("a replay has no rigid shapes");
    };
    let (first, second) = (part_a.triangles[own.index()], part_b.triangles[other.index()]);
    let (vertices_a, vertices_b) = contact.feature_vertices();
    let names = (feature_name(part_a, first, &vertices_a), feature_name(part_b, second, &vertices_b));
    let ascending = first <= second;
    let order = |pair: (Vec3, Vec3)| if ascending { pair } else { (pair.1, pair.0) };
    let (weights_a, weights_b) = contact.barycentrics();
    let (weights_a, weights_b) = if ascending { (weights_a, weights_b) } else { (weights_b, weights_a) };
    let (feature_a, feature_b) = if ascending { names } else { (names.1, names.0) };
    let (point_a, point_b) = order(contact.points());
    let normal = if ascending { contact.normal() } else { -contact.normal() };
    ContactRow {
        frame,
        triangle_a: first.min(second),
        triangle_b: first.max(second),
        kind: contact.kind().name(),
        feature_a,
        feature_b,
        barycentric_a_0: weights_a[0],
        barycentric_a_1: weights_a[1],
        barycentric_a_2: weights_a[2],
        barycentric_b_0: weights_b[0],
        barycentric_b_1: weights_b[1],
        barycentric_b_2: weights_b[2],
        point_a_x: point_a.x,
        point_a_y: point_a.y,
        point_a_z: point_a.z,
        point_b_x: point_b.x,
        point_b_y: point_b.y,
        point_b_z: point_b.z,
        normal_x: normal.x,
        normal_y: normal.y,
        normal_z: normal.z,
        distance: contact.distance(),
        separation: contact.separation(),
    }
}
