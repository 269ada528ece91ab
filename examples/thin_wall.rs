//! Turns the thin walls of a mesh into single-layer sheets with thickness, and prints what has become of each part.
//!
//! `cargo run --release --example thin_wall -- [MESH] [options]`; `--help` lists the options. Without a file it takes an
//! embedded panel with ribs and holes.

use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings,
    geometry::thin_wall::{Deviation, RegionKind, ThinWallSettings, ThinWalls},
    prelude::*,
};
use bevy_ecs::{error::BevyError, prelude::*};
use circumsphere_examples::headless::{
    self, BAD_INPUT, detect, headless_app,
    recording::{Recorder, RecordingOptions},
};
use circumsphere_support::{
    recording::{RecordingError, read_recording},
    scenes::{Panel, panel},
};
use clap::Parser;
use glam::Vec3;
use serde::Serialize;

/// How many regions the table lists. The JSON has all.
const LISTED_REGIONS: usize = 20;

/// Turn the thin walls of a mesh into single-layer sheets with thickness.
#[derive(Parser, Debug)]
#[command(name = "thin_wall")]
struct Options {
    /// The mesh: PLY, OBJ, or a .bin recording of one frame; without it: an embedded panel with ribs and holes
    file: Option<PathBuf>,
    /// Write the sheets, and what is left, as OBJ. A `vt` per vertex has half its thickness, 0 for what is left
    #[arg(long, value_name = "SHEET.obj")]
    out: Option<PathBuf>,
    /// Write the report as JSON
    #[arg(long, value_name = "REPORT.json")]
    json: Option<PathBuf>,
    #[command(flatten)]
    recording: RecordingOptions,
}

#[derive(Debug, thiserror::Error)]
enum ThinWallError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("{}: has {frames} frames: give a recording of one", .file.display())]
    SeveralFrames { file: PathBuf, frames: usize },
    #[error("{name}: {source}")]
    Mesh { name: String, source: bevy_circumsphere::geometry::TopologyError },
    #[error("cannot write {}: {source}", .path.display())]
    Write { path: PathBuf, source: io::Error },
    #[error(transparent)]
    Rerun(#[from] headless::recording::RecordingError),
    #[error("--rerun: {0}")]
    Show(BevyError),
}

/// The mesh to look at.
struct Input {
    name: String,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Input {
    fn read(file: Option<&Path>) -> Result<Self, ThinWallError> {
        let Some(file) = file else {
            let mesh = panel(&Panel::ribbed());
            let positions = mesh.positions.into_iter().map(Vec3::from_array).collect();
            return Ok(Self { name: "the embedded panel".to_owned(), positions, triangles: mesh.triangles });
        };
        let mut recording = read_recording(&[file.to_path_buf()])?;
        if recording.frames.len() > 1 {
            return Err(ThinWallError::SeveralFrames { file: file.to_path_buf(), frames: recording.frames.len() });
        }
        let frame = recording.frames.pop().unwrap_or_default();
        let positions = frame.into_iter().map(Vec3::from_array).collect();
        Ok(Self { name: file.display().to_string(), positions, triangles: recording.triangles })
    }
}

/// A region in the JSON.
#[derive(Serialize)]
struct RegionRow {
    kind: &'static str,
    area: f64,
    thickness_min: f64,
    thickness_max: f64,
    parent: Option<usize>,
}

/// What is left, in the JSON.
#[derive(Serialize)]
struct LeftRow {
    reason: String,
    area: f64,
}

/// The JSON.
#[derive(Serialize)]
struct Report {
    triangles_before: usize,
    triangles_after: usize,
    thin_area: f64,
    abstracted_area: f64,
    area_before: f64,
    hausdorff: f64,
    hausdorff_over_thickness: f64,
    regions: Vec<RegionRow>,
    left_out: Vec<LeftRow>,
}

impl Report {
    fn new(triangles_before: usize, walls: &ThinWalls, deviation: &Deviation) -> Self {
        let kind = |kind| match kind {
            RegionKind::Plate => "plate",
            RegionKind::Rib => "rib",
        };
        Self {
            triangles_before,
            triangles_after: walls.triangles.len(),
            thin_area: walls.thin_area,
            abstracted_area: walls.abstracted_area,
            area_before: walls.area_before,
            hausdorff: deviation.hausdorff,
            hausdorff_over_thickness: deviation.over_thickness,
            regions: walls
                .regions
                .iter()
                .map(|region| RegionRow {
                    kind: kind(region.kind),
                    area: region.area,
                    thickness_min: region.thickness_min,
                    thickness_max: region.thickness_max,
                    parent: region.parent,
                })
                .collect(),
            left_out: walls
                .left_out
                .iter()
                .map(|left| LeftRow { reason: left.reason.to_string(), area: left.area })
                .collect(),
        }
    }

    fn print(&self, input: &Input, deviation: &Deviation) -> io::Result<()> {
        let mut lines = io::stdout().lock();
        let share = |part: f64, whole: f64| if whole > 0.0 { 100.0 * part / whole } else { 0.0 };
        writeln!(lines, "{}: {} triangles, area {:.6}", input.name, self.triangles_before, self.area_before)?;
        let of_all = share(self.thin_area, self.area_before);
        writeln!(lines, "  thin              {:14.6}  {of_all:5.1} % of the area", self.thin_area)?;
        let of_thin = share(self.abstracted_area, self.thin_area);
        writeln!(lines, "  now sheets        {:14.6}  {of_thin:5.1} % of the thin area", self.abstracted_area)?;
        let of_before = share(self.triangles_after as f64, self.triangles_before as f64);
        writeln!(lines, "  triangles left    {:14}  {of_before:5.1} %", self.triangles_after)?;
        let of_thickness = 100.0 * self.hausdorff_over_thickness;
        writeln!(lines, "  Hausdorff distance{:14.6}  {of_thickness:5.1} % of the thickness there", self.hausdorff)?;
        writeln!(
            lines,
            "                    {} samples, {:.6} apart, in both directions",
            deviation.samples, deviation.spacing
        )?;
        if !self.regions.is_empty() {
            writeln!(lines, "\n  region  kind             area    thickness from        to  parent")?;
        }
        for (number, region) in self.regions.iter().enumerate().take(LISTED_REGIONS) {
            let parent = region.parent.map_or("-".to_owned(), |parent| parent.to_string());
            let RegionRow { kind, area, thickness_min, thickness_max, .. } = region;
            writeln!(
                lines,
                "  {number:6}  {kind:5}  {area:14.6}  {thickness_min:16.6}{thickness_max:10.6}  {parent:>6}"
            )?;
        }
        if self.regions.len() > LISTED_REGIONS {
            writeln!(lines, "  and {} smaller ones", self.regions.len() - LISTED_REGIONS)?;
        }
        if !self.left_out.is_empty() {
            writeln!(lines, "\n  left as it was")?;
        }
        for left in &self.left_out {
            writeln!(lines, "  {:14.6}  {:5.1} %  {}", left.area, share(left.area, self.area_before), left.reason)?;
        }
        Ok(())
    }
}

/// A file that is opened before any computation, so that a wrong path is reported at once.
fn create(path: Option<&PathBuf>) -> Result<Option<(PathBuf, BufWriter<File>)>, ThinWallError> {
    let Some(path) = path else { return Ok(None) };
    let file = File::create(path).map_err(|source| ThinWallError::Write { path: path.clone(), source })?;
    Ok(Some((path.clone(), BufWriter::new(file))))
}

fn write_obj(file: &mut impl Write, walls: &ThinWalls) -> io::Result<()> {
    for position in &walls.positions {
        writeln!(file, "v {} {} {}", position.x, position.y, position.z)?;
    }
    if walls.regions.is_empty() {
        for [a, b, c] in walls.triangles.iter().map(|corners| corners.map(|vertex| vertex + 1)) {
            writeln!(file, "f {a} {b} {c}")?;
        }
        return file.flush();
    }
    for half in &walls.half_thickness {
        writeln!(file, "vt {half} 0")?;
    }
    for (triangle, corners) in walls.triangles.iter().enumerate() {
        let region = walls.sheet_regions.get(triangle);
        if triangle == 0 || region != walls.sheet_regions.get(triangle - 1) {
            match region {
                Some(region) => writeln!(file, "g region_{region}")?,
                None => writeln!(file, "g left")?,
            }
        }
        let [a, b, c] = corners.map(|vertex| vertex + 1);
        writeln!(file, "f {a}/{a} {b}/{b} {c}/{c}")?;
    }
    file.flush()
}

/// Records the original and the sheets, each region as a surface of its own. Nothing collides.
fn show(input: &Input, walls: &ThinWalls, recorder: Recorder) -> Result<(), BevyError> {
    let plugins = DeformableCollisionPlugins::new(Update).build();
    let mut app = headless_app(plugins, CircumsphereSettings::default(), recorder);
    let alone = SurfaceLayers { memberships: 0, filters: 0 };
    let mut spawn = |name: String, positions: &[Vec3], triangles: &[[u32; 3]]| {
        let surface = DeformableSurface::from_mesh(positions, triangles)?;
        app.world_mut().spawn((surface, alone, Name::new(name)));
        Ok::<_, BevyError>(())
    };
    spawn("original".to_owned(), &input.positions, &input.triangles)?;
    let mut by_region = vec![Vec::new(); walls.regions.len() + 1];
    for (triangle, &corners) in walls.triangles.iter().enumerate() {
        let region = walls.sheet_regions.get(triangle).map_or(walls.regions.len(), |&region| region as usize);
        by_region[region].push(corners);
    }
    for (region, triangles) in by_region.iter().enumerate().filter(|(_, triangles)| !triangles.is_empty()) {
        let name = match walls.regions.get(region) {
            Some(found) => format!("{:?} {region}", found.kind).to_lowercase(),
            None => "left".to_owned(),
        };
        // Vertices of other regions are left out.
        let mut names = vec![u32::MAX; walls.positions.len()];
        let mut positions = Vec::new();
        let mut own = Vec::new();
        for corners in triangles {
            own.push(corners.map(|vertex| {
                let name = &mut names[vertex as usize];
                if *name == u32::MAX {
                    *name = positions.len() as u32;
                    positions.push(walls.positions[vertex as usize]);
                }
                *name
            }));
        }
        spawn(name, &positions, &own)?;
    }
    detect(&mut app);
    Ok(())
}

fn run(options: &Options) -> Result<(), ThinWallError> {
    let input = Input::read(options.file.as_deref())?;
    let mut out = create(options.out.as_ref())?;
    let mut json = create(options.json.as_ref())?;
    let recorder = options.recording.rerun.as_deref().map(|path| options.recording.recorder(path)).transpose()?;
    let (walls, deviation) = ThinWalls::find(&input.positions, &input.triangles, &ThinWallSettings::default())
        .map_err(|source| ThinWallError::Mesh { name: input.name.clone(), source })?;
    let report = Report::new(input.triangles.len(), &walls, &deviation);
    if let Some((path, file)) = &mut out {
        write_obj(file, &walls).map_err(|source| ThinWallError::Write { path: path.clone(), source })?;
    }
    if let Some((path, file)) = &mut json {
        serde_json::to_writer_pretty(&mut *file, &report)
            .map_err(io::Error::from)
            .and_then(|()| file.write_all(b"\n"))
            .and_then(|()| file.flush())
            .map_err(|source| ThinWallError::Write { path: path.clone(), source })?;
    }
    if let Some(recorder) = recorder {
        show(&input, &walls, recorder).map_err(ThinWallError::Show)?;
    }
    // The reader of the table may have closed the pipe.
    let _ = report.print(&input, &deviation);
    Ok(())
}

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}
