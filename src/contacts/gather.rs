//! The last stage of detection: gathers what the stages found into the [`ContactStore`]. The store shares their lists.

use std::{collections::HashMap, sync::Arc};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use glam::Vec3;

use super::{
    sides::{Before, Reversed, Sides, agree},
    store::{ContactStore, StoredPair},
};
use crate::{
    detection::{
        CandidateTrianglePairs, DetectionDiagnostics, DetectionMemory, ExactTrianglePairs, Frame, OtherSide,
        PairContacts, SphereContacts, SurfacePair, Threads, is_one_sided,
    },
    diagnostics::StageWatch,
    kernel::capacity,
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactSide},
};

/// Gathers contacts into the [`ContactStore`].
pub struct ContactsPlugin;

impl Plugin for ContactsPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<ContactStore>().init_resource::<DetectionMemory>();
        app.add_systems(SurfaceDetection, gather_contacts.in_set(SurfaceDetectionSystems::Contacts));
    }
}

/// The indices of pairs in the store of their detection.
#[derive(Default)]
struct KeptPairs {
    /// For each of [`CandidateTrianglePairs`], its index in the store, if it is stored.
    places: Vec<Option<u32>>,
    /// The same for the last detection, while this one is gathered.
    last_places: Vec<Option<u32>>,
    /// The indices in the store of the last detection, by sides.
    by_sides: HashMap<(ContactSide, ContactSide), usize>,
}

#[expect(clippy::too_many_arguments, reason = "the last stage reads every stage before it")]
fn gather_contacts(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut found: ResMut<ExactTrianglePairs>,
    mut spheres: ResMut<SphereContacts>,
    mut store: ResMut<ContactStore>,
    mut previous: Local<ContactStore>,
    mut kept: Local<KeptPairs>,
    mut sides: Local<Sides>,
    mut reversed: Local<Reversed>,
    memory: Res<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
) {
    let start = StageWatch::start("contacts");
    diagnostics.pairs_kept = memory.kept_count();
    if memory.keeps_all() {
        store.tick += 1;
        diagnostics.finish(start, 0, store.contact_count());
        return;
    }
    std::mem::swap(&mut *store, &mut *previous);
    store.tick = previous.tick + 1;
    store.pairs.clear();
    let KeptPairs { places: stored_places, last_places, by_sides } = &mut *kept;
    by_sides.clear();
    by_sides.extend(previous.pairs.iter().enumerate().map(|(place, pair)| ((pair.a, pair.b), place)));
    std::mem::swap(stored_places, last_places);
    stored_places.clear();

    for (place, pair) in candidates.pairs.iter().enumerate() {
        if let Some(origin) = memory.origin(place) {
            let last = last_places[origin].map(|last| &previous.pairs[last as usize]);
            stored_places.push(last.map(|_| store.pairs.len() as u32));
            store.pairs.extend(last.cloned());
            continue;
        }
        let is_exact = pair.method.is_exact();
        let found = if is_exact { &mut found.pairs[place] } else { &mut spheres.pairs[place] };
        if found.contacts.is_empty() && found.nearest > f64::from(pair.range) {
            stored_places.push(None);
            continue;
        }
        stored_places.push(Some(store.pairs.len() as u32));
        if is_exact {
            let before =
                if keeps_sides(&active, pair) { last_of(&previous, by_sides, sides_of(&active, pair)) } else { None };
            let before = match before {
                Some((before, false)) => before.before(),
                Some((before, true)) => reversed.of(before.before(), |normal| turned(normal, before, pair.frame)),
                None => Before::default(),
            };
            sides.keep(found.contacts.make_mut(), before, &Threads(settings.threads));
            if let OtherSide::Surface(second) = pair.second
                && found.nearest > 0.0
            {
                let topology = |surface: usize| &*active.surfaces[surface].topology;
                agree(found.contacts.make_mut(), [topology(pair.first), topology(second)]);
            }
        }
        store.pairs.push(stored_pair(&active, pair, found));
    }
    // The lists must not stay shared, so that the stages can reuse their memory.
    previous.pairs.clear();
    let count = store.pairs.len();
    capacity::trim(&mut previous.pairs, count);
    capacity::trim(&mut store.pairs, count);
    index_entities(&mut store);
    capacity::trim(&mut store.by_entity, 2 * count);
    capacity::trim(&mut previous.by_entity, 2 * count);
    capacity::trim(stored_places, candidates.pairs.len());
    capacity::trim(last_places, candidates.pairs.len());
    if by_sides.len() > 2 * count {
        by_sides.clear();
        by_sides.shrink_to(count);
    }
    diagnostics.finish(start, candidates.pairs.len(), store.contact_count());
}

/// The stored pair of two sides in the last tick, and whether their order has changed since. `None` if there is none,
/// or if it was found by spheres: those contacts have no sides.
fn last_of<'a>(
    previous: &'a ContactStore,
    by_sides: &HashMap<(ContactSide, ContactSide), usize>,
    (a, b): (ContactSide, ContactSide),
) -> Option<(&'a StoredPair, bool)> {
    let place = by_sides.get(&(a, b)).map(|&place| (place, false));
    let (place, is_reversed) = place.or_else(|| by_sides.get(&(b, a)).map(|&place| (place, true)))?;
    Some((&previous.pairs[place], is_reversed)).filter(|(pair, _)| pair.spheres.is_none())
}

/// Transforms a normal of a pair of the last tick, whose sides come in the other order now, into the pair's current
/// frame. That is the frame of the same surface, or of the other one if both have the same number of triangles.
fn turned(normal: Vec3, before: &StoredPair, frame: Frame) -> Vec3 {
    let own = match frame {
        Frame::First => &before.poses[1],
        Frame::Second => &before.poses[0],
    };
    own.inverse_transform_direction(before.frame_pose.transform_direction(normal.as_dvec3())).as_vec3()
}

fn sides_of(active: &ActiveSurfaces, pair: &SurfacePair) -> (ContactSide, ContactSide) {
    let second = match pair.second {
        OtherSide::Surface(second) => active.surfaces[second].side(),
        OtherSide::Shape(place) => ContactSide::Shape(active.shapes[place].entity),
    };
    (active.surfaces[pair.first].side(), second)
}

/// A pair as it is stored. Shares the lists of what was found.
fn stored_pair(active: &ActiveSurfaces, pair: &SurfacePair, found: &PairContacts) -> StoredPair {
    let first = &active.surfaces[pair.first];
    let has_inside = |surface: &ActiveSurface| is_one_sided(surface, pair);
    let (a, b) = sides_of(active, pair);
    let (topology_b, shape, pose_b, one_sided_b, events_b, hold_b, order_b, thickness_b) = match pair.second {
        OtherSide::Surface(second) => {
            let second = &active.surfaces[second];
            let topology = Some(Arc::clone(&second.topology));
            let one_sided = has_inside(second);
            let thickness = second.vertex_thickness.clone();
            (topology, None, second.pose, one_sided, second.events, second.event_hold, second.order, thickness)
        }
        OtherSide::Shape(place) => {
            let shape = &active.shapes[place];
            let geometry = Some(Arc::clone(&shape.geometry));
            (None, geometry, shape.pose, true, shape.events, shape.event_hold, shape.order, None)
        }
    };
    StoredPair {
        is_smooth: pair.is_smooth(active),
        a,
        b,
        contact_distance: pair.contact_distance,
        vertex_thickness: [first.vertex_thickness.clone(), thickness_b],
        nearest: found.nearest,
        contacts: found.contacts.clone(),
        touching: found.touching.clone(),
        spheres: found.spheres.clone(),
        shared: found.shared.clone(),
        frame_pose: pair.frame_pose,
        topology_a: Arc::clone(&first.topology),
        topology_b,
        shape,
        poses: [first.pose, pose_b],
        one_sided: [has_inside(first), one_sided_b],
        events: [first.events, events_b],
        event_hold: first.event_hold.max(hold_b),
        order: (matches!(pair.second, OtherSide::Shape(_)), first.order, order_b),
    }
}

fn index_entities(store: &mut ContactStore) {
    store.by_entity.clear();
    for (place, pair) in store.pairs.iter().enumerate() {
        store.by_entity.push((pair.a.entity(), place as u32));
        if pair.a.entity() != pair.b.entity() {
            store.by_entity.push((pair.b.entity(), place as u32));
        }
    }
    store.by_entity.sort_unstable();
}

/// Whether the sides of a pair are known only from earlier ticks.
fn keeps_sides(active: &ActiveSurfaces, pair: &SurfacePair) -> bool {
    let OtherSide::Surface(second) = pair.second else { return false };
    let (first, second) = (&active.surfaces[pair.first], &active.surfaces[second]);
    let remembered = !first.fresh && !second.fresh;
    remembered && pair.method.is_exact() && (pair.is_self() || !(first.one_sided || second.one_sided))
}
