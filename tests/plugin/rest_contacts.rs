//! Contacts of a surface with itself that are there at rest are left out, and no other.

use std::collections::BTreeSet;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    QuarantineReason, RestContactsError,
    detection::{BruteForceBroadPhasePlugin, DetectionDiagnostics, TreeBroadPhasePlugin},
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};
use circumsphere_support::{
    bars::BAND,
    random::Random,
    scenes::{Mesh, crumpled_sheet},
};
use circumsphere_truth::{ReferencePair, exact_weld, touching_pairs_brute_force};
use glam::{DVec3, Vec3};

use crate::world::{
    EXACT_METHODS, POOL_THREADS, Seen, all, app, insert, points, sheet, spawn, status, store, surface, write_positions,
};

/// Half the contact distance. The cloth's edges are about 2.7 long.
const THICKNESS: f32 = 0.15;

/// Up to where pairs at rest are left out. More than half of those that touch are farther apart.
const REST_DISTANCE: f32 = 0.1;

/// A crumpled cloth that touches itself.
fn cloth() -> Mesh {
    crumpled_sheet(200, 0.0)
}

/// Pairs that are no farther apart than `distance`, by f64 brute force.
fn reference(mesh: &Mesh, positions: &[Vec3], distance: f64) -> Vec<ReferencePair> {
    let positions: Vec<DVec3> = positions.iter().map(|position| position.as_dvec3()).collect();
    let rest: Vec<DVec3> = points(mesh).iter().map(|position| position.as_dvec3()).collect();
    touching_pairs_brute_force(&positions, &mesh.triangles, &exact_weld(&rest), distance)
}

fn names(pairs: &[ReferencePair]) -> BTreeSet<[u32; 2]> {
    pairs.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect()
}

/// The pairs of the reference that are certainly within a distance, and those that may be.
fn bounds(mesh: &Mesh, positions: &[Vec3], distance: f32) -> [Vec<ReferencePair>; 2] {
    [-BAND, BAND].map(|band| reference(mesh, positions, f64::from(distance) * (1.0 + band)))
}

/// The vertices of the cloth in every tick: each drifts in its own direction.
fn drift(mesh: &Mesh, speed: f32, ticks: usize) -> Vec<Vec<Vec3>> {
    let mut random = Random::new(7);
    let directions: Vec<Vec3> =
        mesh.positions.iter().map(|_| Vec3::from_array(std::array::from_fn(|_| random.signed_unit()))).collect();
    let place = |tick: usize| {
        let moved = points(mesh).into_iter().zip(&directions);
        moved.map(|(point, direction)| point + *direction * (speed * tick as f32)).collect()
    };
    (0..ticks).map(place).collect()
}

fn ignored(mesh: &Mesh) -> RestContactsIgnored {
    RestContactsIgnored::new(&surface(mesh).0, &points(mesh), REST_DISTANCE).expect("the rest shape is sound")
}

/// Whether a contact is of features of two triangles.
fn is_of(contact: &Seen, [a, b]: [[u32; 3]; 2]) -> bool {
    let are_of = |vertices: &[VertexId], corners: [u32; 3]| vertices.iter().all(|vertex| corners.contains(&vertex.0));
    let (first, second) = &contact.feature_vertices;
    are_of(first, a) && are_of(second, b) || are_of(first, b) && are_of(second, a)
}

/// Checks a tick against the reference, without the pairs at rest: the touching pairs, and for each pair that does not
/// cross a contact of its closest features, no matter which pair of triangles reports it.
fn check(app: &mut App, mesh: &Mesh, positions: &[Vec3], at_rest: &BTreeSet<[u32; 2]>, what: &str) -> usize {
    let [certain, possible] = bounds(mesh, positions, 2.0 * THICKNESS);
    let touching: BTreeSet<[u32; 2]> = store(app).touching().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
    for pair in &certain {
        let name = [pair.triangle_a, pair.triangle_b];
        assert_eq!(touching.contains(&name), !at_rest.contains(&name), "{what}: {pair:?}");
    }
    assert!(touching.is_subset(&names(&possible)), "{what}: a pair is too far apart");
    let contacts = all(app);
    for pair in certain.iter().filter(|pair| !at_rest.contains(&[pair.triangle_a, pair.triangle_b])) {
        let corners = [pair.triangle_a, pair.triangle_b].map(|triangle| mesh.triangles[triangle as usize]);
        let is_closest = |contact: &&Seen| {
            let off = f64::from(contact.distance.abs()) - pair.distance;
            off.abs() <= BAND * f64::from(2.0 * THICKNESS)
        };
        let closest = contacts.iter().filter(is_closest).find(|contact| is_of(contact, corners));
        assert!(closest.is_some() || pair.distance == 0.0, "{what}: no contact of the closest features of {pair:?}");
    }
    let keys: Vec<_> = contacts.iter().map(|contact| contact.key).collect();
    assert_eq!(keys.iter().collect::<BTreeSet<_>>().len(), keys.len(), "{what}: no feature pair has two contacts");
    certain.len() - touching.len()
}

/// An app with the cloth in it.
fn world(method: ContactMethod, threads: usize, extra: impl Bundle) -> (App, Entity) {
    let mut app = app();
    app.insert_resource(CircumsphereSettings { threads, ..Default::default() });
    let extra = (SurfaceThickness::World(THICKNESS), method, SelfCollision, extra);
    let cloth = spawn(&mut app, &cloth(), extra);
    (app, cloth)
}

#[test]
fn the_pairs_of_the_component_are_those_of_the_reference() {
    let mesh = cloth();
    let [certain, possible] = bounds(&mesh, &points(&mesh), REST_DISTANCE);
    let found: BTreeSet<[u32; 2]> = ignored(&mesh).pairs().map(|pair| pair.map(|triangle| triangle.0)).collect();
    assert!(found.is_superset(&names(&certain)) && found.is_subset(&names(&possible)));
    assert!(found.len() > 50, "{} pairs touch at rest", found.len());
    let none = RestContactsIgnored::new(&surface(&sheet()).0, &points(&sheet()), 0.1).expect("the rest shape is sound");
    assert_eq!(none.pairs().count(), 0, "a flat sheet does not touch itself");
}

#[test]
fn exact_methods_find_the_reference_without_the_pairs_at_rest() {
    let mesh = cloth();
    let at_rest: BTreeSet<[u32; 2]> = ignored(&mesh).pairs().map(|pair| pair.map(|triangle| triangle.0)).collect();
    // Slow enough for lists of near pairs, and so fast that nothing is remembered.
    for (speed, ticks) in [(0.01, 12), (0.4, 6)] {
        for method in EXACT_METHODS {
            let (mut app, cloth) = world(method, 1, ignored(&mesh));
            let (mut left_out, mut reused) = (0, 0);
            for (tick, positions) in drift(&mesh, speed, ticks).iter().enumerate() {
                write_positions(&mut app, cloth, positions);
                app.update();
                left_out += check(&mut app, &mesh, positions, &at_rest, &format!("{method:?}, {speed}, tick {tick}"));
                reused += app.world().resource::<DetectionDiagnostics>().lists_reused;
            }
            assert!(left_out > 10 * ticks, "{left_out} pairs in {ticks} ticks are left out");
            let has_lists = speed < 0.1 && method != ContactMethod::Polygon;
            assert_eq!(reused > 0, has_lists, "{method:?}, {speed}");
            assert!(store(&app).touching_count() > 20, "other pairs touch");
        }
    }
}

#[test]
fn sphere_methods_find_what_they_found_without_the_pairs_at_rest() {
    let mesh = cloth();
    let at_rest: BTreeSet<[u32; 2]> = ignored(&mesh).pairs().map(|pair| pair.map(|triangle| triangle.0)).collect();
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        let (mut all, of_all) = world(method, 1, ());
        let (mut fewer, of_fewer) = world(method, 1, ignored(&mesh));
        for positions in drift(&mesh, 0.1, 5) {
            write_positions(&mut all, of_all, &positions);
            write_positions(&mut fewer, of_fewer, &positions);
            all.update();
            fewer.update();
            let found = |app: &App| -> Vec<[u32; 2]> {
                store(app).touching().map(|pair| [pair.triangle_a, pair.triangle_b]).collect()
            };
            let mut expected = found(&all);
            let before = expected.len();
            expected.retain(|pair| !at_rest.contains(pair));
            assert!(expected.len() < before && !expected.is_empty(), "{method:?}");
            assert_eq!(found(&fewer), expected, "{method:?}");
        }
    }
}

#[test]
fn threads_and_broad_phases_change_nothing() {
    ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(POOL_THREADS).build());
    let mesh = cloth();
    for method in ContactMethod::ALL {
        let run = |(mut app, cloth): (App, Entity)| -> Vec<String> {
            let mut found = Vec::new();
            for positions in drift(&mesh, 0.01, 8) {
                write_positions(&mut app, cloth, &positions);
                app.update();
                let store = store(&app);
                found.extend(store.contacts().map(|contact| format!("{contact:?}")));
                found.extend(store.touching().map(|pair| format!("{pair:?}")));
            }
            found
        };
        let alone = run(world(method, 1, ignored(&mesh)));
        assert!(alone.len() > 100);
        for threads in [0, 2, 7] {
            assert!(run(world(method, threads, ignored(&mesh))) == alone, "{method:?} on {threads} threads");
        }
        let mut app = App::new();
        let plugins = DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>();
        app.add_plugins((plugins, BruteForceBroadPhasePlugin));
        app.insert_resource(CircumsphereSettings { threads: 1, ..Default::default() });
        let extra = (SurfaceThickness::World(THICKNESS), method, SelfCollision, ignored(&mesh));
        let cloth = spawn(&mut app, &mesh, extra);
        assert!(run((app, cloth)) == alone, "{method:?} by brute force");
    }
}

#[test]
fn inserting_and_removing_the_component_takes_effect_where_nothing_moves() {
    let (mut app, cloth) = world(ContactMethod::Exact, 1, ());
    let mut touching = |change: &dyn Fn(&mut App)| {
        change(&mut app);
        app.update();
        app.update();
        store(&app).touching_count()
    };
    let all = touching(&|_| {});
    assert!(all > 50);
    let fewer = touching(&|app| insert(app, cloth, ignored(&self::cloth())));
    assert_eq!(fewer, all - ignored(&self::cloth()).pairs().count());
    assert!(0 < fewer && fewer < all);
    assert_eq!(touching(&|app| _ = app.world_mut().entity_mut(cloth).remove::<RestContactsIgnored>()), all);
}

#[test]
fn sweeps_leave_the_pairs_out() {
    // Two layers of one surface that pass through each other.
    let layers = |gap: f32| -> Vec<Vec3> {
        let corner = |height: f32| points(&sheet()).into_iter().map(move |point| point + Vec3::Y * height);
        corner(0.0).chain(corner(gap)).collect()
    };
    let count = sheet().positions.len() as u32;
    let upper = sheet().triangles.into_iter().map(|triangle| triangle.map(|vertex| vertex + count));
    let triangles: Vec<[u32; 3]> = sheet().triangles.into_iter().chain(upper).collect();
    let mesh = DeformableSurface::from_mesh(&layers(0.05), &triangles).expect("the mesh is sound");
    for sewn in [false, true] {
        let mut app = app();
        let extra = (SurfaceThickness::World(0.05), SelfCollision, SweptCollision);
        let entity = app.world_mut().spawn((mesh.clone(), extra)).id();
        if sewn {
            let ignored = RestContactsIgnored::new(&mesh.0, &layers(0.05), 2.0).expect("the rest shape is sound");
            insert(&mut app, entity, ignored);
        }
        app.update();
        write_positions(&mut app, entity, &layers(-0.5));
        app.update();
        let impacts = app
            .world_mut()
            .run_system_cached(|impacts: SurfaceImpacts| impacts.iter().count())
            .expect("the system runs");
        assert_eq!(impacts == 0, sewn, "{impacts} impacts");
    }
}

#[test]
fn a_component_of_another_mesh_is_refused() {
    let (mut app, entity) = world(ContactMethod::Exact, 1, ignored(&cloth()));
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
    insert(&mut app, entity, surface(&sheet()));
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Quarantined(QuarantineReason::RestContacts));
    app.world_mut().entity_mut(entity).remove::<RestContactsIgnored>();
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
    // The same mesh, made again, is the same mesh.
    insert(&mut app, entity, (surface(&cloth()), ignored(&cloth())));
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
}

#[test]
fn a_rest_shape_that_is_not_sound_is_refused() {
    let (surface, SurfacePositions(positions)) = surface(&sheet());
    let new = |positions: &[Vec3], distance: f32| RestContactsIgnored::new(&surface, positions, distance).err();
    let expected = positions.len();
    assert_eq!(new(&positions[1..], 0.1), Some(RestContactsError::PositionCount { expected, found: expected - 1 }));
    let mut broken = positions.clone();
    broken[3].y = f32::NAN;
    assert_eq!(new(&broken, 0.1), Some(RestContactsError::NonFinitePosition(VertexId(3))));
    for distance in [-0.1, f32::INFINITY] {
        assert_eq!(new(&positions, distance), Some(RestContactsError::Distance(distance)));
    }
    assert!(matches!(new(&positions, f32::NAN), Some(RestContactsError::Distance(_))));
    assert_eq!(new(&positions, 0.0), None);
}
