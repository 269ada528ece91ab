//! The order of the store, against a stable comparison sort of whole records.

use bevy_circumsphere::kernel::{
    contact::{CompactContact, ContactKey, TouchingPair},
    contact_order::{ContactOrder, TouchingOrder, copy_in_order},
    exact::{Feature, FeaturePair},
    share::{OneByOne, Share},
};
use circumsphere_support::random::Random;
use glam::Vec3;

use crate::last_first::LastFirst;

fn below(random: &mut Random, end: u32) -> u32 {
    random.below(end.into()) as u32
}

/// Contacts of three kinds, among `numbers` features, every one of them found up to `copies` times; told apart by their
/// distance, which is the place where they were found.
fn contacts(random: &mut Random, count: usize, numbers: u32, copies: u32) -> Vec<CompactContact> {
    let mut contacts: Vec<CompactContact> = Vec::new();
    while contacts.len() < count {
        let kind = [0_u64, 4, 8][below(random, 3) as usize];
        // A third of them on the same feature: a landscape of a few large triangles.
        let first = if below(random, 3) == 0 { numbers / 2 } else { below(random, numbers) };
        let key = (kind << 56) | (u64::from(first) << 28) | u64::from(below(random, numbers));
        for _ in 0..=below(random, copies) {
            contacts.push(CompactContact {
                key: ContactKey(key),
                triangle_a: below(random, 3),
                triangle_b: below(random, 3),
                features: FeaturePair { a: Feature::Face, b: Feature::Face },
                swapped: false,
                barycentric_a: [0.0; 2],
                barycentric_b: [0.0; 2],
                point_b: Vec3::ZERO,
                normal: Vec3::Y,
                distance: 0.0,
            });
        }
    }
    // Copies are found far from each other.
    for place in (1..contacts.len()).rev() {
        contacts.swap(place, below(random, place as u32 + 1) as usize);
    }
    for (place, contact) in contacts.iter_mut().enumerate() {
        contact.distance = place as f32;
    }
    contacts
}

fn in_order(order: &mut ContactOrder, found: &[CompactContact], share: &impl Share) -> Vec<CompactContact> {
    order.arrange(found, share);
    let mut sorted = found[..order.count()].to_vec();
    copy_in_order(found, order.parts(), order.count(), &mut sorted, share, |_| ());
    sorted
}

#[test]
fn contacts_come_in_the_order_of_a_stable_sort_and_every_key_once() {
    let mut random = Random::new(5);
    let mut order = ContactOrder::default();
    let mut dropped = 0;
    // Sorted by comparison because they are few, by counting, by comparison because they are thinly spread, and as the
    // first but with so many on few features that whole buckets are of one number.
    for (count, numbers, copies) in [
        (0, 5, 1),
        (1, 5, 1),
        (40, 9, 4),
        (5000, 700, 6),
        (20_000, 9000, 3),
        (300, 1 << 27, 2),
        (60_000, 1 << 27, 1),
        (60_000, 70, 2),
    ] {
        let found = contacts(&mut random, count, numbers, copies);
        let mut expected = found.clone();
        expected.sort_by_key(|contact| (contact.key, contact.triangle_a, contact.triangle_b));
        expected.dedup_by_key(|contact| contact.key);
        dropped += found.len() - expected.len();
        assert_eq!(in_order(&mut order, &found, &OneByOne), expected, "{count} contacts");
        assert_eq!(in_order(&mut order, &found, &LastFirst), expected, "{count} contacts, last task first");
    }
    assert!(dropped > 10_000, "only {dropped} contacts were found more than once");
}

#[test]
fn touching_pairs_come_in_the_order_of_their_triangles() {
    let mut random = Random::new(6);
    let mut order = TouchingOrder::default();
    for (count, triangles) in
        [(0, 1), (30, 4), (10_000, 800), (10_000, 20), (200, u32::MAX), (40_000, 30_000), (40_000, u32::MAX)]
    {
        let mut pairs: Vec<[u32; 2]> =
            (0..count).map(|_| [below(&mut random, triangles), below(&mut random, 100_000)]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let pair = |[triangle_a, triangle_b]: [u32; 2]| TouchingPair { triangle_a, triangle_b, distance: 0.5 };
        let expected: Vec<TouchingPair> = pairs.iter().copied().map(pair).collect();
        for place in (1..pairs.len()).rev() {
            pairs.swap(place, below(&mut random, place as u32 + 1) as usize);
        }
        let found: Vec<TouchingPair> = pairs.iter().copied().map(pair).collect();
        assert!(count < 30 || found != expected, "they have to be in disorder");
        let mut sorted = found.clone();
        order.sort(&found, &mut sorted, &OneByOne);
        assert_eq!(sorted, expected, "{count} pairs of {triangles} triangles");
        sorted.fill(TouchingPair { triangle_a: 0, triangle_b: 0, distance: 0.0 });
        order.sort(&found, &mut sorted, &LastFirst);
        assert_eq!(sorted, expected, "{count} pairs of {triangles} triangles, last task first");
    }
}
