//! Our own methods, measured through the whole plugin in a headless app: cold, after a small motion, and unchanged.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, ContactStore, detection::DetectionDiagnostics, prelude::*};
use bevy_ecs::prelude::*;
use circumsphere_examples::headless::{detect, headless_app, move_surface, recording::Recorder};
use glam::Vec3;

use super::{
    input::{Input, Tick},
    measure::{Contestant, Counts, Level, Log, timed},
};

pub const COLD: &str = "cold tick";
/// A cold tick at the end of the small motion. Moved and unchanged ticks are compared with it, because they find the
/// same pairs.
pub const COLD_MOVED: &str = "cold tick, where the motion ends";
pub const MOVED: &str = "tick, moved by 0.09 contact distances";
/// Moved ticks that reuse a list of near pairs, and moved ticks that make a new one.
pub const FOLLOWED: &str = "of those, with a reused list";
pub const RENEWED: &str = "of those, with a new list";
pub const UNCHANGED: &str = "tick, unchanged";
/// A cold tick of a sphere method that writes contacts with points and normals. Its other rows write distances only.
pub const WITH_POINTS: &str = "cold tick, with points and normals";

/// One method on one number of threads.
pub struct Ours {
    app: App,
    surface: Entity,
    method: ContactMethod,
    threads: usize,
}

pub fn method_name(method: ContactMethod) -> String {
    format!("ours, {method:?}")
}

impl Ours {
    pub fn new(input: &Input, method: ContactMethod, threads: usize) -> Self {
        Self::recorded(input, method, threads, SphereContactDetail::Distances, Recorder::default())
    }

    /// Plays the frames once for the recorder, without measuring.
    pub fn record(input: &Input, method: ContactMethod, recorder: Recorder) {
        let mut ours = Self::recorded(input, method, 1, SphereContactDetail::Points, recorder);
        for tick in &input.ticks {
            move_surface(&mut ours.app, ours.surface, tick.now.clone());
            detect(&mut ours.app);
        }
    }

    /// A method that writes contacts with points and normals.
    pub fn with_points(input: &Input, method: ContactMethod, threads: usize) -> Self {
        Self::recorded(input, method, threads, SphereContactDetail::Points, Recorder::default())
    }

    fn recorded(
        input: &Input,
        method: ContactMethod,
        threads: usize,
        sphere_contacts: SphereContactDetail,
        recorder: Recorder,
    ) -> Self {
        let settings = CircumsphereSettings { threads, sphere_contacts, ..CircumsphereSettings::default() };
        let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, recorder);
        let positions = &input.ticks[0].now;
        let (surface, positions) =
            DeformableSurface::from_mesh(positions, &input.triangles).expect("the mesh has been validated");
        let thickness = SurfaceThickness::World(input.thickness());
        let parts = (surface, positions, SelfCollision, thickness, Sidedness::TwoSided, method);
        let surface = app.world_mut().spawn(parts).id();
        // Build the trees in this first tick. The other libraries also build theirs before the measurement.
        detect(&mut app);
        Self { app, surface, method, threads }
    }

    fn counts(&self) -> Counts {
        let world = self.app.world();
        let (store, diagnostics) = (world.resource::<ContactStore>(), world.resource::<DetectionDiagnostics>());
        Counts {
            box_pairs: None,
            // Box pairs that are not neighbors, before slabs drop most of them.
            apart: diagnostics
                .stages
                .iter()
                .find(|stage| stage.name == "broad phase")
                .map(|stage| stage.pairs_in as u64),
            tested: Some(diagnostics.pairs_examined as u64).filter(|_| self.method.is_exact()),
            touching: Some(store.touching_count() as u64),
            contacts: Some(store.contact_count() as u64),
        }
    }

    /// Teleports the mesh, so that no earlier results are reused.
    fn jump(&mut self, positions: &[Vec3]) {
        move_surface(&mut self.app, self.surface, positions.to_vec());
        self.app.world_mut().entity_mut(self.surface).insert(Teleported);
    }

    /// A cold tick that is not measured.
    fn jump_and_update(&mut self, positions: &[Vec3]) {
        self.jump(positions);
        self.app.update();
    }

    /// Logs a whole tick.
    fn log(&self, what: &str, duration: Duration, log: &mut Log) {
        log.add(&method_name(self.method), what, self.threads, Level::Whole, duration, self.counts());
    }

    /// Measures one tick: the whole update, and optionally its stages.
    fn measure(&mut self, what: &str, log: &mut Log, with_stages: bool) {
        let (duration, ()) = timed(|| self.app.update());
        self.log(what, duration, log);
        let who = method_name(self.method);
        if with_stages {
            for stage in &self.app.world().resource::<DetectionDiagnostics>().stages {
                log.add(&who, stage.name, self.threads, Level::Part, stage.duration, Counts::default());
            }
        }
    }
}

impl Contestant for Ours {
    fn name(&self) -> String {
        format!("{} ({} threads)", method_name(self.method), self.threads)
    }

    fn run(&mut self, _: usize, tick: &Tick, log: &mut Log) -> Result<(), String> {
        // A cold tick: the mesh teleports from another shape.
        self.jump_and_update(&tick.before);
        self.jump(&tick.now);
        self.measure(COLD, log, true);
        // The baseline never reuses results, so only its cold tick is of interest.
        if self.method == ContactMethod::Polygon {
            return Ok(());
        }
        let mut ticks = [(FOLLOWED, Duration::ZERO, 0), (RENEWED, Duration::ZERO, 0)];
        for positions in &tick.drift {
            move_surface(&mut self.app, self.surface, positions.clone());
            let (duration, ()) = timed(|| self.app.update());
            let is_followed = self.app.world().resource::<DetectionDiagnostics>().lists_reused > 0;
            let (_, sum, count) = &mut ticks[usize::from(!is_followed)];
            (*sum, *count) = (*sum + duration, *count + 1);
        }
        // The mean over all ticks, because updating the lists of near pairs is part of the cost.
        let [(_, followed, followed_count), (_, renewed, renewed_count)] = ticks;
        let (who, mean) = (method_name(self.method), (followed + renewed) / (followed_count + renewed_count));
        self.log(MOVED, mean, log);
        for (what, sum, count) in ticks.into_iter().filter(|(.., count)| followed_count > 0 && *count > 0) {
            log.add(&who, what, self.threads, Level::Part, sum / count, Counts::default());
        }
        self.measure(UNCHANGED, log, false);
        self.jump_and_update(&tick.before);
        self.jump(&tick.drift[tick.drift.len() - 1]);
        self.measure(COLD_MOVED, log, false);
        Ok(())
    }
}

/// A sphere method in an app that writes contacts with points and normals.
pub struct WithPoints(pub Ours);

impl Contestant for WithPoints {
    fn name(&self) -> String {
        format!("{}, with points", self.0.name())
    }

    fn run(&mut self, _: usize, tick: &Tick, log: &mut Log) -> Result<(), String> {
        let Self(ours) = self;
        ours.jump_and_update(&tick.before);
        ours.jump(&tick.now);
        ours.measure(WITH_POINTS, log, false);
        Ok(())
    }
}
