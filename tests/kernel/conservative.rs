//! Conservative distances against the f64 reference.

use crate::common::{CATEGORIES, Random, Triangle, hard_pair};
use bevy_circumsphere::kernel::{
    conservative::{NearPair, near_pairs},
    reference::triangle_distance,
};
use glam::{DVec3, Vec3};

const PAIRS: usize = 320_000;

/// Error of a settled distance relative to the pair's extent: what its proof may be short of, and rounding.
const DISTANCE_TOLERANCE: f64 = 2.0e-12;

fn near(a: &[Vec3; 3], b: &[Vec3; 3], range: f32) -> Option<NearPair> {
    let mut near = Vec::new();
    near_pairs([a, b], [&[[0, 1, 2]], &[[0, 1, 2]]], &[[0, 0]], range, &mut near);
    near.pop()
}

fn rounded(triangle: &Triangle) -> [Vec3; 3] {
    triangle.map(DVec3::as_vec3)
}

#[test]
fn no_pair_within_range_is_lost_and_closest_features_are_the_closest() {
    let mut random = Random::new(20_261_120);
    let (mut within, mut settled) = (0, 0);
    let mut worst: f64 = 0.0;
    for index in 0..PAIRS {
        let (a, b) = hard_pair(&mut random, index % CATEGORIES.len());
        let (a, b) = (rounded(&a), rounded(&b));
        let exact = [a, b].map(|triangle| triangle.map(Vec3::as_dvec3));
        let distance = triangle_distance(&exact[0], &exact[1]);
        let extent = exact[0].iter().chain(&exact[1]).map(|point| (*point - exact[0][0]).length()).fold(0.0, f64::max);
        if !(1.0e-12..1.0e15).contains(&extent) {
            continue;
        }
        // Exactly at the range, where rounding decides: to be kept.
        let found = near(&a, &b, distance as f32 * (1.0 + f32::EPSILON));
        assert!(found.is_some(), "{a:?} and {b:?} are {distance} apart, and lost at that range");
        within += 1;
        if let Some(closest) = found.and_then(|pair| pair.closest_features([&exact[0], &exact[1]])) {
            settled += 1;
            worst = worst.max((closest.distance - distance).abs() / extent);
        }
    }
    println!("{within} pairs, {settled} of them settled, their distances wrong by at most {worst:.1e} of the pair");
    assert!(within > PAIRS * 9 / 10, "{within} pairs are within what f32 squares");
    // Half of the kinds of pairs cross, touch, or are slivers.
    assert!(settled * 3 > within, "{settled} of {within} are settled");
    assert!(worst <= DISTANCE_TOLERANCE, "a settled distance is wrong by {worst} of the pair");
}

#[test]
fn pairs_clearly_out_of_range_are_not_kept() {
    let mut random = Random::new(7);
    let (mut apart, mut kept) = (0, 0);
    for index in 0..PAIRS / 4 {
        let (a, b) = hard_pair(&mut random, index % CATEGORIES.len());
        let (a, b) = (rounded(&a), rounded(&b));
        let exact = [a, b].map(|triangle| triangle.map(Vec3::as_dvec3));
        let distance = triangle_distance(&exact[0], &exact[1]);
        let extent = exact[0].iter().chain(&exact[1]).map(|point| (*point - exact[0][0]).length()).fold(0.0, f64::max);
        if !(1.0e-12..1.0e15).contains(&extent) || distance < 1.0e-2 * extent {
            continue;
        }
        apart += 1;
        kept += usize::from(near(&a, &b, distance as f32 * 0.99).is_some());
    }
    println!("{kept} of {apart} pairs kept too many");
    assert!(apart > 5000, "{apart} pairs are apart");
    assert!(kept * 1000 < apart, "{kept} of {apart} are kept");
}
