//! The production narrow phase over batches of candidate pairs against the f64 reference, for any number of pairs.
//!
//! `CIRCUMSPHERE_PAIRS` sets how many pairs are compared and `CIRCUMSPHERE_SEED` sets the seed, as in the tests of the
//! reference. Each batch has one contact distance, so its pairs are scaled to one size by powers of two, which does not
//! round.

use std::collections::BTreeMap;
use std::time::Instant;

use bevy_circumsphere::kernel::{
    exact::stage::{closest_pairs, exact_pairs},
    mesh::topology::SurfaceTopology,
    pair::{FoundPairs, PairSettings, SurfaceSide},
};
use circumsphere_truth::{ClosestFeatures, ClosestKind, closest_features};
use glam::{DVec3, Vec3};

use crate::common::{CATEGORIES, Random, Triangle, hard_pair};
use crate::truth::{independent, longest_edge};

/// Relative to the contact distance: within this band, rounding of f32 positions decides. See section 5 of the design.
const BAND: f64 = 1.0e-4;

/// Limit for the error of a separation, relative to the larger of the contact distance and the smaller triangle's size.
const SEPARATION_TOLERANCE: f64 = 1.0e-5;

/// Pairs in one call. The number leaves lanes of the screen unused.
const BATCH: usize = 61;

/// Kinds of pairs in addition to [`CATEGORIES`].
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

/// The number of pairs to compare: 500,000 unless `CIRCUMSPHERE_PAIRS` is set.
fn pair_count() -> usize {
    std::env::var("CIRCUMSPHERE_PAIRS").map_or(500_000, |text| text.parse().expect("CIRCUMSPHERE_PAIRS is a number"))
}

/// The seed: 20261120 unless `CIRCUMSPHERE_SEED` is set.
fn seed() -> u64 {
    std::env::var("CIRCUMSPHERE_SEED").map_or(20_261_120, |text| text.parse().expect("CIRCUMSPHERE_SEED is a number"))
}

fn stored(triangle: Triangle) -> Triangle {
    triangle.map(|corner| corner.as_vec3().as_dvec3())
}

fn extent(a: &Triangle, b: &Triangle) -> f64 {
    a.iter().chain(b).map(|p| (*p - a[0]).abs().max_element()).fold(0.0, f64::max)
}

/// A pair of the given kind, scaled so that its extent is between one and two units, if it has an extent.
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
            // The same triangle, reversed or with one corner elsewhere.
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

struct Needed {
    a: Triangle,
    b: Triangle,
    truth: ClosestFeatures,
}

/// Pairs of one kind that are tested together.
struct Batch {
    number: usize,
    kind: usize,
    /// World length of a unit of the frame.
    scale: f64,
    /// In world units.
    contact_distance: f64,
    pairs: Vec<Needed>,
    positions: [Vec<Vec3>; 2],
}

impl Batch {
    fn new(random: &mut Random, number: usize) -> Self {
        let kind = number % KINDS;
        let unit = match random.below(16) {
            0 => 2f64.powi(random.whole(0, 1) * 200 - 100),
            1..6 => 1.0,
            _ => 2f64.powi(random.whole(-20, 20)),
        };
        let scale = [1.0, 1.0, 0.37, 3.0][random.below(4)];
        let mut distance = unit * random.power_of_ten(-4.0, 0.3);
        let pairs: Vec<Needed> = (0..BATCH)
            .map(|_| {
                let (a, b) = pair_of(random, kind, unit, distance);
                Needed { a, b, truth: closest_features(&a, &b) }
            })
            .collect();
        match random.below(8) {
            0 => distance = 0.0,
            // At or just beside the distance of one of the pairs. Pairs made for a contact distance keep theirs.
            1..4 if kind != AT_THE_CONTACT_DISTANCE => {
                let chosen = pairs[random.below(BATCH)].truth.distance;
                let sign = if random.below(2) == 0 { -1.0 } else { 1.0 };
                if chosen > 1.0e-6 * unit {
                    distance = chosen * (1.0 + sign * random.power_of_ten(-8.0, -1.0));
                }
            }
            _ => {}
        }
        let positions = |of: fn(&Needed) -> &Triangle| -> Vec<Vec3> {
            pairs.iter().flat_map(|pair| of(pair).map(DVec3::as_vec3)).collect()
        };
        let positions = [positions(|pair| &pair.a), positions(|pair| &pair.b)];
        Self { number, kind, scale, contact_distance: distance * scale, pairs, positions }
    }

    /// The results of a test of the production narrow phase.
    fn tested(&self, topology: &SurfaceTopology, test: Test, cull: bool) -> Found {
        let contact_distance = self.contact_distance;
        let reported = contact_distance * [1.0, 1.5][usize::from(self.number.is_multiple_of(2))];
        let settings = PairSettings {
            contact_distance,
            reported_distance: reported,
            range: reported,
            scale: self.scale,
            bulge: 0.0,
            cull,
            same_surface: false,
            any_left_out: false,
        };
        let side = |positions| SurfaceSide::flat(topology, positions);
        let candidates: Vec<[u32; 2]> = (0..BATCH as u32).map(|pair| [pair; 2]).collect();
        let mut found = FoundPairs::default();
        test(&side(&self.positions[0]), &side(&self.positions[1]), &candidates, &settings, &mut found);
        let mut contacts: BTreeMap<u32, f64> = BTreeMap::new();
        for contact in &found.contacts {
            let nearest = contacts.entry(contact.triangle_a).or_insert(f64::INFINITY);
            *nearest = nearest.min(f64::from(contact.distance.abs()));
        }
        Found { touching: found.touching.iter().map(|pair| (pair.triangle_a, pair.distance)).collect(), contacts }
    }
}

/// [`exact_pairs`] or [`closest_pairs`].
type Test = fn(&SurfaceSide<'_>, &SurfaceSide<'_>, &[[u32; 2]], &PairSettings, &mut FoundPairs);

/// By pair: the distance if it touches, and the distance of the nearest contact.
struct Found {
    touching: BTreeMap<u32, f64>,
    contacts: BTreeMap<u32, f64>,
}

#[derive(Clone, Copy, Default)]
struct Tally {
    pairs: usize,
    touching: usize,
    crossing: usize,
    apart: usize,
    in_band: usize,
    missed: usize,
    false_pairs: usize,
    screened_differently: usize,
    closest_differently: usize,
    without_contact: usize,
    worst_error: f64,
    worst_contact_error: f64,
}

impl Tally {
    /// Compares a batch with the reference and reports what is wrong.
    fn judge(&mut self, batch: &Batch, topology: &SurfaceTopology, fail: &mut dyn FnMut(&str, u32)) {
        let contact_distance = batch.contact_distance;
        let found = batch.tested(topology, exact_pairs, true);
        if found.touching != batch.tested(topology, exact_pairs, false).touching {
            self.screened_differently += 1;
            fail("the screen changes what touches", 0);
        }
        let closest = batch.tested(topology, closest_pairs, true);
        if closest.touching != found.touching {
            self.closest_differently += 1;
            fail("the closest features alone change what touches", 0);
        }
        for (pair, Needed { a, b, truth }) in (0u32..).zip(&batch.pairs) {
            let distance = truth.distance * batch.scale;
            let crossing = truth.kind == ClosestKind::Crossing;
            let is_found = found.touching.contains_key(&pair);
            self.pairs += 1;
            self.crossing += usize::from(crossing);
            if crossing || distance <= contact_distance * (1.0 - BAND) && contact_distance > 0.0 {
                self.touching += 1;
                if !is_found {
                    self.missed += 1;
                    fail("missed", pair);
                }
            } else if distance > contact_distance * (1.0 + BAND) {
                self.apart += 1;
                if is_found {
                    self.false_pairs += 1;
                    fail("false", pair);
                }
            } else {
                self.in_band += 1;
            }
            let Some(found_distance) = found.touching.get(&pair) else { continue };
            let size = longest_edge(a).min(longest_edge(b)) * batch.scale;
            let error = |found: f64| {
                let error = (found - distance).abs() / size.max(contact_distance).max(f64::MIN_POSITIVE);
                if error.is_nan() { f64::INFINITY } else { error }
            };
            let closest_distance = closest.touching.get(&pair).copied().unwrap_or(f64::INFINITY);
            for distance in [*found_distance, closest_distance] {
                self.worst_error = self.worst_error.max(error(distance));
                if error(distance) > SEPARATION_TOLERANCE {
                    fail("a wrong separation", pair);
                }
            }
            for found in [&found, &closest] {
                if let Some(nearest) = found.contacts.get(&pair) {
                    self.worst_contact_error = self.worst_contact_error.max(error(*nearest));
                    if error(*nearest) > SEPARATION_TOLERANCE {
                        fail("a wrong separation of the nearest contact", pair);
                    }
                } else {
                    self.without_contact += 1;
                    fail("no contact", pair);
                }
            }
        }
    }

    fn sum(self, other: Self) -> Self {
        Self {
            pairs: self.pairs + other.pairs,
            touching: self.touching + other.touching,
            crossing: self.crossing + other.crossing,
            apart: self.apart + other.apart,
            in_band: self.in_band + other.in_band,
            missed: self.missed + other.missed,
            false_pairs: self.false_pairs + other.false_pairs,
            screened_differently: self.screened_differently + other.screened_differently,
            closest_differently: self.closest_differently + other.closest_differently,
            without_contact: self.without_contact + other.without_contact,
            worst_error: self.worst_error.max(other.worst_error),
            worst_contact_error: self.worst_contact_error.max(other.worst_contact_error),
        }
    }

    fn print(&self, name: &str) {
        println!(
            "{name:<26}{:>10}{:>10}{:>10}{:>10}{:>8}{:>7}{:>7}{:>7}{:>9}{:>11}{:>9.1e}{:>9.1e}",
            self.pairs,
            self.touching,
            self.crossing,
            self.apart,
            self.in_band,
            self.missed,
            self.false_pairs,
            self.screened_differently,
            self.closest_differently,
            self.without_contact,
            self.worst_error,
            self.worst_contact_error
        );
    }
}

#[test]
fn no_random_pair_is_missed_or_false_and_separations_are_true() {
    let (count, seed, started) = (pair_count(), seed(), Instant::now());
    let mut random = Random::new(seed);
    // A topology of unconnected triangles. Each batch supplies the positions.
    let apart: Vec<[Vec3; 3]> =
        (0..BATCH).map(|k| [0, 1, 2].map(|corner| Vec3::new((3 * k + corner) as f32, 0.0, 0.0))).collect();
    let (rest, triangles) = independent(&apart);
    let topology = SurfaceTopology::new(&rest, &triangles).expect("the triangles are valid");
    assert!((0..).zip(topology.weld()).all(|(vertex, &weld)| vertex == weld));
    // At a positive contact distance, and at 0, where only a common point counts.
    let mut tallies = [[Tally::default(); KINDS]; 2];
    let mut failures: Vec<String> = Vec::new();
    let batches = count.div_ceil(BATCH);
    for number in 0..batches {
        let batch = Batch::new(&mut random, number);
        let tally = &mut tallies[usize::from(batch.contact_distance == 0.0)][batch.kind];
        tally.judge(&batch, &topology, &mut |what, pair| {
            if failures.len() < 10 {
                let Needed { a, b, truth } = &batch.pairs[pair as usize];
                failures.push(format!(
                    "{what}: {}, batch {number} pair {pair}, contact distance {:e}, scale {}: {truth:?}\n  {a:?}\n  {b:?}",
                    kind_name(batch.kind),
                    batch.contact_distance,
                    batch.scale
                ));
            }
        });
    }

    println!("{} pairs, seed {seed}, {:.0} s", batches * BATCH, started.elapsed().as_secs_f64());
    println!(
        "{:<26}{:>10}{:>10}{:>10}{:>10}{:>8}{:>7}{:>7}{:>7}{:>9}{:>11}{:>9}{:>9}",
        "kind",
        "pairs",
        "touching",
        "crossing",
        "apart",
        "band",
        "missed",
        "false",
        "screen",
        "closest",
        "no contact",
        "error",
        "contact"
    );
    for (title, tallies) in ["contact distance above 0", "contact distance 0"].into_iter().zip(&tallies) {
        println!("{title}:");
        for (kind, tally) in tallies.iter().enumerate() {
            tally.print(kind_name(kind));
        }
        let all = tallies.iter().copied().fold(Tally::default(), Tally::sum);
        all.print("all");
        assert!(all.touching * 10 > all.pairs && all.apart * 10 > all.pairs && all.crossing * 20 > all.pairs);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    assert!(tallies[0][AT_THE_CONTACT_DISTANCE].in_band > 0, "some distances are in the band");
}
