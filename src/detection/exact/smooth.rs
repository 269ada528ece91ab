//! The last step of the exact test of a pair with a smooth side: moves contacts and distances to the patches.

use crate::{
    detection::parallel::Threads,
    kernel::{
        contact::{CompactContact, TouchingPair},
        mesh::feature::FeatureKind,
        pair::{FoundPairs, PairSettings, SurfaceSide},
        simd::parallel::Parallel,
        smooth::refine::{refine_contacts, refine_touching},
    },
};

/// Contacts or pairs per task.
const CHUNK: usize = 256;

/// Moves what was found on flat triangles, with [widened](PairSettings::widened) distances, to the patches of a pair of
/// surfaces.
pub(in crate::detection) fn refine_pair(
    sides: [&SurfaceSide<'_>; 2],
    settings: &PairSettings,
    threads: usize,
    found: &mut FoundPairs,
) {
    let FoundPairs { contacts, touching, .. } = found;
    let chunks = contacts.len() / CHUNK;
    Threads(threads).run_tasks(contacts.chunks_mut(CHUNK), chunks, |contacts| {
        refine_contacts(sides, settings, contacts);
    });
    let chunks = touching.len() / CHUNK;
    let mut inner: Vec<Vec<CompactContact>> = Vec::new();
    inner.resize_with(touching.len().div_ceil(CHUNK), Vec::new);
    let tasks = touching.chunks_mut(CHUNK).zip(&mut inner);
    Threads(threads).run_tasks(tasks, chunks, |(touching, inner)| refine_touching(sides, settings, touching, inner));
    reconcile(touching, contacts);
    contacts.retain(|contact| !contact.is_none());
    contacts.extend(inner.iter().flatten());
    finish(sides, settings, found);
}

/// Drops what is too far away, and restores the order.
fn finish(sides: [&SurfaceSide<'_>; 2], settings: &PairSettings, found: &mut FoundPairs) {
    // Two sorted lists, one after the other.
    found.contacts.sort_by_key(|contact| (contact.triangles(), contact.key));
    let [a, b] = sides;
    let lack = |contact: &CompactContact| {
        a.lack_at(contact.triangle_a, contact.barycentric_a) + b.lack_at(contact.triangle_b, contact.barycentric_b)
    };
    // Where patches are closest is not known here, so that the largest thickness of their corners counts.
    let reach = |pair: &TouchingPair| pair.distance + a.least_lack(pair.triangle_a) + b.least_lack(pair.triangle_b);
    if !(a.is_evenly_thick() && b.is_evenly_thick()) {
        let is_reported = |contact: &CompactContact| {
            contact.features.kind() == FeatureKind::EdgeFace
                || f64::from(contact.distance) + lack(contact) <= settings.reported_distance
        };
        found.contacts.retain(is_reported);
    }
    let of_contacts = found.contacts.iter().map(|contact| f64::from(contact.distance).abs() + lack(contact));
    let nearest = found.touching.iter().map(reach).chain(of_contacts).fold(f64::INFINITY, f64::min);
    found.nearest = if nearest <= settings.range { nearest } else { f64::INFINITY };
    found.touching.retain(|pair: &TouchingPair| reach(pair) <= settings.contact_distance);
    found.list_shared();
}

/// Makes both lists agree, which are in the order of the triangles: patches are no farther apart than the points of
/// their contacts, and have no crossing contact if they do not cross.
fn reconcile(touching: &mut [TouchingPair], contacts: &mut [CompactContact]) {
    let mut pairs = touching.iter_mut().peekable();
    for contact in contacts.iter_mut().filter(|contact| !contact.is_none()) {
        let triangles = contact.triangles();
        while pairs.next_if(|pair| (pair.triangle_a, pair.triangle_b) < triangles).is_some() {}
        let Some(pair) = pairs.peek_mut().filter(|pair| (pair.triangle_a, pair.triangle_b) == triangles) else {
            continue;
        };
        if contact.features.kind() != FeatureKind::EdgeFace {
            pair.distance = pair.distance.min(f64::from(contact.distance.abs()));
        } else if pair.distance > 0.0 {
            *contact = CompactContact::NONE;
        }
    }
}
