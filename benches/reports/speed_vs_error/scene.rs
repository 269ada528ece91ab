//! The scenes to play: bodies with positions for each tick, generated or from a recording.

use std::{
    fs,
    path::{Path, PathBuf},
};

use bevy_circumsphere::geometry::{SurfaceTopology, TopologyError};
use circumsphere_support::{
    recording::{Recording, RecordingError, read_recording},
    scenes::{MovingScene, moving_scene},
};
use circumsphere_truth::{exact_weld, mean_edge_length};
use glam::{DVec3, Vec3};

use super::options::{Options, OptionsError};

/// The recording from which one of the scenes is taken.
const CLOTH_FALL: &[u8] = include_bytes!("../../../assets/cloth_fall.bin");

/// Other files that may lie next to recordings: answers, queries, and the same meshes in double precision.
const NOT_RECORDINGS: [&str; 3] = [".f64.bin", ".gt.bin", ".ccdq.bin"];

/// Number of ticks of a generated scene in which errors are measured. Costs and steadiness are measured in all ticks.
const MEASURED_TICKS: usize = 6;

#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error(transparent)]
    Options(#[from] OptionsError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error("cannot read {}: {source}", .path.display())]
    Folder { path: PathBuf, source: std::io::Error },
    #[error("{}: the folder has no recordings: expected files that end in .bin, .ply, or .obj", .path.display())]
    NoRecording { path: PathBuf },
    #[error("{}: the folder has no recording named {name}", .path.display())]
    NoSuchRecording { path: PathBuf, name: String },
    #[error("{name}: {source}")]
    Mesh { name: String, source: TopologyError },
}

pub struct Body {
    pub triangles: Vec<[u32; 3]>,
    pub ticks: Vec<Vec<Vec3>>,
    pub is_closed: bool,
    pub touches_itself: bool,
    /// The representative of each vertex. Vertices at equal positions in the first tick are welded.
    pub weld: Vec<u32>,
    pub mean_edge: f64,
}

impl Body {
    fn new(
        name: &str,
        triangles: Vec<[u32; 3]>,
        ticks: Vec<Vec<Vec3>>,
        is_closed: bool,
        touches_itself: bool,
    ) -> Result<Self, SceneError> {
        SurfaceTopology::new(&ticks[0], &triangles)
            .map_err(|source| SceneError::Mesh { name: name.to_owned(), source })?;
        let rest = wide(&ticks[0]);
        let weld = exact_weld(&rest);
        let mean_edge = mean_edge_length(&rest, &triangles, &weld);
        Ok(Self { triangles, ticks, is_closed, touches_itself, weld, mean_edge })
    }
}

pub struct Scene {
    pub name: String,
    pub what: String,
    pub deforms: bool,
    pub bodies: Vec<Body>,
    /// The ticks in which errors are measured, ascending.
    pub measured: Vec<usize>,
}

pub fn wide(positions: &[Vec3]) -> Vec<DVec3> {
    positions.iter().map(|position| position.as_dvec3()).collect()
}

impl Scene {
    pub fn of_moving(scene: MovingScene) -> Result<Self, SceneError> {
        let bodies = scene
            .bodies
            .into_iter()
            .map(|body| {
                let ticks = body.ticks.into_iter().map(|tick| tick.into_iter().map(Vec3::from).collect()).collect();
                Body::new(scene.name, body.triangles, ticks, body.is_closed, body.touches_itself)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let ticks = bodies[0].ticks.len();
        let step = ticks.div_ceil(MEASURED_TICKS);
        Ok(Self {
            name: scene.name.to_owned(),
            what: scene.what.to_owned(),
            deforms: scene.deforms,
            bodies,
            // The last tick is always included.
            measured: (0..ticks).rev().step_by(step).collect::<Vec<_>>().into_iter().rev().collect(),
        })
    }

    fn of_recording(name: String, recording: Recording, frames: usize) -> Result<Self, SceneError> {
        let frames = frames.min(recording.frames.len());
        let ticks: Vec<Vec<Vec3>> =
            recording.frames[..frames].iter().map(|frame| frame.iter().copied().map(Vec3::from).collect()).collect();
        // A recording is one two-sided mesh, even if it has several components, as in the example `replay`.
        let body = Body::new(&name, recording.triangles, ticks, false, true)?;
        let (what, deforms) = (format!("{frames} of {} recorded frames", recording.frames.len()), frames > 1);
        Ok(Self { name, what, deforms, bodies: vec![body], measured: (0..frames).collect() })
    }

    pub fn ticks(&self) -> usize {
        self.bodies[0].ticks.len()
    }

    pub fn triangles(&self) -> usize {
        self.bodies.iter().map(|body| body.triangles.len()).sum()
    }

    /// The median of the bodies' mean edges. Contact distances are multiples of it. The median is not dominated by a
    /// single coarse ground or a single fine object.
    pub fn mean_edge(&self) -> f64 {
        let mut edges: Vec<f64> = self.bodies.iter().map(|body| body.mean_edge).collect();
        edges.sort_by(f64::total_cmp);
        edges[(edges.len() - 1) / 2]
    }

    /// The thickness of a body for a contact distance in mean edges, and that distance after rounding.
    pub fn thickness(&self, distance_edges: f64) -> (f32, f64) {
        let thickness = (0.5 * distance_edges * self.mean_edge()) as f32;
        (thickness, f64::from(thickness + thickness))
    }

    /// The pairs of bodies that may touch, the lower index first.
    pub fn body_pairs(&self) -> Vec<[usize; 2]> {
        let count = self.bodies.len();
        (0..count)
            .flat_map(|a| (a..count).map(move |b| [a, b]))
            .filter(|[a, b]| a != b || self.bodies[*a].touches_itself)
            .collect()
    }
}

/// The scenes that the options ask for.
pub fn scenes(options: &Options) -> Result<Vec<Scene>, SceneError> {
    match &options.folder {
        Some(folder) => recordings(folder, options),
        None => options
            .scene_names()?
            .into_iter()
            .map(|name| {
                let scene = moving_scene(name, options.fineness(), options.ticks(), CLOTH_FALL)?;
                Scene::of_moving(scene.expect("every listed scene exists"))
            })
            .collect(),
    }
}

fn recordings(folder: &Path, options: &Options) -> Result<Vec<Scene>, SceneError> {
    let unreadable = |source| SceneError::Folder { path: folder.to_path_buf(), source };
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        files.push(entry.map_err(unreadable)?.path());
    }
    let is_recording = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        [".bin", ".ply", ".obj"].iter().any(|ending| name.ends_with(ending))
            && !NOT_RECORDINGS.iter().any(|ending| name.ends_with(ending))
    };
    files.retain(is_recording);
    files.sort();
    if files.is_empty() {
        return Err(SceneError::NoRecording { path: folder.to_path_buf() });
    }
    let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    if let Some(name) = options.scenes.iter().find(|name| !files.iter().any(|path| stem(path) == **name)) {
        return Err(SceneError::NoSuchRecording { path: folder.to_path_buf(), name: name.clone() });
    }
    files
        .into_iter()
        .filter(|path| options.scenes.is_empty() || options.scenes.contains(&stem(path)))
        .map(|path| {
            let name = stem(&path);
            let recording = read_recording(&[path])?;
            Scene::of_recording(name, recording, options.recording_frames())
        })
        .collect()
}
