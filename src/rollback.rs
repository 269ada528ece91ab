//! What the plugins remember from tick to tick and results depend on, as one value that can be saved and put back.
//!
//! Caches that only save time are not in it: they notice by themselves that positions have changed. At the end of a tick
//! the history is collected; at the beginning of the next one it is handed out again if the game has replaced it.

use bevy_app::prelude::*;
use bevy_ecs::{
    change_detection::Tick,
    entity::EntityHashMap,
    prelude::*,
    schedule::{InternedScheduleLabel, ScheduleLabel},
};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

#[cfg(test)]
mod tests;

use crate::{
    contacts::{ContactStore, TouchingSides},
    detection::{DetectionMemory, SweptHistory},
    response::ResponseHistory,
    schedule::DeformableSystems,
    surface::{Circumspheres, PreviousPositions, SurfaceStatus},
};

/// Everything that the plugins remember and that later contacts, messages, and motions depend on: on which side sheets
/// were, what touches, where things were in the last tick, how long bodies have been at rest. For games that go back in
/// time, as `bevy_ggrs` does for the network.
///
/// Add [`RollbackPlugin`], which writes this resource at the end of each tick. To go back to the end of a tick, put back
/// its clone of that tick together with the components that you save anyway: [`SurfacePositions`](crate::SurfacePositions),
/// `Transform`, what the game inserts and removes, such as [`SurfaceDisabled`](crate::SurfaceDisabled), and with the
/// response [`XpbdBody`](crate::response::XpbdBody), [`XpbdTethers`](crate::response::XpbdTethers), and `Time`. The next tick then goes on from there: contacts, messages,
/// and positions are those of the first time, to the last bit.
///
/// - With `bevy_ggrs`: `app.rollback_resource_with_clone::<CollisionHistory>()`, and the same for the components.
/// - By hand: clone the resource, and insert the clone later.
/// - Without it, after components were put back, what is remembered comes from a future that has not happened. Insert
///   [`Teleported`](crate::Teleported) on what has moved: nothing is remembered of it then.
///
/// Do not put back [`DeformableSurface`](crate::DeformableSurface) and [`SurfaceFrame`](crate::SurfaceFrame) where they
/// have not changed: that makes a surface a new one. Entities are named as they are, so a history belongs to one world, and
/// to entities that live on. Give those that are despawned and spawned again a [`SurfaceOrder`](crate::SurfaceOrder) of
/// their own, so that the order of contacts does not depend on when they were spawned.
///
/// A clone shares the lists of contacts, and has its own copies of positions of swept and animated surfaces.
#[derive(Resource, Clone, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Default))]
pub struct CollisionHistory {
    store: ContactStore,
    touching: TouchingSides,
    swept: SweptHistory,
    surfaces: EntityHashMap<SurfaceHistory>,
    response: ResponseHistory,
}

/// What is remembered in components.
#[derive(Clone)]
struct SurfaceHistory {
    status: SurfaceStatus,
    previous: Option<PreviousPositions>,
    spheres: Option<Circumspheres>,
}

/// Writes [`CollisionHistory`] at the end of each tick, and goes back to it if the game has replaced it. Add it after
/// [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins), in the same schedule. Not part of them, because it
/// copies what is remembered in every tick.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_circumsphere::{CollisionHistory, RollbackPlugin};
/// let mut app = App::new();
/// app.add_plugins((DeformableCollisionPlugins::new(Update), RollbackPlugin::new(Update)));
/// app.update();
/// let saved = app.world().resource::<CollisionHistory>().clone();
/// app.update();
/// // Back to the end of the first tick, together with the components of that time.
/// app.insert_resource(saved);
/// app.update();
/// ```
pub struct RollbackPlugin {
    schedule: InternedScheduleLabel,
}

impl RollbackPlugin {
    /// Writes it in `schedule`.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Plugin for RollbackPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<CollisionHistory>();
        app.add_systems(
            self.schedule,
            (go_back.before(DeformableSystems::Prepare), collect.in_set(DeformableSystems::Log)),
        );
    }
}

/// When the history was last collected.
#[derive(Resource)]
struct Collected(Tick);

/// Hands the history out if it is not the one that was collected last.
fn go_back(world: &mut World) {
    let changed = world.get_resource_ref::<CollisionHistory>().map(|history| history.last_changed());
    let collected = world.get_resource::<Collected>().map(|collected| collected.0);
    if collected.is_none() || changed.is_none() || changed == collected {
        return;
    }
    world.resource_scope(|world, history: Mut<CollisionHistory>| history.hand_out(world));
}

fn collect(world: &mut World) {
    let history = CollisionHistory::of(world);
    world.insert_resource(history);
    if let Some(history) = world.get_resource_ref::<CollisionHistory>() {
        let changed = history.last_changed();
        world.insert_resource(Collected(changed));
    }
}

type Remembered =
    (Entity, &'static mut SurfaceStatus, Option<&'static mut PreviousPositions>, Option<&'static mut Circumspheres>);

impl CollisionHistory {
    fn of(world: &mut World) -> Self {
        let mut components = world.query::<Remembered>();
        let surfaces = components.iter_mut(world).map(|(entity, status, previous, spheres)| {
            let spheres = spheres.filter(|spheres| !spheres.radii.is_empty()).map(|spheres| spheres.clone());
            let previous = previous.map(|previous| previous.clone());
            (entity, SurfaceHistory { status: status.clone(), previous, spheres })
        });
        Self {
            surfaces: surfaces.collect(),
            store: world.get_resource().cloned().unwrap_or_default(),
            touching: world.get_resource().cloned().unwrap_or_default(),
            swept: world.get_resource().cloned().unwrap_or_default(),
            response: ResponseHistory::of(world),
        }
    }

    fn hand_out(&self, world: &mut World) {
        let mut components = world.query::<Remembered>();
        for (entity, mut status, previous, spheres) in components.iter_mut(world) {
            let known = self.surfaces.get(&entity);
            // What is not known was not there yet, and is new in the next tick.
            status.set_if_neq(known.map_or(SurfaceStatus::Waiting, |known| known.status.clone()));
            if let Some(mut previous) = previous {
                *previous = known.and_then(|known| known.previous.clone()).unwrap_or_default();
            }
            if let Some(mut spheres) = spheres {
                *spheres = known.and_then(|known| known.spheres.clone()).unwrap_or_default();
            }
        }
        world.insert_resource(self.store.clone());
        world.insert_resource(self.touching.clone());
        world.insert_resource(self.swept.clone());
        world.resource_mut::<DetectionMemory>().keep_nothing();
        self.response.hand_out(world);
    }
}
