//! The headless app in which the examples play meshes.
//!
//! An example adds its surfaces, writes their positions every tick, and reads the results of detection.

pub mod embedded;
pub mod frames;
pub mod method;
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

/// Exit status for bad input: the shell's convention for wrong usage.
pub const BAD_INPUT: u8 = 2;

/// An app that detects contacts on every update, with the number of threads from the settings. `recorder` records it.
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

/// Sets the positions of a surface for the next tick.
pub fn move_surface(app: &mut App, surface: Entity, positions: Vec<Vec3>) {
    if let Some(mut current) = app.world_mut().get_mut::<SurfacePositions>(surface) {
        current.0 = positions;
    }
}

/// The results of one detection.
pub struct Detection {
    pub total: Duration,
    pub stages: Vec<StageDiagnostics>,
    pub recipes_refreshed: usize,
    /// Occupied cells of a spatial hash, crowded ones, and triangles that are too large for them.
    pub cells: [usize; 3],
    pub pairs: usize,
    pub contacts: usize,
}

/// Simulated time per detection.
const STEP: Duration = Duration::from_nanos(1_000_000_000 / 60);

/// Detects once and advances the clock. Also returns the time of first tree builds, which is not part of the
/// detection's time.
pub fn detect(app: &mut App) -> (Detection, Duration) {
    app.update();
    app.world_mut().resource_mut::<Time>().advance_by(STEP);
    let diagnostics = app.world().resource::<DetectionDiagnostics>();
    let store = app.world().resource::<ContactStore>();
    let detection = Detection {
        total: diagnostics.total(),
        stages: diagnostics.stages.clone(),
        recipes_refreshed: diagnostics.recipes_refreshed,
        cells: [diagnostics.occupied_cells, diagnostics.crowded_cells, diagnostics.large_triangles],
        pairs: store.touching_count(),
        contacts: store.contact_count(),
    };
    (detection, diagnostics.first_tree_builds)
}
