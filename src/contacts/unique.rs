//! The contacts that were found of a pair of surfaces, each pair of features once.
//!
//! They are found triangle pair by triangle pair, in the order in which they are stored. Most features are reported by one
//! triangle pair alone; of those that [several](CompactContact::is_shared) report the first contact stays. Every record is
//! copied once, from where it was found to where it stays, in parts that may be shared among threads.

use std::mem;

use bevy_platform::collections::{HashMap, HashSet};
use glam::Vec3;

use crate::kernel::{
    contact::{CompactContact, ContactKey, SharedContact},
    exact::FeatureKind,
    share::Share,
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

/// Finds out which contacts stay and copies them. Keeps its memory.
#[derive(Default)]
pub(super) struct UniqueContacts {
    known: HashSet<ContactKey>,
    /// The places of contacts that are left out, ascending.
    left_out: Vec<u32>,
    parts: Vec<Part>,
    unmatched: HashMap<ContactKey, u32>,
    shared: Vec<SharedContact>,
}

/// What is known of some consecutive contacts once they are copied.
#[derive(Default)]
struct Part {
    /// How many there are.
    count: u32,
    /// Those that are shared and have sides, by their places from the first of the part on.
    shared: Vec<SharedContact>,
    /// Those of them that the same triangles did not report in the last tick.
    unmatched: Vec<SharedContact>,
}

impl UniqueContacts {
    /// Finds out which of some contacts stay, given which of them are shared, and how many.
    pub(super) fn count(&mut self, contacts: &[CompactContact], shared: &[SharedContact]) -> usize {
        self.known.clear();
        self.left_out.clear();
        let repeats = shared.iter().filter(|shared| !self.known.insert(shared.key));
        self.left_out.extend(repeats.map(|shared| shared.place));
        contacts.len() - self.left_out.len()
    }

    /// Copies those that stay of the same contacts, as many as were counted: pair by pair, those of a pair by key. Where a
    /// contact's normal has turned round since the last tick it has passed through: it keeps the side it was on, and its
    /// distance is negative. Returns what the next tick has to be told as [shared](Before::shared).
    pub(super) fn copy(
        &mut self,
        found: &[CompactContact],
        before: Before<'_>,
        stored: &mut [CompactContact],
        share: &impl Share,
    ) -> &[SharedContact] {
        for part in &mut self.parts {
            part.clear();
        }
        self.parts.resize_with(self.parts.len().max(found.len().div_ceil(PART)), Part::default);
        let mut rest = (0, &self.left_out[..], &mut *stored);
        let tasks = ends_of_parts(found).zip(&mut self.parts).map(|(end, part)| {
            let (start, left_out, stored) = mem::take(&mut rest);
            let (left_out, later_left_out) =
                left_out.split_at(left_out.partition_point(|&place| (place as usize) < end));
            let (stored, later) = stored.split_at_mut(end - start - left_out.len());
            rest = (end, later_left_out, later);
            (start..end, left_out, stored, part)
        });
        share.hand_out(tasks, found.len() / CONTACTS_OF_ONE, |(range, left_out, stored, part)| {
            copy_all_but(&found[range.clone()], range.start, left_out, stored);
            part.keep_sides(stored, before.contacts);
        });
        self.join();
        self.keep_shared_sides(before, stored);
        &self.shared
    }

    /// Joins what is known of the parts, whose contacts are then told by their places among all.
    fn join(&mut self) {
        self.shared.clear();
        self.unmatched.clear();
        let mut first = 0;
        for part in &self.parts {
            self.shared.extend(part.shared.iter().map(|shared| shared.later(first)));
            self.unmatched.extend(part.unmatched.iter().map(|shared| (shared.key, shared.place + first)));
            first += part.count;
        }
    }

    /// Turns round what other triangles have reported in the last tick.
    fn keep_shared_sides(&self, before: Before<'_>, stored: &mut [CompactContact]) {
        if self.unmatched.is_empty() {
            return;
        }
        for last in before.shared {
            // Whoever writes to the store may have put another one in that place.
            let contact = before.contacts.get(last.place as usize).filter(|contact| contact.key == last.key);
            if let (Some(&place), Some(contact)) = (self.unmatched.get(&last.key), contact) {
                keep_side(&mut stored[place as usize], contact);
            }
        }
    }
}

impl Part {
    fn clear(&mut self) {
        self.count = 0;
        self.shared.clear();
        self.unmatched.clear();
    }

    /// Turns contacts round whose normals have turned round.
    fn keep_sides(&mut self, stored: &mut [CompactContact], before: &[CompactContact]) {
        self.count = stored.len() as u32;
        let Some(first) = stored.first() else { return };
        let mut before = &before[before.partition_point(|other| other.triangles() < first.triangles())..];
        for (place, contact) in (0..).zip(stored) {
            // Around a corner or a rim a direction may turn without anything having passed.
            if !matches!(contact.features.kind(), FeatureKind::VertexFace | FeatureKind::EdgeEdge) {
                continue;
            }
            let is_earlier =
                |other: &CompactContact| (other.triangles(), other.key) < (contact.triangles(), contact.key);
            while let [other, later @ ..] = before
                && is_earlier(other)
            {
                before = later;
            }
            let same = before.first().filter(|other| other.key == contact.key);
            if contact.is_shared {
                let shared = SharedContact { key: contact.key, place };
                self.shared.push(shared);
                self.unmatched.extend(same.is_none().then_some(shared));
            }
            if let Some(last) = same {
                keep_side(contact, last);
            }
        }
    }
}

/// Where parts end that together are all contacts.
fn ends_of_parts(found: &[CompactContact]) -> impl Iterator<Item = usize> + Send {
    let mut start = 0;
    std::iter::from_fn(move || {
        let mut end = (start + PART).min(found.len());
        while end < found.len() && found[end].triangles() == found[end - 1].triangles() {
            end += 1;
        }
        (mem::replace(&mut start, end) < found.len()).then_some(end)
    })
}

/// Copies contacts, the first of which was found at `start`, without those of some places.
fn copy_all_but(found: &[CompactContact], start: usize, left_out: &[u32], stored: &mut [CompactContact]) {
    let mut left_out = left_out.iter().map(|&place| place as usize - start).chain([found.len()]);
    let (mut next, mut first_of_pair, mut kept) = (left_out.next(), 0, 0);
    for (place, contact) in found.iter().enumerate() {
        if next == Some(place) {
            next = left_out.next();
            continue;
        }
        stored[kept] = *contact;
        if kept > 0 && stored[kept - 1].triangles() == contact.triangles() {
            let mut place = kept;
            while place > first_of_pair && stored[place].key < stored[place - 1].key {
                stored.swap(place, place - 1);
                place -= 1;
            }
        } else {
            first_of_pair = kept;
        }
        kept += 1;
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
