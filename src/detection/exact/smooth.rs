//! The last step of the exact test of a pair with a smooth side: moves contacts and distances to the patches.

use crate::{
    detection::parallel::Threads,
    kernel::{
        contact::{CompactContact, TouchingPair},
        pair::{FoundPairs, PairSettings},
        simd::parallel::Parallel,
        smooth::{
            refine::{refine_contacts, refine_touching},
            slide::SmoothSide,
        },
    },
};

/// Contacts or pairs per task.
const CHUNK: usize = 256;

/// Moves what was found on flat triangles, with [widened](PairSettings::widened) distances, to the patches of a pair of
/// surfaces. `bulge` is how far the patches may be from the triangles, in world units.
pub(super) fn refine_pair(
    sides: [SmoothSide<'_>; 2],
    settings: &PairSettings,
    bulge: f64,
    threads: usize,
    found: &mut FoundPairs,
) {
    let FoundPairs { contacts, touching, .. } = found;
    let chunks = contacts.len() / CHUNK;
    Threads(threads).run_tasks(contacts.chunks_mut(CHUNK), chunks, |contacts| {
        refine_contacts(sides, settings, contacts);
    });
    let chunks = touching.len() / CHUNK;
    Threads(threads).run_tasks(touching.chunks_mut(CHUNK), chunks, |touching| {
        refine_touching(sides, settings, bulge, touching);
    });
    finish(settings, found);
}

/// Drops what is too far away, and restores the order.
fn finish(settings: &PairSettings, found: &mut FoundPairs) {
    found.contacts.retain(|contact| !contact.is_none());
    let order = |contact: &CompactContact| (contact.triangles(), contact.key);
    if !found.contacts.is_sorted_by_key(order) {
        found.contacts.sort_unstable_by_key(order);
    }
    let of_contacts = found.contacts.iter().map(|contact| f64::from(contact.distance).abs());
    let nearest = found.touching.iter().map(|pair| pair.distance).chain(of_contacts).fold(f64::INFINITY, f64::min);
    found.nearest = if nearest <= settings.range { nearest } else { f64::INFINITY };
    found.touching.retain(|pair: &TouchingPair| pair.distance <= settings.contact_distance);
    found.list_shared();
}
