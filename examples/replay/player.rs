//! Plays a recording in a headless app.

use std::{
    collections::HashMap,
    time::{Duration, Instant},
};

use bevy_app::{PluginGroupBuilder, prelude::*};
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    detection::{
        BroadPhasePlugin, BruteForceBroadPhasePlugin, HierarchicalSpatialHashBroadPhasePlugin,
        SpatialHashBroadPhasePlugin, TreeBroadPhasePlugin,
    },
    geometry::{SurfaceTopology, TopologyError},
    prelude::*,
};
use bevy_ecs::{prelude::*, system::SystemState};
use circumsphere_examples::headless::{Detection, detect, headless_app, move_surface, recording::Recorder};
use circumsphere_support::recording::Recording;
use circumsphere_truth::ParryBroadPhasePlugin;
use glam::Vec3;
use indicatif::{ProgressBar, ProgressStyle};

use super::{
    options::{BroadPhase, Options, Settings, Surfaces},
    output::OutputError,
};

/// A part of the recorded mesh that becomes a separate surface. Its elements are numbered as in the file.
pub struct Part {
    pub name: String,
    pub vertices: Vec<u32>,
    pub triangles: Vec<u32>,
    local_triangles: Vec<[u32; 3]>,
}

impl Part {
    fn empty(name: String) -> Self {
        Self { name, vertices: Vec::new(), triangles: Vec::new(), local_triangles: Vec::new() }
    }

    fn positions(&self, frame: &[[f32; 3]]) -> Vec<Vec3> {
        self.vertices.iter().map(|&vertex| Vec3::from_array(frame[vertex as usize])).collect()
    }
}

/// The recorded mesh as surfaces.
pub struct Scene {
    parts: Vec<Part>,
    topology: SurfaceTopology,
    first_frame: Vec<Vec3>,
}

impl Scene {
    /// `names` are the names of the connected components. Components without one are numbered.
    pub fn new(recording: &Recording, options: &Options, names: &[&str]) -> Result<Self, TopologyError> {
        let first_frame: Vec<Vec3> = recording.frames[0].iter().copied().map(Vec3::from_array).collect();
        let topology = SurfaceTopology::new(&first_frame, &recording.triangles)?;
        let parts = match options.surfaces {
            Surfaces::Whole => vec![Part {
                name: "mesh".to_owned(),
                vertices: (0..first_frame.len() as u32).collect(),
                triangles: (0..recording.triangles.len() as u32).collect(),
                local_triangles: recording.triangles.clone(),
            }],
            Surfaces::Components => split(&topology, names),
        };
        Ok(Self { parts, topology, first_frame })
    }

    pub fn mean_edge(&self) -> f64 {
        self.topology.mean_edge_length(&self.first_frame)
    }
}

/// One part per connected component, in the order of their first triangles.
fn split(topology: &SurfaceTopology, names: &[&str]) -> Vec<Part> {
    let (component, count) = topology.components();
    let name = |number: usize| names.get(number).map_or_else(|| format!("component {number}"), |&name| name.to_owned());
    let mut parts: Vec<Part> = (0..count).map(|number| Part::empty(name(number))).collect();
    let mut local = HashMap::new();
    for (triangle, corners) in topology.triangles().iter().enumerate() {
        let part = &mut parts[component[triangle] as usize];
        part.triangles.push(triangle as u32);
        part.local_triangles.push(corners.map(|vertex| {
            *local.entry(vertex).or_insert_with(|| {
                part.vertices.push(vertex);
                part.vertices.len() as u32 - 1
            })
        }));
    }
    parts
}

/// All detections of one frame.
pub struct PlayedFrame {
    pub frame: usize,
    pub detections: Vec<Detection>,
}

/// The results of playing.
pub struct Played {
    /// Time to build adjacency and first trees, once per app.
    pub builds: Vec<Duration>,
    pub frames: Vec<PlayedFrame>,
}

/// The contacts of a frame, with the parts that map them to the numbers of the file.
pub struct FrameContacts<'a> {
    pub parts: &'a HashMap<Entity, &'a Part>,
    pub store: &'a ContactStore,
    pub contacts: &'a SurfaceContacts<'a>,
}

/// Plays the frames. `recorder` records the first app. `write` is called once per frame with the contacts.
pub fn play(
    recording: &Recording,
    scene: &Scene,
    settings: &Settings,
    recorder: Recorder,
    mut write: impl FnMut(usize, &FrameContacts) -> Result<(), OutputError>,
) -> Result<Played, OutputError> {
    let mut played = Played {
        builds: Vec::new(),
        frames: settings.frames.clone().map(|frame| PlayedFrame { frame, detections: Vec::new() }).collect(),
    };
    let (apps, repeats) = if settings.warm { (1, settings.repeat) } else { (settings.repeat, 1) };
    let progress = ProgressBar::new(u64::from(settings.repeat) * played.frames.len() as u64).with_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} detections, {eta} left")
            .expect("the template is well formed"),
    );
    let mut recorder = Some(recorder);
    for round in 0..apps {
        let start = Instant::now();
        let mut stage = Stage::new(recording, scene, settings, recorder.take().unwrap_or_default());
        let mut build = start.elapsed();
        for (place, frame) in played.frames.iter_mut().enumerate() {
            for repeat in 0..repeats {
                let (detection, first_tree_builds) = stage.detect(&recording.frames[frame.frame]);
                frame.detections.push(detection);
                if place == 0 && repeat == 0 {
                    build += first_tree_builds;
                }
                progress.inc(1);
            }
            if round == 0 {
                stage.read(|contacts| write(frame.frame, contacts))?;
            }
        }
        played.builds.push(build);
    }
    progress.finish_and_clear();
    Ok(played)
}

/// Replaces the tree by another broad phase.
fn with_broad_phase(plugins: PluginGroupBuilder, broad_phase: BroadPhase) -> PluginGroupBuilder {
    let plugins = match broad_phase {
        BroadPhase::Tree => return plugins,
        _ => plugins.disable::<TreeBroadPhasePlugin>(),
    };
    match broad_phase {
        BroadPhase::Tree => plugins,
        BroadPhase::SpatialHash => plugins.add_after::<BroadPhasePlugin>(SpatialHashBroadPhasePlugin::default()),
        BroadPhase::HierarchicalHash => {
            plugins.add_after::<BroadPhasePlugin>(HierarchicalSpatialHashBroadPhasePlugin::default())
        }
        BroadPhase::BruteForce => plugins.add_after::<BroadPhasePlugin>(BruteForceBroadPhasePlugin),
        BroadPhase::Parry => plugins.add_after::<BroadPhasePlugin>(ParryBroadPhasePlugin),
    }
}

/// An app with the surfaces.
struct Stage<'a> {
    app: App,
    surfaces: Vec<(Entity, &'a Part)>,
    parts: HashMap<Entity, &'a Part>,
    contacts: SystemState<SurfaceContacts<'static>>,
}

impl<'a> Stage<'a> {
    fn new(recording: &Recording, scene: &'a Scene, settings: &Settings, recorder: Recorder) -> Self {
        let plugins = DeformableCollisionPlugins::new(Update).build();
        let plugins = with_broad_phase(plugins, settings.broad_phase);
        let circumsphere_settings = CircumsphereSettings {
            sphere_offset: settings.sphere_offset,
            refit_threshold: settings.refit_threshold,
            curvature_threshold: settings.curvature_threshold,
            plane_cull: settings.plane_cull,
            widen_cones: settings.widen_cones,
            estimator: settings.estimator.into(),
            threads: settings.threads,
            // A frame that is detected again counts as one that has moved.
            memory: !settings.warm,
            ..CircumsphereSettings::default()
        };
        let mut app = headless_app(plugins, circumsphere_settings, recorder);
        let surfaces: Vec<(Entity, &Part)> = scene
            .parts
            .iter()
            .map(|part| {
                // Weld at the first frame of the file, whichever frames are played.
                let positions = part.positions(&recording.frames[0]);
                let (surface, _) = DeformableSurface::from_mesh(&positions, &part.local_triangles)
                    .expect("the whole mesh has been validated");
                // A recording is one mesh. Splitting it into surfaces must not change its contacts.
                let sidedness = Sidedness::TwoSided;
                let thickness = SurfaceThickness::World((0.5 * settings.contact_distance) as f32);
                let entity = app
                    .world_mut()
                    .spawn((
                        Name::new(part.name.clone()),
                        surface,
                        SelfCollision,
                        thickness,
                        sidedness,
                        ContactMethod::from(settings.method),
                        if settings.smooth { SurfaceShape::Smooth } else { SurfaceShape::Flat },
                    ))
                    .id();
                (entity, part)
            })
            .collect();
        let parts = surfaces.iter().copied().collect();
        let contacts = SystemState::new(app.world_mut());
        Self { app, surfaces, parts, contacts }
    }

    fn detect(&mut self, frame: &[[f32; 3]]) -> (Detection, Duration) {
        for &(entity, part) in &self.surfaces {
            move_surface(&mut self.app, entity, part.positions(frame));
        }
        detect(&mut self.app)
    }

    fn read<T>(&mut self, read: impl FnOnce(&FrameContacts) -> T) -> T {
        let world = self.app.world();
        let contacts = self.contacts.get(world).expect("the plugins insert the contact store");
        read(&FrameContacts { parts: &self.parts, store: world.resource::<ContactStore>(), contacts: &contacts })
    }
}
