//! The number of threads changes only the run time.

use bevy_app::prelude::*;
use bevy_circumsphere::{detection::CandidateTrianglePairs, geometry::FeaturePair, prelude::*};
use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, grid, icosphere, torus};
use glam::{Quat, Vec3};

use crate::world::{Called, POOL_THREADS, app, spawn, store};

/// Two fine sheets that cross, one of them crumpled onto itself, and a large ball.
fn scene(method: ContactMethod, threads: usize) -> App {
    let mut app = app();
    app.insert_resource(CircumsphereSettings { threads, ..Default::default() });
    let fine = grid(50, 50, 4.0, 4.0, Diagonals::Alternating);
    let thick = SurfaceThickness::World(0.01);
    spawn(&mut app, &fine, (thick, method, Called("sheet")));
    let tilted = Transform::from_xyz(0.01, 0.0, 0.013).with_rotation(Quat::from_rotation_x(0.002));
    let crumpled = spawn(&mut app, &fine, (thick, method, SelfCollision, Called("crumpled"), tilted));
    for position in &mut app.world_mut().get_mut::<SurfacePositions>(crumpled).expect("the entity is a surface").0 {
        position.x = (position.x * 7.0).fract() * 0.2 + position.x * 0.5;
    }
    let ball = Transform::from_xyz(0.1, 0.45, 0.2);
    spawn(&mut app, &icosphere(4, 0.5), (thick, method, Called("ball"), ball));
    app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), Called("floor")));
    app
}

/// Everything that is stored, with floats as bits.
#[derive(PartialEq)]
struct Bits {
    pairs: Vec<(&'static str, &'static str, u64, usize, usize)>,
    contacts: Vec<([u64; 3], [u32; 12], FeaturePair)>,
    touching: Vec<[u64; 3]>,
}

fn bits(app: &App) -> Bits {
    let store = store(app);
    let name = |side: ContactSide| app.world().get::<Called>(side.entity()).expect("the entity has a name").0;
    let pairs = store
        .pairs()
        .iter()
        .map(|pair| (name(pair.a), name(pair.b), pair.nearest.to_bits(), pair.contacts.len(), pair.touching.len()));
    let contacts = store.contacts().map(|contact| {
        let mut floats = [0; 12];
        let values = contact.barycentric_a.into_iter().chain(contact.barycentric_b);
        let values = values.chain(contact.point_b.to_array()).chain(contact.normal.to_array());
        for (bits, value) in floats.iter_mut().zip(values.chain([contact.distance])) {
            *bits = value.to_bits();
        }
        let numbers = [contact.key.0, u64::from(contact.triangle_a), u64::from(contact.triangle_b)];
        (numbers, floats, contact.features)
    });
    let touching =
        store.touching().map(|pair| [u64::from(pair.triangle_a), u64::from(pair.triangle_b), pair.distance.to_bits()]);
    Bits { pairs: pairs.collect(), contacts: contacts.collect(), touching: touching.collect() }
}

#[test]
fn contacts_are_the_same_to_the_last_bit_for_any_number_of_threads() {
    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(POOL_THREADS).build());
    assert!(pool.thread_num() > 1, "the task pool has one thread, so there is nothing to compare");
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere, ContactMethod::BoundingSphere] {
        let found = |threads: usize| {
            let mut app = scene(method, threads);
            app.update();
            let first = bits(&app);
            app.update();
            assert!(first == bits(&app), "{method:?}: nothing has moved, yet the second tick differs");
            let pairs = &app.world().resource::<CandidateTrianglePairs>().pairs();
            let chunks = pairs.iter().map(|pair| pair.triangles.len().div_ceil(4096)).max();
            assert!(chunks >= Some(8), "{chunks:?} chunks are too few");
            first
        };
        let alone = found(1);
        assert!(alone.pairs.len() >= 4 && alone.contacts.len() > 1000, "{method:?}: {} contacts", alone.contacts.len());
        for threads in [0, 2, 3, 100] {
            assert!(found(threads) == alone, "{method:?}: {threads} threads give a different result");
        }
    }
}

/// A heap of rings, each inside a few others: many pairs of surfaces, none large enough for more than one thread.
fn heap(method: ContactMethod, threads: usize) -> App {
    let mut app = app();
    app.insert_resource(CircumsphereSettings { threads, ..Default::default() });
    let ring = torus(0.3, 0.25, 25, 20);
    for number in 0..48_u8 {
        let [x, y, z] = [number % 4, number / 4 % 4, number / 16].map(|cell| 0.8 * f32::from(cell));
        let turned = Quat::from_rotation_x(f32::from(number)) * Quat::from_rotation_z(0.7 * f32::from(number));
        let place = Transform::from_xyz(x, y, z).with_rotation(turned);
        spawn(&mut app, &ring, (SurfaceThickness::World(0.02), method, Called("ring"), place));
    }
    app
}

#[test]
fn contacts_of_many_bodies_are_the_same_to_the_last_bit_for_any_number_of_threads() {
    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(POOL_THREADS).build());
    assert!(pool.thread_num() > 1, "the task pool has one thread, so there is nothing to compare");
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere, ContactMethod::BoundingSphere] {
        let found = |threads: usize| {
            let mut app = heap(method, threads);
            app.update();
            let first = bits(&app);
            app.update();
            assert!(first == bits(&app), "{method:?}: nothing has moved, yet the second tick differs");
            let pairs = &app.world().resource::<CandidateTrianglePairs>().pairs();
            let most = pairs.iter().map(|pair| pair.triangles.len()).max();
            assert!(most < Some(4096), "{most:?} candidates are shared out");
            let all: usize = pairs.iter().map(|pair| pair.triangles.len()).sum();
            assert!(all > 4 * 4096, "{all} candidates are too few to be shared out");
            first
        };
        let alone = found(1);
        assert!(alone.pairs.len() > 60 && alone.contacts.len() > 1000, "{method:?}: {} contacts", alone.contacts.len());
        for threads in [0, 2, 3, 100] {
            assert!(found(threads) == alone, "{method:?}: {threads} threads give a different result");
        }
    }
}
