//! Keeps two-sided contacts on the sides they were on in the last tick.
//!
//! Where a contact's normal has turned round since then, its features have passed through each other: the normal stays, and the
//! distance is negative. Contacts come in the same order in every tick, so each is found beside the last one; those that other
//! triangles may have reported are looked up by their keys.

use std::mem;

use bevy_platform::collections::HashMap;
use glam::Vec3;

use crate::kernel::{
    contact::{CompactContact, ContactKey, SharedContact},
    simd::share::Share,
};

#[cfg(test)]
mod tests;

/// Contacts of one part, and a few more: a pair of triangles is never cut.
const PART: usize = 8192;

/// Fewer contacts than these are not worth another thread.
const CONTACTS_OF_ONE: usize = 32_768;

/// The contacts of the last tick.
#[derive(Clone, Copy, Default)]
pub(super) struct Before<'a> {
    pub(super) contacts: &'a [CompactContact],
    /// Those that are shared and have sides.
    pub(super) shared: &'a [SharedContact],
}

/// The contacts of a tick in which the sides came in the other order, as if they had come in this one: what the
/// [`SurfaceOrder`](crate::SurfaceOrder) of a surface has changed.
#[derive(Default)]
pub(super) struct Reversed {
    contacts: Vec<CompactContact>,
    shared: Vec<SharedContact>,
}

impl Reversed {
    /// Those that have sides, where `turn` brings normals into the frame of this tick.
    pub(super) fn of(&mut self, before: Before<'_>, turn: impl Fn(Vec3) -> Vec3) -> Before<'_> {
        self.contacts.clear();
        let with_sides = before.contacts.iter().filter(|contact| contact.key.has_sides());
        self.contacts.extend(with_sides.map(|&contact| CompactContact {
            key: contact.key.reversed(),
            triangle_a: contact.triangle_b,
            triangle_b: contact.triangle_a,
            features: contact.features.swapped(),
            // The way to the first side is the way from it now.
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

/// Turns contacts round. Keeps its memory.
#[derive(Default)]
pub(super) struct Sides {
    parts: Vec<Vec<SharedContact>>,
    unmatched: HashMap<ContactKey, u32>,
}

impl Sides {
    /// Turns those contacts round whose normals have turned round since the last tick.
    pub(super) fn keep(&mut self, contacts: &mut [CompactContact], before: Before<'_>, share: &impl Share) {
        if before.contacts.is_empty() {
            return;
        }
        self.parts.iter_mut().for_each(Vec::clear);
        self.parts.resize_with(self.parts.len().max(contacts.len().div_ceil(PART)), Vec::new);
        let count = contacts.len() / CONTACTS_OF_ONE;
        let tasks = parts_of(contacts).zip(&mut self.parts);
        share.hand_out(tasks, count, |((first, contacts), unmatched)| {
            keep_own_sides(contacts, first, before.contacts, unmatched);
        });
        self.keep_shared_sides(contacts, before);
    }

    /// Turns round what other triangles have reported in the last tick.
    fn keep_shared_sides(&mut self, contacts: &mut [CompactContact], before: Before<'_>) {
        self.unmatched.clear();
        self.unmatched.extend(self.parts.iter().flatten().map(|shared| (shared.key, shared.place)));
        if self.unmatched.is_empty() {
            return;
        }
        for last in before.shared {
            // Whoever writes to the store may have put another one in that place.
            let contact = before.contacts.get(last.place as usize).filter(|contact| contact.key == last.key);
            if let (Some(&place), Some(contact)) = (self.unmatched.get(&last.key), contact) {
                keep_side(&mut contacts[place as usize], contact);
            }
        }
    }
}

/// Consecutive parts that together are all contacts, each with the place of its first one.
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

/// Turns round what the same triangles have reported in the last tick, and lists those shared contacts that they have not.
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

/// Turns a contact round where its normal has turned round since the last one of the same features.
fn keep_side(contact: &mut CompactContact, last: &CompactContact) {
    if from_first_feature(contact).dot(from_first_feature(last)) < 0.0 {
        contact.normal = -contact.normal;
        contact.distance = -contact.distance;
    }
}

/// The normal of a contact, of which in a self-collision either of the two features may have come first.
fn from_first_feature(contact: &CompactContact) -> Vec3 {
    if contact.swapped { -contact.normal } else { contact.normal }
}
