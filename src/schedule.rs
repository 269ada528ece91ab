//! When things run: one schedule of the game's choice hosts the sets, and a schedule of our own holds the stages.

use bevy_app::prelude::*;
use bevy_ecs::{
    prelude::*,
    schedule::{InternedScheduleLabel, LogLevel, ScheduleBuildSettings, ScheduleLabel, SingleThreadedExecutor},
};

/// What happens to deformable surfaces in one tick, in this order, in the schedule that was given to
/// [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins).
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DeformableSystems {
    /// Positions, poses and settings are validated and gathered. Write [`SurfacePositions`](crate::SurfacePositions)
    /// before this.
    Prepare,
    /// For systems that guess where positions will be, before contacts are looked for.
    Predict,
    /// Runs the schedule [`SurfaceDetection`]. Read contacts after this.
    Detect,
    /// For systems that answer contacts.
    Respond,
    /// For systems that write the answer to positions.
    Writeback,
    /// Messages are written and observers run.
    Events,
    /// For systems that record the tick.
    Log,
}

/// The schedule of the detection stages. It runs in [`DeformableSystems::Detect`], and can be run by hand.
#[derive(ScheduleLabel, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SurfaceDetection;

/// The stages of [`SurfaceDetection`], in this order. Each reads what earlier ones wrote and writes its own.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SurfaceDetectionSystems {
    /// Boxes of surfaces, and of the triangles of those that something was near last time; others' follow when asked for.
    Bounds,
    /// Pairs of surfaces, then pairs of triangles whose boxes overlap and that no slab parts.
    BroadPhase,
    /// Curvature and dihedral angles of triangles.
    Curvature,
    /// Spheres and cones of triangles.
    Refit,
    /// Pairs whose spheres overlap.
    Overlap,
    /// Pairs that pass the cone test.
    Cone,
    /// Pairs tested exactly.
    Refine,
    /// First impacts of fast surfaces, of those with [`SweptCollision`](crate::SweptCollision). It finds pairs of its own
    /// by what surfaces sweep, and leaves those of the other stages as they are.
    Swept,
    /// Contacts kept on their sides, gathered and stored.
    Contacts,
}

/// The schedule that hosts [`DeformableSystems`], for plugins that add to it.
#[derive(Resource, Clone, Copy)]
#[cfg_attr(not(feature = "rerun"), expect(dead_code, reason = "only plugins outside of the group have to ask"))]
pub(crate) struct HostSchedule(pub(crate) InternedScheduleLabel);

/// Sets up the schedule and the sets; every other plugin of the group builds on it.
pub struct DeformableSchedulePlugin {
    schedule: InternedScheduleLabel,
}

impl DeformableSchedulePlugin {
    /// Hosts the sets in `schedule`.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Plugin for DeformableSchedulePlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(HostSchedule(self.schedule));
        app.configure_sets(
            self.schedule,
            (
                DeformableSystems::Prepare,
                DeformableSystems::Predict,
                DeformableSystems::Detect,
                DeformableSystems::Respond,
                DeformableSystems::Writeback,
                DeformableSystems::Events,
                DeformableSystems::Log,
            )
                .chain(),
        );
        app.edit_schedule(SurfaceDetection, |schedule| {
            schedule
                // The stages depend on one another, and spread their own work over the task pool.
                .set_executor(SingleThreadedExecutor::new())
                .set_build_settings(ScheduleBuildSettings {
                    ambiguity_detection: LogLevel::Error,
                    ..ScheduleBuildSettings::default()
                })
                .configure_sets(
                    (
                        SurfaceDetectionSystems::Bounds,
                        SurfaceDetectionSystems::BroadPhase,
                        SurfaceDetectionSystems::Curvature,
                        SurfaceDetectionSystems::Refit,
                        SurfaceDetectionSystems::Overlap,
                        SurfaceDetectionSystems::Cone,
                        SurfaceDetectionSystems::Refine,
                        SurfaceDetectionSystems::Swept,
                        SurfaceDetectionSystems::Contacts,
                    )
                        .chain(),
                );
        });
        app.add_systems(self.schedule, run_detection.in_set(DeformableSystems::Detect));
    }

    fn finish(&self, app: &mut App) {
        let fixed = [
            FixedFirst.intern(),
            FixedPreUpdate.intern(),
            FixedUpdate.intern(),
            FixedPostUpdate.intern(),
            FixedLast.intern(),
        ];
        let has_clock = app.world().contains_resource::<bevy_time::Time<bevy_time::Fixed>>();
        if fixed.contains(&self.schedule) && !has_clock {
            log::warn!(
                "deformable surfaces are detected in {:?}, but the app has no fixed clock, so nothing will run: add \
                 TimePlugin, or use DeformableCollisionPlugins::new(Update)",
                self.schedule
            );
        }
    }
}

pub(crate) fn run_detection(world: &mut World) {
    world.run_schedule(SurfaceDetection);
}
