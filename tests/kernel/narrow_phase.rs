//! The production narrow phase over batches of candidate pairs against the f64 truth, as many as one likes.
//!
//! `CIRCUMSPHERE_PAIRS` sets how many pairs are compared and `CIRCUMSPHERE_SEED` the seed, as in the tests of the
//! reference. Each batch has one contact distance, so its pairs are brought to one size by powers of two, which round
//! nothing.

use crate::common::{CATEGORIES, Random, Triangle, hard_pair};
use crate::truth::{independent, longest_edge};
use bevy_circumsphere::kernel::{
    pair::{FoundPairs, PairSettings, SurfaceSide},
    reference::{ClosestFeatures, ClosestKind, closest_features},
    refine::refine_pairs,
    topology::SurfaceTopology,
};
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;
use std::time::Instant;

/// Where honest rounding of f32 positions decides, relative to the contact distance: section 5 of the design.
const BAND: f64 = 1.0e-4;

/// Bar for the error of a separation, relative to the larger of the contact distance and the smaller triangle's size.
const SEPARATION_TOLERANCE: f64 = 1.0e-5;

/// At contact distance 0 there is no band: triangles that only just touch are missed where their distance is rounded to
/// more than 0. Within this share of their extent, a few dozen roundings, they must be found.
const TOUCHING_TOLERANCE: f64 = 1.0e-14;

/// Pairs in one call, a number that leaves lanes of the culls unused.
const BATCH: usize = 61;

/// Kinds of pairs beside those of [`CATEGORIES`].
const DUPLICATE: usize = CATEGORIES.len();
const AT_THE_CONTACT_DISTANCE: usize = CATEGORIES.len() + 1;
const KINDS: usize = CATEGORIES.len() + 2;

fn kind_name(kind: usize) -> &'static str {
    match kind {
        DUPLICATE => "duplicate",
        AT_THE_CONTACT_DISTANCE => "at the contact distance",
        _ => CATEGORIES[kind],
    }
}

/// Pairs compared, 500,000 unless `CIRCUMSPHERE_PAIRS` says otherwise.
fn pair_count() -> usize {
    std::env::var("CIRCUMSPHERE_PAIRS").map_or(500_000, |text| text.parse().expect("CIRCUMSPHERE_PAIRS is a number"))
}

/// The seed, 20261120 unless `CIRCUMSPHERE_SEED` says otherwise.
fn seed() -> u64 {
    std::env::var("CIRCUMSPHERE_SEED").map_or(20_261_120, |text| text.parse().expect("CIRCUMSPHERE_SEED is a number"))
}

fn stored(triangle: Triangle) -> Triangle {
    triangle.map(|corner| corner.as_vec3().as_dvec3())
}

fn extent(a: &Triangle, b: &Triangle) -> f64 {
    a.iter().chain(b).map(|p| (*p - a[0]).abs().max_element()).fold(0.0, f64::max)
}

/// A pair of a kind whose extent is from one to two units, if it has any.
fn pair_of(random: &mut Random, kind: usize, unit: f64, contact_distance: f64) -> (Triangle, Triangle) {
    let category = if kind < CATEGORIES.len() { kind } else { random.below(CATEGORIES.len()) };
    let (a, b) = hard_pair(random, category);
    let extent = extent(&a, &b);
    let scale = if extent > 0.0 { unit * 2f64.powi(-(extent.log2().floor() as i32)) } else { unit };
    let (a, b) = (stored(a.map(|p| p * scale)), stored(b.map(|p| p * scale)));
    match kind {
        DUPLICATE => {
            let mut other = a;
            other.rotate_left(random.below(3));
            // The same triangle, turned over, or with one corner elsewhere.
            match random.below(3) {
                0 => other.swap(0, 1),
                1 => other[0] = b[0],
                _ => {}
            }
            (a, other)
        }
        AT_THE_CONTACT_DISTANCE => {
            let truth = closest_features(&a, &b);
            let direction = (truth.point_b - truth.point_a).normalize_or_zero();
            let sign = if random.below(2) == 0 { -1.0 } else { 1.0 };
            let wanted = contact_distance * (1.0 + sign * random.power_of_ten(-8.0, -1.0));
            (a, stored(b.map(|p| p + direction * (wanted - truth.distance))))
        }
        _ => (a, b),
    }
}

#[derive(Clone, Default)]
struct Tally {
    pairs: usize,
    touching: usize,
    crossing: usize,
    apart: usize,
    in_band: usize,
    missed: usize,
    false_pairs: usize,
    culled_differently: usize,
    without_contact: usize,
    worst_error: f64,
    worst_contact_error: f64,
}

struct Asked {
    a: Triangle,
    b: Triangle,
    truth: ClosestFeatures,
}

#[test]
fn no_random_pair_is_missed_or_false_and_separations_are_true() {
    let (count, seed, started) = (pair_count(), seed(), Instant::now());
    let mut random = Random::new(seed);
    // Topologies of triangles that have nothing in common; the positions are those of each batch.
    let apart: Vec<[Vec3; 3]> =
        (0..BATCH).map(|k| [0, 1, 2].map(|corner| Vec3::new((3 * k + corner) as f32, 0.0, 0.0))).collect();
    let (rest, triangles) = independent(&apart);
    let topology = SurfaceTopology::new(&rest, &triangles).expect("the triangles are valid");
    assert!((0..).zip(topology.weld()).all(|(vertex, &weld)| vertex == weld));
    let candidates: Vec<[u32; 2]> = (0..BATCH as u32).map(|k| [k, k]).collect();
    // At a positive contact distance, and at 0, where only a common point counts.
    let mut tallies = vec![[Tally::default(), Tally::default()]; KINDS];
    let mut failures: Vec<String> = Vec::new();
    let mut asked_for = 0;
    for batch in 0.. {
        if asked_for >= count {
            break;
        }
        let kind = batch % KINDS;
        let unit = match random.below(16) {
            0 => 2f64.powi(random.whole(0, 1) * 200 - 100),
            1..6 => 1.0,
            _ => 2f64.powi(random.whole(-20, 20)),
        };
        let scale = [1.0, 1.0, 0.37, 3.0][random.below(4)];
        let mut local_distance = unit * random.power_of_ten(-4.0, 0.3);
        let pairs: Vec<Asked> = (0..BATCH)
            .map(|_| {
                let (a, b) = pair_of(&mut random, kind, unit, local_distance);
                Asked { a, b, truth: closest_features(&a, &b) }
            })
            .collect();
        match random.below(8) {
            0 => local_distance = 0.0,
            // Of all but the pairs that are there already: at, or just beside, the distance of one of them.
            1..4 if kind != AT_THE_CONTACT_DISTANCE => {
                let distance = pairs[random.below(BATCH)].truth.distance;
                let sign = if random.below(2) == 0 { -1.0 } else { 1.0 };
                if distance > 1.0e-6 * unit {
                    local_distance = distance * (1.0 + sign * random.power_of_ten(-8.0, -1.0));
                }
            }
            _ => {}
        }
        let contact_distance = local_distance * scale;
        let positions = |of: fn(&Asked) -> &Triangle| -> Vec<Vec3> {
            pairs.iter().flat_map(|pair| of(pair).map(DVec3::as_vec3)).collect()
        };
        let positions = [positions(|pair| &pair.a), positions(|pair| &pair.b)];
        let side = |side: usize| SurfaceSide {
            topology: &topology,
            positions: &positions[side],
            one_sided: false,
            mirrored: false,
        };
        let refined = |contact_distance: f64, cull: bool| {
            let mut found = FoundPairs::default();
            let reported = contact_distance * [1.0, 1.5][usize::from(batch % 2 == 0)];
            let settings = PairSettings {
                contact_distance,
                reported_distance: reported,
                range: reported,
                scale,
                cull,
                same_surface: false,
            };
            refine_pairs(&side(0), &side(1), &candidates, &settings, &mut found);
            found
        };
        let (found, without_cull) = (refined(contact_distance, true), refined(contact_distance, false));
        let rounded = (contact_distance == 0.0).then(|| refined(TOUCHING_TOLERANCE * unit * scale, true));
        let touches_but_for_rounding = |pair: u32| {
            rounded.as_ref().is_some_and(|found| found.touching.iter().any(|touching| touching.triangle_a == pair))
        };
        let touching: BTreeMap<u32, f64> = found.touching.iter().map(|pair| (pair.triangle_a, pair.distance)).collect();
        let mut contacts: BTreeMap<u32, f64> = BTreeMap::new();
        for contact in &found.contacts {
            let nearest = contacts.entry(contact.triangle_a).or_insert(f64::INFINITY);
            *nearest = nearest.min(f64::from(contact.distance.abs()));
        }
        let tally = &mut tallies[kind][usize::from(contact_distance == 0.0)];
        tally.culled_differently += usize::from(found.touching != without_cull.touching);
        for (pair, Asked { a, b, truth }) in (0u32..).zip(&pairs) {
            let distance = truth.distance * scale;
            let size = longest_edge(a).min(longest_edge(b)) * scale;
            let larger = size.max(contact_distance).max(f64::MIN_POSITIVE);
            let mut fail = |what: &str| {
                if failures.len() < 10 {
                    failures.push(format!(
                        "{what}: {} batch {batch} pair {pair}: contact distance {contact_distance:e} scale {scale} truth {distance:e} {:?} found {:?} {:?}\n  {a:?}\n  {b:?}",
                        kind_name(kind),
                        truth.kind,
                        touching.get(&pair),
                        contacts.get(&pair)
                    ));
                }
            };
            tally.pairs += 1;
            let crossing = truth.kind == ClosestKind::Crossing;
            tally.crossing += usize::from(crossing);
            let is_found = touching.contains_key(&pair);
            if crossing || distance <= contact_distance * (1.0 - BAND) && contact_distance > 0.0 {
                tally.touching += 1;
                if !is_found {
                    tally.missed += 1;
                    if !touches_but_for_rounding(pair) {
                        fail("missed");
                    }
                }
            } else if distance > contact_distance * (1.0 + BAND) {
                tally.apart += 1;
                if is_found {
                    tally.false_pairs += 1;
                    fail("false");
                }
            } else {
                tally.in_band += 1;
            }
            if let Some(found_distance) = touching.get(&pair) {
                let error = (found_distance - distance).abs() / larger;
                if error > tally.worst_error {
                    tally.worst_error = error;
                }
                if error.is_nan() || error > SEPARATION_TOLERANCE {
                    fail("separation");
                }
                match contacts.get(&pair) {
                    Some(nearest) => {
                        let error = (nearest - distance).abs() / larger;
                        tally.worst_contact_error = tally.worst_contact_error.max(error);
                        if error.is_nan() || error > SEPARATION_TOLERANCE {
                            fail("contact");
                        }
                    }
                    None => {
                        tally.without_contact += 1;
                        fail("no contact");
                    }
                }
            }
        }
        asked_for += BATCH;
    }

    println!("{asked_for} pairs, seed {seed}, {:.0} s", started.elapsed().as_secs_f64());
    println!(
        "{:<26}{:>10}{:>10}{:>10}{:>10}{:>8}{:>7}{:>7}{:>7}{:>11}{:>9}{:>9}",
        "kind",
        "pairs",
        "touching",
        "crossing",
        "apart",
        "band",
        "missed",
        "false",
        "culls",
        "no contact",
        "error",
        "contact"
    );
    let print = |name: &str, t: &Tally| {
        println!(
            "{name:<26}{:>10}{:>10}{:>10}{:>10}{:>8}{:>7}{:>7}{:>7}{:>11}{:>9.1e}{:>9.1e}",
            t.pairs,
            t.touching,
            t.crossing,
            t.apart,
            t.in_band,
            t.missed,
            t.false_pairs,
            t.culled_differently,
            t.without_contact,
            t.worst_error,
            t.worst_contact_error
        );
    };
    for (at_zero, title) in ["contact distance above 0", "contact distance 0"].into_iter().enumerate() {
        println!("{title}:");
        let mut all = Tally::default();
        for (kind, tallies) in tallies.iter().enumerate() {
            let t = &tallies[at_zero];
            print(kind_name(kind), t);
            all.pairs += t.pairs;
            all.touching += t.touching;
            all.crossing += t.crossing;
            all.apart += t.apart;
            all.in_band += t.in_band;
            all.missed += t.missed;
            all.false_pairs += t.false_pairs;
            all.culled_differently += t.culled_differently;
            all.without_contact += t.without_contact;
            all.worst_error = all.worst_error.max(t.worst_error);
            all.worst_contact_error = all.worst_contact_error.max(t.worst_contact_error);
        }
        print("all", &all);
        assert!(all.touching * 10 > all.pairs && all.apart * 10 > all.pairs && all.crossing * 20 > all.pairs);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    assert!(tallies.iter().flatten().all(|tally| tally.culled_differently == 0));
    assert!(tallies[AT_THE_CONTACT_DISTANCE][0].in_band > 0, "the band was met");
}
