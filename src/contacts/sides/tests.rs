//! Compares the contacts that remain, and their sides, with searches through whole lists.

use std::collections::{BTreeMap, BTreeSet};

use circumsphere_support::random::Random;

use super::*;
use crate::kernel::{
    exact::unique::UniqueFeatures,
    mesh::feature::{Feature, FeaturePair},
    pair::FoundPairs,
    simd::parallel::{OnTwoThreads, Sequential},
};

/// Kinds of feature pairs, and their numbers in keys.
const KINDS: [(FeaturePair, u64); 3] = [
    (FeaturePair { a: Feature::Vertex(0), b: Feature::Face }, 2),
    (FeaturePair { a: Feature::Edge(0), b: Feature::Edge(1) }, 4),
    (FeaturePair { a: Feature::Vertex(0), b: Feature::Vertex(1) }, 0),
];

fn contact(
    random: &mut Random,
    key: u64,
    triangles: [u32; 2],
    is_shared: bool,
    (features, kind): (FeaturePair, u64),
) -> CompactContact {
    let [triangle_a, triangle_b] = triangles;
    let turned = random.below(3) == 0;
    CompactContact {
        key: ContactKey(kind << 56 | key),
        triangle_a,
        triangle_b,
        features,
        swapped: random.below(2) == 0,
        is_shared,
        barycentric_a: [0.0; 2],
        barycentric_b: [0.0; 2],
        point_b: Vec3::ZERO,
        normal: if turned { -Vec3::Y } else { Vec3::Y },
        distance: random.below(1000) as f32,
    }
}

/// Contacts of some pairs of triangles. Pairs are in order, but the contacts of a pair are not. Every shared key is of
/// one kind, and every other key belongs to one pair.
fn contacts(random: &mut Random, pair_count: u64, shared_keys: u64) -> Vec<CompactContact> {
    let mut found: Vec<CompactContact> = Vec::new();
    for first in 0..pair_count {
        // Pairs come and go from tick to tick.
        if random.below(5) == 0 {
            continue;
        }
        let triangles = [(first / 7) as u32, (first % 7) as u32];
        let mut known = BTreeSet::new();
        for number in 0..random.below(4) {
            let is_shared = random.below(2) == 0;
            let key = if is_shared { 2 * random.below(shared_keys) } else { 2 * (first * 4 + 3 - number) + 1 };
            if known.insert(key) {
                found.push(contact(random, key, triangles, is_shared, KINDS[(key / 2 % 3) as usize]));
            }
        }
    }
    found
}

/// The contacts that must remain. `before` are those of the last tick.
fn expected(found: &[CompactContact], before: &[CompactContact]) -> Vec<CompactContact> {
    let mut known = BTreeSet::new();
    let mut kept: Vec<CompactContact> = found.iter().copied().filter(|contact| known.insert(contact.key)).collect();
    kept.sort_by_key(|contact| (contact.triangles(), contact.key));
    let last: BTreeMap<ContactKey, CompactContact> = before.iter().map(|contact| (contact.key, *contact)).collect();
    for contact in &mut kept {
        let has_sides = contact.features != KINDS[2].0;
        let turned = |last: &CompactContact| {
            let same_order = last.swapped == contact.swapped;
            (last.normal == contact.normal) != same_order
        };
        if has_sides && last.get(&contact.key).is_some_and(turned) {
            contact.normal = -contact.normal;
            contact.distance = -contact.distance;
        }
    }
    kept
}

/// The contacts that remain if they are found in parts, and the shared ones for the next tick.
fn kept(
    found: &[CompactContact],
    parts: usize,
    before: Before<'_>,
    parallel: &impl Parallel,
) -> (Vec<CompactContact>, Vec<SharedContact>) {
    let (mut unique, mut kept) = (UniqueFeatures::default(), FoundPairs::default());
    let mut rest = found;
    for part in 0..parts {
        let mut count = if part + 1 == parts { rest.len() } else { found.len() / parts };
        while count > 0 && count < rest.len() && rest[count].triangles() == rest[count - 1].triangles() {
            count += 1;
        }
        let (now, later) = rest.split_at(count.min(rest.len()));
        rest = later;
        // In place, or appended from a separate list.
        if part % 2 == 0 {
            let (first, first_shared) = (kept.contacts.len(), kept.shared.len());
            kept.contacts.extend_from_slice(now);
            kept.finish_contacts(first);
            unique.drop_repeats(&mut kept, first_shared);
        } else {
            let mut later = FoundPairs { contacts: now.to_vec(), ..FoundPairs::default() };
            later.finish_contacts(0);
            unique.append(&mut kept, &mut later);
        }
    }
    Sides::default().keep(&mut kept.contacts, before, parallel);
    (kept.contacts, kept.shared)
}

#[test]
fn every_pair_of_features_stays_once_on_its_side() {
    let mut random = Random::new(7);
    for (pair_count, shared_keys) in [(0, 1), (1, 1), (40, 10), (20_000, 3_000), (30_000, 200_000)] {
        let (mut before, mut shared) = (Vec::new(), Vec::new());
        let (mut repeats, mut turned, mut turned_elsewhere) = (0, 0, 0);
        for _ in 0..4 {
            let found = contacts(&mut random, pair_count, shared_keys);
            let expected = expected(&found, &before);
            let last = Before { contacts: &before, shared: &shared };
            let (stored, now_shared) = kept(&found, 1, last, &Sequential);
            assert!(stored == expected, "{pair_count} pairs");
            for parts in [2, 7] {
                let in_parts = kept(&found, parts, last, &OnTwoThreads);
                assert!(in_parts == (stored.clone(), now_shared.clone()), "{pair_count} pairs in {parts} parts");
            }
            for shared in &now_shared {
                assert_eq!(stored[shared.place as usize].key, shared.key);
            }
            repeats += found.len() - stored.len();
            let places: BTreeMap<ContactKey, (u32, u32)> =
                before.iter().map(|contact: &CompactContact| (contact.key, contact.triangles())).collect();
            for contact in stored.iter().filter(|contact| contact.distance < 0.0) {
                turned += 1;
                turned_elsewhere += usize::from(places[&contact.key] != contact.triangles());
            }
            (before, shared) = (stored, now_shared);
        }
        let is_large = pair_count > 1000;
        assert!(!is_large || repeats > 100 && turned > 100 && turned_elsewhere > 20, "{repeats} {turned}");
    }
}

#[test]
fn most_contacts_of_two_components_decide_for_all() {
    // Two triangles without a common vertex, and one that has both in one component.
    let positions: Vec<Vec3> = (0..6).map(|vertex| Vec3::X * vertex as f32).collect();
    let topology = |triangles| SurfaceTopology::new(&positions, triangles).expect("the triangles are valid");
    let (apart, joined) = (topology(&[[0, 1, 2], [3, 4, 5]]), topology(&[[0, 1, 2], [2, 3, 4]]));
    let mut random = Random::new(5);
    let mut with = |triangle_a: u32, triangle_b: u32, distance: f32, kind: usize| CompactContact {
        distance,
        swapped: false,
        ..contact(&mut random, 1, [triangle_a, triangle_b], false, KINDS[kind])
    };
    let found = [
        with(0, 0, 0.1, 0),
        with(0, 1, 0.2, 1),
        with(0, 0, -0.3, 1),
        // Without sides, so it does not count.
        with(1, 0, 0.1, 2),
        with(1, 0, 0.1, 2),
        with(1, 0, -0.2, 0),
        with(1, 1, -0.4, 1),
        with(1, 1, 0.4, 0),
    ];
    let flipped = |[a, b]: [&SurfaceTopology; 2]| {
        let mut contacts = found.to_vec();
        agree(&mut contacts, [a, b]);
        contacts
            .iter()
            .zip(&found)
            .map(|(after, before)| {
                assert_eq!(after.distance.abs(), before.distance.abs());
                assert_eq!(after.normal == -before.normal, after.distance != before.distance);
                after.distance != before.distance
            })
            .collect::<Vec<bool>>()
    };
    // Each component by itself: one of three has passed, and two of three.
    assert_eq!(flipped([&apart, &joined]), [false, false, true, false, false, false, false, false]);
    // All together: three of six.
    assert_eq!(flipped([&joined, &joined]), [false; 8]);
    // Each by itself on both sides: one of two, and all of one.
    assert_eq!(flipped([&apart, &apart]), [false; 8]);
}
