//! Sleep: bodies at rest are not solved until something touches or moves them.
//!
//! Bodies near each other form an island. An island whose bodies have all stayed where they are for [`CALM_TIME`] falls
//! asleep. To every other part of the response, and to detection, a sleeping body is a surface that the game does not
//! move. One reason to wake wakes the whole island.

mod state;

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_time::Time;

pub(super) use self::state::Sleep;
use self::state::{Asleep, CALM_TIME, Seen, Watched};
use super::{scene::Scene, settings::XpbdSettings};
use crate::{
    contacts::StoredPair,
    settings::EVENT_HYSTERESIS,
    surface::{ActiveSurface, ActiveSurfaces},
};

impl Sleep {
    /// Wakes what an awake body or an object that moves has come near, and what a new object touches. Also what its
    /// tethers pull or no longer hold, and what has lost something that it touched.
    pub(super) fn wake_touched(&mut self, scene: &Scene<'_, '_>) {
        if self.asleep.is_empty() {
            return;
        }
        let moves = |entity: Entity| {
            let is_awake = |entity| scene.is_body(entity) && !self.asleep.contains_key(&entity);
            scene.motions.course(entity).is_some() || is_awake(entity)
        };
        let mut islands = Vec::new();
        for pair in &scene.store.pairs {
            let [a, b] = [pair.a.entity(), pair.b.entity()];
            for (own, other) in [(a, b), (b, a)] {
                let Some(asleep) = self.asleep.get(&own) else { continue };
                if moves(other) || touches(pair) && !asleep.holders.contains(&other) {
                    islands.push(asleep.island);
                }
            }
        }
        let approached = scene.motions.approached().iter().filter_map(|body| self.asleep.get(body));
        islands.extend(approached.map(|asleep| asleep.island));
        for (&body, asleep) in &self.asleep {
            let is_gone = |&other: &Entity| !scene.store.pairs_between(body, other).any(nearly_touches);
            let is_pulled = || scene.tethers.get(body).is_ok_and(|tethers| tethers.holding() != Some(asleep.tethers));
            if asleep.holders.iter().any(is_gone) || is_pulled() {
                islands.push(asleep.island);
            }
        }
        self.wake(&islands);
    }
}

/// Whether the sides of a pair touch, or are so near that the least motion may make them.
fn touches(pair: &StoredPair) -> bool {
    pair.touches_within(0.5 * f64::from(EVENT_HYSTERESIS))
}

/// A little farther than [`touches`], against rounding. Detection finds such pairs also between sleeping bodies, which
/// have no margins.
fn nearly_touches(pair: &StoredPair) -> bool {
    pair.touches_within(f64::from(EVENT_HYSTERESIS))
}

/// Wakes bodies that the game has changed, and all if it has changed the settings.
pub(super) fn wake_changed(
    settings: Res<XpbdSettings>,
    active: Res<ActiveSurfaces>,
    bodies: Query<Watched>,
    mut sleep: ResMut<Sleep>,
) {
    let sleep = &mut *sleep;
    if sleep.settings != *settings {
        sleep.settings = *settings;
        sleep.asleep.clear();
        sleep.calm.clear();
    }
    if sleep.asleep.is_empty() {
        return;
    }
    let mut unchanged = 0;
    let mut islands = Vec::new();
    for surface in &active.surfaces {
        let Some(asleep) = sleep.asleep.get_mut(&surface.entity) else { continue };
        let is_same = bodies.get(surface.entity).is_ok_and(|item| asleep.is_undisturbed(surface, &item));
        if is_same && !surface.fresh {
            unchanged += 1;
        } else {
            islands.push(asleep.island);
        }
    }
    // Those that are gone wake what they touched in `wake_touched`.
    if unchanged + islands.len() < sleep.asleep.len() {
        let here = |body: &Entity| active.surfaces.iter().any(|surface| surface.entity == *body);
        sleep.asleep.retain(|body, _| here(body));
    }
    sleep.wake(&islands);
}

/// Lets islands fall asleep. Bodies that nothing holds, and bodies whose weight is to be reported, never do.
pub(super) fn settle(time: Option<Res<Time>>, scene: Scene, watched: Query<Watched>, mut sleep: ResMut<Sleep>) {
    let sleep = &mut *sleep;
    if time.is_none_or(|time| time.delta_secs_f64() <= 0.0) {
        return;
    }
    let bodies: Vec<&ActiveSurface> = scene
        .active
        .surfaces
        .iter()
        .filter(|surface| scene.is_body(surface.entity) && !sleep.is_asleep(surface.entity))
        .collect();
    let places: EntityHashMap<usize> = (0..).zip(&bodies).map(|(place, body)| (body.entity, place)).collect();
    sleep.calm.retain(|body, _| places.contains_key(body));
    if !sleep.calm.values().any(|calm| calm.time >= CALM_TIME) {
        return;
    }
    let is_calm = |body: Entity| sleep.calm.get(&body).is_some_and(|calm| calm.time >= CALM_TIME);
    let mut islands: Vec<usize> = (0..bodies.len()).collect();
    let mut is_restless: Vec<bool> = bodies.iter().map(|body| !is_calm(body.entity)).collect();
    let mut is_held: Vec<bool> = bodies.iter().map(|body| scene.is_held(body.entity)).collect();
    for pair in &scene.store.pairs {
        let [a, b] = [pair.a.entity(), pair.b.entity()];
        match [a, b].map(|side| places.get(&side).copied()) {
            [Some(a), Some(b)] => {
                let [a, b] = [root(&islands, a), root(&islands, b)];
                islands[a.max(b)] = a.min(b);
            }
            [Some(place), None] | [None, Some(place)] => {
                let other = if a == bodies[place].entity { b } else { a };
                is_held[place] |= touches(pair);
                is_restless[place] |= scene.motions.course(other).is_some() || scene.wants_reaction(other);
            }
            [None, None] => {}
        }
    }
    for place in 0..bodies.len() {
        let island = root(&islands, place);
        is_restless[island] |= is_restless[place];
        is_held[island] |= is_held[place];
    }
    let first = sleep.islands;
    for (place, surface) in bodies.iter().enumerate() {
        let island = root(&islands, place);
        if is_restless[island] || !is_held[island] {
            continue;
        }
        let Ok(item) = watched.get(surface.entity) else { continue };
        let holders = scene.store.pairs_of(surface.entity).filter(|pair| touches(pair)).map(|pair| {
            let [a, b] = [pair.a.entity(), pair.b.entity()];
            if a == surface.entity { b } else { a }
        });
        let island = first.wrapping_add(island as u32);
        let tethers = item.tethers.as_ref().and_then(|tethers| tethers.holding()).unwrap_or_default();
        let seen = Seen::new(surface, &item);
        let asleep = Asleep { island, seen, values: item.values(), holders: holders.collect(), tethers };
        sleep.asleep.insert(surface.entity, asleep);
        sleep.calm.remove(&surface.entity);
    }
    sleep.islands = first.wrapping_add(bodies.len() as u32);
}

/// The representative of an island, in a union-find forest.
fn root(islands: &[usize], mut place: usize) -> usize {
    while islands[place] != place {
        place = islands[place];
    }
    place
}
