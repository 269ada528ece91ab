//! Writes what was found of each pair of surfaces into the store: sorted by key, each key once, and a two-sided contact
//! on the side it was on in the last tick.
//!
//! Every record is copied once, from where it was found to where it stays. The lists of an earlier tick are overwritten
//! in place, so that in a steady scene nothing is allocated or cleared.

use std::{
    ops::Range,
    sync::atomic::{AtomicBool, Ordering},
};

use super::store::{ContactStore, StoredPair};
use crate::{
    detection::Threads,
    kernel::{
        contact::{CompactContact, TouchingPair},
        contact_order::{ContactOrder, TouchingOrder, copy_in_order},
        exact::FeatureKind,
        pair::FoundPairs,
        share::Share,
    },
};

/// Touching pairs that one task looks through.
const SCANNED: usize = 65_536;

/// What writing keeps for its memory.
#[derive(Default)]
pub(super) struct WriteBuffers {
    order: ContactOrder,
    touching: TouchingOrder,
}

/// Overwrites a store pair by pair.
pub(super) struct StoreWriter<'a> {
    pub(super) store: &'a mut ContactStore,
    buffers: &'a mut WriteBuffers,
    threads: Threads,
    contacts: usize,
    touching: usize,
}

impl<'a> StoreWriter<'a> {
    pub(super) fn new(store: &'a mut ContactStore, buffers: &'a mut WriteBuffers, threads: usize) -> Self {
        let threads = Threads(threads);
        Self { store, buffers, threads, contacts: 0, touching: 0 }
    }

    /// Writes the contacts of a pair. `before` are those of the last tick, where sides are known from there.
    pub(super) fn write_contacts(&mut self, found: &[CompactContact], before: &[CompactContact]) -> Range<usize> {
        let (start, order) = (self.contacts, &mut self.buffers.order);
        order.arrange(found, &self.threads);
        let count = order.count();
        let sorted = room_for(&mut self.store.contacts, start, count, found.first());
        copy_in_order(found, order.parts(), count, sorted, &self.threads, |sorted| keep_sides(sorted, before));
        self.contacts += count;
        start..self.contacts
    }

    /// Writes the touching triangles of a pair.
    pub(super) fn write_touching(&mut self, found: &[TouchingPair]) -> Range<usize> {
        let start = self.touching;
        let sorted = room_for(&mut self.store.touching, start, found.len(), found.first());
        if found.is_sorted_by_key(|pair| (pair.triangle_a, pair.triangle_b)) {
            // What came of a sorted list.
            sorted.copy_from_slice(found);
        } else {
            self.buffers.touching.sort(found, sorted, &self.threads);
        }
        self.touching += found.len();
        start..self.touching
    }

    /// Writes a pair again as it is in another store.
    pub(super) fn keep(&mut self, pair: &StoredPair, other: &ContactStore) {
        let (contacts, touching) = (&other.contacts[pair.contacts.clone()], &other.touching[pair.touching.clone()]);
        let room = room_for(&mut self.store.contacts, self.contacts, contacts.len(), contacts.first());
        room.copy_from_slice(contacts);
        let room = room_for(&mut self.store.touching, self.touching, touching.len(), touching.first());
        room.copy_from_slice(touching);
        let [first_contact, first_touching] = [self.contacts, self.touching];
        self.contacts += contacts.len();
        self.touching += touching.len();
        self.store.pairs.push(StoredPair {
            contacts: first_contact..self.contacts,
            touching: first_touching..self.touching,
            ..pair.clone()
        });
    }

    /// Takes over what is sorted by key, each key once. The lists of the store are left in place of the first ones.
    pub(super) fn take_over(&mut self, found: &mut FoundPairs) -> [Range<usize>; 2] {
        let place = |pair: &TouchingPair| (pair.triangle_a, pair.triangle_b);
        // Where a surface meets itself, contacts are sorted by the lower triangle, whichever stands first.
        let unsorted = AtomicBool::new(false);
        let ends = (0..found.touching.len()).step_by(SCANNED).map(|start| start + SCANNED + 1);
        let lists = ends.map(|end| &found.touching[end - SCANNED - 1..end.min(found.touching.len())]);
        self.threads.hand_out(lists, found.touching.len() / SCANNED, |list| {
            if !list.is_sorted_by_key(place) {
                unsorted.store(true, Ordering::Relaxed);
            }
        });
        if unsorted.into_inner() {
            found.touching.sort_unstable_by_key(place);
        }
        [
            take_over(&mut self.store.contacts, &mut self.contacts, &mut found.contacts),
            take_over(&mut self.store.touching, &mut self.touching, &mut found.touching),
        ]
    }

    /// Drops what is left of an earlier tick.
    pub(super) fn finish(self) {
        self.store.contacts.truncate(self.contacts);
        self.store.touching.truncate(self.touching);
    }
}

/// Appends `found` to the first `count` items of a list.
fn take_over<T: Copy>(list: &mut Vec<T>, count: &mut usize, found: &mut Vec<T>) -> Range<usize> {
    let (start, added) = (*count, found.len());
    if start == 0 {
        std::mem::swap(list, found);
    } else {
        room_for(list, start, added, found.first()).copy_from_slice(found);
    }
    *count += added;
    start..*count
}

/// The part of a list from `start` on, made longer where it is too short. What it holds is to be overwritten.
fn room_for<'a, T: Copy>(list: &'a mut Vec<T>, start: usize, count: usize, any: Option<&T>) -> &'a mut [T] {
    if let Some(&any) = any
        && list.len() < start + count
    {
        list.resize(start + count, any);
    }
    &mut list[start..start + count]
}

/// A contact whose normal has turned round since the last tick has passed through: it keeps the side it was on, and
/// its distance is negative. Both lists are sorted by key.
fn keep_sides(contacts: &mut [CompactContact], before: &[CompactContact]) {
    let Some(first) = contacts.first() else { return };
    // In a self-collision either of the two features may have come first.
    let normal = |contact: &CompactContact| if contact.swapped { -contact.normal } else { contact.normal };
    let mut before = before[before.partition_point(|other| other.key < first.key)..].iter().peekable();
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
