//! The order of contacts comes from the scene, never from the memory layout of entities.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, cuboid, icosphere, torus};
use glam::{Quat, Vec3};

use crate::world::{Called, THIN, app, at, ball, fingerprint, sheet, spawn};

#[derive(Component)]
struct Red;
#[derive(Component)]
struct Heavy(#[expect(dead_code, reason = "only its size matters")] [u64; 3]);
#[derive(Component)]
#[component(storage = "SparseSet")]
struct Rare;

enum Body {
    Surface(Mesh),
    Shape(SharedShape),
}

/// Twelve bodies that cross and touch each other: a sheet, meshes, and shapes.
fn bodies() -> Vec<(&'static str, Body, Transform)> {
    let turned = |x: f32, y: f32, z: f32, angle: f32| at(x, y, z).with_rotation(Quat::from_rotation_x(angle));
    let surface = Body::Surface;
    vec![
        ("sheet", surface(sheet()), at(0.0, 0.0, 0.0)),
        ("second sheet", surface(sheet()), turned(0.1, 0.06, 0.05, 0.02)),
        ("ball", surface(ball()), at(0.1, 0.53, 0.2)),
        ("low ball", surface(ball()), turned(-0.6, 0.2, 0.3, 0.5)),
        ("box", surface(cuboid([0.3, 0.4, 0.5], 2)), turned(0.5, 0.3, 0.5, 0.7)),
        ("ring", surface(torus(0.8, 0.2, 12, 8)), turned(-0.3, 0.3, -0.4, 0.3)),
        ("small ball", surface(icosphere(1, 0.3)), at(0.8, 0.25, -0.6)),
        ("big ball", surface(icosphere(2, 0.9)), turned(-1.2, 0.4, -0.9, 1.0)),
        ("twin of ball", surface(ball()), at(0.1, 0.53, 0.2)),
        ("shape ball", Body::Shape(SharedShape::ball(0.4)), at(1.0, 0.2, 0.9)),
        ("shape box", Body::Shape(SharedShape::cuboid(0.3, 0.3, 0.3)), turned(-1.0, 0.1, 0.9, 0.4)),
        ("floor", Body::Shape(SharedShape::halfspace(Vec3::Y)), at(0.0, -0.02, 0.0)),
    ]
}

/// A pseudo-random permutation: Knuth's linear congruential generator, top bits.
fn shuffled(count: usize, seed: u64) -> Vec<usize> {
    let mut state = seed.wrapping_mul(2_862_933_555_777_941_757).wrapping_add(3_037_000_493);
    let mut order: Vec<usize> = (0..count).collect();
    for last in (1..count).rev() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        order.swap(last, (state >> 33) as usize % (last + 1));
    }
    order
}

struct Arrangement {
    /// The order in which the bodies are spawned.
    spawn_order: Vec<usize>,
    /// The seed of the extra components that bodies carry. With 0 there are none.
    markers: u64,
    /// Whether each body is given its place in the order.
    ordered: bool,
    /// Whether other entities are spawned and despawned in between, so that ids are recycled.
    churn: bool,
}

fn world(arrangement: &Arrangement, method: ContactMethod) -> App {
    let mut app = app();
    let mut bodies: Vec<Option<_>> = bodies().into_iter().map(Some).collect();
    let mut gone = Vec::new();
    for &body in &arrangement.spawn_order {
        if arrangement.churn {
            let passing: Vec<Entity> = (0..3).map(|_| app.world_mut().spawn_empty().id()).collect();
            gone.push(passing[1]);
            app.world_mut().despawn(passing[0]);
            app.world_mut().despawn(passing[2]);
        }
        let (name, kind, transform) = bodies[body].take().expect("each is spawned once");
        let entity = match kind {
            Body::Surface(mesh) => spawn(&mut app, &mesh, (THIN, method, SelfCollision, Called(name), transform)),
            Body::Shape(shape) => app.world_mut().spawn((RigidShape(shape), Called(name), transform)).id(),
        };
        let mut entity = app.world_mut().entity_mut(entity);
        if arrangement.ordered {
            entity.insert(SurfaceOrder(body as u32));
        }
        if arrangement.markers != 0 {
            let bits = shuffled(8, arrangement.markers.wrapping_mul(31).wrapping_add(body as u64))[0];
            if bits & 1 != 0 {
                entity.insert(Red);
            }
            if bits & 2 != 0 {
                entity.insert(Heavy([0; 3]));
            }
            if bits & 4 != 0 {
                entity.insert(Rare);
            }
        }
    }
    app
}

/// The contacts of a first tick, and of a second one after some bodies have moved.
fn found(mut app: App) -> Vec<(&'static str, &'static str, Vec<String>)> {
    app.update();
    let mut found = fingerprint(&app);
    let mut moved = app.world_mut().query::<(&Called, &mut Transform)>();
    for (called, mut transform) in moved.iter_mut(app.world_mut()) {
        transform.translation.y -= if called.0.contains("ball") { 0.05 } else { 0.0 };
    }
    app.update();
    found.extend(fingerprint(&app));
    found
}

#[test]
fn with_an_order_given_neither_spawn_order_nor_archetypes_change_a_bit() {
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere] {
        let reference = Arrangement { spawn_order: (0..12).collect(), markers: 0, ordered: true, churn: false };
        let expected = found(world(&reference, method));
        let contacts: usize = expected.iter().map(|(.., contacts)| contacts.len()).sum();
        assert!(expected.len() > 20 && contacts > 500, "{} pairs, {contacts} contacts", expected.len());
        for seed in 1..6 {
            let arrangement =
                Arrangement { spawn_order: shuffled(12, seed), markers: seed, ordered: true, churn: seed % 2 == 0 };
            assert!(found(world(&arrangement, method)) == expected, "{method:?}: seed {seed} gives another result");
        }
    }
}

#[test]
fn without_an_order_archetypes_alone_do_not_change_a_bit() {
    let spawn_order: Vec<usize> = shuffled(12, 99);
    let plain = Arrangement { spawn_order: spawn_order.clone(), markers: 0, ordered: false, churn: false };
    let expected = found(world(&plain, ContactMethod::Exact));
    for seed in 1..6 {
        let arrangement =
            Arrangement { spawn_order: spawn_order.clone(), markers: seed, ordered: false, churn: seed % 2 == 0 };
        assert!(found(world(&arrangement, ContactMethod::Exact)) == expected, "seed {seed} gives another result");
    }
    // The comparison would detect another order: a different spawn order gives a different order of pairs.
    let other = Arrangement { spawn_order: shuffled(12, 7), markers: 0, ordered: false, churn: false };
    assert!(found(world(&other, ContactMethod::Exact)) != expected);
}

#[test]
fn two_runs_of_the_same_world_agree_to_the_last_bit() {
    let arrangement = Arrangement { spawn_order: (0..12).collect(), markers: 3, ordered: false, churn: true };
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere, ContactMethod::BoundingSphere] {
        assert!(found(world(&arrangement, method)) == found(world(&arrangement, method)), "{method:?}");
    }
}
