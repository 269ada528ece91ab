//! Contacts of spheres that are written when somebody reads them, however late, are those that are written in the tick.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore, StoredPair,
    detection::{CandidateTrianglePairs, broad_phase::BroadPhaseSystems},
    kernel::contact::{CompactContact, TouchingPair},
    prelude::*,
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{Mesh, crumpled_sheet, icosphere};

use crate::world::{app, points, spawn, store, write_positions};

const TICKS: usize = 5;

/// A sheet that meets itself, and two balls in each other: near one another nearly all of their triangles are in many pairs.
fn meshes(tick: usize) -> [Mesh; 3] {
    let shift = 0.01 * tick as f32;
    [
        crumpled_sheet(2_000, 0.05 * tick as f64),
        icosphere(3, 0.5).translate([50.0 + shift, 0.0, 0.0]),
        icosphere(3, 0.5).translate([50.3, shift, 0.1]),
    ]
}

struct Run {
    app: App,
    surfaces: Vec<Entity>,
}

impl Run {
    fn new(method: ContactMethod, threads: usize) -> Self {
        let mut app = app();
        app.insert_resource(CircumsphereSettings { threads, ..Default::default() });
        let [sheet, first, second] = meshes(0);
        let surfaces = vec![
            spawn(&mut app, &sheet, (method, SelfCollision, SurfaceThickness::World(0.05))),
            spawn(&mut app, &first, (method, SurfaceThickness::World(0.2))),
            spawn(&mut app, &second, (method, SurfaceThickness::World(0.2))),
        ];
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
            let as_found = |store: &ContactStore| -> Vec<_> {
                store.pairs.iter().map(|pair| pair.sphere_contacts().collect::<Vec<_>>()).collect()
            };
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
        assert_eq!(unread.last().expect("there are ticks").pairs.len(), 2, "the sheet, and both balls");
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

/// A reader has its contacts written by all threads in the tick, from the second one on that it reads; the same contacts as
/// ever, and while nobody reads nothing is written.
#[test]
fn contacts_that_are_read_every_tick_are_written_in_the_tick() {
    const READ: [bool; 6] = [false, true, true, false, false, true];
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        for threads in [1, 2] {
            let [mut run, mut unread] = [threads, 1].map(|threads| Run::new(method, threads));
            let (mut was_read, mut read) = (false, Vec::new());
            for (tick, reads) in READ.into_iter().enumerate() {
                let (found, expected) = (run.tick(tick), unread.tick(tick));
                assert_eq!(found.pairs.len(), 2);
                assert!(found.pairs.iter().all(|pair| is_written(pair) == was_read), "{method:?}, tick {tick}");
                let as_found = |store: &ContactStore| -> Vec<_> {
                    store.pairs.iter().map(|pair| pair.sphere_contacts().collect::<Vec<_>>()).collect()
                };
                assert!(as_found(&found) == as_found(&expected), "{method:?}, tick {tick}");
                if reads {
                    // Of a pair's two lists either is enough.
                    let count: usize = found.pairs.iter().map(|pair| pair.touching.iter().count()).sum();
                    assert!(count > 1_000, "{method:?}: {count} pairs touch");
                    read.push((lists(&found), expected));
                }
                was_read = reads;
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
