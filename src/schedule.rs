//! Sets and schedules. A schedule of the game's choice hosts [`DeformableSystems`]. The detection stages run in a
//! schedule of their own, [`SurfaceDetection`].

use std::{any::type_name, marker::PhantomData};

use bevy_app::prelude::*;
use bevy_ecs::{
    prelude::*,
    schedule::{InternedScheduleLabel, LogLevel, ScheduleBuildSettings, ScheduleLabel, SingleThreadedExecutor},
};

/// The sets of one tick, in this order. They run in the schedule that was passed to
/// [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins).
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum DeformableSystems {
    /// Validates and gathers positions, poses, and settings. Write [`SurfacePositions`](crate::SurfacePositions) before
    /// this.
    Prepare,
    /// For systems that predict positions before contacts are detected.
    Predict,
    /// Runs the schedule [`SurfaceDetection`]. Read contacts after this.
    Detect,
    /// For systems that respond to contacts.
    Respond,
    /// For systems that write the response to positions.
    Writeback,
    /// Writes messages and runs observers.
    Events,
    /// For systems that record the tick.
    Log,
}

/// The schedule of the detection stages. Runs in [`DeformableSystems::Detect`], and can be run by hand.
#[derive(ScheduleLabel, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SurfaceDetection;

/// The stages of [`SurfaceDetection`], in this order. Each reads what earlier ones wrote, and writes its own results.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SurfaceDetectionSystems {
    /// Computes the boxes of surfaces, and of their triangles if those were needed last time. Others are computed on
    /// demand.
    Bounds,
    /// Finds pairs of surfaces, then pairs of triangles whose boxes overlap and that no slab separates.
    BroadPhase,
    /// Computes curvature and dihedral angles of triangles.
    Curvature,
    /// Refits spheres and cones of triangles.
    Refit,
    /// Finds pairs whose spheres overlap.
    Overlap,
    /// Finds pairs that pass the cone test.
    Cone,
    /// Tests pairs exactly.
    Exact,
    /// Finds the first impacts of fast surfaces with [`SweptCollision`](crate::SweptCollision). Finds its own pairs
    /// from what surfaces sweep, and does not change those of the other stages.
    Swept,
    /// Keeps contacts on their sides, gathers them, and stores them.
    Contacts,
}

/// The schedule that hosts [`DeformableSystems`], for plugins that add systems to it.
#[derive(Resource, Clone, Copy)]
pub(crate) struct HostSchedule(pub(crate) InternedScheduleLabel);

/// Marks a plugin whose systems are in the host schedule.
#[derive(Resource)]
struct Hosted<P: Send + Sync + 'static>(PhantomData<P>);

/// Adds the systems of a plugin to the host schedule, once: when the plugin is built, if the schedule is known, otherwise when
/// it is finished. So plugins can be added in any order.
///
/// # Panics
/// In `finish`, without [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins).
pub(crate) fn add_to_host_schedule<P: Plugin>(
    app: &mut App,
    is_finished: bool,
    add: impl FnOnce(&mut App, InternedScheduleLabel),
) {
    if app.world().contains_resource::<Hosted<P>>() {
        return;
    }
    if let Some(&HostSchedule(schedule)) = app.world().get_resource() {
        app.insert_resource(Hosted::<P>(PhantomData));
        add(app, schedule);
    } else {
        let name = type_name::<P>().rsplit("::").next().unwrap_or_default();
        assert!(!is_finished, "{name} works on what DeformableCollisionPlugins detect: add DeformableCollisionPlugins");
    }
}

/// Sets up the schedule and the sets. Every other plugin of the group depends on it.
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
                // The stages depend on one another. Each distributes its own work over the task pool.
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
                        SurfaceDetectionSystems::Exact,
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
