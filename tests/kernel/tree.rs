//! The bounding volume hierarchy against brute force over all pairs of boxes.

use bevy_circumsphere::kernel::{
    bvh::tree::{BoxTree, LEAF_WIDTH},
    mesh::bounds::{Aabb, pairs_between_brute_force, self_pairs_brute_force, triangle_bounds},
};
use circumsphere_support::scenes::triangle_soup;
use glam::{DVec3, Vec3};
use proptest::prelude::*;

use crate::{common::Random, last_first::LastFirst};

/// A box on a coarse grid, where many boxes touch exactly, repeat, or are flat, or a box anywhere.
fn random_box(random: &mut Random) -> Aabb {
    match random.below(8) {
        0..4 => {
            let low = random.grid_point(4).as_vec3();
            let size = Vec3::new(random.below(3) as f32, random.below(3) as f32, random.below(3) as f32);
            Aabb { min: low, max: low + size }
        }
        4 => {
            let point = random.grid_point(2).as_vec3();
            Aabb { min: point, max: point }
        }
        _ => {
            let low = (random.vector() * 4.0).as_vec3();
            let size = (random.vector().abs() * random.power_of_ten(-2.0, 0.7)).as_vec3();
            Aabb { min: low, max: low + size }
        }
    }
}

fn random_boxes(random: &mut Random, count: usize) -> Vec<Aabb> {
    let mut boxes: Vec<Aabb> = (0..count).map(|_| random_box(random)).collect();
    for _ in 0..count / 6 {
        let (from, to) = (random.below(count), random.below(count));
        boxes[to] = boxes[from];
    }
    boxes
}

fn sorted(mut pairs: Vec<[u32; 2]>) -> Vec<[u32; 2]> {
    pairs.sort_unstable();
    pairs
}

fn brute_self(boxes: &[Aabb]) -> Vec<[u32; 2]> {
    // Written out here: closed intervals on three axes.
    let mut pairs = Vec::new();
    for first in 0..boxes.len() {
        for second in first + 1..boxes.len() {
            let (a, b) = (boxes[first], boxes[second]);
            if (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis]) {
                pairs.push([first as u32, second as u32]);
            }
        }
    }
    pairs
}

fn brute_between(a: &[Aabb], b: &[Aabb]) -> Vec<[u32; 2]> {
    let mut pairs = Vec::new();
    for (first, own) in a.iter().enumerate() {
        for (second, other) in b.iter().enumerate() {
            if (0..3).all(|axis| own.min[axis] <= other.max[axis] && other.min[axis] <= own.max[axis]) {
                pairs.push([first as u32, second as u32]);
            }
        }
    }
    pairs
}

/// Asserts that a tree finds the same pairs as brute force. Returns the number of pairs.
fn assert_tree_equals_brute_force(tree: &BoxTree, boxes: &[Aabb], other: &BoxTree, other_boxes: &[Aabb]) -> usize {
    let expected = brute_self(boxes);
    let mut found = Vec::new();
    tree.self_pairs(&mut found);
    assert_eq!(sorted(found), expected);
    let mut found = Vec::new();
    self_pairs_brute_force(boxes, &mut found);
    assert_eq!(found, expected);

    let expected_between = brute_between(boxes, other_boxes);
    let mut found = Vec::new();
    tree.pairs_of(0..tree.leaf_count(), other, None, &mut found);
    assert_eq!(sorted(found), expected_between);
    let mut found = Vec::new();
    pairs_between_brute_force(boxes, other_boxes, &mut found);
    assert_eq!(found, expected_between);

    for (index, probe) in other_boxes.iter().enumerate() {
        let mut found = Vec::new();
        tree.query(probe, |item| found.push(item));
        found.sort_unstable();
        let expected: Vec<u32> =
            expected_between.iter().filter(|pair| pair[1] as usize == index).map(|pair| pair[0]).collect();
        assert_eq!(found, expected);
    }
    let whole = boxes.iter().fold(Aabb::EMPTY, |whole, bounds| whole.union(bounds));
    assert_eq!(tree.bounds(), whole);
    assert_eq!(tree.len(), boxes.len());
    assert_eq!(tree.is_empty(), boxes.is_empty());
    expected.len() + expected_between.len()
}

#[test]
fn the_tree_finds_what_brute_force_finds_for_every_small_number_of_boxes() {
    let mut random = Random::new(1);
    let mut pairs = 0;
    for count in 1..=40 {
        for _ in 0..40 {
            let mut boxes = random_boxes(&mut random, count);
            let other_count = 1 + random.below(40);
            let other_boxes = random_boxes(&mut random, other_count);
            let (mut tree, other) = (BoxTree::new(&boxes), BoxTree::new(&other_boxes));
            pairs += assert_tree_equals_brute_force(&tree, &boxes, &other, &other_boxes);
            // Moved a little, then anywhere. The structure of the tree stays that of the first boxes.
            for bounds in &mut boxes {
                let shift = (random.vector() * 0.5).as_vec3();
                *bounds = Aabb { min: bounds.min + shift, max: bounds.max + shift };
            }
            tree.refit(&boxes);
            pairs += assert_tree_equals_brute_force(&tree, &boxes, &other, &other_boxes);
            boxes = random_boxes(&mut random, count);
            tree.refit(&boxes);
            pairs += assert_tree_equals_brute_force(&tree, &boxes, &other, &other_boxes);
            let count_now = 1 + random.below(40);
            boxes = random_boxes(&mut random, count_now);
            tree.rebuild(&boxes);
            pairs += assert_tree_equals_brute_force(&tree, &boxes, &other, &other_boxes);
        }
    }
    println!("{pairs} overlapping pairs");
    assert!(pairs > 50_000);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_tree_finds_what_brute_force_finds_for_any_boxes(
        corners in prop::collection::vec(prop::array::uniform6(-3i8..=3), 0..120),
        others in prop::collection::vec(prop::array::uniform6(-3i8..=3), 0..60),
        moved in prop::collection::vec(prop::array::uniform6(-3i8..=3), 120),
    ) {
        let boxes = |corners: &[[i8; 6]]| -> Vec<Aabb> {
            corners
                .iter()
                .map(|&[a, b, c, d, e, f]| {
                    let (first, second) = ([a, b, c].map(f32::from), [d, e, f].map(f32::from));
                    Aabb::from_points([Vec3::from(first) * 0.5, Vec3::from(first) * 0.5 + Vec3::from(second).abs() * 0.125])
                })
                .collect()
        };
        let (own, other) = (boxes(&corners), boxes(&others));
        let (mut tree, other_tree) = (BoxTree::new(&own), BoxTree::new(&other));
        assert_tree_equals_brute_force(&tree, &own, &other_tree, &other);
        let moved = boxes(&moved[..corners.len()]);
        tree.refit(&moved);
        assert_tree_equals_brute_force(&tree, &moved, &other_tree, &other);
    }
}

#[test]
fn the_tree_finds_what_brute_force_finds_in_a_soup() {
    let mesh = triangle_soup(3_000, 7);
    let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from).collect();
    let mut boxes = Vec::new();
    let whole = triangle_bounds(&positions, &mesh.triangles, 0.02, &mut boxes);
    let tree = BoxTree::new(&boxes);
    assert_eq!(tree.bounds(), whole);
    let mut found = Vec::new();
    tree.self_pairs(&mut found);
    let expected = brute_self(&boxes);
    assert!(expected.len() > 20_000, "{}", expected.len());
    assert_eq!(sorted(found), expected);
}

#[test]
fn an_empty_tree_finds_nothing_and_is_found_by_nothing() {
    let (empty, one) = (BoxTree::new(&[]), BoxTree::new(&[Aabb { min: -Vec3::ONE, max: Vec3::ONE }]));
    assert!(empty.is_empty() && BoxTree::default().is_empty() && !one.is_empty());
    assert_eq!(empty.bounds(), Aabb::EMPTY);
    assert_eq!(empty.decay(), 1.0);
    let mut pairs = Vec::new();
    empty.self_pairs(&mut pairs);
    one.self_pairs(&mut pairs);
    empty.pairs_of(0..empty.leaf_count(), &one, None, &mut pairs);
    one.pairs_of(0..one.leaf_count(), &empty, None, &mut pairs);
    empty.query(&one.bounds(), |_| panic!("there is nothing to find"));
    one.query(&Aabb::EMPTY, |_| panic!("the empty box overlaps nothing"));
    assert!(pairs.is_empty());
}

/// Unused lanes of a leaf must not match, even for an infinite box.
#[test]
fn a_box_without_bounds_finds_every_item_once() {
    let everywhere = Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };
    let mut random = Random::new(2);
    for count in 1..=3 * LEAF_WIDTH {
        let boxes = random_boxes(&mut random, count);
        let tree = BoxTree::new(&boxes);
        let mut found = Vec::new();
        tree.query(&everywhere, |item| found.push(item));
        found.sort_unstable();
        assert_eq!(found, (0..count as u32).collect::<Vec<_>>());
        let mut found = Vec::new();
        let all = BoxTree::new(&[everywhere]);
        all.pairs_of(0..all.leaf_count(), &tree, None, &mut found);
        assert_eq!(sorted(found), (0..count as u32).map(|item| [0, item]).collect::<Vec<_>>());
        let mut with_everywhere = boxes.clone();
        with_everywhere[count / 2] = everywhere;
        let mut found = Vec::new();
        BoxTree::new(&with_everywhere).self_pairs(&mut found);
        assert_eq!(sorted(found), brute_self(&with_everywhere));
    }
}

/// A box with NaN coordinates overlaps nothing and hides no other box.
#[test]
fn boxes_without_numbers_hide_no_others() {
    let mut random = Random::new(3);
    let mut pairs = 0;
    for count in (2..=40).chain(20..=40).chain(30..=60) {
        for nothing in [Aabb { min: Vec3::NAN, max: Vec3::NAN }, Aabb::EMPTY] {
            let mut boxes = random_boxes(&mut random, count);
            for _ in 0..=(count / 4) {
                boxes[random.below(count)] = nothing;
            }
            let mut found = Vec::new();
            BoxTree::new(&boxes).self_pairs(&mut found);
            let expected = brute_self(&boxes);
            pairs += expected.len();
            assert_eq!(sorted(found), expected);
        }
    }
    println!("{pairs} overlapping pairs");
    assert!(pairs > 500);
}

#[test]
fn a_triangle_without_numbers_hides_no_other_from_the_bounds_of_all() {
    let points = [Vec3::ZERO, Vec3::ONE, Vec3::X, Vec3::NAN, Vec3::splat(5.0)];
    for triangles in
        [[[0, 1, 2], [3, 3, 3], [4, 4, 4]], [[3, 3, 3], [0, 1, 2], [4, 4, 4]], [[4, 4, 4], [0, 1, 2], [3, 3, 3]]]
    {
        let mut boxes = Vec::new();
        let whole = triangle_bounds(&points, &triangles, 0.5, &mut boxes);
        assert!((whole.min + 0.5).abs().max_element() < 1.0e-5, "{whole:?}");
        assert!((whole.max - 5.5).abs().max_element() < 1.0e-5, "{whole:?}");
        let tree = BoxTree::new(&boxes);
        let mut found = 0;
        tree.query(&whole, |_| found += 1);
        assert_eq!(found, 2);
    }
}

#[test]
fn a_tree_decays_as_its_boxes_scatter_and_is_new_after_a_rebuild() {
    let mut random = Random::new(4);
    let boxes: Vec<Aabb> = (0..512)
        .map(|_| {
            let low = random.vector().as_vec3();
            Aabb { min: low, max: low + Vec3::splat(0.01) }
        })
        .collect();
    let mut tree = BoxTree::new(&boxes);
    assert_eq!(tree.decay(), 1.0);
    // Boxes swap places step by step. The total extent stays the same.
    let mut scattered = boxes.clone();
    let mut previous = 1.0;
    for _ in 0..4 {
        for _ in 0..64 {
            let (first, second) = (random.below(512), random.below(512));
            scattered.swap(first, second);
        }
        tree.refit(&scattered);
        assert!(tree.decay() > previous, "{} {previous}", tree.decay());
        previous = tree.decay();
    }
    // Leaves of eight scattered boxes are nearly as large as the whole, and half of all nodes are leaves.
    assert!(previous > 2.0, "{previous}");
    tree.refit(&boxes);
    assert_eq!(tree.decay(), 1.0);
    tree.rebuild(&scattered);
    assert_eq!(tree.decay(), 1.0);
    let mut found = Vec::new();
    tree.self_pairs(&mut found);
    assert_eq!(sorted(found), brute_self(&scattered));
}

#[test]
fn grown_boxes_of_triangles_in_range_overlap() {
    let mut random = Random::new(5);
    let mut checked = 0;
    for _ in 0..20_000 {
        let scale = random.power_of_ten(-3.0, 3.0);
        let offset = random.vector() * random.power_of_ten(0.0, 6.0);
        let range = (random.power_of_ten(-3.0, 0.0) * scale) as f32;
        let direction = random.direction();
        // Two points exactly `range` apart or slightly closer in f64, then stored.
        let first = random.vector() * scale + offset;
        let (first, second) = (first.as_vec3(), (first + direction * f64::from(range) * random.unit()).as_vec3());
        if first.as_dvec3().distance(second.as_dvec3()) > f64::from(range) {
            continue;
        }
        let mut boxes = Vec::new();
        let points = [first, second];
        triangle_bounds(&points, &[[0, 0, 0], [1, 1, 1]], 0.5 * range, &mut boxes);
        assert!(boxes[0].overlaps(&boxes[1]), "{first} {second} {range}");
        checked += 1;
    }
    assert!(checked > 10_000);
}

/// Small boxes in a cube, enough for a tree of several levels.
fn small_boxes(random: &mut Random, count: usize) -> Vec<Aabb> {
    (0..count)
        .map(|_| {
            let low = random.vector().as_vec3();
            Aabb { min: low, max: low + Vec3::splat(0.03) }
        })
        .collect()
}

#[test]
fn a_refit_in_tasks_leaves_the_same_tree_whichever_task_is_first() {
    let mut random = Random::new(11);
    // Roots over leaves only, over leaves and nodes, and over nodes only.
    for count in [1, 9, 60, 65, 200, 500, 513, 3_000] {
        let (first, second) = (small_boxes(&mut random, count), small_boxes(&mut random, count));
        let (mut one_by_one, mut last_first) = (BoxTree::new(&first), BoxTree::new(&first));
        one_by_one.refit(&second);
        last_first.refit_on(&LastFirst, &second);
        assert_eq!(one_by_one.decay().to_bits(), last_first.decay().to_bits(), "{count} boxes");
        let nodes = |tree: &BoxTree| {
            let mut nodes = Vec::new();
            tree.for_each_node(|level, bounds| nodes.push((level, *bounds)));
            nodes
        };
        assert_eq!(nodes(&one_by_one), nodes(&last_first), "{count} boxes");
        let pairs = |tree: &BoxTree| {
            let mut pairs = Vec::new();
            tree.self_pairs(&mut pairs);
            pairs
        };
        assert_eq!(pairs(&one_by_one), pairs(&last_first), "{count} boxes");
        assert_eq!(sorted(pairs(&last_first)), brute_self(&second), "{count} boxes");
    }
}

#[test]
fn a_tree_that_is_built_anew_in_slices_is_right_at_every_slice_and_as_good_as_a_new_one_after_the_last() {
    let mut random = Random::new(12);
    for count in [1, 9, 65, 1_000, 3_000] {
        let (first, mut second) = (small_boxes(&mut random, count), small_boxes(&mut random, count));
        let mut tree = BoxTree::new(&first);
        tree.refit(&second);
        let decayed = tree.decay();
        tree.begin_rebuild(&second);
        let centers = second.clone();
        let mut slices = 1;
        while !tree.go_on_rebuilding() {
            assert!(tree.is_rebuilding());
            slices += 1;
            for bounds in &mut second {
                let shift = (random.vector() * 0.001).as_vec3();
                *bounds = Aabb { min: bounds.min + shift, max: bounds.max + shift };
            }
            tree.refit(&second);
            let mut found = Vec::new();
            tree.self_pairs(&mut found);
            assert_eq!(sorted(found), brute_self(&second), "{count} boxes, slice {slices}");
        }
        assert!(!tree.is_rebuilding() && !tree.go_on_rebuilding());
        tree.refit(&centers);
        assert_eq!(tree.decay(), 1.0);
        let (mut found, mut of_new) = (Vec::new(), Vec::new());
        tree.self_pairs(&mut found);
        BoxTree::new(&centers).self_pairs(&mut of_new);
        assert_eq!(found, of_new, "{count} boxes, in the order of a tree built in one go");
        println!("{count} boxes: {slices} slices, {decayed} times as large before");
        assert!(count < 1_000 || (slices >= 4 && decayed > 2.0), "{slices} slices, decayed by {decayed}");
    }
}

/// Consecutive leaves are traversed together, unless too many boxes are near them. Neither the results nor their order
/// may depend on that.
#[test]
fn leaves_together_find_what_each_finds_by_itself() {
    let mut random = Random::new(9);
    let mut line = |count: usize, size: f64| -> Vec<Aabb> {
        let boxes = (0..count).map(|number| {
            let low = random.vector() * 0.2 + DVec3::X * (16.0 * number as f64 / count as f64);
            Aabb { min: low.as_vec3(), max: (low + size).as_vec3() }
        });
        boxes.collect()
    };
    // Near all of the first boxes: 256 leaves, one more, and many more. Near each of their leaves: some dozens.
    for count in [2_048, 2_056, 8_000] {
        let (few, many) = (line(100, 0.1), line(count, 0.3));
        let trees = [&few, &many].map(|boxes| {
            let mut tree = BoxTree::default();
            tree.rebuild(boxes);
            tree
        });
        let [first, second] = &trees;
        let (mut together, mut alone) = (Vec::new(), Vec::new());
        first.pairs_of(0..first.leaf_count(), second, None, &mut together);
        for leaf in 0..first.leaf_count() {
            first.pairs_of(leaf..leaf + 1, second, None, &mut alone);
        }
        assert!(together == alone, "{count} boxes");
        assert_eq!(sorted(together), sorted(brute_between(&few, &many)));

        let (mut together, mut alone) = (Vec::new(), Vec::new());
        second.self_pairs_of(0..second.leaf_count(), None, &mut together);
        for leaf in 0..second.leaf_count() {
            second.self_pairs_of(leaf..leaf + 1, None, &mut alone);
        }
        assert!(together == alone, "{count} boxes of one tree");
        assert_eq!(sorted(together), brute_self(&many));
    }
    // Each box is near all others.
    for count in [2_048, 2_049, 2_600] {
        let boxes = vec![Aabb { min: Vec3::ZERO, max: Vec3::ONE }; count];
        let mut tree = BoxTree::default();
        tree.rebuild(&boxes);
        let mut pairs = Vec::new();
        tree.self_pairs(&mut pairs);
        assert_eq!(sorted(pairs).len(), count * (count - 1) / 2);
    }
}
