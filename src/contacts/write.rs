//! Writes what was found of each pair of surfaces into the store: sorted by triangles, each pair of features once, and a
//! two-sided contact on the side it was on in the last tick.
//!
//! The lists of an earlier tick are overwritten in place, so that in a steady scene nothing is allocated or cleared.

use std::ops::Range;

use super::{
    store::{ContactStore, StoredPair},
    unique::{Before, UniqueContacts},
};
use crate::{
    detection::Threads,
    kernel::{
        contact::{CompactContact, SharedContact, TouchingPair},
        pair::FoundPairs,
    },
};

/// Overwrites a store pair by pair.
pub(super) struct StoreWriter<'a> {
    pub(super) store: &'a mut ContactStore,
    unique: &'a mut UniqueContacts,
    threads: Threads,
    contacts: usize,
    touching: usize,
}

impl<'a> StoreWriter<'a> {
    /// `unique` keeps the memory of what writing needs.
    pub(super) fn new(store: &'a mut ContactStore, unique: &'a mut UniqueContacts, threads: usize) -> Self {
        store.shared.clear();
        Self { store, unique, threads: Threads(threads), contacts: 0, touching: 0 }
    }

    /// Writes the contacts of a pair, which come in the order of their triangles, given which of them are shared. `before` are those of the last tick, where
    /// sides are known from there. Returns where they are, and where those are named that are shared.
    pub(super) fn write_contacts(
        &mut self,
        found: &[CompactContact],
        shared: &[SharedContact],
        before: Before<'_>,
    ) -> [Range<usize>; 2] {
        let (start, first_shared) = (self.contacts, self.store.shared.len());
        let count = self.unique.count(found, shared);
        let stored = room_for(&mut self.store.contacts, start, count, found.first());
        let shared = self.unique.copy(found, before, stored, &self.threads);
        self.store.shared.extend_from_slice(shared);
        self.contacts += count;
        [start..self.contacts, first_shared..self.store.shared.len()]
    }

    /// Writes the touching triangles of a pair, which come in their order.
    pub(super) fn write_touching(&mut self, found: &[TouchingPair]) -> Range<usize> {
        let start = self.touching;
        room_for(&mut self.store.touching, start, found.len(), found.first()).copy_from_slice(found);
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
        let first_shared = self.store.shared.len();
        self.store.shared.extend_from_slice(&other.shared[pair.shared.clone()]);
        self.contacts += contacts.len();
        self.touching += touching.len();
        self.store.pairs.push(StoredPair {
            contacts: first_contact..self.contacts,
            touching: first_touching..self.touching,
            shared: first_shared..self.store.shared.len(),
            ..pair.clone()
        });
    }

    /// Takes over what is sorted, each pair of triangles once. The lists of the store are left in place of the first ones.
    pub(super) fn take_over(&mut self, found: &mut FoundPairs) -> [Range<usize>; 2] {
        let place = |pair: &TouchingPair| (pair.triangle_a, pair.triangle_b);
        // Where a surface meets itself, contacts are sorted by the lower triangle, whichever stands first.
        if !found.touching.is_sorted_by_key(place) {
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
