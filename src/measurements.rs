//! What the stages cost and find, as entries of `bevy_diagnostic`: for overlays and logs of the whole app.

use bevy_app::prelude::*;
use bevy_diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, DiagnosticsStore, RegisterDiagnostic};
use bevy_ecs::{
    prelude::*,
    schedule::{InternedScheduleLabel, ScheduleLabel},
};

use crate::{
    contacts::ContactStore,
    diagnostics::{DetectionDiagnostics, StageDiagnostics},
    response::XpbdDiagnostics,
    schedule::DeformableSystems,
};

/// Adds measurements to the [`DiagnosticsStore`] once a tick, of all stages of
/// [`DetectionDiagnostics`](crate::detection::DetectionDiagnostics) and of
/// [`XpbdDiagnostics`](crate::response::XpbdDiagnostics). Add it after
/// [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins), in the same schedule.
///
/// | path | measurement |
/// |---|---|
/// | `collision/time` | the whole detection, in milliseconds |
/// | `collision/contacts`, `collision/touching` | contacts, and touching pairs of triangles |
/// | `collision/STAGE/time` | a stage, in milliseconds, 0 if it did not run |
/// | `collision/STAGE/pairs_in`, `collision/STAGE/pairs_out` | the pairs that went into it and came out, see [`StageDiagnostics`](crate::detection::StageDiagnostics) |
/// | `collision/response/gather/time`, `…/solve/time`, `…/guard/time` | the steps of the response, in milliseconds, if the app has one |
/// | `collision/response/bodies`, `…/asleep`, `…/contacts`, `…/impacts` | what the response moved, and what it met |
///
/// `STAGE` is one of [`STAGES`](Self::STAGES), with underscores for spaces: `collision/broad_phase/time`.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::{CollisionDiagnosticsPlugin, prelude::*};
/// # use bevy_diagnostic::{DiagnosticPath, DiagnosticsStore};
/// let mut app = App::new();
/// app.add_plugins((DeformableCollisionPlugins::new(Update), CollisionDiagnosticsPlugin::new(Update)));
/// app.update();
/// let store = app.world().resource::<DiagnosticsStore>();
/// let time = store.get_measurement(&DiagnosticPath::new("collision/contacts/time"));
/// assert!(time.is_some_and(|time| time.value >= 0.0));
/// ```
pub struct CollisionDiagnosticsPlugin {
    schedule: InternedScheduleLabel,
}

impl CollisionDiagnosticsPlugin {
    /// The stages that have entries, by their names in [`StageDiagnostics`](crate::detection::StageDiagnostics).
    pub const STAGES: [&str; 17] = [
        "prepare",
        "containments",
        "bounds",
        "pair surfaces",
        "patches",
        "tree update",
        "normal cones",
        "broad phase",
        "filter",
        "curvature",
        "refit balls",
        "refit",
        "overlap",
        "cone",
        "exact",
        "swept",
        "contacts",
    ];

    /// Measures in `schedule`.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Plugin for CollisionDiagnosticsPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<DiagnosticsStore>();
        let paths = Paths::new();
        for path in paths.times() {
            app.register_diagnostic(Diagnostic::new(path.clone()).with_suffix("ms"));
        }
        for path in paths.counts() {
            app.register_diagnostic(Diagnostic::new(path.clone()));
        }
        app.insert_resource(paths);
        app.add_systems(self.schedule, (measure_detection, measure_response).in_set(DeformableSystems::Log));
    }

    fn finish(&self, app: &mut App) {
        if !app.world().contains_resource::<XpbdDiagnostics>() {
            let Some(paths) = app.world().get_resource::<Paths>() else { return };
            let of_response: Vec<DiagnosticPath> = paths.response.iter().chain(&paths.of_bodies).cloned().collect();
            let mut store = app.world_mut().resource_mut::<DiagnosticsStore>();
            for path in of_response {
                if let Some(diagnostic) = store.get_mut(&path) {
                    diagnostic.is_enabled = false;
                }
            }
        }
    }
}

/// The paths of all entries.
#[derive(Resource)]
struct Paths {
    total: DiagnosticPath,
    contacts: [DiagnosticPath; 2],
    /// For each stage: its time, and the pairs that go in and come out.
    stages: Vec<[DiagnosticPath; 3]>,
    /// Times of the response.
    response: [DiagnosticPath; 3],
    /// Counts of the response.
    of_bodies: [DiagnosticPath; 4],
}

impl Paths {
    fn new() -> Self {
        let path = |name: &str| DiagnosticPath::new(format!("collision/{name}"));
        let of_stage = |stage: &str| {
            ["time", "pairs_in", "pairs_out"].map(|what| path(&format!("{}/{what}", stage.replace(' ', "_"))))
        };
        Self {
            total: path("time"),
            contacts: ["contacts", "touching"].map(path),
            stages: CollisionDiagnosticsPlugin::STAGES.into_iter().map(of_stage).collect(),
            response: ["gather", "solve", "guard"].map(|step| path(&format!("response/{step}/time"))),
            of_bodies: ["bodies", "asleep", "contacts", "impacts"].map(|what| path(&format!("response/{what}"))),
        }
    }

    fn times(&self) -> impl Iterator<Item = &DiagnosticPath> {
        let of_stages = self.stages.iter().map(|[time, ..]| time);
        of_stages.chain([&self.total]).chain(&self.response)
    }

    fn counts(&self) -> impl Iterator<Item = &DiagnosticPath> {
        let of_stages = self.stages.iter().flat_map(|[_, counts @ ..]| counts);
        of_stages.chain(&self.contacts).chain(&self.of_bodies)
    }
}

fn measure_detection(
    paths: Res<Paths>,
    detection: Res<DetectionDiagnostics>,
    store: Res<ContactStore>,
    mut diagnostics: Diagnostics,
) {
    diagnostics.add_measurement(&paths.total, || milliseconds(detection.total()));
    diagnostics.add_measurement(&paths.contacts[0], || store.contact_count() as f64);
    diagnostics.add_measurement(&paths.contacts[1], || store.touching_count() as f64);
    for ([time, pairs_in, pairs_out], name) in paths.stages.iter().zip(CollisionDiagnosticsPlugin::STAGES) {
        // A stage runs once in a detection. With the response, several detections may be in a tick: the last one counts.
        let stage = || detection.stages.iter().rev().find(|stage| stage.name == name);
        let count = |of: fn(&StageDiagnostics) -> usize| stage().map_or(0.0, |stage| of(stage) as f64);
        diagnostics.add_measurement(time, || stage().map_or(0.0, |stage| milliseconds(stage.duration)));
        diagnostics.add_measurement(pairs_in, || count(|stage| stage.pairs_in));
        diagnostics.add_measurement(pairs_out, || count(|stage| stage.pairs_out));
    }
}

fn measure_response(paths: Res<Paths>, response: Option<Res<XpbdDiagnostics>>, mut diagnostics: Diagnostics) {
    let Some(response) = response else { return };
    let times = [response.gathering, response.solving, response.guarding];
    for (path, time) in paths.response.iter().zip(times) {
        diagnostics.add_measurement(path, || milliseconds(time));
    }
    let counts = [response.bodies, response.asleep, response.contacts, response.impacts];
    for (path, count) in paths.of_bodies.iter().zip(counts) {
        diagnostics.add_measurement(path, || count as f64);
    }
}

fn milliseconds(duration: core::time::Duration) -> f64 {
    duration.as_secs_f64() * 1.0e3
}
