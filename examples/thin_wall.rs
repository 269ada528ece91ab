//! Turns the thin walls of a mesh into single-layer sheets with thickness, and prints what has become of each part, and what
//! random balls touch of both.
//!
//! `cargo run --release --example thin_wall -- [MESH] [options]`; `--help` lists the options. Without a file it takes an
//! embedded panel with ribs and holes.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    geometry::thin_wall::{Deviation, RegionKind, ThinWallSettings, ThinWalls},
    prelude::*,
};
use bevy_ecs::{error::BevyError, prelude::*};
use bevy_transform::components::Transform;
use circumsphere_examples::headless::{
    self, BAD_INPUT, detect, headless_app,
    recording::{Recorder, RecordingOptions},
};
use circumsphere_support::{
    random::Random,
    recording::{RecordingError, read_recording},
    scenes::{Panel, icosphere, panel},
};
use clap::Parser;
use glam::Vec3;
use serde::Serialize;

/// How many regions the table lists. The JSON has all.
const LISTED_REGIONS: usize = 20;

/// How many random balls are put near the original.
const PROBES: usize = 10_000;

/// How often detection is timed. The median counts.
const TIMES: usize = 15;

/// The mesh against which it is timed: 5,120 triangles, with a radius relative to the diagonal of the box of the original.
const OTHER_LEVEL: u32 = 4;
const OTHER_RADIUS: f32 = 0.3;

/// How far over the original the sheets are shown, relative to the diagonal of its box.
const SHOWN_OVER: f32 = 0.15;

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

/// What random balls near the original touch.
#[derive(Default, Serialize)]
struct Probes {
    count: usize,
    /// Those that touch the original.
    touching: usize,
    /// Those of them that do not touch the sheets with what is left.
    missed: usize,
    /// Those of them that are farther away than the Hausdorff distance.
    missed_beyond_hausdorff: usize,
    /// Those that touch only the sheets.
    added: usize,
}

/// Median times of detections in which every vertex has moved, against a closed mesh that cuts through, on one thread, in
/// milliseconds.
#[derive(Default, Serialize)]
struct Times {
    ms_before: f64,
    ms_after: f64,
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
    probes: Probes,
    detection: Times,
}

impl Report {
    fn new(
        triangles_before: usize,
        walls: &ThinWalls,
        deviation: &Deviation,
        (probes, detection): (Probes, Times),
    ) -> Self {
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
            probes,
            detection,
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
        let Probes { count, touching, missed, missed_beyond_hausdorff, added, .. } = self.probes;
        writeln!(lines, "  probes            {count:14}  {touching} touch the original, {added} only the sheets")?;
        writeln!(
            lines,
            "                    {missed} of those miss the sheets, {missed_beyond_hausdorff} by more than the Hausdorff distance"
        )?;
        let Times { ms_before, ms_after } = self.detection;
        writeln!(lines, "  detection         {ms_before:11.3} ms  before, {ms_after:.3} ms after, on one thread")?;
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

/// The original, or the sheets with what is left, and balls that may touch it.
struct Probed {
    app: App,
    mesh: Entity,
    places: BTreeMap<Entity, usize>,
}

impl Probed {
    fn new(
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        thickness: &[f32],
        balls: &[(Vec3, f32)],
        margin: f32,
    ) -> Option<Self> {
        let mut app = App::new();
        app.add_plugins(DeformableCollisionPlugins::new(Update));
        app.insert_resource(CircumsphereSettings { margin, threads: 1, ..CircumsphereSettings::default() });
        let surface = DeformableSurface::from_mesh(positions, triangles).ok()?;
        let mesh = app.world_mut().spawn((surface, VertexThickness::new(thickness.iter().copied()))).id();
        let spawn = |(place, &(center, radius)): (usize, &(Vec3, f32))| {
            let ball = RigidShape(SharedShape::ball(radius));
            (app.world_mut().spawn((ball, Transform::from_translation(center))).id(), place)
        };
        let places = balls.iter().enumerate().map(spawn).collect();
        Some(Self { app, mesh, places })
    }

    /// The balls no farther away than the contact distance and `more`.
    fn touching(&self, more: f64) -> BTreeSet<usize> {
        let pairs = self.app.world().resource::<ContactStore>().pairs().iter();
        let near = pairs.filter(|pair| pair.nearest <= f64::from(pair.contact_distance) + more);
        near.map(|pair| self.places[&pair.b.entity()]).collect()
    }
}

fn box_around(positions: &[Vec3]) -> (Vec3, Vec3) {
    positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)))
}

/// The median time in milliseconds of a detection against a closed mesh around the middle.
fn time(positions: &[Vec3], triangles: &[[u32; 3]], thickness: &[f32]) -> Option<f64> {
    let (low, high) = box_around(positions);
    let Probed { mut app, mesh, .. } = Probed::new(positions, triangles, thickness, &[], 0.0)?;
    let other = icosphere(OTHER_LEVEL, OTHER_RADIUS * (high - low).length());
    let points: Vec<Vec3> = other.positions.iter().copied().map(Vec3::from_array).collect();
    let other = DeformableSurface::from_mesh(&points, &other.triangles).ok()?;
    app.world_mut().spawn((other, SurfaceThickness::World(0.0), Transform::from_translation(low.midpoint(high))));
    let mut times = [0.0; TIMES];
    for time in &mut times {
        app.world_mut()
            .get_mut::<SurfacePositions>(mesh)?
            .0
            .iter_mut()
            .for_each(|position| *position *= 1.0 + 4.0 * f32::EPSILON);
        let start = Instant::now();
        app.update();
        *time = 1000.0 * start.elapsed().as_secs_f64();
    }
    times.sort_by(f64::total_cmp);
    Some(times[TIMES / 2])
}

/// Puts random balls outside of the original, from touching it to one radius away, and tells what they touch, and how long
/// detection takes.
fn probe(input: &Input, walls: &ThinWalls, deviation: &Deviation) -> (Probes, Times) {
    let mut random = Random::new(1);
    let mut areas = Vec::with_capacity(input.triangles.len());
    let mut area = 0.0;
    for corners in &input.triangles {
        let [a, b, c] = corners.map(|corner| input.positions[corner as usize]);
        area += f64::from(0.5 * (b - a).cross(c - a).length());
        areas.push(area);
    }
    let halves = walls.half_thickness.iter().filter(|half| **half > 0.0);
    let (sum, count) = halves.fold((0.0, 0.0), |(sum, count), half| (sum + half, count + 1.0));
    // Without walls, there is no thickness to compare with.
    let size = if count > 0.0 { 2.0 * sum / count } else { 0.02 * area.sqrt() as f32 };
    let mut balls = Vec::with_capacity(PROBES);
    while balls.len() < PROBES && area > 0.0 {
        let at = random.unit() * area;
        let triangle = areas.partition_point(|&before| before < at).min(areas.len() - 1);
        let [a, b, c] = input.triangles[triangle].map(|corner| input.positions[corner as usize]);
        let [mut u, mut v] = [0; 2].map(|_| random.unit() as f32);
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let radius = size * (0.6 + 0.4 * random.signed_unit());
        let height = radius * (1.0 + random.signed_unit());
        balls.push((a + (b - a) * u + (c - a) * v + (b - a).cross(c - a).normalize_or_zero() * height, radius));
    }
    let farther = deviation.hausdorff * (1.0 + 1.0e-5) + 1.0e-6 * area.sqrt();
    let zero = vec![0.0; input.positions.len()];
    let before = Probed::new(&input.positions, &input.triangles, &zero, &balls, 0.0);
    let after = Probed::new(&walls.positions, &walls.triangles, &walls.half_thickness, &balls, farther as f32);
    let (Some(mut before), Some(mut after)) = (before, after) else { return <(Probes, Times)>::default() };
    before.app.update();
    after.app.update();
    let (original, sheets, near) = (before.touching(0.0), after.touching(0.0), after.touching(farther));
    let probes = Probes {
        count: balls.len(),
        touching: original.len(),
        missed: original.difference(&sheets).count(),
        missed_beyond_hausdorff: original.difference(&near).count(),
        added: sheets.difference(&original).count(),
    };
    let times = Times {
        ms_before: time(&input.positions, &input.triangles, &zero).unwrap_or_default(),
        ms_after: time(&walls.positions, &walls.triangles, &walls.half_thickness).unwrap_or_default(),
    };
    (probes, times)
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

/// Records the original, and the sheets over it, each region as a surface of its own. Nothing collides.
fn show(input: &Input, walls: &ThinWalls, recorder: Recorder) -> Result<(), BevyError> {
    let plugins = DeformableCollisionPlugins::new(Update).build();
    let mut app = headless_app(plugins, CircumsphereSettings::default(), recorder);
    let alone = SurfaceLayers { memberships: 0, filters: 0 };
    let mut spawn = |name: String, positions: &[Vec3], triangles: &[[u32; 3]], place: Vec3| {
        let surface = DeformableSurface::from_mesh(positions, triangles)?;
        app.world_mut().spawn((surface, alone, Name::new(name), Transform::from_translation(place)));
        Ok::<_, BevyError>(())
    };
    let (low, high) = box_around(&input.positions);
    // Inside of the original, nothing would be seen of them.
    let over = Vec3::Y * ((high - low).y + SHOWN_OVER * (high - low).length());
    spawn("original".to_owned(), &input.positions, &input.triangles, Vec3::ZERO)?;
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
        spawn(name, &positions, &own, over)?;
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
    let report = Report::new(input.triangles.len(), &walls, &deviation, probe(&input, &walls, &deviation));
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
