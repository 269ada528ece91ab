//! Announces when two sides come into contact and when they separate. Compares the [`ContactStore`] with the last tick,
//! in [`DeformableSystems::Events`].

use std::{
    cell::LazyCell,
    collections::{HashMap, HashSet},
};

use bevy_app::prelude::*;
use bevy_ecs::{
    entity::{Entities, EntityHashMap},
    prelude::*,
    schedule::{InternedScheduleLabel, ScheduleLabel},
};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::store::{ContactStore, PairOrder, StoredPair};
use crate::{
    kernel::capacity,
    schedule::DeformableSystems,
    settings::EVENT_HYSTERESIS,
    surface::{ActiveShape, ActiveSurface, ActiveSurfaces, PendingQuarantines, SurfaceQuarantined},
};

/// Two surfaces, or a surface and a shape, came into contact in this tick. Sent if at least one of them has
/// [`ContactEventsEnabled`](crate::ContactEventsEnabled).
///
/// The message is sent once per pair. The entity event is sent to each of the two that has events enabled, as its
/// `entity`. In a self-collision, both sides are the same entity.
#[derive(Message, EntityEvent, Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Message, Event, Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceContactStart {
    /// One side.
    pub entity: Entity,
    /// The other side.
    pub other: Entity,
}

/// Two surfaces, or a surface and a shape, are no longer in contact, because they separated or because one of them no
/// longer takes part. Sent like [`SurfaceContactStart`], or [later](crate::ContactEventHold). Entities that no longer exist get no event.
#[derive(Message, EntityEvent, Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Message, Event, Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceContactEnd {
    /// One side.
    pub entity: Entity,
    /// The other side.
    pub other: Entity,
}

/// Sends messages and entity events in [`DeformableSystems::Events`].
pub struct ContactEventsPlugin {
    schedule: InternedScheduleLabel,
}

impl ContactEventsPlugin {
    /// Sends them in `schedule`.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Plugin for ContactEventsPlugin {
    fn build(&self, app: &mut App) {
        app.add_message::<SurfaceContactStart>()
            .add_message::<SurfaceContactEnd>()
            .add_message::<SurfaceQuarantined>()
            .init_resource::<TouchingSides>()
            .add_systems(
                self.schedule,
                (send_quarantines, track_contacts, send_contacts).chain().in_set(DeformableSystems::Events),
            );
    }
}

fn send_quarantines(
    mut commands: Commands,
    mut pending: ResMut<PendingQuarantines>,
    mut messages: MessageWriter<SurfaceQuarantined>,
) {
    pending.0.sort_by_key(|quarantine| quarantine.entity.index_u32());
    for quarantine in pending.0.drain(..) {
        commands.trigger(quarantine.clone());
        messages.write(quarantine);
    }
}

/// The sides that are in contact, and what changed in this tick, whether or not events are enabled.
#[derive(Resource, Clone, Default)]
pub(crate) struct TouchingSides {
    touching: Vec<Touching>,
    /// Pairs that came into contact in this tick, in the order of the store.
    pub(crate) started: Vec<Touching>,
    /// Pairs that are no longer in contact, in the same order.
    pub(crate) ended: Vec<Touching>,
}

/// Two sides that are in contact, and which of them have events enabled.
#[derive(Clone, Copy)]
pub(crate) struct Touching {
    pub(crate) sides: [Entity; 2],
    events: [bool; 2],
    order: PairOrder,
    /// How many ticks in a row the contact may be absent without ending.
    hold: u32,
    /// For how many it has been absent.
    absent: u32,
}

impl Touching {
    fn new(stored: &StoredPair) -> Self {
        let StoredPair { events, order, event_hold: hold, .. } = *stored;
        Self { sides: sides_of(stored), events, order, hold, absent: 0 }
    }

    /// Calls `announce` with each side that has events enabled and still exists, and with the other side.
    fn for_each_listener(&self, entities: &Entities, mut announce: impl FnMut(Entity, Entity)) {
        let [a, b] = self.sides;
        if self.events[0] && entities.contains_spawned(a) {
            announce(a, b);
        }
        if a != b && self.events[1] && entities.contains_spawned(b) {
            announce(b, a);
        }
    }
}

/// What takes part in this tick, by entity. Only needed for contacts that are absent and may not have ended.
struct TakingPart<'a> {
    surfaces: EntityHashMap<&'a ActiveSurface>,
    shapes: EntityHashMap<&'a ActiveShape>,
}

impl<'a> TakingPart<'a> {
    fn new(active: &'a ActiveSurfaces) -> Self {
        Self {
            surfaces: active.surfaces.iter().map(|surface| (surface.entity, surface)).collect(),
            shapes: active.shapes.iter().map(|shape| (shape.entity, shape)).collect(),
        }
    }

    /// Brings the settings of an absent contact up to date. `None` if the two sides can no longer touch, or if what is
    /// known of them is void because one of them has jumped.
    fn settings_of(&self, [a, b]: [Entity; 2]) -> Option<([bool; 2], u32)> {
        let first = self.surfaces.get(&a)?;
        let (meet, fresh, events, hold) = match self.surfaces.get(&b) {
            Some(_) if a == b => (first.self_collision, first.fresh, first.events, first.event_hold),
            Some(second) => (first.meets(second), second.fresh, second.events, second.event_hold),
            None => {
                let shape = self.shapes.get(&b)?;
                let meet = first.layers.interacts_with(shape.layers);
                (meet, shape.fresh, shape.events, shape.event_hold)
            }
        };
        (meet && !first.fresh && !fresh).then(|| ([first.events, events], first.event_hold.max(hold)))
    }
}

fn sides_of(pair: &StoredPair) -> [Entity; 2] {
    [pair.a.entity(), pair.b.entity()]
}

/// A name for two sides that does not depend on their order.
fn name(mut sides: [Entity; 2]) -> [Entity; 2] {
    sides.sort_unstable();
    sides
}

fn track_contacts(
    store: Res<ContactStore>,
    active: Res<ActiveSurfaces>,
    entities: &Entities,
    mut sides: ResMut<TouchingSides>,
) {
    let TouchingSides { touching, started, ended } = &mut *sides;
    // What was detected may have been despawned since.
    let exist = |sides: [Entity; 2]| sides.into_iter().all(|side| entities.contains_spawned(side));
    let parted = |pair: &StoredPair| !pair.touches_within(f64::from(EVENT_HYSTERESIS));
    let near: HashMap<[Entity; 2], &StoredPair> =
        store.pairs.iter().filter(|pair| !parted(pair)).map(|pair| (name(sides_of(pair)), pair)).collect();
    ended.clear();
    let taking_part = LazyCell::new(|| TakingPart::new(&active));
    touching.retain_mut(|pair| {
        let exist = exist(pair.sides);
        if exist && let Some(stored) = near.get(&name(pair.sides)) {
            *pair = Touching::new(stored);
            return true;
        }
        pair.absent += 1;
        let waits = exist
            && pair.hold >= pair.absent
            && taking_part.settings_of(pair.sides).is_some_and(|settings| {
                (pair.events, pair.hold) = settings;
                pair.hold >= pair.absent
            });
        if !waits {
            ended.push(*pair);
        }
        waits
    });
    ended.sort_unstable_by_key(|pair| pair.order);
    let already: HashSet<[Entity; 2]> = touching.iter().map(|pair| name(pair.sides)).collect();
    let touches = |pair: &&StoredPair| pair.touches_within(0.0) && exist(sides_of(pair));
    started.clear();
    started.extend(store.pairs.iter().filter(touches).map(Touching::new));
    started.retain(|pair| !already.contains(&name(pair.sides)));
    touching.extend_from_slice(started);
    let count = touching.len();
    for list in [touching, started, ended] {
        capacity::trim(list, count);
    }
}

fn send_contacts(
    sides: Res<TouchingSides>,
    entities: &Entities,
    mut commands: Commands,
    mut started: MessageWriter<SurfaceContactStart>,
    mut ended: MessageWriter<SurfaceContactEnd>,
) {
    for pair in &sides.ended {
        let [entity, other] = pair.sides;
        if pair.events.contains(&true) {
            ended.write(SurfaceContactEnd { entity, other });
        }
        pair.for_each_listener(entities, |entity, other| commands.trigger(SurfaceContactEnd { entity, other }));
    }
    for pair in &sides.started {
        let [entity, other] = pair.sides;
        if pair.events.contains(&true) {
            started.write(SurfaceContactStart { entity, other });
        }
        pair.for_each_listener(entities, |entity, other| commands.trigger(SurfaceContactStart { entity, other }));
    }
}
