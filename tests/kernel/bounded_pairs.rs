//! Lists of near pairs against the f64 reference: no bound exceeds a distance, and no pair is missing.

use std::collections::{BTreeMap, BTreeSet};

use bevy_circumsphere::kernel::{
    bvh::{
        leaf_triangles::PairCull,
        near_pairs::{BoundedPairs, ListedTriangles},
    },
    exact::stage::{closest_pairs, exact_pairs},
    mesh::{ids::TriangleId, motion::Motion},
    pair::{FoundPairs, PairSettings, SurfaceSide},
    simd::parallel::Sequential,
};
use circumsphere_support::{
    random::Random,
    scenes::{Mesh, crumpled_sheet, ragged_slivers, triangle_soup},
};
use circumsphere_truth::triangle_distance;
use glam::Vec3;

use crate::surface_tree::Surface;

fn side(surface: &Surface) -> SurfaceSide<'_> {
    let Surface { topology, positions, .. } = surface;
    SurfaceSide::flat(topology, positions)
}

fn meshes() -> [(&'static str, Mesh, f32); 3] {
    let soup = triangle_soup(300, 3);
    [("sheet", crumpled_sheet(600, 0.0), 0.4), ("soup", soup, 0.05), ("slivers", ragged_slivers(2), 0.05)]
}

/// The pairs that pass a limit.
fn near(pairs: &BoundedPairs, limit: f32) -> Vec<[u32; 2]> {
    let mut near = Vec::new();
    pairs.append_near(limit, &mut near, &mut Vec::new());
    near
}

#[test]
fn a_list_has_every_pair_within_the_skin_and_bounds_no_greater_than_the_distances() {
    for (name, mesh, range) in meshes() {
        let (a, skin) = (Surface::of_mesh(&mesh, range), 0.8 * range);
        let mut moved = mesh.clone();
        moved.positions.iter_mut().for_each(|point| *point = [point[0] + 0.3 * range, point[1], point[2] + range]);
        let b = Surface::of_mesh(&moved, range);
        for is_self in [true, false] {
            let other = if is_self { &a } else { &b };
            let cull = PairCull {
                triangles: [&a.triangles, &other.triangles],
                neighbors: is_self,
                slabs: range + skin,
                search_from: &[],
                planes_only: false,
            };
            let (mut pairs, leaves) = (BoundedPairs::default(), a.tree.leaf_count());
            // Two parts of the list, cut at any leaf, make up the whole.
            for leaves in [0..leaves / 3, leaves / 3..leaves] {
                let mut part = BoundedPairs::default();
                if is_self {
                    a.tree.bounded_self_pairs_of(leaves, range, skin, &cull, &mut part);
                } else {
                    a.tree.bounded_pairs_of(leaves, &other.tree, range, skin, &cull, &mut part);
                }
                pairs.append(&mut part);
            }
            let listed: BTreeMap<[u32; 2], usize> =
                pairs.pairs().enumerate().map(|(place, pair)| (pair, place)).collect();
            assert_eq!(listed.len(), pairs.len(), "{name}: a pair is listed twice");
            let count = a.topology.triangles().len() as u32;
            let (mut within, mut beyond, mut passed_over) = (0, 0, 0);
            let examined: BTreeSet<[u32; 2]> = near(&pairs, range).into_iter().collect();
            for first in 0..count {
                for second in if is_self { first + 1 } else { 0 }..count {
                    if is_self && a.topology.share_vertex(TriangleId(first), TriangleId(second)) {
                        assert!(!listed.contains_key(&[first, second]), "{name}: {first} and {second} are neighbors");
                        continue;
                    }
                    let distance = triangle_distance(&a.corners(first), &other.corners(second));
                    let is_listed = listed.contains_key(&[first, second]);
                    if distance <= f64::from(range) {
                        assert!(examined.contains(&[first, second]), "{name}: {first} and {second} are not examined");
                        within += 1;
                    } else if distance <= f64::from(range + skin) {
                        assert!(is_listed, "{name}: {first} and {second}, {distance} apart, are not listed");
                        beyond += 1;
                    }
                    passed_over += usize::from(is_listed && !examined.contains(&[first, second]));
                }
            }
            // The largest limit that each pair does not pass must not exceed its distance.
            for step in 0..40 {
                let limit = (range + skin) * step as f32 / 40.0;
                for [first, second] in pairs.pairs().filter(|pair| !near(&pairs, limit).contains(pair)).take(50) {
                    let distance = triangle_distance(&a.corners(first), &other.corners(second));
                    assert!(distance > f64::from(limit) * (1.0 - 1.0e-6), "{name}: {distance} is less than {limit}");
                }
            }
            let limits = [0.0, 0.3 * range, range, range + 0.4 * skin];
            let before = limits.map(|limit| {
                let mut near = near(&pairs, limit);
                near.sort_unstable();
                near
            });
            pairs.sort(count as usize);
            assert!(pairs.pairs().is_sorted() && pairs.len() == listed.len());
            assert_eq!(limits.map(|limit| near(&pairs, limit)), before);
            println!("{name}: {within} within, {beyond} in the skin, {passed_over} passed over of {}", pairs.len());
            assert!(within > 100 && beyond > 100 && passed_over > 100, "{name}: {within} {beyond} {passed_over}");
        }
    }
}

#[test]
fn lower_bounds_of_the_exact_test_are_the_distances_within_the_range_and_beyond() {
    for (name, mesh, range) in meshes() {
        let surface = Surface::of_mesh(&mesh, range);
        let count = surface.topology.triangles().len() as u32;
        let apart = |&[a, b]: &[u32; 2]| !surface.topology.share_vertex(TriangleId(a), TriangleId(b));
        let all: Vec<[u32; 2]> =
            (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b])).filter(apart).step_by(3).collect();
        let range = f64::from(range);
        let settings = PairSettings {
            contact_distance: range,
            reported_distance: range,
            range,
            scale: 1.0,
            bulge: 0.0,
            cull: true,
            same_surface: true,
            any_left_out: false,
        };
        for test in [exact_pairs, closest_pairs] {
            let [mut found, mut without] =
                [true, false].map(|wants_lower_bounds| FoundPairs { wants_lower_bounds, ..FoundPairs::default() });
            test(&side(&surface), &side(&surface), &all, &settings, &mut found);
            test(&side(&surface), &side(&surface), &all, &settings, &mut without);
            assert_eq!((&found.touching, &found.contacts), (&without.touching, &without.contacts), "{name}");
            assert!(without.lower_bounds.is_empty());
            assert_eq!(found.lower_bounds.len(), all.len());
            let (mut beyond, mut close) = (0, 0);
            for (&[a, b], &bound) in all.iter().zip(&found.lower_bounds) {
                let distance = triangle_distance(&surface.corners(a), &surface.corners(b));
                // Two units in the last place of f32. The reference itself is off by 1e-13 of the mesh's extent.
                assert!(f64::from(bound) <= distance + 1.0e-11, "{name}: {a} and {b}: {bound}, {distance}");
                beyond += usize::from(distance > range);
                close += usize::from(distance > range && f64::from(bound) > distance * (1.0 - 1.0e-6));
            }
            println!("{name}: {close} of {beyond}");
            // All except those that the screen cannot tell from crossing pairs, which are examined individually only
            // near the range.
            assert!(beyond > 10_000 && close * 100 > beyond * 95, "{name}: {close} of {beyond}");
        }
    }
}

#[test]
fn a_closer_look_raises_bounds_of_pairs_that_are_apart_and_none_above_the_distance() {
    // Lengths are in units of the range. The squares of the last sizes overflow or underflow in f32.
    let sizes = [(1.0, Vec3::ZERO), (1.0, Vec3::new(300.0, -20.0, 5.0)), (1.0e-10, Vec3::ZERO), (1.0e8, Vec3::ZERO)];
    let extremes = [(1.0e-22, Vec3::ZERO), (1.0e18, Vec3::ZERO)];
    for (name, mesh, range) in meshes() {
        for (number, (size, place)) in sizes.into_iter().chain(extremes).enumerate() {
            let mut mesh = mesh.clone();
            mesh.positions.iter_mut().for_each(|point| *point = (place + Vec3::from_array(*point) * size).to_array());
            let (surface, range) = (Surface::of_mesh(&mesh, range * size), range * size);
            let count = surface.topology.triangles().len() as u32;
            let distance = |[a, b]: [u32; 2]| triangle_distance(&surface.corners(a), &surface.corners(b));
            // All pairs within twice the range, and some of the others.
            let is_requested =
                |pair: &[u32; 2]| (pair[0] + pair[1]).is_multiple_of(16) || distance(*pair) <= 2.0 * f64::from(range);
            let all: Vec<[u32; 2]> = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b])).collect();
            let all: Vec<[u32; 2]> = all.into_iter().filter(is_requested).collect();
            let [firsts, seconds] = [0, 1].map(|side: usize| all.iter().map(|pair| pair[side]).collect::<Vec<u32>>());
            // Some bounds are refined; others are below the motion, above the limit, or NaN.
            let (motion, passed, limit) = (0.25 * range, 0.75 * range, 1.25 * range);
            let bounds = [range, passed, limit, range, 1.5 * range, f32::NAN, range, 0.0];
            let before: Vec<f32> = (0..all.len()).map(|place| bounds[place % bounds.len()]).collect();
            let is_between = |bound: f32| bound > passed && bound <= limit;
            let mut pairs = BoundedPairs::default();
            pairs.extend_from_slices(&firsts, &seconds, &before);
            let triangles =
                ListedTriangles { positions: [&surface.positions; 2], triangles: [surface.topology.triangles(); 2] };
            let looked_at = pairs.look_closer(&Sequential, &triangles, [passed, limit], motion);
            assert_eq!(looked_at, before.iter().filter(|bound| is_between(**bound)).count(), "{name} {size}");
            let near_at = |limit: f32| near(&pairs, limit).into_iter().collect::<BTreeSet<[u32; 2]>>();
            let now = near_at(limit);
            let (mut raised, mut apart) = (0, 0);
            for (&pair, &bound) in all.iter().zip(&before) {
                let is_near = now.contains(&pair);
                if !is_between(bound) {
                    assert_eq!(is_near, bound <= limit || bound.is_nan(), "{name} {size}: {pair:?} was not to change");
                    continue;
                }
                let is_apart = distance(pair) > f64::from(range);
                assert!(is_near || is_apart, "{name} {size}: {pair:?} is lost, {} apart", distance(pair));
                raised += usize::from(!is_near);
                apart += usize::from(is_apart);
            }
            // Bounds stay below the distances for every limit.
            for step in 1..12 {
                let limit = limit * (1.0 + 0.5 * step as f32);
                let now = near_at(limit);
                for (&pair, _) in
                    all.iter().zip(&before).filter(|(pair, bound)| is_between(**bound) && !now.contains(*pair))
                {
                    let least = f64::from(limit - motion) * (1.0 - 1.0e-6);
                    assert!(distance(pair) > least, "{name} {size}: {pair:?}, {} for {limit}", distance(pair));
                }
            }
            println!("{name} {size}: {raised} raised of {apart} that are apart, {} in all", all.len());
            let least = if number < sizes.len() { 85 } else { 0 };
            assert!(apart > 300 && raised * 100 >= apart * least, "{name} {size}: {raised} of {apart}");
        }
    }
}

#[test]
fn what_is_learned_goes_to_the_pairs_that_were_near_and_lasts_as_long_as_the_motion_allows() {
    let mut random = Random::new(1);
    let count = 3000;
    let truth: Vec<f32> = (0..count).map(|_| random.unit() as f32 * 2.0).collect();
    let (firsts, seconds): (Vec<u32>, Vec<u32>) = ((0..count).collect(), (count..2 * count).collect());
    let mut pairs = BoundedPairs::default();
    // Loose bounds, and one NaN.
    let bounds: Vec<f32> =
        truth.iter().enumerate().map(|(place, truth)| if place == 7 { f32::NAN } else { 0.7 * truth }).collect();
    pairs.extend_from_slices(&firsts, &seconds, &bounds);
    let (range, mut known, mut learned) = (0.5, bounds, 0);
    for tick in 0..20 {
        let motion = 0.05 * tick as f32;
        let limit = range + motion;
        let is_near = |&place: &usize| known[place] <= limit || known[place].is_nan();
        let expected: Vec<usize> = (0..count as usize).filter(is_near).collect();
        let (mut found, mut places) = (Vec::new(), Vec::new());
        pairs.append_near(limit, &mut found, &mut places);
        assert!(places.iter().map(|&place| place as usize).eq(expected.iter().copied()));
        assert!(found.iter().map(|pair| pair[0] as usize).eq(expected.iter().copied()));
        assert!(found.iter().all(|pair| pair[1] == pair[0] + count));
        // A list that is one bound too short is ignored.
        pairs.learn(&places, motion, &vec![9.0; found.len() - 1]);
        assert_eq!(near(&pairs, limit), found);
        let distances: Vec<f32> = expected.iter().map(|&place| (truth[place] - motion).max(0.0)).collect();
        pairs.learn(&places, motion, &distances);
        for (place, distance) in expected.into_iter().zip(distances) {
            learned += usize::from(known[place] < distance + motion);
            known[place] = distance + motion;
        }
    }
    assert!(learned > 500, "{learned}");
    pairs.reverse();
    assert!(pairs.pairs().all(|[first, second]| first == second + count));
}

#[test]
fn no_distance_changes_by_more_than_the_relative_motion_which_common_motion_does_not_count_for() {
    let mut random = Random::new(2);
    let mut vector = |length: f32| length * Vec3::new(random.signed_unit(), random.signed_unit(), random.signed_unit());
    for (size, common, own) in [(1.0, 0.0, 0.01), (1.0, 5.0, 0.01), (1.0e4, 3.0e3, 1.0), (1.0e-3, 1.0, 1.0e-5)] {
        let before: [Vec<Vec3>; 2] = [0; 2].map(|_| (0..200).map(|_| vector(size)).collect());
        let [all, first_alone] = [vector(common), vector(own)];
        let after = [0, 1].map(|side: usize| -> Vec<Vec3> {
            let whole = if side == 0 { all + first_alone } else { all };
            before[side].iter().map(|&point| point + whole + vector(own)).collect()
        });
        let motions = [0, 1].map(|side: usize| Motion::between(&before[side], &after[side]));
        for sides in [[0, 1], [0, 0], [1, 1]] {
            let most = motions[sides[0]].relative(&motions[sides[1]]);
            let mut largest: f64 = 0.0;
            let [[a, a_after], [b, b_after]] = sides.map(|side| [&before[side], &after[side]]);
            for (a, a_after) in a.iter().zip(a_after) {
                for (b, b_after) in b.iter().zip(b_after) {
                    let moved = (a_after.as_dvec3() - a.as_dvec3()) - (b_after.as_dvec3() - b.as_dvec3());
                    largest = largest.max(moved.length());
                }
            }
            assert!(largest <= most, "{largest} {most}");
            // Vertices that move in different directions move relative to each other. The common motion rounds
            // coordinates.
            assert!(most < 2.0 * largest + f64::from(32.0 * f32::EPSILON * (common + size)), "{largest} {most}");
        }
    }
    assert!(Motion::UNKNOWN.relative(&Motion::REST).is_infinite());
    assert_eq!(Motion::REST.relative(&Motion::REST), 0.0);
    // Lengths whose squares overflow or underflow in f32.
    for length in [1.0e-25, 1.0e25] {
        let moved = Motion::between(&[Vec3::ZERO, Vec3::ZERO], &[Vec3::splat(length), Vec3::ZERO]);
        assert!(moved.relative(&moved) >= f64::from(length), "{length}");
    }
    assert!(Motion::between(&[Vec3::ZERO], &[]).relative(&Motion::REST).is_infinite());
}
