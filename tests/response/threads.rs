//! A solution does not depend on how many threads share it.

use bevy_circumsphere::{CircumsphereSettings, prelude::*, response::*};
use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, grid, icosphere};
use glam::{Mat3, Vec3};

use crate::harness::Scene;

/// The threads of the pool. The calling thread works too.
const POOL_THREADS: usize = 3;

/// A pinned cloth of several slabs that falls on a ball, its own folds, and a soft ball, after some ticks, with what another
/// cloth has pushed a rigid ball beside them by, and the most contacts that pressed in one.
fn fallen(threads: usize) -> (Vec<[u32; 3]>, usize) {
    let mut scene = Scene::new();
    scene.app.world_mut().resource_mut::<CircumsphereSettings>().threads = threads;
    let thickness = SurfaceThickness::World(0.003);
    scene.add_obstacle(&icosphere(3, 0.3), thickness);
    let cloth =
        grid(64, 48, 1.6, 1.2, Diagonals::Alternating).rotate([0.0, 1.0, 0.0], 0.3).translate([0.05, 0.31, 0.0]);
    let pinned = |mut body: XpbdBody| {
        body.inverse_masses[0] = 0.0;
        body.inverse_masses[40] = 0.0;
        body
    };
    let cloth = scene.add_changed(&cloth, XpbdMaterial::CLOTH, pinned, (thickness, SelfCollision));
    let ball = icosphere(3, 0.1).translate([0.1, 0.45, 0.05]);
    let ball = scene.add(&ball, XpbdMaterial::SOFT, thickness);
    let beside = grid(12, 12, 0.4, 0.4, Diagonals::Alternating).translate([3.02, 0.32, 0.2]);
    let beside = scene.add(&beside, XpbdMaterial::CLOTH, (thickness, SelfCollision));
    let mass = RigidMass {
        inverse_mass: Vec3::splat(20.0),
        inverse_inertia: Mat3::from_diagonal(Vec3::splat(5.0e3)),
        center_of_mass: Vec3::new(3.0, 0.2, 0.2),
    };
    let rigid = (RigidShape(SharedShape::ball(0.1)), mass, Transform::from_translation(mass.center_of_mass));
    let rigid = scene.app.world_mut().spawn(rigid).id();
    // Another one hangs above it from tethers, in all slabs. Every third of its vertices has two.
    let hung = grid(32, 16, 1.6, 0.8, Diagonals::Alternating).translate([0.0, 2.0, 0.0]);
    let offsets = [Vec3::Y * 0.02, Vec3::new(0.01, 0.03, 0.0)];
    let tether = |(vertex, offset): (usize, usize)| Tether {
        longest: 0.01,
        ..Tether::pin(
            VertexId(vertex as u32),
            TetherTarget::World(Vec3::from(hung.positions[vertex]) + offsets[offset]),
        )
    };
    let all = 0..hung.positions.len();
    let tethers = all.clone().map(|vertex| (vertex, 0)).chain(all.clone().step_by(3).map(|vertex| (vertex, 1)));
    let tethers = XpbdTethers::new(tethers.map(tether));
    let held_by = |vertex: usize| Vec3::from(hung.positions[vertex]) + offsets[usize::from(vertex.is_multiple_of(3))];
    let hanging = scene.add(&hung, XpbdMaterial::CLOTH, (thickness, tethers));
    let (mut pressing, mut pushed) = (0, [Vec3::ZERO; 2]);
    for _ in 0..40 {
        scene.run(1);
        pressing = pressing.max(scene.diagnostics().pressing);
        let push = scene.app.world().get::<RigidPush>(rigid).unwrap();
        pushed = [pushed[0] + push.velocity, pushed[1] + push.angular_velocity];
    }
    assert!(pushed[0].length() > 0.1, "the cloth pushes the rigid ball: {pushed:?}");
    let is_held = |vertex: &usize| scene.positions(hanging)[*vertex].distance(held_by(*vertex)) < 0.0101;
    let held = all.clone().filter(is_held).count();
    assert!(held > all.len() * 9 / 10, "tethers hold {held} of {}", all.len());
    let at = [cloth, ball, beside, hanging].map(|body| scene.positions(body).to_vec());
    (at.concat().into_iter().chain(pushed).map(|at: Vec3| at.to_array().map(f32::to_bits)).collect(), pressing)
}

/// Two cloths of more triangles than one thread is left to, which lie upon each other and are thrown against a ball, with
/// the guard. Returns what else was counted: the most contacts that the solver watched, and how often it solved again.
fn thrown(threads: usize) -> (Vec<[u32; 3]>, [usize; 2]) {
    let mut scene = Scene::new();
    scene.app.world_mut().resource_mut::<CircumsphereSettings>().threads = threads;
    let thickness = SurfaceThickness::World(0.003);
    scene.add_obstacle(&icosphere(3, 0.3), thickness);
    let cloths = [0.0, 0.0062].map(|height| {
        let cloth = grid(50, 50, 1.0, 1.0, Diagonals::Alternating).rotate([0.0, 1.0, 0.0], 30.0 * height);
        let cloth = cloth.translate([0.05, 0.35 + height, 0.0]);
        let falling = |body: XpbdBody| body.moving(Vec3::new(0.0, -8.0, 0.0));
        scene.add_changed(&cloth, XpbdMaterial::CLOTH, falling, (thickness, SelfCollision, SweptCollision))
    });
    let mut most = [0; 2];
    for _ in 0..12 {
        scene.run(1);
        let diagnostics = scene.diagnostics();
        most = [most[0].max(diagnostics.contacts), most[1] + diagnostics.solved_again];
    }
    let at = cloths.map(|body| scene.positions(body).to_vec());
    (at.concat().into_iter().map(|at: Vec3| at.to_array().map(f32::to_bits)).collect(), most)
}

#[test]
fn a_solution_is_the_same_to_the_last_bit_for_any_number_of_threads() {
    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(POOL_THREADS).build());
    assert!(pool.thread_num() > 1, "the task pool has one thread, so there is nothing to compare");
    let (alone, pressing) = fallen(1);
    assert!(pressing > 500, "only {pressing} contacts press");
    for threads in [2, 3, 0] {
        assert!(fallen(threads).0 == alone, "{threads} threads");
    }
    let (alone, [contacts, again]) = thrown(1);
    assert!(contacts > 10_000 && again > 0, "{contacts} contacts, solved again {again} times");
    for threads in [2, 3, 0] {
        assert!(thrown(threads).0 == alone, "thrown, on {threads} threads");
    }
}
