//! Brings what was found of a pair of surfaces into the order of the store: contacts by key, each key once, and touching
//! triangles by their numbers.
//!
//! Reads the records where they were found and copies each of those that stay once, to where it belongs; what is sorted is
//! small.

use super::{
    contact::{CompactContact, FEATURE_BITS, TouchingPair},
    key_order::{KeyOrder, Places, RECORDS_OF_ONE, joined},
    share::Share,
};

/// Records listed or copied by one task.
const CHUNK: usize = 8192;

/// The order of a pair's contacts. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct ContactOrder {
    order: KeyOrder,
    /// The triangles of every contact.
    triangles: Vec<u64>,
}

impl ContactOrder {
    /// Finds which contacts stay, and their order: of every key the one of the lowest triangles, of those with the same
    /// triangles the first that was found.
    pub fn arrange(&mut self, contacts: &[CompactContact], share: &impl Share) {
        let Self { order, triangles } = self;
        triangles.resize(contacts.len(), 0);
        let lists = order.keys(contacts.len()).chunks_mut(CHUNK).zip(triangles.chunks_mut(CHUNK));
        let chunks = contacts.chunks(CHUNK).zip(lists);
        share.hand_out(chunks, contacts.len() / RECORDS_OF_ONE, |(contacts, (keys, triangles))| {
            for ((contact, key), triangles) in contacts.iter().zip(keys).zip(triangles) {
                *key = key_in_halves(contact.key.0);
                *triangles = joined(contact.triangle_a, contact.triangle_b);
            }
        });
        order.arrange(share, Some(&|later, earlier| triangles[later] < triangles[earlier]));
    }

    /// How many contacts stay.
    #[must_use]
    pub fn count(&self) -> usize {
        self.order.count()
    }

    /// The places of the contacts that stay, in parts that are not empty.
    pub fn parts(&self) -> impl Iterator<Item = Places<'_>> {
        self.order.parts()
    }
}

/// Kind and first feature in one half of a number, the second feature in the other.
fn key_in_halves(key: u64) -> u64 {
    joined((key >> FEATURE_BITS) as u32, (key & ((1 << FEATURE_BITS) - 1)) as u32)
}

/// Sorts touching pairs by their triangles. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct TouchingOrder(KeyOrder);

impl TouchingOrder {
    /// Writes touching pairs in their order.
    pub fn sort(&mut self, touching: &[TouchingPair], sorted: &mut [TouchingPair], share: &impl Share) {
        let order = &mut self.0;
        let lists = touching.chunks(CHUNK).zip(order.keys(touching.len()).chunks_mut(CHUNK));
        share.hand_out(lists, touching.len() / RECORDS_OF_ONE, |(touching, keys)| {
            for (pair, key) in touching.iter().zip(keys) {
                *key = joined(pair.triangle_a, pair.triangle_b);
            }
        });
        order.arrange(share, None);
        copy_in_order(touching, order.parts(), touching.len(), sorted, share, |_| ());
    }
}

/// Copies the records of some places, `count` in all, one part after the other, each of which is finished by `finish`.
pub fn copy_in_order<'a, T: Copy + Send + Sync>(
    records: &[T],
    parts: impl Iterator<Item = Places<'a>> + Send,
    count: usize,
    mut sorted: &mut [T],
    share: &impl Share,
    finish: impl Fn(&mut [T]) + Sync,
) {
    let copies = parts.map(|part| {
        let (own, later) = std::mem::take(&mut sorted).split_at_mut(part.len());
        sorted = later;
        (part, own)
    });
    share.hand_out(copies, count / RECORDS_OF_ONE, |(places, sorted)| {
        for (place, sorted) in places.iter().zip(&mut *sorted) {
            *sorted = records[place];
        }
        finish(sorted);
    });
}
