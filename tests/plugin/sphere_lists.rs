//! Contacts of spheres that are written when somebody reads them, however late, are those that are written in the tick.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore, StoredPair,
    detection::{CandidateTrianglePairs, MeetingCaps, SphereContacts, broad_phase::BroadPhaseSystems},
    kernel::{
        contact::{CompactContact, TouchingPair},
        spheres::contacts::SphereContact,
    },
    prelude::*,
    response::*,
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, crumpled_sheet, icosphere};
use glam::{Quat, Vec3};

use crate::world::{app, insert, points, sheet, spawn, store, surface, write_positions};

const TICKS: usize = 5;

/// A sheet that meets itself, and a ball between two smaller ones, which are in each other where they [stand](standing): near one
/// another nearly all of their triangles are in many pairs. The smaller of two is brought into the frame of the larger one: once
/// it is the first, and once the second.
fn meshes(tick: usize) -> [Mesh; 4] {
    let shift = 0.01 * tick as f32;
    [
        crumpled_sheet(2_000, 0.05 * tick as f64),
        icosphere(2, 0.5).translate([50.0 + shift, 0.0, 0.0]),
        icosphere(3, 0.5).translate([0.0, shift, 0.0]),
        icosphere(2, 0.5).translate([0.0, 0.0, shift]),
    ]
}

/// Turned, larger than they are, and one of them mirrored.
fn standing() -> [Transform; 4] {
    let turned = |x: f32, scale: f32| {
        Transform::from_xyz(x, 0.0, 0.1).with_rotation(Quat::from_rotation_y(x)).with_scale(Vec3::splat(scale))
    };
    [Transform::IDENTITY, Transform::IDENTITY, turned(50.3, 1.1), turned(50.6, -1.2)]
}

struct Run {
    app: App,
    surfaces: Vec<Entity>,
}

impl Run {
    fn new(method: ContactMethod, threads: usize) -> Self {
        let mut app = app();
        app.insert_resource(CircumsphereSettings { threads, ..Default::default() });
        let mut surfaces = Vec::new();
        for (mesh, stands) in meshes(0).iter().zip(standing()) {
            let thickness = SurfaceThickness::World(if surfaces.is_empty() { 0.05 } else { 0.2 });
            surfaces.push(spawn(&mut app, mesh, (method, thickness, stands)));
        }
        insert(&mut app, surfaces[0], SelfCollision);
        Self { app, surfaces }
    }

    /// The store as a tick leaves it, which nobody has read.
    fn tick(&mut self, tick: usize) -> ContactStore {
        for (&surface, mesh) in self.surfaces.iter().zip(meshes(tick)) {
            write_positions(&mut self.app, surface, &points(&mesh));
        }
        self.app.update();
        store(&self.app).clone()
    }
}

/// What a stage is given that others may have written to, it writes out in the tick.
fn touch(mut candidates: ResMut<CandidateTrianglePairs>) {
    candidates.set_changed();
}

fn is_written(pair: &StoredPair) -> bool {
    !format!("{:?}", pair.contacts).contains("unwritten")
}

type Lists = Vec<(Vec<CompactContact>, Vec<TouchingPair>)>;

fn lists(store: &ContactStore) -> Lists {
    store.pairs.iter().map(|pair| (pair.contacts.to_vec(), pair.touching.to_vec())).collect()
}

/// What is in contact, in the order in which it was found.
fn as_found(store: &ContactStore) -> Vec<Vec<SphereContact>> {
    store.pairs.iter().map(|pair| pair.sphere_contacts().collect()).collect()
}

#[test]
fn contacts_of_spheres_that_are_read_late_are_those_of_their_tick() {
    #[cfg(feature = "parallel")]
    bevy_tasks::ComputeTaskPool::get_or_init(|| {
        bevy_tasks::TaskPoolBuilder::new().num_threads(crate::world::POOL_THREADS).build()
    });
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        let [mut late, mut shared] = [1, 2].map(|threads| Run::new(method, threads));
        let mut at_once = Run::new(method, 1);
        let place = (SurfaceDetectionSystems::BroadPhase, SurfaceDetectionSystems::Curvature);
        at_once.app.add_systems(SurfaceDetection, touch.after(place.0).before(place.1));
        let (mut unread, mut expected) = (Vec::new(), Vec::new());
        for tick in 0..TICKS {
            let (found, of_two_threads, written) = (late.tick(tick), shared.tick(tick), at_once.tick(tick));
            assert!(!found.pairs.iter().any(is_written) && written.pairs.iter().all(is_written), "{method:?}");
            assert!(as_found(&found) == as_found(&of_two_threads), "{method:?}: threads change the order");
            expected.push((lists(&written), written.pairs.iter().map(|pair| pair.nearest).collect::<Vec<_>>()));
            unread.push(found);
        }
        let mut count = 0;
        for (store, (expected, nearest)) in unread.iter().zip(&expected).rev() {
            assert!(store.pairs.iter().map(|pair| pair.nearest).eq(nearest.iter().copied()), "{method:?}");
            let counts: Vec<_> = store.pairs.iter().map(|pair| (pair.contacts.len(), pair.touching.len())).collect();
            assert!(!store.pairs.iter().any(is_written), "{method:?}: to count is not to read");
            let read = lists(store);
            assert!(read == *expected, "{method:?}");
            assert_eq!(
                counts,
                read.iter().map(|(contacts, touching)| (contacts.len(), touching.len())).collect::<Vec<_>>()
            );
            for (pair, (contacts, _)) in store.pairs.iter().zip(&read) {
                let mut found: Vec<_> = pair.sphere_contacts().collect();
                // A surface with itself has its contacts by the lower triangle.
                found.sort_by_key(|contact| {
                    let [a, b] = [contact.triangle_a, contact.triangle_b];
                    if pair.a == pair.b { (a.min(b), a.max(b)) } else { (a, b) }
                });
                assert_eq!(found.len(), contacts.len());
                for (found, contact) in found.iter().zip(contacts) {
                    assert_eq!((found.triangle_a, found.triangle_b), contact.triangles());
                    // Differences of lengths below 1.
                    assert!((found.distance - contact.distance).abs() <= 8.0 * f32::EPSILON, "{found:?}: {contact:?}");
                }
                count += contacts.len();
            }
        }
        println!("{method:?}: {count} contacts");
        assert_eq!(unread.last().expect("there are ticks").pairs.len(), 4, "the sheet, and three balls");
        assert!(count > 20_000, "{method:?}: {count} contacts");
    }
}

/// Pairs that others put on the list: neighbors, and those that are on it already.
fn add(mut candidates: ResMut<CandidateTrianglePairs>, mut last: Local<Vec<Vec<[u32; 2]>>>) {
    for (place, pair) in candidates.pairs.iter_mut().enumerate() {
        if pair.is_self() {
            pair.triangles.extend([[0, 1], [1, 2]]);
        }
        pair.triangles.extend(last.get(place).into_iter().flatten().step_by(7));
    }
    *last = candidates.pairs.iter().map(|pair| pair.triangles.clone()).collect();
}

#[test]
fn pairs_that_were_on_the_list_before_add_nothing() {
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        let [mut run, mut without] = [1, 1].map(|threads| Run::new(method, threads));
        let within = add.in_set(SurfaceDetectionSystems::BroadPhase);
        let place = (BroadPhaseSystems::PairSurfaces, BroadPhaseSystems::PairTriangles);
        run.app.add_systems(SurfaceDetection, within.after(place.0).before(place.1));
        for tick in 0..TICKS {
            let (found, expected) = (run.tick(tick), without.tick(tick));
            let counts: Vec<_> = found.pairs.iter().map(|pair| pair.contacts.len()).collect();
            assert!(counts.iter().all(|&count| count > 0));
            assert_eq!(counts, found.pairs.iter().map(|pair| pair.contacts.iter().count()).collect::<Vec<_>>());
            for (pair, expected) in found.pairs.iter().zip(&expected.pairs) {
                assert!(pair.contacts[..] == expected.contacts[..], "{method:?}, tick {tick}");
            }
        }
    }
}

/// Whoever writes to such a list gets it whole.
#[test]
fn what_is_dropped_from_a_list_that_was_not_written_is_dropped_from_the_whole_list() {
    let mut run = Run::new(ContactMethod::BoundingSphere, 1);
    let mut found = run.tick(0);
    let whole = lists(&found);
    for pair in &mut found.pairs {
        let count = pair.contacts.len();
        pair.contacts.truncate(count / 2);
    }
    for (pair, (contacts, touching)) in found.pairs.iter().zip(&whole) {
        assert_eq!(pair.contacts[..], contacts[..contacts.len() / 2]);
        assert_eq!(pair.touching[..], touching[..]);
    }
    assert!(lists(store(&run.app)) == whole, "a clone's list is its own");
}

/// A reader has its contacts written by all threads in the tick, from the one after the first that it reads until four after
/// the last; the same contacts as ever.
#[test]
fn contacts_that_are_read_every_tick_are_written_in_the_tick() {
    const READ: [bool; 10] = [false, true, true, false, true, false, false, false, false, false];
    // For four ticks after one that was read.
    const WRITTEN: [bool; 10] = [false, false, true, true, true, true, true, true, true, false];
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        for threads in [1, 2] {
            let [mut run, mut unread] = [threads, 1].map(|threads| Run::new(method, threads));
            let mut read = Vec::new();
            for (tick, reads) in READ.into_iter().enumerate() {
                let (found, expected) = (run.tick(tick), unread.tick(tick));
                assert_eq!(found.pairs.len(), 4);
                assert!(found.pairs.iter().all(|pair| is_written(pair) == WRITTEN[tick]), "{method:?}, tick {tick}");
                assert!(as_found(&found) == as_found(&expected), "{method:?}, tick {tick}");
                if reads {
                    // Of a pair's two lists either is enough.
                    let count: usize = found.pairs.iter().map(|pair| pair.touching.iter().count()).sum();
                    assert!(count > 1_000, "{method:?}: {count} pairs touch");
                    read.push((lists(&found), expected));
                }
            }
            assert!(read.iter().all(|(found, expected)| *found == lists(expected)), "{method:?}");
            // Nothing moves, and nobody loses what has been read.
            let last = lists(store(&run.app));
            run.tick(READ.len() - 1);
            run.tick(READ.len() - 1);
            assert!(lists(store(&run.app)) == last, "{method:?}");
        }
    }
}

/// Three balls, of which the first comes to the second in the third tick, so that their pair takes the first place; the contacts
/// of the other two are read all the time.
#[test]
fn what_is_expected_is_expected_of_two_surfaces_wherever_their_pair_stands() {
    let mut app = app();
    let parts = (ContactMethod::BoundingSphere, SurfaceThickness::World(0.2));
    let ball = |x: f32, y: f32| icosphere(3, 0.5).translate([x, y, 0.0]);
    let [first, second, third] = [50.0, 0.0, 0.3].map(|x| spawn(&mut app, &ball(x, 0.0), parts));
    for tick in 0..6 {
        let x = if tick < 3 { 50.0 } else { -0.3 };
        write_positions(&mut app, first, &points(&ball(x, 0.01 * tick as f32)));
        write_positions(&mut app, second, &points(&ball(0.0, 0.01 * tick as f32)));
        app.update();
        let pairs = &store(&app).pairs;
        assert_eq!(pairs.len(), if tick < 3 { 1 } else { 3 });
        for pair in pairs {
            let is_read = [pair.a.entity(), pair.b.entity()] == [second, third];
            assert_eq!(is_written(pair), is_read && tick > 0, "tick {tick}: {:?} and {:?}", pair.a, pair.b);
            assert!(!is_read || pair.contacts.iter().count() > 1_000);
        }
    }
}

/// Rows are of places of surfaces. The cone stage, which alone is disturbed here, must not take those of other surfaces.
#[test]
fn pairs_that_the_cone_stage_forgets_are_found_again_among_fewer_surfaces() {
    let mut app = app();
    let parts = (ContactMethod::Circumsphere, SurfaceThickness::World(0.2));
    let far = spawn(&mut app, &icosphere(1, 0.5).translate([90.0, 0.0, 0.0]), parts);
    for place in [[0.0; 3], [0.3, 0.01, 0.1]] {
        spawn(&mut app, &icosphere(3, 0.5).translate(place), parts);
    }
    app.update();
    let expected = lists(store(&app));
    assert!(expected.len() == 1 && expected[0].0.len() > 100, "{}", expected.len());
    app.update();
    app.world_mut().despawn(far);
    app.world_mut().resource_mut::<MeetingCaps>().set_changed();
    app.update();
    assert!(lists(store(&app)) == expected);
}

/// What spheres have found, and the memory for it, goes with the method.
#[test]
fn exact_pairs_hold_nothing_of_spheres() {
    let mut run = Run::new(ContactMethod::BoundingSphere, 1);
    for tick in 0..TICKS {
        let found = run.tick(tick);
        assert!(lists(&found).iter().any(|(contacts, _)| contacts.len() > 1_000));
    }
    let held = |run: &Run| format!("{:?}", run.app.world().resource::<SphereContacts>()).contains("SphereLists");
    assert!(held(&run));
    for &surface in &run.surfaces {
        insert(&mut run.app, surface, ContactMethod::Refined);
    }
    run.tick(0);
    assert!(!held(&run));
}

/// One body that must not be passed through does not have the contacts of all others written.
#[test]
fn a_swept_body_reads_no_contacts_of_others() {
    let mut run = Run::new(ContactMethod::BoundingSphere, 1);
    run.app.add_plugins(XpbdResponsePlugin::new(Update)).init_resource::<Time>();
    let (surface, positions) = surface(&sheet().translate([0.0, 90.0, 0.0]));
    let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH).expect("it has an area");
    run.app.world_mut().spawn((surface, positions, body, SweptCollision));
    for tick in 0..TICKS {
        run.app.world_mut().resource_mut::<Time>().advance_by(Duration::from_millis(16));
        let found = run.tick(tick);
        assert_eq!(found.pairs.len(), 4);
        assert!(!found.pairs.iter().any(is_written), "tick {tick}");
    }
}
