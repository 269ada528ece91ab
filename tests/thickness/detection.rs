//! Detection between surfaces.

use std::collections::{BTreeMap, BTreeSet};

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::system::RunSystemOnce;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, grid, icosphere, triangle_soup},
};
use circumsphere_truth::triangles_cross;
use glam::{DVec3, Quat, Vec3};

use super::{
    truth::{Bounds, Thick, least},
    world::{Body, EXACT_METHODS, app, apps, store, vector},
};

/// f32 positions, thicknesses, and distances of sizes up to 2 round by this much.
const ROUNDING: f64 = 2.0e-6;

type Pairs = BTreeSet<(u32, u32)>;

fn crosses(a: &Thick, b: &Thick) -> bool {
    triangles_cross(&a.corners, &b.corners)
}

/// The pairs of triangles that touch, and those that are too close to tell.
fn touching_by_brute_force(a: &[Thick], b: &[Thick], is_pair: impl Fn(usize, usize) -> bool) -> [Pairs; 2] {
    let (mut touching, mut doubtful) = (Pairs::new(), Pairs::new());
    for (first, own) in a.iter().enumerate() {
        for (second, other) in b.iter().enumerate().filter(|&(second, _)| is_pair(first, second)) {
            let pair = (first as u32, second as u32);
            // Both signs must be clear of rounding.
            let thicker = |by: f64| Thick { thickness: own.thickness.map(|thickness| thickness + by), ..*own };
            let surely = |by: f64| least(thicker(by), *other, 0.0, true);
            if crosses(own, other) || surely(-ROUNDING).most <= 0.0 {
                touching.insert(pair);
            } else if surely(ROUNDING).least <= 0.0 {
                doubtful.insert(pair);
            }
        }
    }
    [touching, doubtful]
}

fn assert_same(found: &Pairs, [touching, doubtful]: &[Pairs; 2], what: &str) {
    let missed: Vec<_> = touching.difference(found).collect();
    assert!(missed.is_empty(), "{what}: {missed:?} are missed");
    let wrong: Vec<_> = found.difference(touching).filter(|pair| !doubtful.contains(pair)).collect();
    assert!(wrong.is_empty(), "{what}: {wrong:?} do not touch");
    assert!(doubtful.len() * 50 <= touching.len(), "{what}: {} doubtful", doubtful.len());
}

fn found_by(app: &App) -> Pairs {
    store(app).touching().map(|pair| (pair.triangle_a, pair.triangle_b)).collect()
}

/// Two soups of triangles that are as long as thick, in poses of their own.
fn soups(seed: u64) -> [Body; 2] {
    let mut random = Random::new(seed);
    [0, 1].map(|number| {
        let transform = Transform::from_translation(vector(&mut random, 0.1))
            .with_rotation(Quat::from_scaled_axis(vector(&mut random, 2.0)))
            .with_scale(Vec3::splat([1.0, 0.7][number]));
        Body::random(triangle_soup(150, seed + number as u64), 0.12, transform, &mut random)
    })
}

#[test]
fn triangles_touch_where_the_hulls_of_their_balls_meet_with_every_broad_phase() {
    let mut thin = 0;
    for seed in [1, 2, 3] {
        let bodies = soups(seed);
        let [a, b] = [bodies[0].thick(), bodies[1].thick()];
        let expected = touching_by_brute_force(&a, &b, |_, _| true);
        assert!(expected[0].len() > 100, "{}", expected[0].len());
        let largest = |body: &Body| body.thickness.iter().copied().fold(0.0, f32::max);
        for (name, mut app) in apps() {
            for method in EXACT_METHODS {
                let entities = bodies.each_ref().map(|body| body.spawn(&mut app, method));
                app.update();
                assert_same(&found_by(&app), &expected, &format!("{name}, {method:?}"));
                for (body, entity) in bodies.iter().zip(entities) {
                    let scale = body.transform.scale.x;
                    let mut entity = app.world_mut().entity_mut(entity);
                    entity.remove::<VertexThickness>().insert(SurfaceThickness::World(largest(body) * scale));
                }
                app.update();
                thin += found_by(&app).len() - expected[0].len();
                for entity in entities {
                    app.world_mut().despawn(entity);
                }
            }
        }
    }
    assert!(thin > 1000, "everything touches with the largest thickness: {thin}");
}

#[test]
fn a_surface_touches_itself_where_the_hulls_of_its_balls_meet() {
    for seed in [4, 5] {
        let mut random = Random::new(seed);
        let sheet = grid(10, 10, 1.0, 1.0, Diagonals::Uniform);
        let mut body = Body::random(sheet, 0.05, Transform::IDENTITY, &mut random);
        // Folded over, and crumpled.
        for position in &mut body.mesh.positions {
            let [x, y, z] = *position;
            let bend = if x > 0.0 { [-x, 0.06, z] } else { [x, y, z] };
            *position = (Vec3::from_array(bend) + vector(&mut random, 0.02)).to_array();
        }
        let thick = body.thick();
        let triangles = &body.mesh.triangles;
        let are_neighbors = |a: usize, b: usize| triangles[a].iter().any(|vertex| triangles[b].contains(vertex));
        let expected = touching_by_brute_force(&thick, &thick, |a, b| a < b && !are_neighbors(a, b));
        assert!(expected[0].len() > 100, "{}", expected[0].len());
        for (name, mut app) in apps() {
            body.spawn(&mut app, SelfCollision);
            app.update();
            assert_same(&found_by(&app), &expected, name);
        }
    }
}

/// What a contact says about its points.
struct Seen {
    triangles: (u32, u32),
    separation: f64,
    contact_distance: f64,
    barycentrics: [[f64; 3]; 2],
    points: [DVec3; 2],
    crosses: bool,
}

fn seen(app: &mut App) -> Vec<Seen> {
    let read = |contacts: SurfaceContacts| {
        let of = |contact: Contact<'_>| {
            let (first, second) = contact.triangles();
            let (a, b) = contact.barycentrics();
            let points = contact.points();
            Seen {
                triangles: (first.expect("a surface").0, second.expect("a surface").0),
                separation: f64::from(contact.separation()),
                contact_distance: f64::from(contact.contact_distance()),
                barycentrics: [a.map(f64::from), b.map(f64::from)],
                points: [points.0.as_dvec3(), points.1.as_dvec3()],
                crosses: contact.is_crossing(),
            }
        };
        contacts.iter().map(of).collect::<Vec<_>>()
    };
    app.world_mut().run_system_once(read).expect("the system runs")
}

#[test]
fn contacts_are_where_the_balls_overlap_most() {
    let mut count = 0;
    for method in EXACT_METHODS {
        let bodies = soups(7);
        let thick = bodies.each_ref().map(Body::thick);
        let mut app = app();
        app.insert_resource(CircumsphereSettings { margin: 0.02, ..CircumsphereSettings::default() });
        for body in &bodies {
            body.spawn(&mut app, method);
        }
        app.update();
        let mut deepest: BTreeMap<(u32, u32), f64> = BTreeMap::new();
        let contacts = seen(&mut app);
        for contact in contacts.iter().filter(|contact| !contact.crosses) {
            let sides = [&thick[0][contact.triangles.0 as usize], &thick[1][contact.triangles.1 as usize]];
            let mut thickness = 0.0;
            for ((side, weights), point) in sides.into_iter().zip(contact.barycentrics).zip(contact.points) {
                let at: DVec3 = side.corners.iter().zip(weights).map(|(corner, weight)| *corner * weight).sum();
                assert!(at.distance(point) < 5.0 * ROUNDING, "{at} {point}");
                thickness += side.thickness.iter().zip(weights).map(|(own, weight)| own * weight).sum::<f64>();
            }
            assert!((contact.contact_distance - thickness).abs() < ROUNDING);
            let distance = contact.points[0].distance(contact.points[1]);
            assert!((contact.separation - (distance - thickness)).abs() < 10.0 * ROUNDING);
            let own = deepest.entry(contact.triangles).or_insert(f64::INFINITY);
            *own = own.min(contact.separation);
        }
        // The triangles of a soup have no common vertices, so each pair reports its own features.
        for (first, a) in thick[0].iter().enumerate() {
            for (second, b) in thick[1].iter().enumerate().filter(|(_, b)| !crosses(a, b)) {
                let found = deepest.get(&(first as u32, second as u32)).copied();
                let near = least(*a, *b, 0.2, false);
                if found.is_none() && near.least > 0.02 {
                    continue;
                }
                let Bounds { least, most } = least(*a, *b, 1.0e-5, false);
                if found.is_none() {
                    assert!(most > 0.02 - ROUNDING, "{first} {second}: {least}–{most} is missed");
                    continue;
                }
                let found = found.unwrap_or(f64::INFINITY);
                assert!(found >= least - 10.0 * ROUNDING && found <= most + 10.0 * ROUNDING, "{found} {least} {most}");
                count += 1;
            }
        }
    }
    assert!(count > 300, "{count}");
}

#[test]
fn the_same_thickness_at_every_vertex_is_that_of_the_surface() {
    for method in ContactMethod::ALL {
        let [mut one, mut other] = [app(), app()];
        for (number, mut body) in soups(11).into_iter().enumerate() {
            let scale = [1.0, 0.7][number];
            body.transform.scale = Vec3::splat(scale);
            body.thickness = vec![0.05; body.thickness.len()];
            body.spawn(&mut one, method);
            let entity = body.spawn(&mut other, method);
            let mut entity = other.world_mut().entity_mut(entity);
            entity.remove::<VertexThickness>().insert(SurfaceThickness::World(0.05 * scale));
        }
        one.update();
        other.update();
        let contacts = |app: &App| store(app).contacts().copied().collect::<Vec<_>>();
        assert!(!contacts(&one).is_empty(), "{method:?}");
        assert_eq!(contacts(&one), contacts(&other), "{method:?}");
    }
}

#[test]
fn sphere_methods_count_a_triangle_as_thick_as_its_thickest_corner() {
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        // Two balls over one sheet, which is thick under one of them.
        let mut app = app();
        let mesh = grid(16, 16, 4.0, 4.0, Diagonals::Uniform);
        let thickness = mesh.positions.iter().map(|[x, ..]| if *x > 0.0 { 0.3 } else { 0.05 }).collect();
        let sheet = Body { mesh, thickness, transform: Transform::IDENTITY };
        sheet.spawn(&mut app, method);
        let mut touched = Vec::new();
        for x in [-1.0, 1.0] {
            let mesh = icosphere(3, 0.5);
            let thickness = vec![0.0; mesh.positions.len()];
            let ball = Body { mesh, thickness, transform: Transform::from_xyz(x, 0.7, 0.0) };
            let entity = ball.spawn(&mut app, method);
            app.update();
            touched.push(store(&app).touching_count() > 0);
            if x > 0.0 {
                let near: Vec<Seen> = seen(&mut app);
                assert!(near.iter().any(|contact| contact.separation < 0.0), "{method:?}");
            }
            app.world_mut().despawn(entity);
        }
        assert_eq!(touched, [false, true], "{method:?}");
    }
}

#[test]
fn smooth_surfaces_are_as_thick_as_their_vertices() {
    for method in EXACT_METHODS {
        // The lowest point of a ball of radius 0.5 is 0.2 over the sheet.
        for (thick, expected) in [(0.3, true), (0.1, false)] {
            let mut app = app();
            let mesh = grid(16, 16, 4.0, 4.0, Diagonals::Uniform);
            let thickness = mesh.positions.iter().map(|[x, ..]| if *x > 0.0 { thick } else { 0.4 }).collect();
            let sheet = Body { mesh, thickness, transform: Transform::IDENTITY };
            let sheet = sheet.spawn(&mut app, (method, SurfaceShape::Smooth));
            let mesh = icosphere(3, 0.5);
            let thickness = vec![0.0; mesh.positions.len()];
            let ball = Body { mesh, thickness, transform: Transform::from_xyz(1.5, 0.7, 0.0) };
            let ball = ball.spawn(&mut app, (method, SurfaceShape::Smooth));
            app.update();
            let least = move |contacts: SurfaceContacts| {
                let of_pair = contacts.between(sheet, ball).map(|contact| contact.separation());
                (contacts.is_touching(sheet, ball), of_pair.fold(f32::INFINITY, f32::min))
            };
            let (touches, least) = app.world_mut().run_system_once(least).expect("the system runs");
            assert_eq!(touches, expected, "{method:?}");
            if expected {
                // Patches of this ball are within 0.001 of it.
                assert!((least - (0.2 - thick)).abs() < 1.0e-3, "{method:?}: {least}");
            } else {
                assert!(least > 0.0, "{method:?}: {least}");
            }
        }
    }
}
