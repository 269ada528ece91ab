//! Touching pairs equal those of the reference for any meshes, motions, sizes, and contact distances, with every exact
//! method, both broad phases, and any number of threads.

use crate::harness::{
    BAND, Body, BroadPhase, Count, Found, Judge, Setup, SmallWorld, assert_numbers, between, for_all, mean_edge,
    points, truth_between, truth_within, wide,
};
use crate::strategies::{Motion, motion, placement, two_meshes};
use bevy_circumsphere::{detection::CandidateTrianglePairs, geometry::TouchingPair, prelude::*};
use circumsphere_support::scenes::{Mesh, triangle_soup};
use circumsphere_truth::ReferencePair;
use proptest::prelude::*;
use std::collections::HashSet;

/// Contact distances in mean edges, including 0 and distances below the f32 resolution far from the origin.
pub fn edges() -> impl Strategy<Value = f64> {
    prop_oneof![
        1 => Just(0.0),
        1 => Just(1.0e-7),
        3 => 0.001f64..0.1,
        3 => 0.1f64..1.0,
    ]
}

/// Two placed meshes at rest, their positions in the following ticks, and the contact distance.
#[derive(Clone, Debug)]
pub struct Case {
    pub rest: [Mesh; 2],
    pub moved: Vec<[Mesh; 2]>,
    pub distance: f32,
}

pub fn case() -> impl Strategy<Value = Case> {
    (two_meshes(), prop::collection::vec((motion(), motion()), 0..3), placement(), edges()).prop_map(
        |(meshes, motions, placement, edges)| {
            let mut current = meshes.clone();
            let moved = motions
                .into_iter()
                .map(|motions: (Motion, Motion)| {
                    let [first, second] = current.clone();
                    current = [motions.0.apply(first), motions.1.apply(second)];
                    current.clone().map(|mesh| placement.apply(mesh))
                })
                .collect();
            let distance = edges * meshes.iter().map(mean_edge).fold(0.0, f64::max) * f64::from(placement.scale);
            Case { rest: meshes.map(|mesh| placement.apply(mesh)), moved, distance: distance as f32 }
        },
    )
}

impl Case {
    pub fn bodies(&self) -> Vec<Body> {
        self.rest.iter().map(Body::new).collect()
    }

    /// The positions in every tick. The first tick is at rest.
    pub fn ticks(&self) -> impl Iterator<Item = &[Mesh; 2]> {
        std::iter::once(&self.rest).chain(&self.moved)
    }

    /// The reference result for one tick, up to past the end of the band.
    fn truth(&self, meshes: &[Mesh; 2]) -> [Vec<ReferencePair>; 3] {
        let reach = f64::from(self.distance) * (1.0 + 2.0 * BAND) + f64::from(f32::MIN_POSITIVE);
        let [a, b] = [wide(&points(&meshes[0])), wide(&points(&meshes[1]))];
        let (triangles_a, triangles_b) = (&meshes[0].triangles, &meshes[1].triangles);
        [
            truth_within(&points(&self.rest[0]), &a, triangles_a, reach),
            truth_between((&a, triangles_a), (&b, triangles_b), reach),
            truth_within(&points(&self.rest[1]), &b, triangles_b, reach),
        ]
    }

    fn assert_right(&self, what: &str, meshes: &[Mesh; 2], truth: &[Vec<ReferencePair>; 3], found: &[Found]) {
        let positions = [wide(&points(&meshes[0])), wide(&points(&meshes[1]))];
        let distance = f64::from(self.distance);
        for (sides, truth) in [[0, 0], [0, 1], [1, 1]].into_iter().zip(truth) {
            let corners = sides.map(|side| (&positions[side][..], &meshes[side].triangles[..]));
            let judge = Judge { corners, distance, band: BAND * distance };
            judge.assert_right(&format!("{what}, {sides:?}"), between(found, sides), truth);
        }
    }
}

#[test]
fn exact_methods_find_the_pairs_of_the_reference_by_either_broad_phase() {
    let (crossing, apart, ticks) = (Count::default(), Count::default(), Count::default());
    for_all(file!(), 400, case(), |case| {
        let mut worlds: Vec<(Setup, SmallWorld)> =
            Setup::exact().map(|setup| (setup, SmallWorld::new(&case.bodies(), case.distance, setup))).collect();
        for (tick, meshes) in case.ticks().enumerate() {
            let truth = case.truth(meshes);
            crossing.add(truth.iter().flatten().filter(|pair| pair.distance == 0.0).count());
            apart.add(truth.iter().flatten().filter(|pair| pair.distance > 0.0).count());
            ticks.add(1);
            // The contacts of `Closest` differ from those of the other methods.
            let mut first: [Option<Vec<Found>>; 2] = [None, None];
            for (setup, world) in &mut worlds {
                for body in 0..2 {
                    world.write(body, &points(&meshes[body]));
                }
                let found = world.tick();
                match &mut first[usize::from(setup.method == ContactMethod::Closest)] {
                    first @ None => {
                        case.assert_right(&format!("tick {tick}, {setup:?}"), meshes, &truth, &found);
                        *first = Some(found);
                    }
                    Some(first) => assert!(*first == found, "tick {tick}: {setup:?} finds something different"),
                }
            }
        }
    });
    ticks.assert_at_least(600, "ticks");
    crossing.assert_at_least(30_000, "crossing pairs");
    apart.assert_at_least(200_000, "pairs that are apart");
}

#[test]
fn the_sphere_methods_give_numbers_for_any_mesh_and_enclosing_balls_miss_nothing() {
    let (contacts, sure) = (Count::default(), Count::default());
    for_all(file!(), 200, case(), |case| {
        for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
            let mut world = SmallWorld::new(&case.bodies(), case.distance, Setup { method, ..Setup::REFINED });
            for meshes in case.ticks() {
                for body in 0..2 {
                    world.write(body, &points(&meshes[body]));
                }
                let found = world.tick();
                contacts.add(found.iter().map(|found| found.contacts.len()).sum());
                if method == ContactMethod::Circumsphere {
                    // The cone rejects pairs by design.
                    continue;
                }
                for (sides, truth) in [[0, 0], [0, 1], [1, 1]].into_iter().zip(case.truth(meshes)) {
                    let named: HashSet<_> =
                        between(&found, sides).iter().map(|pair| (pair.triangle_a, pair.triangle_b)).collect();
                    let must = truth.iter().filter(|pair| pair.distance <= f64::from(case.distance) * (1.0 - BAND));
                    for pair in must {
                        sure.add(1);
                        assert!(named.contains(&(pair.triangle_a, pair.triangle_b)), "{sides:?}: missed {pair:?}");
                    }
                }
            }
        }
    });
    contacts.assert_at_least(100_000, "contacts");
    sure.assert_at_least(50_000, "pairs that touch");
}

/// Enough nearby loose triangles for several chunks of work.
#[cfg(feature = "parallel")]
#[test]
fn contacts_are_the_same_to_the_last_bit_for_any_number_of_threads() {
    let chunks = Count::default();
    let soup = (120usize..200, any::<u64>(), placement(), motion(), 4.0f64..6.0);
    for_all(file!(), 16, soup, |(count, seed, placement, motion, edges)| {
        let mesh = triangle_soup(count, seed);
        let distance = (edges * mean_edge(&mesh)) as f32 * placement.scale;
        let moved = points(&placement.apply(motion.apply(mesh.clone())));
        let body = Body::new(&placement.apply(mesh));
        for method in Setup::methods().map(|setup| setup.method) {
            let mut alone: Option<Vec<Found>> = None;
            for threads in [1, 2, 4] {
                let setup = Setup { method, broad_phase: BroadPhase::Tree, threads };
                let mut world = SmallWorld::new(std::slice::from_ref(&body), distance, setup);
                let mut found = world.tick();
                world.write(0, &moved);
                found.extend(world.tick());
                let pairs = world.app.world().resource::<CandidateTrianglePairs>();
                chunks.add(usize::from(pairs.triangle_pair_count() > 4096));
                assert_numbers(&found);
                match &alone {
                    None => alone = Some(found),
                    Some(alone) => assert!(*alone == found, "{method:?} on {threads} threads differs"),
                }
            }
        }
    });
    chunks.assert_at_least(100, "detections of several chunks");
}

/// The comparison itself can fail: it notices a missing pair, an additional pair, and a wrong distance.
#[test]
fn a_missed_a_false_and_a_misplaced_pair_are_noticed() {
    let mesh = triangle_soup(30, 5);
    let case = Case { rest: [mesh.clone(), mesh], moved: Vec::new(), distance: 0.05 };
    let truth = case.truth(&case.rest);
    let found = SmallWorld::new(&case.bodies(), case.distance, Setup::REFINED).tick();
    let fails = |found: Vec<Found>| {
        std::panic::catch_unwind(|| case.assert_right("spoiled", &case.rest, &truth, &found)).is_err()
    };
    assert!(!fails(found.clone()));
    let place = found.iter().position(|found| found.sides == [0, 1]).expect("the two coincide");
    let spoiled = |spoil: &dyn Fn(&mut Vec<TouchingPair>)| {
        let mut found = found.clone();
        spoil(&mut found[place].touching);
        fails(found)
    };
    assert!(spoiled(&|touching| touching.truncate(touching.len() - 1)), "a missed pair");
    assert!(spoiled(&|touching| touching.retain(|pair| pair.distance > 0.0)), "missed crossings");
    assert!(spoiled(&|touching| touching[0].distance += 0.01), "a wrong distance");
    let far = (0..30)
        .flat_map(|a| (0..30).map(move |b| (a, b)))
        .find(|&(a, b)| !between(&found, [0, 1]).iter().any(|pair| (pair.triangle_a, pair.triangle_b) == (a, b)));
    let (triangle_a, triangle_b) = far.expect("some pair does not touch");
    let false_pair = TouchingPair { triangle_a, triangle_b, distance: 0.0 };
    assert!(
        spoiled(&|touching| {
            touching.push(false_pair);
            touching.sort_unstable_by_key(|pair| (pair.triangle_a, pair.triangle_b));
        }),
        "a false pair"
    );
}
