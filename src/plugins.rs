//! The plugin group that a game adds.

use bevy_app::{PluginGroup, PluginGroupBuilder, prelude::*};
use bevy_ecs::schedule::{InternedScheduleLabel, ScheduleLabel};

use crate::{
    contacts::{ContactEventsPlugin, ContactsPlugin},
    detection::{
        BoundsPlugin, BroadPhasePlugin, ConePlugin, CurvaturePlugin, ExactPlugin, NormalConeCullingPlugin,
        OverlapPlugin, RefitPlugin, SweptPlugin, TreeBroadPhasePlugin,
    },
    schedule::DeformableSchedulePlugin,
    surface::SurfacePlugin,
};

/// All plugins that detection needs. Adds no clock, task pool, or transform plugin: the app brings those that it uses.
///
/// Runs in [`FixedPostUpdate`] by default, for positions that a fixed-step simulation writes. Use `new(PostUpdate)` for
/// characters that are animated in `PostUpdate`, and `new(Update)` for headless tests.
pub struct DeformableCollisionPlugins {
    schedule: InternedScheduleLabel,
}

impl DeformableCollisionPlugins {
    /// Detects contacts in `schedule`.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for DeformableCollisionPlugins {
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

impl PluginGroup for DeformableCollisionPlugins {
    fn build(self) -> PluginGroupBuilder {
        let plugins = PluginGroupBuilder::start::<Self>()
            .add(DeformableSchedulePlugin::new(self.schedule))
            .add(SurfacePlugin::new(self.schedule))
            .add(BoundsPlugin)
            .add(BroadPhasePlugin)
            .add(TreeBroadPhasePlugin)
            .add(NormalConeCullingPlugin)
            .add(CurvaturePlugin)
            .add(RefitPlugin)
            .add(OverlapPlugin)
            .add(ConePlugin)
            .add(ExactPlugin)
            .add(SweptPlugin)
            .add(ContactsPlugin)
            .add(ContactEventsPlugin::new(self.schedule));
        #[cfg(feature = "mesh")]
        let plugins = plugins.add(crate::surface::SurfaceMeshPlugin::new(self.schedule));
        #[cfg(feature = "reflect")]
        let plugins = plugins.add(crate::reflect::ReflectPlugin);
        plugins
    }
}
