//! What rays cost, beside a loop over all triangles as in Bevy's mesh ray cast.

use std::time::{Duration, Instant};

use circumsphere_support::{random::Random, scenes::torus};
use glam::Vec3;

use crate::world::{ALL, app, query, random_vector, spawn, wavy, write_positions};

/// Rays per tick.
const RAYS: usize = 1_000;

/// Of these, the loop over all triangles is measured for so many.
const MEASURED: usize = 20;

/// The nearest triangle, by Möller and Trumbore in f32.
fn brute_force(positions: &[Vec3], triangles: &[[u32; 3]], origin: Vec3, direction: Vec3) -> f32 {
    triangles.iter().fold(f32::INFINITY, |nearest, corners| {
        let [a, b, c] = corners.map(|vertex| positions[vertex as usize]);
        let (first, second, from) = (b - a, c - a, origin - a);
        let across = direction.cross(second);
        let volume = first.dot(across);
        let inverse = volume.recip();
        let v = from.dot(across) * inverse;
        if !(0.0..=1.0).contains(&v) {
            return nearest;
        }
        let turned = from.cross(first);
        let w = direction.dot(turned) * inverse;
        let distance = second.dot(turned) * inverse;
        if w >= 0.0 && v + w <= 1.0 && distance >= 0.0 { nearest.min(distance) } else { nearest }
    })
}

#[test]
#[ignore = "measures time: cargo test --release --test spatial_query cost -- --ignored --nocapture"]
fn a_thousand_rays_at_a_hundred_thousand_deforming_triangles() {
    let mesh = torus(0.8, 0.3, 320, 160);
    assert!(mesh.triangles.len() >= 100_000);
    let mut random = Random::new(61);
    let mut app = app();
    let entity = spawn(&mut app, &mesh, ());
    let (mut ticks, mut loops, mut first_rays, mut updates) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for tick in 0..12 {
        let positions = wavy(&mesh, f64::from(tick) * 0.05);
        write_positions(&mut app, entity, positions.clone());
        let start = Instant::now();
        app.update();
        let update = start.elapsed();
        let rays: Vec<(Vec3, Vec3)> = (0..RAYS)
            .map(|_| {
                let origin = random_vector(&mut random).normalize() * 3.0;
                (origin, random_vector(&mut random) - origin)
            })
            .collect();
        let copy = rays.clone();
        let (found, first, all) = query(&mut app, move |query| {
            let start = Instant::now();
            let mut first = Duration::ZERO;
            let mut found = Vec::with_capacity(RAYS);
            for (origin, direction) in &copy {
                found.push(query.cast_ray(*origin, *direction, f32::INFINITY, &ALL).map(|hit| hit.distance));
                if found.len() == 1 {
                    first = start.elapsed();
                }
            }
            (found, first, start.elapsed())
        });
        assert!(found.iter().flatten().count() > RAYS / 4);
        let start = Instant::now();
        for (&(origin, direction), found) in rays.iter().zip(&found).take(MEASURED) {
            let expected = brute_force(&positions, &mesh.triangles, origin, direction);
            let apart = found.map_or(0.0, |found| (found - expected).abs());
            assert!(apart < 1.0e-4 && found.is_none() == expected.is_infinite(), "{found:?} is not {expected}");
        }
        let one_by_one = start.elapsed() / MEASURED as u32 * RAYS as u32;
        // The first tick builds the tree.
        if tick > 1 {
            ticks.push(update + all);
            first_rays.push(first);
            updates.push(update);
            loops.push(one_by_one);
        }
    }
    let median = |times: &mut Vec<Duration>| {
        times.sort();
        times[times.len() / 2]
    };
    let (tick, one_by_one) = (median(&mut ticks), median(&mut loops));
    println!(
        "{} triangles: app.update() {:?}, first ray with the tree's refit {:?}, update and {RAYS} rays {tick:?}; a loop over \
         all triangles {one_by_one:?}, {:.0} times as long",
        mesh.triangles.len(),
        median(&mut updates),
        median(&mut first_rays),
        one_by_one.as_secs_f64() / tick.as_secs_f64()
    );
}
