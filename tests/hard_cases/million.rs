//! A surface of a million triangles under a small body.

use std::collections::BTreeMap;

use bevy_circumsphere::{ContactMethod, detection::CandidateTrianglePairs};
use circumsphere_support::scenes::{Diagonals, grid, icosphere};

use crate::harness::{BROAD_PHASES, Body, BroadPhase, Case, Found, Run, Stated, Tally, Truth, at, turned};

/// Cells per side, each of length 0.1: 1,002,528 triangles.
const CELLS: usize = 708;
const SIDE: f32 = 70.8;

const THIN: f32 = 0.01;

/// As for any ball on a sheet, balls and caps of triangles beside the lowest point bulge into it.
const MILLION: Stated =
    Stated { touching: 39, false_by_balls: 25, missed_by_caps: 0, bodies_missed_by_caps: 0, false_by_caps: 7 };

/// The most candidates: the triangles under the ball with those of the ball, and within the sheet the pairs of boxes
/// that lie rim to rim. Their number must not grow with the square of a million.
const MOST_CANDIDATES: usize = 1_499_796;

/// Pairs of the flat sheet with itself that share no vertex and are reported as touching, by method. In truth none
/// touches, but balls of triangles two apart overlap.
const FALSE_OF_ITSELF: [usize; 4] = [1_499_544, 0, 0, 0];

#[test]
fn a_million_triangles_meet_a_small_body_only_where_it_is() {
    let sheet = grid(CELLS, CELLS, SIDE, SIDE, Diagonals::Alternating);
    assert!(sheet.triangles.len() > 1_000_000);
    let place = at(12.34, 0.405, -20.56).with_rotation(turned(glam::Vec3::new(1.0, 0.2, 0.4), 0.3));
    let ball = Body::new(&icosphere(2, 0.4), THIN).at(place);

    // The reference covers only the surroundings of the ball. Everything else is out of its reach.
    let is_near = |corner: &u32| {
        let [x, _, z] = sheet.positions[*corner as usize];
        (x - place.translation.x).abs() < 1.0 && (z - place.translation.z).abs() < 1.0
    };
    let local: Vec<u32> = (0..sheet.triangles.len() as u32)
        .filter(|&triangle| sheet.triangles[triangle as usize].iter().any(is_near))
        .collect();
    let mut patch = sheet.clone();
    patch.triangles = local.iter().map(|&triangle| sheet.triangles[triangle as usize]).collect();
    let truth = Truth::of(&[Body::new(&patch, THIN), ball.clone()]);

    let sheet = Body::new(&sheet, THIN);
    let mut tally = Tally::default();
    for (method, most_of_itself) in ContactMethod::ALL.into_iter().zip(FALSE_OF_ITSELF) {
        let [tree, brute_force, parry] = BROAD_PHASES.map(|broad_phase| {
            // Self-collision is tested only with the tree, because brute force would compare 5e11 boxes.
            let sheet = sheet.clone();
            let sheet = if broad_phase == BroadPhase::Tree { sheet.meeting_itself() } else { sheet };
            let mut run = Run::new(&Case::new([sheet, ball.clone()]), method, broad_phase);
            let mut found = run.tick();
            let of_itself = found.pairs.remove(&(0, 0)).map_or(0, |pair| pair.touching.len());
            println!("{method:?}, {broad_phase:?}: {of_itself} pairs of itself");
            assert!(of_itself <= most_of_itself, "{method:?}: {of_itself} pairs of a flat sheet with itself");
            let candidates = run.app.world().resource::<CandidateTrianglePairs>().triangle_pair_count();
            println!("{method:?}, {broad_phase:?}: {candidates} candidates");
            assert!(candidates <= MOST_CANDIDATES, "{method:?}, {broad_phase:?}: {candidates} candidates");
            found
        });
        let what = format!("{method:?}");
        tree.assert_same_bits(&brute_force, &what);
        tree.assert_same_bits(&parry, &what);
        tally.add(method, &renumbered(tree, &local), &truth, &what);
    }
    tally.assert_as(MILLION);
}

/// The results, with the sheet's triangles numbered as in the list around the ball.
fn renumbered(mut found: Found, local: &[u32]) -> Found {
    let numbers: BTreeMap<u32, u32> = local.iter().copied().zip(0..).collect();
    let number = |triangle: &mut u32| *triangle = *numbers.get(triangle).expect("contacts are around the ball");
    for pair in found.pairs.values_mut() {
        pair.touching.iter_mut().for_each(|touching| number(&mut touching.triangle_a));
        pair.contacts.iter_mut().for_each(|contact| number(&mut contact.triangle_a));
    }
    found
}
