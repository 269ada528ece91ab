//! Garments (feature `mesh`): cloth parts of characters whose meshes are loaded. Makes their bodies and tethers once the
//! meshes have become surfaces.
//!
//! Between surfaces from meshes and the snapshot of the tick: meshes and posed surfaces come in, components go out.

mod components;
mod dress;
mod error;
mod find;
mod fit;
mod freedom;

use bevy_app::prelude::*;
use bevy_ecs::{prelude::*, schedule::InternedScheduleLabel};

use crate::{
    schedule::DeformableSystems,
    surface::{GatherSurfaces, MeshSystems, OwnMeshes},
};
pub use components::{GarmentPaint, XpbdGarment, XpbdGarments};
pub use error::{XpbdGarmentError, XpbdGarmentNotWorn};

/// Adds the systems that find garments and dress characters.
pub(super) fn build(app: &mut App, schedule: InternedScheduleLabel) {
    OwnMeshes::init(app);
    app.add_message::<XpbdGarmentNotWorn>();
    app.add_systems(
        schedule,
        (
            (
                find::find_garments
                    .run_if(any_with_component::<XpbdGarments>)
                    .after(MeshSystems::Find)
                    .before(MeshSystems::Read),
                dress::dress.run_if(any_with_component::<XpbdGarment>).after(MeshSystems::Read).before(GatherSurfaces),
            )
                .in_set(DeformableSystems::Prepare),
            fit::warn_of_crossings
                .run_if(any_with_component::<XpbdGarment>)
                .after(DeformableSystems::Detect)
                .before(DeformableSystems::Respond),
        ),
    );
}
