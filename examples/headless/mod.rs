//! The headless app that the examples play meshes in: what is on every example's stage, whatever it measures there.
//!
//! An example adds its surfaces, writes their positions tick by tick and reads what one detection did.

pub mod recording;

use std::time::Duration;

use bevy_app::{PluginGroupBuilder, TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy, prelude::*};
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    detection::{DetectionDiagnostics, StageDiagnostics},
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use glam::Vec3;

use self::recording::Recorder;

/// An app that detects contacts at every update, with as many threads as the settings name, and that `recorder` records.
pub fn headless_app(plugins: PluginGroupBuilder, settings: CircumsphereSettings, recorder: Recorder) -> App {
    let mut app = App::new();
    if settings.threads > 1 {
        // The calling thread works too.
        let workers = settings.threads - 1;
        let compute = TaskPoolThreadAssignmentPolicy {
            min_threads: workers,
            max_threads: workers,
            percent: 1.0,
            on_thread_spawn: None,
            on_thread_destroy: None,
        };
        let task_pool_options = TaskPoolOptions { compute, ..TaskPoolOptions::default() };
        app.add_plugins(TaskPoolPlugin { task_pool_options });
    }
    app.add_plugins(plugins);
    app.insert_resource(settings);
    app.init_resource::<Time>();
    recorder.add_to(&mut app);
    app.finish();
    app.cleanup();
    app
}

/// Gives a surface the positions of the next tick.
pub fn move_surface(app: &mut App, surface: Entity, positions: Vec<Vec3>) {
    if let Some(mut current) = app.world_mut().get_mut::<SurfacePositions>(surface) {
        current.0 = positions;
    }
}

/// What one detection did.
pub struct Detection {
    pub total: Duration,
    pub stages: Vec<StageDiagnostics>,
    pub recipes_refreshed: usize,
    pub pairs: usize,
    pub contacts: usize,
}

/// How much simulated time a detection stands for.
const STEP: Duration = Duration::from_nanos(1_000_000_000 / 60);

/// Detects once, and advances the clock. Also gives the time of first builds of trees, which is no part of the detection's.
pub fn detect(app: &mut App) -> (Detection, Duration) {
    app.update();
    app.world_mut().resource_mut::<Time>().advance_by(STEP);
    let diagnostics = app.world().resource::<DetectionDiagnostics>();
    let store = app.world().resource::<ContactStore>();
    let detection = Detection {
        total: diagnostics.total(),
        stages: diagnostics.stages.clone(),
        recipes_refreshed: diagnostics.recipes_refreshed,
        pairs: store.touching_count(),
        contacts: store.contact_count(),
    };
    (detection, diagnostics.first_tree_builds)
}
