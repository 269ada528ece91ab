//! Surfaces from Bevy's mesh assets (feature `mesh`): makes them once the assets are loaded, moves them where Bevy
//! draws the meshes, skinned and morphed, and writes what the response moved back into the meshes.

mod components;
mod drive;
mod error;
mod hierarchy;
mod joints;
mod own;
mod read;
mod source;
mod write;

use bevy_app::prelude::*;
use bevy_asset::AssetEventSystems;
use bevy_ecs::{
    prelude::*,
    schedule::{InternedScheduleLabel, ScheduleLabel},
};

use self::source::MeshSources;
use super::prepare::GatherSurfaces;
use crate::schedule::DeformableSystems;
pub use components::{SurfaceFromMesh, SurfaceFromMeshHierarchy, SurfaceSettings, WriteSurfaceToMesh};
pub use drive::DrivenMesh;
pub use error::{SurfaceMeshError, SurfaceMeshNotWritten};
pub use joints::SurfaceJoints;
pub(crate) use own::OwnMeshes;

/// What is done in [`DeformableSystems::Prepare`] before surfaces are gathered.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum MeshSystems {
    /// Finds the meshes below roots.
    Find,
    /// Makes and moves surfaces.
    Read,
}

/// Makes surfaces from meshes. Part of [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins) if the
/// feature `mesh` is on. May be added before or after the plugins that bring the assets. Without these, surfaces from
/// meshes are quarantined with [`SurfaceMeshError::NoAssets`].
pub struct SurfaceMeshPlugin {
    schedule: InternedScheduleLabel,
}

impl SurfaceMeshPlugin {
    /// Makes them in `schedule`, which must be the schedule of the other plugins.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Plugin for SurfaceMeshPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<MeshSources>().add_message::<SurfaceMeshNotWritten>();
        let find_meshes = hierarchy::find_meshes.run_if(any_with_component::<SurfaceFromMeshHierarchy>);
        app.add_systems(
            self.schedule,
            (
                (find_meshes.in_set(MeshSystems::Find), read::read_meshes.in_set(MeshSystems::Read))
                    .chain()
                    .before(GatherSurfaces),
                read::report_failures.after(GatherSurfaces),
            )
                .in_set(DeformableSystems::Prepare),
        );
        app.add_systems(
            self.schedule,
            (write::write_meshes, drive::drive_meshes)
                .chain()
                .after(DeformableSystems::Writeback)
                .before(DeformableSystems::Events)
                // In `PostUpdate`, where Bevy announces changes to the renderer: otherwise it draws them a frame late.
                .before(AssetEventSystems),
        );
    }
}
