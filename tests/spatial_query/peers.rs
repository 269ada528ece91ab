//! Rays at deforming meshes against parry's triangle mesh in f64.

use circumsphere_support::{random::Random, scenes::icosphere};
use glam::Vec3;
use parry3d_f64::{
    query::{Ray, RayCast},
    shape::TriMesh,
};

use crate::world::{ALL, app, query, random_vector, spawn, wavy, write_positions};

/// Rays at a mesh that deforms every tick. Returns hits, misses, and how often one of the two hits what the other misses.
fn compare(level: u32, ticks: usize, rays_per_tick: usize) -> [usize; 3] {
    let mesh = icosphere(level, 1.0);
    let mut random = Random::new(51);
    let mut app = app();
    let entity = spawn(&mut app, &mesh, ());
    let mut counts = [0; 3];
    for tick in 0..ticks {
        let positions = wavy(&mesh, tick as f64 * 0.1);
        write_positions(&mut app, entity, positions.clone());
        app.update();
        let wide = positions.iter().map(|position| position.as_dvec3()).collect();
        let reference = TriMesh::new(wide, mesh.triangles.clone()).expect("the mesh is valid");
        let rays: Vec<(Vec3, Vec3)> = (0..rays_per_tick)
            .map(|_| {
                let origin = random_vector(&mut random) * 3.0;
                (origin, random_vector(&mut random) * 1.2 - origin)
            })
            .collect();
        let copy = rays.clone();
        let found: Vec<Option<f32>> = query(&mut app, move |query| {
            let cast = |&(origin, direction): &(Vec3, Vec3)| query.cast_ray(origin, direction, f32::INFINITY, &ALL);
            copy.iter().map(|ray| cast(ray).map(|hit| hit.distance)).collect()
        });
        for ((origin, direction), found) in rays.into_iter().zip(found) {
            let ray = Ray::new(origin.as_dvec3(), direction.as_dvec3());
            let expected = reference.cast_local_ray(&ray, f64::MAX, false);
            match (found, expected) {
                (Some(found), Some(expected)) => {
                    // Distances are rounded to f32. parry tests triangles up to a tolerance.
                    assert!((f64::from(found) - expected).abs() < 1.0e-6 * (1.0 + expected), "{found}, {expected}");
                    counts[0] += 1;
                }
                (None, None) => counts[1] += 1,
                // Rays that only graze the silhouette.
                _ => counts[2] += 1,
            }
        }
    }
    counts
}

#[test]
fn rays_at_a_deforming_ball_agree_with_parry() {
    let [hits, misses, different] = compare(3, 10, 2_000);
    assert!(hits > 5_000 && misses > 3_000 && different == 0, "{hits} {misses} {different}");
}

#[test]
#[ignore = "a million rays take a minute"]
fn a_million_rays_at_deforming_meshes_agree_with_parry() {
    let [hits, misses, different] = compare(5, 100, 10_000);
    eprintln!("{hits} hits, {misses} misses, {different} different");
    assert!(hits > 300_000 && misses > 200_000 && different == 0, "{hits} {misses} {different}");
}
