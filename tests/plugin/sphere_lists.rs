//! Contacts of spheres, with distances alone or with points and normals too. Both report the same pairs.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, SphereContactDetail, StoredPair,
    detection::SphereContacts,
    geometry::{CompactContact, SphereContact, TouchingPair},
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, crumpled_sheet, icosphere};
use glam::{Quat, Vec3};

use crate::world::{app, insert, points, spawn, store, write_positions};

const TICKS: usize = 5;

/// A sheet that touches itself, and a ball between two smaller ones. Where they [stand](standing), the balls overlap,
/// and nearly all of their triangles are in many pairs. The smaller of two is moved into the frame of the larger one:
/// it is once the first and once the second surface.
fn meshes(tick: usize) -> [Mesh; 4] {
    let shift = 0.01 * tick as f32;
    [
        crumpled_sheet(2_000, 0.05 * tick as f64),
        icosphere(2, 0.5).translate([50.0 + shift, 0.0, 0.0]),
        icosphere(3, 0.5).translate([0.0, shift, 0.0]),
        icosphere(2, 0.5).translate([0.0, 0.0, shift]),
    ]
}

/// Rotated, enlarged, and one of them mirrored.
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
    fn new(method: ContactMethod, threads: usize, sphere_contacts: SphereContactDetail) -> Self {
        let mut app = app();
        app.insert_resource(CircumsphereSettings { threads, sphere_contacts, ..Default::default() });
        let mut surfaces = Vec::new();
        for (mesh, stands) in meshes(0).iter().zip(standing()) {
            let thickness = SurfaceThickness::World(if surfaces.is_empty() { 0.05 } else { 0.2 });
            surfaces.push(spawn(&mut app, mesh, (method, thickness, stands)));
        }
        insert(&mut app, surfaces[0], SelfCollision);
        Self { app, surfaces }
    }

    fn tick(&mut self, tick: usize) -> Vec<StoredPair> {
        for (&surface, mesh) in self.surfaces.iter().zip(meshes(tick)) {
            write_positions(&mut self.app, surface, &points(&mesh));
        }
        self.app.update();
        store(&self.app).pairs().to_vec()
    }
}

type Lists = Vec<(Vec<CompactContact>, Vec<TouchingPair>)>;

fn lists(pairs: &[StoredPair]) -> Lists {
    pairs.iter().map(|pair| (pair.contacts.to_vec(), pair.touching.to_vec())).collect()
}

/// The contacts in the order in which they were found.
fn as_found(pairs: &[StoredPair]) -> Vec<Vec<SphereContact>> {
    pairs.iter().map(|pair| pair.sphere_contacts().collect()).collect()
}

#[test]
fn distances_alone_are_those_of_the_contacts_with_points() {
    #[cfg(feature = "parallel")]
    bevy_tasks::ComputeTaskPool::get_or_init(|| {
        bevy_tasks::TaskPoolBuilder::new().num_threads(crate::world::POOL_THREADS).build()
    });
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        let [mut bare, mut shared] = [1, 2].map(|threads| Run::new(method, threads, SphereContactDetail::Distances));
        let [mut whole, mut of_two] = [1, 2].map(|threads| Run::new(method, threads, SphereContactDetail::Points));
        let mut count = 0;
        for tick in 0..TICKS {
            let (distances, of_two_threads) = (bare.tick(tick), shared.tick(tick));
            let (points, points_of_two_threads) = (whole.tick(tick), of_two.tick(tick));
            assert!(as_found(&distances) == as_found(&of_two_threads), "{method:?}: the order depends on the threads");
            assert!(as_found(&distances) == as_found(&points), "{method:?}");
            assert!(lists(&points) == lists(&points_of_two_threads), "{method:?}: the contacts depend on the threads");
            assert_eq!(points.len(), 4, "the sheet, and three balls");
            for (bare, pair) in distances.iter().zip(&points) {
                assert!(bare.contacts.is_empty() && bare.touching.is_empty(), "{method:?}");
                assert_eq!([bare.contact_count(), bare.touching_count()], [pair.contacts.len(), pair.touching.len()]);
                assert_eq!(bare.nearest, pair.nearest);
                let mut found: Vec<_> = bare.sphere_contacts().collect();
                // The contacts of a surface with itself are sorted by the lower triangle.
                found.sort_by_key(|contact| {
                    let [a, b] = [contact.triangle_a, contact.triangle_b];
                    if pair.a == pair.b { (a.min(b), a.max(b)) } else { (a, b) }
                });
                assert_eq!(found.len(), pair.contacts.len());
                for (found, contact) in found.iter().zip(&*pair.contacts) {
                    assert_eq!((found.triangle_a, found.triangle_b), contact.triangles());
                    // Differences of lengths below 1.
                    assert!((found.distance - contact.distance).abs() <= 8.0 * f32::EPSILON, "{found:?}: {contact:?}");
                }
                count += found.len();
            }
        }
        println!("{method:?}: {count} contacts");
        assert!(count > 20_000, "{method:?}: {count} contacts");
    }
}

#[test]
fn a_clone_of_a_stored_pair_keeps_the_lists_of_its_tick() {
    for method in [ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        let mut run = Run::new(method, 1, SphereContactDetail::Points);
        let found: Vec<_> = (0..TICKS).map(|tick| run.tick(tick)).collect();
        let mut again = Run::new(method, 1, SphereContactDetail::Points);
        for (tick, found) in found.iter().enumerate() {
            let expected = again.tick(tick);
            assert!(lists(found) == lists(&expected) && as_found(found) == as_found(&expected), "{method:?} {tick}");
        }
    }
}

/// Rows belong to places in the list of surfaces. A pair must not be tested with the rows of another surface that had
/// its place before.
#[test]
fn pairs_are_found_among_fewer_surfaces() {
    let mut app = app();
    let parts = (ContactMethod::Circumsphere, SurfaceThickness::World(0.2));
    let far = spawn(&mut app, &icosphere(1, 0.5).translate([90.0, 0.0, 0.0]), parts);
    for place in [[0.0; 3], [0.3, 0.01, 0.1]] {
        spawn(&mut app, &icosphere(3, 0.5).translate(place), parts);
    }
    app.update();
    let expected = lists(store(&app).pairs());
    assert!(expected.len() == 1 && expected[0].0.len() > 100, "{}", expected.len());
    app.update();
    app.world_mut().despawn(far);
    app.world_mut().resource_mut::<CircumsphereSettings>().memory = false;
    app.update();
    assert!(lists(store(&app).pairs()) == expected);
}

/// Spheres that are made anew in place, as after a teleport, give the contacts of a new world, even if nothing is near
/// in that tick.
#[test]
fn spheres_that_are_made_anew_in_place_are_those_that_pairs_are_tested_with() {
    let parts = (ContactMethod::Circumsphere, SurfaceThickness::World(0.2));
    let balls = [[0.0; 3], [0.3, 0.01, 0.1]].map(|place| icosphere(3, 0.5).translate(place));
    // A smaller change of shape than the one that makes a sphere anew.
    let drawn_out =
        |mesh: &Mesh| points(mesh).iter().map(|&point| point * Vec3::new(1.4, 0.8, 1.0)).collect::<Vec<_>>();
    let mut new = app();
    for ball in &balls {
        let surface = spawn(&mut new, ball, parts);
        write_positions(&mut new, surface, &drawn_out(ball));
    }
    new.update();
    let expected = lists(store(&new).pairs());
    for is_apart in [false, true] {
        let mut app = app();
        let surfaces = balls.each_ref().map(|ball| spawn(&mut app, ball, parts));
        app.update();
        for (&surface, ball) in surfaces.iter().zip(&balls) {
            write_positions(&mut app, surface, &drawn_out(ball));
        }
        app.update();
        assert!(expected != lists(store(&app).pairs()) && expected[0].0.len() > 100);
        for surface in surfaces {
            insert(&mut app, surface, Teleported);
        }
        if is_apart {
            insert(&mut app, surfaces[1], Transform::from_xyz(90.0, 0.0, 0.0));
            app.update();
            assert!(store(&app).pairs().is_empty());
            insert(&mut app, surfaces[1], Transform::IDENTITY);
        }
        app.update();
        assert!(lists(store(&app).pairs()) == expected, "apart: {is_apart}");
    }
}

/// When the method changes, the contacts found by spheres are dropped, and so is their memory.
#[test]
fn exact_pairs_hold_nothing_of_spheres() {
    let mut run = Run::new(ContactMethod::BoundingSphere, 1, SphereContactDetail::Points);
    for tick in 0..TICKS {
        assert!(lists(&run.tick(tick)).iter().any(|(contacts, _)| contacts.len() > 1_000));
    }
    let held = |run: &Run| format!("{:?}", run.app.world().resource::<SphereContacts>()).contains("FoundBySpheres");
    assert!(held(&run));
    for &surface in &run.surfaces {
        insert(&mut run.app, surface, ContactMethod::Exact);
    }
    run.tick(0);
    assert!(!held(&run));
}
