//! Random rays at deforming meshes against parry's triangle mesh in f64.

use bevy_circumsphere::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Character, CharacterFineness, Mesh, crumpled_sheet, icosphere, ragged_slivers},
};
use glam::{DVec3, Vec3};
use parry3d_f64::{
    query::{Ray, RayCast, RayCullingMode},
    shape::TriMesh,
};

use crate::world::{
    ALL, app, points, query, random_pose, random_vector, spawn, wavy, world_triangles, write_positions,
};

/// Rays of the test that always runs.
const FEW: usize = 24_000;

/// Rays at the meshes of one tick.
const PER_TICK: usize = 500;

/// How near to the edge of a triangle a ray must pass, in parts of the triangle's size, for two exact engines to disagree:
/// the rounding of vertices, rays, and poses in f64 by one, and in f32 by none.
const GRAZING: f64 = 1.0e-9;

/// What became of the rays at a mesh.
#[derive(Debug, Default)]
struct Tally {
    hits: usize,
    misses: usize,
    /// Rays through the edge of a triangle, on which both may decide otherwise.
    grazing: usize,
    /// Rays that nothing explains.
    wrong: Vec<String>,
}

/// A mesh of many, at a time.
type Form = (&'static str, Mesh, fn(&Mesh, f64) -> Vec<Vec3>);

fn forms() -> Vec<Form> {
    let sheet = crumpled_sheet(2_000, 0.0);
    let character = Character::new(CharacterFineness::Coarse, 5.0).rest().clone();
    vec![
        ("ball", icosphere(3, 1.0), wavy),
        ("sheet", sheet, |mesh, time| {
            let moved = crumpled_sheet(2_000, time);
            assert_eq!(moved.triangles, mesh.triangles);
            points(&moved)
        }),
        ("character", character, |_, time| {
            let character = Character::new(CharacterFineness::Coarse, 5.0);
            character.positions(time).into_iter().map(Vec3::from_array).collect()
        }),
        ("slivers", ragged_slivers(7), wavy),
    ]
}

/// Whether the line of a ray passes an edge of a triangle that closely.
fn grazes([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> bool {
    let size = (b - a).length().max((c - a).length()).max((c - b).length());
    let across = |point: DVec3| (point - origin).reject_from(direction);
    [(a, b), (b, c), (c, a)].into_iter().any(|(start, end)| {
        let (from, along) = (across(start), across(end) - across(start));
        let share = (-from.dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (from + along * share).length() <= GRAZING * (size + (start - origin).length())
    })
}

/// Random rays at a mesh in one form after the other, in random poses, from both sides or only at the front.
fn compare((name, mesh, form): &Form, rays: usize, seed: u64) -> Tally {
    let mut random = Random::new(seed);
    let mut app = app();
    let entity = spawn(&mut app, mesh, ());
    let mut tally = Tally::default();
    for tick in 0..rays.div_ceil(PER_TICK) {
        write_positions(&mut app, entity, form(mesh, tick as f64 * 0.1));
        let place = random_vector(&mut random) * 2.0;
        *app.world_mut().get_mut::<Transform>(entity).expect("it has one") = random_pose(&mut random, place);
        app.update();
        let is_mirrored = app.world().get::<Transform>(entity).expect("it has one").scale.x < 0.0;
        let triangles = world_triangles(&app, entity);
        let corners = triangles.as_flattened().to_vec();
        let numbers = (0..triangles.len() as u32).map(|triangle| [0, 1, 2].map(|corner| 3 * triangle + corner));
        let reference = TriMesh::new(corners.clone(), numbers.collect()).expect("the mesh is valid");
        let [low, high] = [DVec3::min as fn(DVec3, DVec3) -> DVec3, DVec3::max]
            .map(|of| corners.iter().copied().reduce(of).expect("there are vertices"));
        let (center, half) = (((low + high) * 0.5).as_vec3(), ((high - low) * 0.5).as_vec3());
        let reach = half.max_element();
        let rays: Vec<(Vec3, Vec3)> = (0..PER_TICK)
            .map(|_| {
                let origin = center + random_vector(&mut random) * 3.0 * reach;
                (origin, center + random_vector(&mut random) * half - origin)
            })
            .collect();
        let culls_back_faces = tick % 2 == 1;
        // In the world, mirrored triangles are wound the other way round.
        let culling = if is_mirrored { RayCullingMode::IgnoreFrontfaces } else { RayCullingMode::IgnoreBackfaces };
        let copy = rays.clone();
        let found: Vec<Option<f32>> = query(&mut app, move |query| {
            let filter = SurfaceQueryFilter { culls_back_faces, ..ALL };
            let cast = |&(origin, direction)| query.cast_ray(origin, direction, f32::INFINITY, &filter);
            copy.iter().map(|ray| cast(ray).map(|hit| hit.distance)).collect()
        });
        for ((origin, direction), found) in rays.into_iter().zip(found) {
            let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
            let ray = Ray::new(origin, direction);
            let expected = if culls_back_faces {
                reference.cast_local_ray_with_culling(&ray, f64::MAX, culling).map(|hit| hit.time_of_impact)
            } else {
                reference.cast_local_ray(&ray, f64::MAX, false)
            };
            match (found, expected) {
                (None, None) => tally.misses += 1,
                // Distances are rounded to f32.
                (Some(found), Some(expected)) if (f64::from(found) - expected).abs() < 1.0e-6 * (1.0 + expected) => {
                    tally.hits += 1;
                }
                _ if triangles.iter().any(|corners| grazes(*corners, origin, direction)) => tally.grazing += 1,
                _ => tally.wrong.push(format!("{name}, {origin} + {direction}: {found:?} is not {expected:?}")),
            }
        }
    }
    tally
}

fn compare_all(rays: usize) {
    let forms = forms();
    for (seed, form) in (51..).zip(&forms) {
        let rays = rays / forms.len();
        let Tally { hits, misses, grazing, wrong } = compare(form, rays, seed);
        eprintln!("{}: {hits} hits, {misses} misses, {grazing} grazing, {} wrong", form.0, wrong.len());
        assert!(wrong.is_empty(), "{:#?}", &wrong[..wrong.len().min(10)]);
        assert!(hits > rays / 8 && misses > rays / 8, "{}: {hits} hits, {misses} misses", form.0);
        assert!(grazing <= rays / 10_000, "{}: {grazing} of {rays}", form.0);
    }
}

#[test]
fn random_rays_at_deforming_meshes_agree_with_parry() {
    compare_all(FEW);
}

#[test]
#[ignore = "takes minutes without --release: cargo test --release --test spatial_query million -- --ignored --nocapture"]
fn a_million_rays_at_deforming_meshes_agree_with_parry() {
    compare_all(1_000_000);
}
