//! Keeps two-sided contacts on the sides that they were on in the last tick.
//!
//! If the normal of a contact has reversed since then, its features have passed through each other. The old normal is
//! kept, and the distance becomes negative. Two connected surfaces that do not cross are on one side of each other, so
//! there most contacts decide for all. Contacts come in the same order in every tick, so each is found next to its
//! predecessor. Contacts that other triangles may have reported are looked up by key.

use std::mem;

use bevy_platform::collections::HashMap;
use glam::Vec3;

use crate::kernel::{
    contact::{CompactContact, ContactKey, SharedContact},
    mesh::topology::SurfaceTopology,
    simd::parallel::Parallel,
};

#[cfg(test)]
mod tests;

/// Contacts per part. A part may have a few more, because a pair of triangles is never split.
const PART: usize = 8192;

/// Contacts per thread. With fewer, another thread does not pay off.
const CONTACTS_OF_ONE: usize = 32_768;

/// The contacts of the last tick.
#[derive(Clone, Copy, Default)]
pub(super) struct Before<'a> {
    pub(super) contacts: &'a [CompactContact],
    /// The shared ones that have sides.
    pub(super) shared: &'a [SharedContact],
}

/// The contacts of a tick in which the two sides came in the other order, converted to the current order. The order
/// changes with the [`SurfaceOrder`](crate::SurfaceOrder) of a surface.
#[derive(Default)]
pub(super) struct Reversed {
    contacts: Vec<CompactContact>,
    shared: Vec<SharedContact>,
}

impl Reversed {
    /// Converts the contacts that have sides. `turn` transforms normals into the frame of this tick.
    pub(super) fn of(&mut self, before: Before<'_>, turn: impl Fn(Vec3) -> Vec3) -> Before<'_> {
        self.contacts.clear();
        let with_sides = before.contacts.iter().filter(|contact| contact.key.has_sides());
        self.contacts.extend(with_sides.map(|&contact| CompactContact {
            key: contact.key.reversed(),
            triangle_a: contact.triangle_b,
            triangle_b: contact.triangle_a,
            features: contact.features.swapped(),
            // Points to the second side, which was the first one.
            normal: -turn(contact.normal),
            ..contact
        }));
        self.contacts.sort_unstable_by_key(|contact| (contact.triangles(), contact.key));
        self.shared.clear();
        let shared = (0..).zip(&self.contacts).filter(|(_, contact)| contact.is_shared);
        self.shared.extend(shared.map(|(place, contact)| SharedContact { key: contact.key, place }));
        Before { contacts: &self.contacts, shared: &self.shared }
    }
}

/// Restores the sides of contacts. Keeps its memory.
#[derive(Default)]
pub(super) struct Sides {
    parts: Vec<Vec<SharedContact>>,
    unmatched: HashMap<ContactKey, u32>,
}

impl Sides {
    /// Flips contacts whose normals have reversed since the last tick.
    pub(super) fn keep(&mut self, contacts: &mut [CompactContact], before: Before<'_>, parallel: &impl Parallel) {
        if before.contacts.is_empty() {
            return;
        }
        self.parts.iter_mut().for_each(Vec::clear);
        self.parts.resize_with(self.parts.len().max(contacts.len().div_ceil(PART)), Vec::new);
        let count = contacts.len() / CONTACTS_OF_ONE;
        let tasks = parts_of(contacts).zip(&mut self.parts);
        parallel.run_tasks(tasks, count, |((first, contacts), unmatched)| {
            keep_own_sides(contacts, first, before.contacts, unmatched);
        });
        self.keep_shared_sides(contacts, before);
    }

    /// Flips contacts that other triangles reported in the last tick.
    fn keep_shared_sides(&mut self, contacts: &mut [CompactContact], before: Before<'_>) {
        self.unmatched.clear();
        self.unmatched.extend(self.parts.iter().flatten().map(|shared| (shared.key, shared.place)));
        if self.unmatched.is_empty() {
            return;
        }
        for last in before.shared {
            // An index counts only if the contact there has the right key.
            let contact = before.contacts.get(last.place as usize).filter(|contact| contact.key == last.key);
            if let (Some(&place), Some(contact)) = (self.unmatched.get(&last.key), contact) {
                keep_side(&mut contacts[place as usize], contact);
            }
        }
    }
}

/// Splits all contacts into consecutive parts, each with the index of its first contact.
fn parts_of(contacts: &mut [CompactContact]) -> impl Iterator<Item = (usize, &mut [CompactContact])> + Send {
    let (mut start, mut rest) = (0, contacts);
    std::iter::from_fn(move || {
        let mut count = PART.min(rest.len());
        while count < rest.len() && rest[count].triangles() == rest[count - 1].triangles() {
            count += 1;
        }
        let (part, later) = mem::take(&mut rest).split_at_mut(count);
        rest = later;
        start += count;
        (count > 0).then_some((start - count, part))
    })
}

/// Flips contacts that the same triangles reported in the last tick. Lists the shared contacts that these triangles did
/// not report.
fn keep_own_sides(
    contacts: &mut [CompactContact],
    first: usize,
    before: &[CompactContact],
    unmatched: &mut Vec<SharedContact>,
) {
    let Some(start) = contacts.first().map(CompactContact::triangles) else { return };
    let mut before = &before[before.partition_point(|other| other.triangles() < start)..];
    for (place, contact) in (first as u32..).zip(contacts) {
        if !contact.key.has_sides() {
            continue;
        }
        let is_earlier = |other: &CompactContact| (other.triangles(), other.key) < (contact.triangles(), contact.key);
        while let [other, later @ ..] = before
            && is_earlier(other)
        {
            before = later;
        }
        match before.first().filter(|other| other.key == contact.key) {
            Some(last) => keep_side(contact, last),
            None if contact.is_shared => unmatched.push(SharedContact { key: contact.key, place }),
            None => {}
        }
    }
}

/// Flips a contact if its normal has reversed since the last contact of the same features.
fn keep_side(contact: &mut CompactContact, last: &CompactContact) {
    if from_first_feature(contact).dot(from_first_feature(last)) < 0.0 {
        flip(contact);
    }
}

/// Flips contacts back that seem to have passed, where most others between the same components have not. For surfaces that
/// do not cross: such a contact has turned round a rim, or was first seen while they crossed.
pub(super) fn agree(contacts: &mut [CompactContact], [a, b]: [&SurfaceTopology; 2]) {
    let has_passed = |contact: &CompactContact| contact.key.has_sides() && contact.distance < 0.0;
    if !contacts.iter().any(has_passed) {
        return;
    }
    let (components_a, components_b) = (a.components().0, b.components().0);
    let components_of = |contact: &CompactContact| {
        let [a, b] = [components_a[contact.triangle_a as usize], components_b[contact.triangle_b as usize]];
        if contact.swapped { [b, a] } else { [a, b] }
    };
    // How many have passed, and how many there are.
    let mut counts: HashMap<[u32; 2], [u32; 2]> = HashMap::default();
    for contact in contacts.iter().filter(|contact| contact.key.has_sides()) {
        let [passed, all] = counts.entry(components_of(contact)).or_default();
        *passed += u32::from(has_passed(contact));
        *all += 1;
    }
    for contact in contacts {
        if has_passed(contact) && counts.get(&components_of(contact)).is_some_and(|[passed, all]| 2 * passed < *all) {
            flip(contact);
        }
    }
}

fn flip(contact: &mut CompactContact) {
    contact.normal = -contact.normal;
    contact.distance = -contact.distance;
}

/// The normal in the order of the key. In a self-collision, either of the two features may come first in the contact.
fn from_first_feature(contact: &CompactContact) -> Vec3 {
    if contact.swapped { -contact.normal } else { contact.normal }
}
