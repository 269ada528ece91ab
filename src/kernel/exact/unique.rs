//! Keeps one contact per feature pair.
//!
//! Contacts are found triangle pair by triangle pair, in the order in which they are stored. Most feature pairs are
//! reported by one triangle pair only. If [several](crate::kernel::contact::CompactContact::is_shared) report one, the
//! first contact is kept.

use bevy_platform::collections::HashSet;

use crate::kernel::{
    contact::{CompactContact, ContactKey},
    pair::FoundPairs,
};

/// Drops contacts of feature pairs that have one already. Keeps its memory.
#[derive(Debug, Default)]
pub struct UniqueFeatures {
    known: HashSet<ContactKey>,
    /// The indices of contacts to drop, ascending.
    repeats: Vec<u32>,
}

impl UniqueFeatures {
    /// Forgets all feature pairs.
    pub fn clear(&mut self) {
        self.known.clear();
    }

    /// Drops repeats among the contacts that are listed as shared, from index `first_shared` of that list on.
    /// Afterwards only vertex–face and edge–edge contacts are listed.
    pub fn drop_repeats(&mut self, found: &mut FoundPairs, first_shared: usize) {
        self.repeats.clear();
        let mut listed = first_shared;
        for place in first_shared..found.shared.len() {
            let shared = found.shared[place];
            if !self.known.insert(shared.key) {
                self.repeats.push(shared.place);
            } else if shared.key.has_sides() {
                found.shared[listed] = shared.earlier(self.repeats.len() as u32);
                listed += 1;
            }
        }
        found.shared.truncate(listed);
        drop_places(&mut found.contacts, &self.repeats);
    }

    /// Appends the results of a later part of the candidates, without repeats.
    pub fn append(&mut self, found: &mut FoundPairs, later: &mut FoundPairs) {
        self.drop_repeats(later, 0);
        found.append(later);
    }
}

/// Recently reported feature pairs. Most of what several pairs of triangles report is found here with one look-up, and
/// need not be computed, written, and dropped again.
pub(in crate::kernel) struct RecentFeatures {
    keys: [ContactKey; Self::COUNT],
}

impl RecentFeatures {
    const COUNT: usize = 256;

    pub(in crate::kernel) const NONE: Self = Self { keys: [CompactContact::NONE.key; Self::COUNT] };

    /// Whether a contact of these features was reported recently that is certain to be kept. Remembers this contact if
    /// it is certain to be kept (`stays`).
    #[inline]
    pub(in crate::kernel) fn know(&mut self, key: ContactKey, stays: bool) -> bool {
        let known = self.place(key);
        let is_known = *known == key;
        if stays {
            *known = key;
        }
        is_known
    }

    /// Remembers a contact that is certain to be kept.
    #[inline]
    pub(in crate::kernel) fn add(&mut self, key: ContactKey) {
        *self.place(key) = key;
    }

    #[inline]
    fn place(&mut self, key: ContactKey) -> &mut ContactKey {
        // 2^64 over the golden ratio: the upper bits of the product depend on the whole key.
        let place = key.0.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (u64::BITS - Self::COUNT.ilog2());
        &mut self.keys[place as usize % Self::COUNT]
    }
}

/// Drops the contacts at some indices, which ascend.
fn drop_places(contacts: &mut Vec<CompactContact>, places: &[u32]) {
    let Some(&first) = places.first() else { return };
    let mut kept = first as usize;
    let ends = places[1..].iter().map(|&place| place as usize).chain([contacts.len()]);
    for (&place, end) in places.iter().zip(ends) {
        let stay = place as usize + 1..end;
        let count = stay.len();
        contacts.copy_within(stay, kept);
        kept += count;
    }
    contacts.truncate(kept);
}
