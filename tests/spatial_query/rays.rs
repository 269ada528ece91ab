//! Rays against brute force in f64: random rays at deforming meshes in many poses.

use bevy_app::prelude::*;
use bevy_circumsphere::RayHit;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Mesh, icosphere, torus},
};
use glam::Vec3;

use crate::{
    truth::{TrueRay, cast},
    world::{ALL, app, query, random_pose, random_vector, spawn, wavy, world_triangles, write_positions},
};

/// A ray in f32, as queries take it.
#[derive(Clone, Copy, Debug)]
struct Ray {
    origin: Vec3,
    direction: Vec3,
    range: f32,
}

/// Rays from around a body of about 1.5 into and past it, and some from within.
fn random_rays(random: &mut Random, count: usize, center: Vec3, size: f32) -> Vec<Ray> {
    (0..count)
        .map(|_| {
            let origin = center + random_vector(random) * 3.0 * size;
            let target = center + random_vector(random) * 1.2 * size;
            let length = if random.below(4) == 0 { 1.0 } else { 0.1 + 2.0 * random.unit() as f32 };
            let range = if random.below(3) == 0 { random.unit() as f32 * 2.0 } else { f32::INFINITY };
            Ray { origin, direction: (target - origin) * length, range }
        })
        .filter(|ray| ray.direction != Vec3::ZERO)
        .collect()
}

/// How many rays hit, how many miss, and how many were too close to call.
#[derive(Debug, Default, PartialEq)]
struct Counts {
    hits: usize,
    misses: usize,
    back_faces: usize,
    doubtful: usize,
}

impl Counts {
    fn check(&mut self, ray: &Ray, found: Option<&RayHit>, truth: &TrueRay, entity: Entity, size: f64) {
        let nearest = truth.hits.first();
        let doubtful = truth.doubtful.iter().min_by(|one, other| one.distance.total_cmp(&other.distance));
        if doubtful.is_some_and(|doubtful| nearest.is_none_or(|nearest| doubtful.distance < nearest.distance)) {
            // A doubtful hit must not hide what is behind it farther than that.
            self.doubtful += 1;
            return;
        }
        let Some(found) = found else {
            assert!(nearest.is_none(), "{ray:?} misses, but hits {nearest:?}");
            self.misses += 1;
            return;
        };
        let nearest = nearest.unwrap_or_else(|| panic!("{ray:?} hits {found:?}, but misses"));
        assert_eq!(found.entity, entity);
        let length = ray.direction.as_dvec3().length();
        // Distances are rounded to f32 once.
        let tolerance = f64::from(f32::EPSILON) * nearest.distance + 1.0e-12 * size / length;
        assert!((f64::from(found.distance) - nearest.distance).abs() <= tolerance, "{ray:?}: {found:?}, {nearest:?}");
        let triangle = found.triangle.expect("a surface has triangles").index();
        let is_same = truth
            .hits
            .iter()
            .take_while(|hit| hit.distance - nearest.distance <= 1.0e-12 * size / length)
            .find(|hit| hit.triangle == triangle);
        let hit = is_same.unwrap_or_else(|| panic!("{ray:?}: {found:?} is not {nearest:?}"));
        assert_eq!(found.is_back_face, hit.is_back_face, "{ray:?}: {found:?}");
        for (weight, expected) in found.barycentric.into_iter().zip(hit.barycentric) {
            // The weights of oblique hits are as uncertain as their triangles are narrow.
            assert!((f64::from(weight) - expected).abs() < 1.0e-6, "{ray:?}: {found:?} is not {hit:?}");
        }
        let point = ray.origin.as_dvec3() + ray.direction.as_dvec3() * hit.distance;
        assert!(found.point.as_dvec3().distance(point) < 4.0 * f64::from(f32::EPSILON) * point.length().max(size));
        assert!((found.normal.length() - 1.0).abs() < 1.0e-6);
        assert_eq!(found.normal.dot(ray.direction) > 0.0, found.is_back_face, "{ray:?}: {found:?}");
        self.hits += 1;
        self.back_faces += usize::from(hit.is_back_face);
    }
}

fn moving(app: &mut App, mesh: &Mesh, transform: Transform) -> Entity {
    spawn(app, mesh, transform)
}

fn cast_all(app: &mut App, rays: Vec<Ray>) -> Vec<Option<RayHit>> {
    query(app, move |query| rays.iter().map(|ray| query.cast_ray(ray.origin, ray.direction, ray.range, &ALL)).collect())
}

/// Rays at a mesh that deforms every tick, in a pose of its own.
fn agree(mesh: &Mesh, ticks: usize, rays_per_tick: usize, seed: u64, counts: &mut Counts) {
    let mut random = Random::new(seed);
    for tick in 0..ticks {
        let mut app = app();
        let far = if tick % 3 == 2 { 1.0e4 } else { 1.0 };
        let transform = if tick % 4 == 0 {
            Transform::IDENTITY
        } else {
            let translation = random_vector(&mut random) * far;
            random_pose(&mut random, translation)
        };
        let entity = moving(&mut app, mesh, transform);
        app.update();
        for step in 0..3 {
            write_positions(&mut app, entity, wavy(mesh, (3 * tick + step) as f64 * 0.4));
            app.update();
            let triangles = world_triangles(&app, entity);
            let size = transform.scale.x.abs();
            let rays = random_rays(&mut random, rays_per_tick / 3, transform.translation, size);
            let found = cast_all(&mut app, rays.clone());
            // What f64 rounds at the coordinates of the world, relative to the triangles.
            let doubt = 1.0e-9 * f64::from(transform.translation.length().max(1.0));
            for (ray, found) in rays.iter().zip(&found) {
                let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
                let mut truth = cast(&triangles, origin, direction, f64::from(ray.range), doubt);
                // In the world, mirrored triangles are wound the other way round, and normals still point outward.
                if transform.scale.x < 0.0 {
                    for hit in &mut truth.hits {
                        hit.is_back_face = !hit.is_back_face;
                    }
                }
                counts.check(ray, found.as_ref(), &truth, entity, f64::from(transform.translation.length() + size));
            }
        }
    }
}

#[test]
fn a_hundred_thousand_random_rays_hit_what_brute_force_hits() {
    let mut counts = Counts::default();
    agree(&icosphere(3, 1.0), 12, 5_000, 1, &mut counts);
    agree(&torus(0.8, 0.3, 40, 20), 12, 5_000, 2, &mut counts);
    eprintln!("{counts:?}");
    assert!(counts.hits + counts.misses > 100_000, "{counts:?}");
    assert!(counts.hits > 40_000 && counts.misses > 20_000 && counts.back_faces > 1_000, "{counts:?}");
    assert!(counts.doubtful < 1_000, "{counts:?}");
}

#[test]
#[ignore = "a million rays take minutes"]
fn a_million_random_rays_hit_what_brute_force_hits() {
    let mut counts = Counts::default();
    agree(&icosphere(3, 1.0), 120, 6_000, 3, &mut counts);
    agree(&torus(0.8, 0.3, 40, 20), 60, 6_000, 4, &mut counts);
    eprintln!("{counts:?}");
    assert!(counts.hits + counts.misses > 1_000_000, "{counts:?}");
}

/// A flat fan around the origin in the plane z = 0, and what is around it.
fn fan() -> Mesh {
    icosphere(1, 1.0)
}

#[test]
fn rays_through_vertices_and_edges_never_slip_through() {
    let mut app = app();
    let mesh = fan();
    let entity = spawn(&mut app, &mesh, ());
    app.update();
    let triangles = world_triangles(&app, entity);
    let mut random = Random::new(5);
    let mut targets = Vec::new();
    for corners in &triangles {
        for k in 0..3 {
            targets.push(corners[k].as_vec3());
            for _ in 0..8 {
                let place = random.unit();
                targets.push(corners[k].lerp(corners[(k + 1) % 3], place).as_vec3());
            }
            targets.push(corners[k].midpoint(corners[(k + 1) % 3]).as_vec3());
        }
    }
    // From within a closed surface, every ray leaves it somewhere.
    let rays: Vec<Ray> = targets
        .iter()
        .flat_map(|&target| {
            [Vec3::ZERO, Vec3::new(0.25, 0.125, 0.0625), Vec3::new(0.1, -0.2, 0.3)].map(|origin| Ray {
                origin,
                direction: target - origin,
                range: f32::INFINITY,
            })
        })
        .collect();
    assert!(rays.len() > 5_000, "{}", rays.len());
    for (ray, found) in rays.iter().zip(cast_all(&mut app, rays.clone())) {
        let found = found.unwrap_or_else(|| panic!("{ray:?} slips through"));
        assert!((found.distance - 1.0).abs() < 1.0e-5 && found.is_back_face, "{ray:?}: {found:?}");
    }
}

#[test]
fn rays_along_axes_through_a_grid_never_slip_through() {
    // Vertices at exact coordinates, and rays exactly through them, through edges, and along diagonals.
    let mut app = app();
    let mesh = circumsphere_support::scenes::grid(8, 8, 8.0, 8.0, circumsphere_support::scenes::Diagonals::Alternating);
    spawn(&mut app, &mesh, ());
    app.update();
    let rays: Vec<Ray> = (-15..=15)
        .flat_map(|x| (-15..=15).map(move |z| Vec3::new(x as f32 * 0.25, 2.0, z as f32 * 0.25)))
        .flat_map(|origin| {
            [Vec3::NEG_Y, Vec3::new(0.0, -8.0, 0.0), Vec3::new(1.0e-30, -1.0, 0.0)].map(|direction| Ray {
                origin,
                direction,
                range: f32::INFINITY,
            })
        })
        .collect();
    let found = cast_all(&mut app, rays.clone());
    assert_eq!(found.len(), 31 * 31 * 3);
    for (ray, found) in rays.iter().zip(found) {
        let found = found.unwrap_or_else(|| panic!("{ray:?} slips through"));
        assert_eq!(found.distance, 2.0 / -ray.direction.y, "{ray:?}: {found:?}");
        assert_eq!(found.normal, Vec3::Y, "{ray:?}");
        assert!(found.point.distance(ray.origin - Vec3::Y * 2.0) < 1.0e-29, "{ray:?}: {found:?}");
    }
}

#[test]
fn what_cannot_be_a_ray_hits_nothing() {
    let mut app = app();
    spawn(&mut app, &icosphere(2, 1.0), ());
    app.update();
    let (far, nan, infinite) = (f32::INFINITY, Vec3::new(0.0, f32::NAN, 0.0), Vec3::new(f32::INFINITY, 0.0, 0.0));
    let hits = query(&mut app, move |query| {
        let cast = |origin, direction, range| query.cast_ray(origin, direction, range, &ALL).is_some();
        [
            cast(Vec3::Z * 3.0, Vec3::NEG_Z, far),
            cast(Vec3::Z * 3.0, Vec3::NEG_Z, 2.5),
            cast(Vec3::Z * 3.0, Vec3::ZERO, far),
            cast(Vec3::Z * 3.0, nan, far),
            cast(Vec3::Z * 3.0, infinite, far),
            cast(nan, Vec3::NEG_Z, far),
            cast(infinite, Vec3::NEG_X, far),
            cast(Vec3::Z * 3.0, Vec3::NEG_Z, f32::NAN),
            cast(Vec3::Z * 3.0, Vec3::NEG_Z, -1.0),
            cast(Vec3::Z * 3.0, Vec3::NEG_Z, 1.5),
            cast(Vec3::Z * 3.0, Vec3::Z, far),
        ]
    });
    assert_eq!(hits, [true, true, false, false, false, false, false, false, false, false, false]);
}

#[test]
fn all_hits_come_in_order_and_are_those_of_brute_force() {
    let mut app = app();
    let mesh = torus(0.8, 0.3, 30, 16);
    let entity = spawn(&mut app, &mesh, ());
    app.update();
    let triangles = world_triangles(&app, entity);
    let rays = random_rays(&mut Random::new(7), 4_000, Vec3::ZERO, 1.0);
    let copy = rays.clone();
    let found = query(&mut app, move |query| {
        copy.iter().map(|ray| query.ray_hits(ray.origin, ray.direction, ray.range, &ALL)).collect::<Vec<_>>()
    });
    let mut counts = [0; 16];
    for (ray, found) in rays.iter().zip(&found) {
        let truth = cast(&triangles, ray.origin.as_dvec3(), ray.direction.as_dvec3(), f64::from(ray.range), 1.0e-9);
        if !truth.doubtful.is_empty() {
            continue;
        }
        let numbers: Vec<usize> = found.iter().map(|hit| hit.triangle.expect("a triangle").index()).collect();
        assert_eq!(numbers, truth.hits.iter().map(|hit| hit.triangle).collect::<Vec<_>>(), "{ray:?}");
        assert!(found.is_sorted_by(|one, other| one.distance <= other.distance), "{ray:?}");
        counts[found.len()] += 1;
    }
    assert!(counts[0] > 500 && counts[2] > 500 && counts[4] > 50, "{counts:?}");
}

#[test]
fn rays_from_far_away_are_as_exact_as_near_ones() {
    let mut app = app();
    let entity = spawn(&mut app, &icosphere(3, 1.0), ());
    app.update();
    let triangles = world_triangles(&app, entity);
    let mut random = Random::new(8);
    let mut counts = Counts::default();
    let rays: Vec<Ray> = (0..2_000)
        .map(|_| {
            let direction = random_vector(&mut random);
            let origin = (direction * -1.0e6).round();
            Ray { origin, direction: random_vector(&mut random) * 1.4 - origin, range: f32::INFINITY }
        })
        .collect();
    let found = cast_all(&mut app, rays.clone());
    for (ray, found) in rays.iter().zip(&found) {
        let truth = cast(&triangles, ray.origin.as_dvec3(), ray.direction.as_dvec3(), f64::INFINITY, 1.0e-8);
        counts.check(ray, found.as_ref(), &truth, entity, 1.0e6);
    }
    assert!(counts.hits > 500 && counts.misses > 200 && counts.doubtful < 10, "{counts:?}");
}
