//! The spatial hashes against brute force over all pairs of boxes.

use std::thread;

use bevy_circumsphere::kernel::{
    mesh::bounds::{Aabb, pairs_between_brute_force, self_pairs_brute_force},
    simd::parallel::{Parallel, Sequential},
    spatial_hash::{HashCounts, HashKind, HashSettings, SpatialHash},
};
use glam::{DVec3, Vec3};
use proptest::prelude::*;

use crate::{common::Random, last_first::LastFirst};

const KINDS: [HashKind; 2] = [HashKind::Uniform, HashKind::Hierarchical];

fn automatic(kind: HashKind) -> HashSettings {
    HashSettings { kind, cell_size: None }
}

fn sorted(mut pairs: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
    pairs.sort_unstable();
    pairs
}

fn sized_box(center: DVec3, size: DVec3) -> Aabb {
    Aabb { min: (center - 0.5 * size).as_vec3(), max: (center + 0.5 * size).as_vec3() }
}

/// Boxes of about one size in a cube, part of which has negative coordinates.
fn uniform_boxes(random: &mut Random, count: usize, half_width: f64) -> Vec<Aabb> {
    (0..count).map(|_| sized_box(random.vector() * half_width, random.vector().abs())).collect()
}

/// Hard lists of boxes, each with a name.
fn hard_lists(random: &mut Random) -> Vec<(&'static str, Vec<Aabb>)> {
    let mut list = |count: usize, make: &mut dyn FnMut(&mut Random) -> Aabb| -> Vec<Aabb> {
        (0..count).map(|_| make(random)).collect()
    };
    let mut lists = vec![
        (
            "sizes of 1000 to 1",
            list(600, &mut |random| {
                sized_box(random.vector() * 20.0, random.vector().abs() * random.power_of_ten(-2.0, 1.0))
            }),
        ),
        (
            "a few large among many small",
            list(800, &mut |random| {
                let size = if random.below(40) == 0 { 10.0 } else { 0.01 };
                sized_box(random.vector() * 5.0, random.vector().abs() * size)
            }),
        ),
        (
            "negative coordinates",
            list(400, &mut |random| sized_box(random.vector() - DVec3::splat(7.0), random.vector().abs() * 0.2)),
        ),
        (
            "far from the origin",
            list(400, &mut |random| {
                sized_box(DVec3::new(1e6, -1e6, 1e6) + random.vector() * 5.0, random.vector().abs() * 2.0)
            }),
        ),
        (
            "huge coordinates",
            list(200, &mut |random| {
                let center = random.vector() * random.power_of_ten(0.0, 38.0);
                sized_box(center, random.vector().abs() * random.power_of_ten(-3.0, 38.0))
            }),
        ),
        (
            "tiny coordinates",
            list(200, &mut |random| sized_box(random.vector() * 1e-40, random.vector().abs() * 1e-41)),
        ),
        ("points", list(400, &mut |random| sized_box(random.grid_point(3), DVec3::ZERO))),
        (
            "flat boxes and needles",
            list(500, &mut |random| {
                let mut size = DVec3::splat(0.01);
                size[random.below(3)] = 0.0;
                size[random.below(3)] = random.power_of_ten(-1.0, 1.5);
                sized_box(random.vector() * 4.0, size)
            }),
        ),
        (
            "a grid, where boxes touch exactly",
            list(600, &mut |random| {
                let low = random.grid_point(4).as_vec3();
                Aabb { min: low, max: low + random.grid_point(1).abs().as_vec3() }
            }),
        ),
        (
            "needles side by side in one cell",
            list(700, &mut |random| {
                let place = DVec3::new(0.0, random.unit(), random.unit());
                sized_box(place, DVec3::new(1.0, 0.003, 0.003))
            }),
        ),
        (
            "boxes without bounds, empty ones, and NaN",
            list(300, &mut |random| match random.below(8) {
                0 => Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY },
                1 => Aabb::EMPTY,
                2 => Aabb { min: Vec3::new(f32::NAN, 0.0, 0.0), max: Vec3::ONE },
                3 => Aabb { min: Vec3::splat(f32::MIN), max: Vec3::splat(f32::MAX) },
                4 => Aabb { min: Vec3::new(f32::INFINITY, 0.0, 0.0), max: Vec3::new(f32::INFINITY, 1.0, 1.0) },
                _ => sized_box(random.vector() * 3.0, random.vector().abs()),
            }),
        ),
    ];
    let same = sized_box(DVec3::new(0.3, -0.2, 0.1), DVec3::splat(0.5));
    lists.push(("one box many times", vec![same; 300]));
    lists.push(("none", Vec::new()));
    lists.push(("one", vec![same]));
    for (_, boxes) in &mut lists {
        let count = boxes.len();
        for _ in 0..count / 10 {
            boxes[random.below(count)] = boxes[random.below(count)];
        }
    }
    lists
}

/// Brute force, without the pairs of empty boxes, which are found where the other box is infinite.
fn without_empty(mut pairs: Vec<[u32; 2]>, lists: [&[Aabb]; 2]) -> Vec<[u32; 2]> {
    let is_filled = |bounds: &Aabb| bounds.min.cmple(bounds.max).all();
    pairs.retain(|pair| (0..2).all(|side| is_filled(&lists[side][pair[side] as usize])));
    pairs
}

fn own_pairs(hash: &mut SpatialHash, settings: &HashSettings, boxes: &[Aabb]) -> (Vec<[u32; 2]>, HashCounts) {
    let mut pairs = Vec::new();
    let counts = hash.self_pairs(&Sequential, settings, boxes, &mut pairs);
    (pairs, counts)
}

/// Asserts that a hash finds the pairs of brute force, in any order. Returns their number.
fn assert_equals_brute_force(
    what: &str,
    hash: &mut SpatialHash,
    settings: &HashSettings,
    lists: [&[Aabb]; 2],
) -> usize {
    let mut expected = Vec::new();
    self_pairs_brute_force(lists[0], &mut expected);
    let expected = without_empty(expected, [lists[0]; 2]);
    let (found, _) = own_pairs(hash, settings, lists[0]);
    assert_eq!(sorted(found), expected, "{what}, {settings:?}");
    let mut between = Vec::new();
    pairs_between_brute_force(lists[0], lists[1], &mut between);
    let between = without_empty(between, lists);
    let mut found = Vec::new();
    hash.pairs_between(&Sequential, settings, lists, &mut found);
    assert_eq!(sorted(found), between, "between, {what}, {settings:?}");
    expected.len() + between.len()
}

#[test]
fn both_spatial_hashes_find_what_brute_force_finds_in_hard_lists() {
    let mut hash = SpatialHash::default();
    for seed in 0..4 {
        let mut random = Random::new(seed);
        let (lists, others) = (hard_lists(&mut random), hard_lists(&mut random));
        for ((what, boxes), (_, other)) in lists.iter().zip(&others) {
            for kind in KINDS {
                for cell_size in [None, Some(0.013), Some(1.0), Some(1e6), Some(f32::MIN_POSITIVE), Some(f32::NAN)] {
                    let pairs =
                        assert_equals_brute_force(what, &mut hash, &HashSettings { kind, cell_size }, [boxes, other]);
                    assert!(pairs > 0 || boxes.len() < 2, "{what}: nothing overlaps");
                }
            }
        }
        // Lists of different kinds, and of different lengths.
        for ((what, boxes), (_, other)) in lists.iter().zip(others.iter().cycle().skip(1)) {
            for kind in KINDS {
                assert_equals_brute_force(what, &mut hash, &automatic(kind), [boxes, &other[..other.len() / 3]]);
            }
        }
    }
}

#[test]
fn both_spatial_hashes_find_what_brute_force_finds_for_every_small_number_of_boxes() {
    let (mut hash, mut random, mut pairs) = (SpatialHash::default(), Random::new(1), 0);
    for count in 0..=60 {
        for kind in KINDS {
            let boxes = uniform_boxes(&mut random, count, 2.0);
            let other_count = random.below(60);
            let other = uniform_boxes(&mut random, other_count, 2.0);
            pairs += assert_equals_brute_force("small", &mut hash, &automatic(kind), [&boxes, &other]);
        }
    }
    assert!(pairs > 500, "{pairs}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn both_spatial_hashes_find_what_brute_force_finds_for_any_boxes(
        corners in prop::collection::vec(prop::array::uniform6(-3i8..=3), 0..120),
        others in prop::collection::vec(prop::array::uniform6(-3i8..=3), 0..60),
        exponent in -3i8..=3,
    ) {
        let boxes = |corners: &[[i8; 6]]| -> Vec<Aabb> {
            corners
                .iter()
                .map(|&[a, b, c, d, e, f]| {
                    let (low, size) = (Vec3::new(a.into(), b.into(), c.into()), Vec3::new(d.into(), e.into(), f.into()));
                    Aabb { min: low * 0.5, max: low * 0.5 + size.abs() * 0.125 }
                })
                .collect()
        };
        let (own, other) = (boxes(&corners), boxes(&others));
        for kind in KINDS {
            for cell_size in [None, Some(f32::from(exponent).exp2())] {
                let settings = HashSettings { kind, cell_size };
                assert_equals_brute_force("any", &mut SpatialHash::default(), &settings, [&own, &other]);
            }
        }
    }
}

/// Every task on another thread.
struct OnThreads;

impl Parallel for OnThreads {
    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        let tasks: Vec<P> = tasks.collect();
        thread::scope(|scope| {
            for task in tasks {
                scope.spawn(|| work(task));
            }
        });
    }
}

#[test]
fn pairs_of_a_spatial_hash_have_the_same_order_on_all_threads() {
    let mut random = Random::new(5);
    // Several parts, crowded cells, and large boxes.
    let mut boxes = uniform_boxes(&mut random, 3_000, 5.0);
    boxes.extend((0..400).map(|_| sized_box(DVec3::splat(0.4) + random.vector() * 0.01, DVec3::splat(0.01))));
    boxes.extend((0..20).map(|_| sized_box(random.vector(), DVec3::splat(9.0))));
    let other = uniform_boxes(&mut random, 1_500, 5.0);
    for kind in KINDS {
        let settings = automatic(kind);
        let mut hash = SpatialHash::default();
        let (one, counts) = own_pairs(&mut hash, &settings, &boxes);
        assert!(one.len() > 10_000 && counts.crowded_cells > 0, "{} {counts:?}", one.len());
        assert_eq!(counts.large_boxes > 0, kind == HashKind::Uniform, "{counts:?}");
        let mut between = Vec::new();
        hash.pairs_between(&Sequential, &settings, [&boxes, &other], &mut between);
        // Into other buffers, in another order, and on threads.
        for hash in [&mut hash, &mut SpatialHash::default()] {
            let mut again = Vec::new();
            assert_eq!(hash.self_pairs(&LastFirst, &settings, &boxes, &mut again), counts);
            assert!(one == again);
            again.clear();
            hash.self_pairs(&OnThreads, &settings, &boxes, &mut again);
            assert!(one == again);
            again.clear();
            hash.pairs_between(&OnThreads, &settings, [&boxes, &other], &mut again);
            assert!(between == again);
        }
    }
}

#[test]
fn a_spatial_hash_reports_crowded_cells_and_large_boxes_and_bounds_its_entries() {
    let mut random = Random::new(6);
    let small = |random: &mut Random| sized_box(random.vector(), DVec3::splat(1e-3));
    let mut boxes: Vec<Aabb> = (0..4_000).map(|_| small(&mut random)).collect();
    let mut hash = SpatialHash::default();
    for kind in KINDS {
        let (_, counts) = own_pairs(&mut hash, &automatic(kind), &boxes);
        assert_eq!((counts.crowded_cells, counts.large_boxes), (0, 0), "{counts:?}");
        assert!(counts.entries < 9 * boxes.len() && counts.occupied_cells > 3_000, "{counts:?}");
    }
    // All in one cell.
    for kind in KINDS {
        let settings = HashSettings { kind, cell_size: Some(64.0) };
        let shifted: Vec<Aabb> = boxes
            .iter()
            .map(|bounds| bounds.grown(0.0))
            .map(|Aabb { min, max }| Aabb { min: min + 8.0, max: max + 8.0 })
            .collect();
        let (pairs, counts) = own_pairs(&mut hash, &settings, &shifted);
        assert_eq!((counts.occupied_cells, counts.crowded_cells, counts.entries), (1, 1, 4_000), "{counts:?}");
        let mut expected = Vec::new();
        self_pairs_brute_force(&shifted, &mut expected);
        assert_eq!(sorted(pairs), expected);
    }
    // A box in billions of cells.
    boxes.push(sized_box(DVec3::ZERO, DVec3::splat(2.5)));
    let (pairs, counts) = own_pairs(&mut hash, &automatic(HashKind::Uniform), &boxes);
    assert_eq!(counts.large_boxes, 1);
    assert!(counts.entries < 9 * boxes.len());
    assert_eq!(pairs.iter().filter(|pair| pair[1] == 4_000).count(), 4_000);
    let (_, counts) = own_pairs(&mut hash, &automatic(HashKind::Hierarchical), &boxes);
    assert_eq!(counts.large_boxes, 0);
    assert!(counts.entries < 9 * boxes.len());
}

#[test]
fn a_spatial_hash_finds_pairs_after_its_buffers_have_been_freed() {
    let mut random = Random::new(7);
    let (many, few) = (uniform_boxes(&mut random, 3_000, 5.0), uniform_boxes(&mut random, 20, 5.0));
    let mut hash = SpatialHash::default();
    let settings = HashSettings::default();
    let expected = own_pairs(&mut hash, &settings, &many).0;
    for _ in 0..3 {
        hash.rest();
        own_pairs(&mut hash, &settings, &few);
    }
    hash.rest();
    assert_eq!(own_pairs(&mut hash, &settings, &many).0, expected);
}
