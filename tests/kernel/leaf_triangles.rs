//! What a traversal rejects: neighbors by their vertices, other pairs by slabs. Partial traversals add up to the whole.

use std::collections::{BTreeSet, HashSet};

use bevy_circumsphere::kernel::{
    bvh::{
        leaf_triangles::{LeafMesh, LeafTriangles, PairCull},
        near_pairs::BoundedPairs,
        tree::{BoxTree, LEAF_WIDTH},
    },
    mesh::{
        bounds::{Aabb, triangle_bounds},
        ids::TriangleId,
    },
};
use circumsphere_support::scenes::{Mesh, crumpled_sheet, duplicate_vertices, icosphere, merge, triangle_soup};
use circumsphere_truth::triangle_distance;
use glam::{DVec3, Vec3};

use crate::{
    common::{CATEGORIES, Random, Triangle, hard_pair},
    surface_tree::Surface,
    truth::independent,
};

fn of_triangles(triangles: &[Triangle], range: f32) -> Surface {
    let stored: Vec<[Vec3; 3]> = triangles.iter().map(|corners| corners.map(DVec3::as_vec3)).collect();
    let (positions, triangles) = independent(&stored);
    Surface::new(positions, &triangles, range)
}

/// The same triangles as a list of leaves in mesh order, the layout of a moved surface.
fn as_leaves(surface: &Surface, range: f32) -> (BoxTree, LeafTriangles) {
    let (mut bounds, mut leaves, mut triangles) = (Vec::new(), BoxTree::default(), LeafTriangles::default());
    triangle_bounds(&surface.positions, surface.topology.triangles(), 0.5 * range, &mut bounds);
    let items: Vec<(u32, Aabb)> = (0..).zip(bounds).collect();
    leaves.collect_leaves(&items);
    triangles.update(&leaves, &LeafMesh::flat(&surface.topology, &surface.positions));
    (leaves, triangles)
}

fn cull(triangles: [&LeafTriangles; 2], slabs: f32, planes_only: bool) -> PairCull<'_> {
    PairCull { triangles, neighbors: false, slabs, search_from: &[], planes_only }
}

/// Counts of rejected pairs, and of all pairs beyond the range.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    within: usize,
    beyond: usize,
    rejected_by_planes: usize,
    rejected: usize,
    /// Pairs whose bound in a list is greater than 0.
    bounded: usize,
}

/// Asserts that a traversal that fills a list of near pairs includes all pairs within the range and the skin, and that
/// no bound exceeds the distance. Returns the number of bounds greater than 0.
fn assert_bounds(a: &Surface, sides: [&Surface; 2], is_self: bool, range: f32, skin: f32) -> usize {
    let within = range + skin;
    let cull = cull(sides.map(|side| &side.triangles), within, false);
    let mut list = BoundedPairs::default();
    if is_self {
        a.tree.bounded_self_pairs_of(0..a.tree.leaf_count(), range, skin, &cull, &mut list);
    } else {
        a.tree.bounded_pairs_of(0..a.tree.leaf_count(), &sides[1].tree, range, skin, &cull, &mut list);
    }
    let [first_count, second_count] = sides.map(|side| side.topology.triangles().len() as u32);
    let near = |limit: f32| {
        let mut near = Vec::new();
        list.append_near(limit, &mut near, &mut Vec::new());
        near.into_iter().collect::<HashSet<[u32; 2]>>()
    };
    let steps = [0.0, 0.3, 0.6, 0.8, 1.0].map(|share| share * within).map(|limit| (limit, near(limit)));
    let mut bounded = 0;
    for first in 0..first_count {
        for second in if is_self { first + 1 } else { 0 }..second_count {
            let pair = [first, second];
            let distance = triangle_distance(&sides[0].corners(first), &sides[1].corners(second));
            for (limit, near) in steps.iter().filter(|(limit, _)| distance <= f64::from(*limit)) {
                let corners = [sides[0].corners(first), sides[1].corners(second)];
                assert!(near.contains(&pair), "{distance:e} is not beyond {limit:e} of {within:e}: {corners:?}");
            }
            bounded += usize::from(steps[4].1.contains(&pair) && !steps[0].1.contains(&pair));
        }
    }
    bounded
}

/// Asserts that slabs reject no pair within range and change nothing else, for two surfaces and for the first with
/// itself.
fn judge(a: &Surface, b: &Surface, range: f32, tally: &mut Tally) {
    let (leaves, of_leaves) = as_leaves(a, range);
    let whole = 0..a.tree.leaf_count();
    for (sides, is_self) in [([a, b], false), ([a, a], true)] {
        let mut all = Vec::new();
        if is_self {
            a.tree.self_pairs(&mut all);
        } else {
            a.tree.pairs_of(0..a.tree.leaf_count(), &b.tree, None, &mut all);
        }
        let distances: Vec<f64> = all
            .iter()
            .map(|&[first, second]| triangle_distance(&sides[0].corners(first), &sides[1].corners(second)))
            .collect();
        let assert_kept = |kept: &[[u32; 2]], count: usize| {
            assert_eq!(count, all.len());
            let mut left = kept.iter().peekable();
            let mut rejected = 0;
            for (pair, &distance) in all.iter().zip(&distances) {
                if left.next_if_eq(&pair).is_none() {
                    let corners = [sides[0].corners(pair[0]), sides[1].corners(pair[1])];
                    assert!(distance > f64::from(range), "{distance:e} is within {range:e}: {corners:?}");
                    rejected += 1;
                }
            }
            assert!(left.next().is_none(), "pairs are out of order or unexpected");
            rejected
        };
        let traverse = |planes_only: bool| {
            let cull = cull(sides.map(|side| &side.triangles), range, planes_only);
            let mut kept = Vec::new();
            let count = if is_self {
                a.tree.self_pairs_of(whole.clone(), Some(&cull), &mut kept)
            } else {
                a.tree.pairs_of(whole.clone(), &b.tree, Some(&cull), &mut kept)
            };
            (kept, count)
        };
        let (by_planes, count) = traverse(true);
        tally.rejected_by_planes += assert_kept(&by_planes, count);
        let (by_all, count) = traverse(false);
        tally.rejected += assert_kept(&by_all, count);
        tally.within += distances.iter().filter(|&&distance| distance <= f64::from(range)).count();
        tally.beyond += distances.iter().filter(|&&distance| distance > f64::from(range)).count();
        tally.bounded += assert_bounds(a, sides, is_self, range, 0.7 * range);
        if !is_self {
            // With leaves in another order, every rejected pair must be beyond the range, too.
            let cull = cull([&of_leaves, &b.triangles], range, false);
            let mut kept = Vec::new();
            leaves.pairs_of(0..leaves.leaf_count(), &b.tree, Some(&cull), &mut kept);
            let kept: BTreeSet<[u32; 2]> = kept.into_iter().collect();
            for (pair, &distance) in all.iter().zip(&distances) {
                assert!(kept.contains(pair) || distance > f64::from(range), "{distance:e} is within {range:e}");
            }
        }
    }
}

#[test]
fn slabs_reject_no_pair_within_range() {
    let mut random = Random::new(4);
    let mut tally = Tally::default();
    for index in 0..3_000 {
        // Pairs of one category, in a partial leaf, one leaf, or several.
        let count = 1 + random.below([1, 7, 8, 40][index / CATEGORIES.len() % 4]);
        let mut hard: Vec<_> = (0..count).map(|_| hard_pair(&mut random, index % CATEGORIES.len())).collect();
        if random.below(3) == 0 {
            // All pairs far from the origin, where f32 is coarse.
            let size =
                hard.iter().flat_map(|(a, b)| a.iter().chain(b)).map(|p| p.abs().max_element()).fold(0.0, f64::max);
            let offset = random.direction() * size * random.power_of_ten(0.0, 3.0);
            let moved = |triangle: Triangle| triangle.map(|p| (p + offset).as_vec3().as_dvec3());
            // Near the limits of f32 they are not moved.
            if size < 1.0e30 {
                hard = hard.into_iter().map(|(a, b)| (moved(a), moved(b))).collect();
            }
        }
        let (a, b) = &hard[random.below(count)];
        let distance = triangle_distance(a, b);
        let extent = a.iter().chain(b).map(|p| (*p - a[0]).abs().max_element()).fold(0.0, f64::max);
        let range = match random.below(4) {
            0 => 0.0,
            // At the limit: exactly the distance of one of the pairs, rounded up to f32.
            1 => (distance as f32).next_up(),
            2 => (distance * random.range(0.3, 1.5)) as f32,
            _ => (extent * random.power_of_ten(-4.0, 0.0)) as f32,
        };
        let [first, second]: [Vec<Triangle>; 2] =
            [hard.iter().map(|pair| pair.0).collect(), hard.iter().map(|pair| pair.1).collect()];
        judge(&of_triangles(&first, range), &of_triangles(&second, range), range, &mut tally);
    }
    println!("{tally:?}");
    assert!(tally.within > 20_000 && tally.beyond > 20_000 && tally.bounded > 10_000);
    // Planes alone reject a pair only where f32 is certain of them, which is rare for hard pairs.
    assert!(tally.rejected * 3 > tally.beyond && tally.rejected_by_planes * 8 > tally.beyond);
}

/// Slabs reject more than nine in ten of the pairs beyond the range, and no others, before the exact test.
#[test]
fn slabs_leave_few_pairs_beyond_the_range() {
    let ball_in_a_ball = merge(&[icosphere(3, 1.0), icosphere(3, 0.97)]);
    for (mesh, name) in
        [(crumpled_sheet(3_000, 0.0), "sheet"), (ball_in_a_ball, "ball in a ball"), (triangle_soup(700, 3), "soup")]
    {
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let topology = Surface::of_mesh(&mesh, 0.0).topology;
        let range = (0.1 * topology.mean_edge_length(&positions)) as f32;
        let surface = Surface::of_mesh(&mesh, range);
        // The number of pairs left, within the range and beyond.
        let left = |slabs: f32| {
            let cull = PairCull { neighbors: true, ..cull([&surface.triangles; 2], slabs, false) };
            let mut kept = Vec::new();
            surface.tree.self_pairs_of(0..surface.tree.leaf_count(), Some(&cull), &mut kept);
            let distance = |&[a, b]: &[u32; 2]| triangle_distance(&surface.corners(a), &surface.corners(b));
            let beyond = kept.iter().filter(|&pair| distance(pair) > f64::from(range)).count();
            (kept.len() - beyond, beyond)
        };
        let ((within, beyond), (kept, left_beyond)) = (left(f32::INFINITY), left(range));
        println!("{name}: {within} within and {beyond} beyond, of which {kept} and {left_beyond} are left");
        assert_eq!(kept, within, "{name}");
        assert!(beyond > 2_000 && left_beyond * 10 < beyond, "{name}");
    }
}

/// Sums of products that overflow are infinite or NaN, and would show gaps that do not exist.
#[test]
fn slabs_reject_no_pair_within_range_where_f32_overflows() {
    let mut random = Random::new(5);
    let point = |x: f32, y: f32, z: f32| Vec3::new(x, y, z).as_dvec3();
    // Found by the fuzz target `narrow_phase`.
    let large = [point(0.0, 0.0, 3.184_344_8e-11), point(-3.522_885_4e25, -3.534_804e25, 4.482_079_4e-8)];
    let large = [large[0], large[1], point(-3.536_107_8e25, 0.0, 0.0)];
    let small = [point(0.0, 0.0, 0.0), point(0.0, 0.0, -35_651_584.0), point(-1.073_741_8e8, -1.073_741_8e8, -1.0e8)];
    let mut pairs = vec![(large, small, 4.0), (small, large, 4.0)];
    for _ in 0..60_000 {
        // Up to a tenth of the largest number. Coordinates have a size each or one size together.
        let size = random.power_of_ten(15.0, 37.0);
        let is_wild = random.below(2) == 0;
        let mut coordinate = || {
            let size = if is_wild { random.power_of_ten(0.0, 1.0) * size.powf(random.range(0.5, 1.0)) } else { size };
            random.range(-1.0, 1.0) * size
        };
        let mut triangle = || [(); 3].map(|()| DVec3::new(coordinate(), coordinate(), coordinate()));
        let (mut a, b) = (triangle(), triangle());
        // The triangles cross: the middle of one edge of the first is in the middle of the second.
        let through = (b[0] + b[1] + b[2]) / 3.0;
        a[1] = through * 2.0 - a[0];
        let stored = |triangle: Triangle| triangle.map(|p| p.as_vec3().as_dvec3());
        pairs.push((stored(a), stored(b), (size * random.power_of_ten(-9.0, -3.0)) as f32));
    }
    let mut tally = Tally::default();
    for (a, b, range) in pairs {
        if a.iter().chain(&b).all(|p| p.is_finite()) {
            judge(&of_triangles(&[a], range), &of_triangles(&[b], range), range, &mut tally);
        }
    }
    println!("{tally:?}");
    assert!(tally.within > 40_000);
}

/// Meshes with coincident vertices, edges of many triangles, and triangles without area.
fn tangled_meshes() -> Vec<Mesh> {
    let ball = icosphere(2, 1.0);
    let fins = Mesh {
        positions: (0u8..30).map(|k| [f32::from(k % 3), f32::from(k % 5) * 0.5, f32::from(k) * 0.1]).collect(),
        triangles: (2..30).map(|k| [0, 1, k]).chain((4..28).map(|k| [k, k + 1, k + 1])).collect(),
    };
    vec![
        duplicate_vertices(&ball),
        merge(&[ball.clone(), ball.clone().scale(0.9), ball]),
        merge(&[fins.clone(), fins.translate([0.3, 0.1, 0.2])]),
        triangle_soup(700, 3),
    ]
}

#[test]
fn neighbors_are_dropped_exactly_where_triangles_share_a_vertex() {
    let (mut dropped, mut left) = (0, 0);
    for mesh in tangled_meshes() {
        let surface = Surface::of_mesh(&mesh, 0.2);
        let mut all = Vec::new();
        surface.tree.self_pairs(&mut all);
        let before = all.len();
        all.retain(|&[a, b]| !surface.topology.share_vertex(TriangleId(a), TriangleId(b)));
        let cull = PairCull { neighbors: true, ..cull([&surface.triangles; 2], f32::INFINITY, false) };
        let mut found = Vec::new();
        let count = surface.tree.self_pairs_of(0..surface.tree.leaf_count(), Some(&cull), &mut found);
        assert_eq!(found, all);
        assert_eq!(count, all.len(), "overlapping pairs that are not neighbors");
        dropped += before - all.len();
        left += all.len();
    }
    println!("{dropped} neighbors, {left} others");
    assert!(dropped > 5_000 && left > 5_000);
}

#[test]
fn a_traversal_in_parts_finds_what_it_finds_as_a_whole_in_the_same_order() {
    let mut random = Random::new(6);
    let range = 0.05;
    let (mut pairs, mut parts) = (0, 0);
    for mesh in tangled_meshes() {
        let surface = Surface::of_mesh(&mesh, range);
        let other = Surface::of_mesh(&mesh.clone().rotate([1.0, 0.3, 0.2], 0.7).translate([0.2, 0.1, 0.0]), range);
        let leaf_count = surface.tree.leaf_count();
        assert!(leaf_count > 5 && surface.tree.len() > 5 * LEAF_WIDTH);
        let of_itself = PairCull { neighbors: true, ..cull([&surface.triangles; 2], range, false) };
        let of_both = cull([&surface.triangles, &other.triangles], range, false);
        for round in 0..20 {
            let (of_itself, of_both) = if round == 0 { (None, None) } else { (Some(&of_itself), Some(&of_both)) };
            let traverse = |leaves: std::ops::Range<usize>, [own, both]: &mut [Vec<[u32; 2]>; 2]| {
                [
                    surface.tree.self_pairs_of(leaves.clone(), of_itself, own),
                    surface.tree.pairs_of(leaves, &other.tree, of_both, both),
                ]
            };
            let mut whole = [Vec::new(), Vec::new()];
            let counts = traverse(0..leaf_count, &mut whole);
            let mut in_parts = [Vec::new(), Vec::new()];
            let (mut from, mut sums) = (0, [0; 2]);
            while from < leaf_count {
                let to = (from + random.below(2 + leaf_count / (1 + round))).min(leaf_count);
                let part = traverse(from..to, &mut in_parts);
                sums = [sums[0] + part[0], sums[1] + part[1]];
                (from, parts) = (to, parts + 1);
            }
            assert_eq!((&whole, counts), (&in_parts, sums));
            pairs += whole[0].len() + whole[1].len();
        }
    }
    println!("{pairs} pairs in {parts} parts");
    assert!(pairs > 10_000 && parts > 300);
}
