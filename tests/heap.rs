//! Memory at a constant load: a heap of trembling cubes uses no more memory after many ticks than after a few, and
//! frees it when it is despawned.
//!
//! This is a separate program with a single test, because the allocator counts everything in the process. `HEAP_CUBES`
//! and `HEAP_TICKS` increase the load.

use std::env;

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, ContactStore, detection::CandidateTrianglePairs, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{random::Random, scenes::cuboid};
use glam::Vec3;
use peak_alloc::PeakAlloc;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

/// Ticks after which a world counts as fresh. Lists are swapped and reused from tick to tick.
const FRESH: usize = 6;

/// The most that memory may grow over a long run, as a factor.
const MOST_GROWTH: f64 = 1.3;

/// The most memory that may be left when everything is despawned, as a share: entity tables, which Bevy does not free.
const MOST_LEFT: f64 = 0.08;

fn setting(name: &str, default: usize) -> usize {
    env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(default)
}

/// How the cubes tremble.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// Their vertices move, all in the world's frame.
    Vertices,
    /// They move as a whole, each in its own frame.
    Poses,
}

struct World {
    app: App,
    cubes: Vec<Entity>,
    motion: Motion,
}

impl World {
    fn new(count: usize, motion: Motion, method: ContactMethod) -> Self {
        let mut app = App::new();
        app.add_plugins(DeformableCollisionPlugins::new(Update));
        app.insert_resource(CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() });
        let mesh = cuboid([0.5; 3], 1);
        let corners: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let cubes = (0..count)
            .map(|_| {
                let surface = DeformableSurface::from_mesh(&corners, &mesh.triangles).expect("the mesh is valid");
                app.world_mut().spawn((surface, method)).id()
            })
            .collect();
        Self { app, cubes, motion }
    }

    /// Every tick has its own places, which are the same in every world.
    fn tick(&mut self, tick: usize) {
        let side = (1..=self.cubes.len()).find(|side| side.pow(3) >= self.cubes.len()).unwrap_or(1);
        let corners = cuboid([0.5; 3], 1).positions;
        for (number, &cube) in self.cubes.iter().enumerate() {
            let mut random = Random::new((tick * self.cubes.len() + number) as u64);
            let mut vector = || Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
            let place = [number % side, number / side % side, number / (side * side)];
            let place = 1.1 * Vec3::from_array(place.map(|cell| cell as f32)) + 0.15 * vector();
            let mut cube = self.app.world_mut().entity_mut(cube);
            match self.motion {
                Motion::Vertices => {
                    let mut positions = cube.get_mut::<SurfacePositions>().expect("it is a surface");
                    positions.0.clear();
                    positions
                        .0
                        .extend(corners.iter().map(|&corner| Vec3::from_array(corner) + place + 0.05 * vector()));
                }
                Motion::Poses => {
                    let turn = glam::Quat::from_scaled_axis(0.3 * vector());
                    cube.insert(Transform::from_translation(place).with_rotation(turn));
                }
            }
        }
        self.app.update();
    }
}

fn measure(count: usize, ticks: usize, motion: Motion, method: ContactMethod) {
    let what = format!("{method:?}, {motion:?}");
    let megabytes = |bytes: usize| bytes as f64 / 1.0e6;
    let before = HEAP.current_usage();
    let mut empty = World::new(0, motion, method);
    (0..FRESH).for_each(|tick| empty.tick(tick));
    let empty_bytes = HEAP.current_usage() - before;
    drop(empty);

    let before = HEAP.current_usage();
    let mut fresh = World::new(count, motion, method);
    (ticks - FRESH..ticks).for_each(|tick| fresh.tick(tick));
    let fresh_bytes = HEAP.current_usage() - before;
    drop(fresh);

    let before = HEAP.current_usage();
    let mut world = World::new(count, motion, method);
    for tick in 0..ticks {
        world.tick(tick);
        if (tick + 1).is_power_of_two() || tick + 1 == ticks {
            let megabytes = megabytes(HEAP.current_usage() - before);
            let candidates = world.app.world().resource::<CandidateTrianglePairs>();
            let contacts = world.app.world().resource::<ContactStore>().contact_count();
            println!(
                "{what}: {megabytes:.2} MB after {} ticks, {} pairs of {} triangles, {contacts} contacts",
                tick + 1,
                candidates.pairs().len(),
                candidates.triangle_pair_count()
            );
        }
    }
    let bytes = HEAP.current_usage() - before;
    let growth = bytes as f64 / fresh_bytes as f64;
    println!(
        "{what}: {:.2} MB fresh, {:.2} MB after {ticks} ticks: {growth:.2}",
        megabytes(fresh_bytes),
        megabytes(bytes)
    );
    let store = world.app.world().resource::<ContactStore>();
    assert!(store.pairs().len() > 2 * count, "{what}: too little touches");

    for cube in std::mem::take(&mut world.cubes) {
        world.app.world_mut().despawn(cube);
    }
    (0..FRESH).for_each(|tick| world.tick(tick));
    let left = HEAP.current_usage() - before;
    println!("{what}: {:.2} MB left, {:.2} MB of an empty world", megabytes(left), megabytes(empty_bytes));
    assert!(growth <= MOST_GROWTH, "{what}: {fresh_bytes} bytes grew to {bytes}");
    let share = left.saturating_sub(empty_bytes) as f64 / bytes as f64;
    assert!(share <= MOST_LEFT, "{what}: {left} of {bytes} bytes are left, an empty world has {empty_bytes}");
}

#[test]
fn a_heap_that_trembles_takes_no_more_memory_with_time() {
    let (count, ticks) = (setting("HEAP_CUBES", 125), setting("HEAP_TICKS", 200));
    let mut faults = Vec::new();
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere, ContactMethod::BoundingSphere] {
        for motion in [Motion::Vertices, Motion::Poses] {
            faults.extend(std::panic::catch_unwind(|| measure(count, ticks, motion, method)).err());
        }
    }
    assert!(faults.is_empty(), "{} of 6 grow or leave something behind", faults.len());
}
