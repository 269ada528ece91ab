//! Plays a scene with one configuration through the plugin, and passes each tick's contacts to the measurement.

use std::{
    hint::black_box,
    mem::size_of,
    sync::Arc,
    time::{Duration, Instant},
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    detection::{CandidateTrianglePairs, MeetingCaps, OverlappingTrianglePairs, StageDiagnostics},
    geometry::{CompactContact, SurfaceTopology, TouchingPair},
    prelude::*,
};
use bevy_ecs::prelude::*;

use circumsphere_examples::headless::{detect, headless_app, move_surface, recording::Recorder};

use super::{HEAP, configurations::Configuration, scene::Scene};

/// Cost of a detection.
#[derive(Clone, Debug)]
pub struct TickCost {
    pub total: Duration,
    pub stages: Vec<StageDiagnostics>,
    pub candidates: usize,
    pub touching_pairs: usize,
    pub contacts: usize,
    pub recipes_refreshed: usize,
}

/// Memory that the app holds after its last tick, in bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    /// Everything allocated since the first surface was spawned.
    pub all: usize,
    /// Lists of pairs of triangles, from the broad phase onwards.
    pub candidate_lists: usize,
    /// Contacts and touching pairs of this tick and the previous one.
    pub contact_lists: usize,
}

/// The results of one tick, while the app still holds them.
pub struct PlayedTick<'a> {
    pub tick: usize,
    pub store: &'a ContactStore,
    surfaces: &'a [Entity],
    pub topologies: &'a [Arc<SurfaceTopology>],
}

impl PlayedTick<'_> {
    /// The index of the body with the given entity.
    pub fn body(&self, entity: Entity) -> usize {
        self.surfaces.iter().position(|&surface| surface == entity).expect("contacts are between bodies of the scene")
    }
}

/// An app with the bodies of a scene.
pub struct Stage {
    app: App,
    surfaces: Vec<Entity>,
    topologies: Vec<Arc<SurfaceTopology>>,
    held: usize,
}

impl Stage {
    pub fn new(scene: &Scene, method: ContactMethod, settings: CircumsphereSettings, distance_edges: f64) -> Self {
        Self::recorded(scene, method, settings, distance_edges, Recorder::default())
    }

    fn recorded(
        scene: &Scene,
        method: ContactMethod,
        settings: CircumsphereSettings,
        distance_edges: f64,
        recorder: Recorder,
    ) -> Self {
        let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, recorder);
        let before = HEAP.current_usage();
        let (thickness, _) = scene.thickness(distance_edges);
        let (mut surfaces, mut topologies) = (Vec::new(), Vec::new());
        for (number, body) in scene.bodies.iter().enumerate() {
            let (surface, positions) =
                DeformableSurface::from_mesh(&body.ticks[0], &body.triangles).expect("the scene has been checked");
            topologies.push(Arc::clone(surface.topology()));
            let sidedness = if body.is_closed { Sidedness::OneSided } else { Sidedness::TwoSided };
            let (name, thickness) = (Name::new(format!("body {number}")), SurfaceThickness::World(thickness));
            let mut entity = app.world_mut().spawn((name, surface, positions, thickness, sidedness, method));
            if body.touches_itself {
                entity.insert(SelfCollision);
            }
            surfaces.push(entity.id());
        }
        Self { app, surfaces, topologies, held: HEAP.current_usage().saturating_sub(before) }
    }

    /// Detects one tick.
    pub fn tick(&mut self, scene: &Scene, tick: usize) -> TickCost {
        let before = HEAP.current_usage();
        for (&surface, body) in self.surfaces.iter().zip(&scene.bodies) {
            move_surface(&mut self.app, surface, body.ticks[tick].clone());
        }
        let (detection, _) = detect(&mut self.app);
        let candidates = self.app.world().resource::<CandidateTrianglePairs>().triangle_pair_count();
        // Read the contacts, because some methods write them only when they are read.
        let start = Instant::now();
        for pair in self.app.world().resource::<ContactStore>().pairs() {
            black_box((pair.contacts.first(), pair.touching.first()));
        }
        let reading = start.elapsed();
        self.held = (self.held + HEAP.current_usage()).saturating_sub(before);
        TickCost {
            total: detection.total + reading,
            candidates,
            touching_pairs: detection.pairs,
            contacts: detection.contacts,
            recipes_refreshed: detection.recipes_refreshed,
            stages: detection.stages,
        }
    }

    /// The results of the last tick.
    pub fn played(&self, tick: usize) -> PlayedTick<'_> {
        let store = self.app.world().resource::<ContactStore>();
        PlayedTick { tick, store, surfaces: &self.surfaces, topologies: &self.topologies }
    }

    pub fn memory(&self) -> Memory {
        let world = self.app.world();
        let candidates = &world.resource::<CandidateTrianglePairs>().pairs();
        let overlapping = &world.resource::<OverlappingTrianglePairs>().pairs();
        let meeting = &world.resource::<MeetingCaps>().pairs();
        let store = world.resource::<ContactStore>();
        let pair = size_of::<[u32; 2]>();
        let (touching, contact) = (size_of::<TouchingPair>(), size_of::<CompactContact>());
        let candidate_lists = candidates.iter().map(|list| list.triangles.capacity() * pair).sum::<usize>()
            + overlapping.iter().map(|list| list.capacity() * pair).sum::<usize>()
            + meeting.iter().map(|list| list.capacity() * pair).sum::<usize>();
        let contact_lists: usize = store
            .pairs()
            .iter()
            .map(|pair| pair.touching.capacity() * touching + pair.contacts.capacity() * contact)
            .sum();
        // The buffers of the previous tick are kept for the next one, and are of the same size.
        let contact_lists = 2 * contact_lists;
        Memory { all: self.held, candidate_lists, contact_lists }
    }
}

/// Plays all ticks in a fresh app, and calls `show` after each.
pub fn play(
    scene: &Scene,
    method: ContactMethod,
    settings: CircumsphereSettings,
    distance_edges: f64,
    mut show: impl FnMut(&PlayedTick),
) -> (Vec<TickCost>, Memory) {
    let mut stage = Stage::new(scene, method, settings, distance_edges);
    let mut costs = Vec::with_capacity(scene.ticks());
    for tick in 0..scene.ticks() {
        costs.push(stage.tick(scene, tick));
        show(&stage.played(tick));
    }
    (costs, stage.memory())
}

/// Plays all ticks with a configuration for the recorder. Nothing is measured, because recording is slow.
pub fn record(scene: &Scene, configuration: &Configuration, recorder: Recorder) {
    let Configuration { method, settings, distance_edges, .. } = configuration;
    let mut stage = Stage::recorded(scene, *method, *settings, *distance_edges, recorder);
    for tick in 0..scene.ticks() {
        stage.tick(scene, tick);
    }
}
