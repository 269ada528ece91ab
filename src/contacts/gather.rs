//! Last stage: what the stages found becomes the store of this tick.
//!
//! Contacts are sorted by key and made unique, and a two-sided contact keeps the side it was on in the last tick.

use std::{collections::HashMap, sync::Arc, time::Instant};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::store::{ContactSide, ContactStore, StoredPair};
use crate::{
    detection::{
        CandidateTrianglePairs, DetectionDiagnostics, RefinedTrianglePairs, SphereContacts, SurfacePair,
        broad_phase::OtherSide,
    },
    kernel::{contact::CompactContact, exact::FeatureKind, pair::FoundPairs},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    surface::{ActiveSurface, ActiveSurfaces},
};

/// Gathers contacts into the [`ContactStore`].
pub struct ContactsPlugin;

impl Plugin for ContactsPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<ContactStore>();
        app.add_systems(SurfaceDetection, gather_contacts.in_set(SurfaceDetectionSystems::Contacts));
    }
}

fn gather_contacts(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    mut spheres: ResMut<SphereContacts>,
    mut refined: ResMut<RefinedTrianglePairs>,
    mut store: ResMut<ContactStore>,
    mut previous: Local<ContactStore>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
) {
    let start = Instant::now();
    std::mem::swap(&mut *store, &mut *previous);
    store.tick = previous.tick + 1;
    store.pairs.clear();
    store.contacts.clear();
    store.touching.clear();
    let places: HashMap<(ContactSide, ContactSide), usize> =
        previous.pairs.iter().enumerate().map(|(place, pair)| ((pair.a, pair.b), place)).collect();

    for (place, pair) in candidates.pairs.iter().enumerate() {
        let is_exact = pair.method.is_exact();
        let found = if is_exact { &mut refined.pairs[place] } else { &mut spheres.pairs[place] };
        if found.contacts.is_empty() && found.nearest > f64::from(pair.range) {
            continue;
        }
        // Those of spheres are made in order.
        if is_exact {
            // Stable: neighboring faces of a shape report a shared edge alike up to the sign of a zero, and the first one
            // of them has to stay the first whatever the order of the candidates.
            found.contacts.sort_by_key(|contact| (contact.key, contact.triangle_a, contact.triangle_b));
            found.contacts.dedup_by_key(|contact| contact.key);
        }
        found.touching.sort_unstable_by_key(|pair| (pair.triangle_a, pair.triangle_b));

        let stored = stored_pair(&active, pair, &store, found);
        if keeps_sides(&active, pair)
            && let Some(&before) = places.get(&(stored.a, stored.b))
        {
            let before = &previous.contacts[previous.pairs[before].contacts.clone()];
            keep_sides(&mut found.contacts, before);
        }
        append_or_swap(&mut store.contacts, &mut found.contacts);
        append_or_swap(&mut store.touching, &mut found.touching);
        store.pairs.push(stored);
    }
    index_entities(&mut store);
    diagnostics.finish("contacts", start, candidates.pairs.len(), store.contacts.len());
}

/// Appends a list that is not needed any more. To an empty one it costs nothing, and leaves that one's memory behind.
fn append_or_swap<T: Copy>(list: &mut Vec<T>, appended: &mut Vec<T>) {
    if list.is_empty() {
        std::mem::swap(list, appended);
    } else {
        list.extend_from_slice(appended);
    }
}

fn stored_pair(active: &ActiveSurfaces, pair: &SurfacePair, store: &ContactStore, found: &FoundPairs) -> StoredPair {
    let first = &active.surfaces[pair.first];
    // Behind a surface's own face may be just the other side of a thin wall.
    let has_inside = |surface: &ActiveSurface| surface.one_sided && !pair.is_self();
    let (b, topology_b, shape, pose_b, one_sided_b, events_b, order_b) = match pair.second {
        OtherSide::Surface(second) => {
            let second = &active.surfaces[second];
            let topology = Some(Arc::clone(&second.topology));
            let one_sided = has_inside(second);
            (ContactSide::Surface(second.entity), topology, None, second.pose, one_sided, second.events, second.order)
        }
        OtherSide::Shape(place) => {
            let shape = &active.shapes[place];
            let geometry = Some(Arc::clone(&shape.geometry));
            (ContactSide::Shape(shape.entity), None, geometry, shape.pose, true, shape.events, shape.order)
        }
    };
    StoredPair {
        a: ContactSide::Surface(first.entity),
        b,
        contact_distance: pair.contact_distance,
        nearest: found.nearest,
        contacts: store.contacts.len()..store.contacts.len() + found.contacts.len(),
        touching: store.touching.len()..store.touching.len() + found.touching.len(),
        frame_pose: pair.frame_pose,
        topology_a: Arc::clone(&first.topology),
        topology_b,
        shape,
        poses: [first.pose, pose_b],
        one_sided: [has_inside(first), one_sided_b],
        events: [first.events, events_b],
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

/// Whether the sides of a pair are known only from the ticks before.
fn keeps_sides(active: &ActiveSurfaces, pair: &SurfacePair) -> bool {
    let OtherSide::Surface(second) = pair.second else { return false };
    let (first, second) = (&active.surfaces[pair.first], &active.surfaces[second]);
    let remembered = !first.fresh && !second.fresh;
    remembered && pair.method.is_exact() && (pair.is_self() || !(first.one_sided || second.one_sided))
}

/// A contact whose normal has turned round since the last tick has passed through: it keeps the side it was on, and
/// its distance is negative. Both lists are sorted by key.
fn keep_sides(contacts: &mut [CompactContact], before: &[CompactContact]) {
    // In a self-collision either of the two features may have come first.
    let normal = |contact: &CompactContact| if contact.swapped { -contact.normal } else { contact.normal };
    let mut before = before.iter().peekable();
    for contact in contacts {
        while before.next_if(|other| other.key < contact.key).is_some() {}
        let Some(last) = before.next_if(|other| other.key == contact.key) else { continue };
        // Around a corner or a rim a direction may turn without anything having passed.
        let has_sides = matches!(contact.features.kind(), FeatureKind::VertexFace | FeatureKind::EdgeEdge);
        if has_sides && normal(contact).dot(normal(last)) < 0.0 {
            contact.normal = -contact.normal;
            contact.distance = -contact.distance;
        }
    }
}
