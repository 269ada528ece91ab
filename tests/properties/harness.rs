//! Runs strategies, small worlds and the reference.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    detection::{BruteForceBroadPhasePlugin, TreeBroadPhasePlugin},
    geometry::{CompactContact, TouchingPair},
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};
use bevy_transform::components::Transform;
pub use circumsphere_support::bars::BAND;
use circumsphere_support::{bars::SEPARATION_TOLERANCE, scenes::Mesh};
use circumsphere_truth::{
    ReferencePair, exact_weld, mean_edge_length, touching_pairs_between_brute_force, touching_pairs_brute_force,
};
use glam::{DVec3, Vec3};
use proptest::{
    prelude::*,
    test_runner::{RngSeed, TestError, TestRunner},
};
use std::{cell::Cell, fmt::Debug};

/// Rounding of f64 in the distance of two triangles that just touch, in their extent: where the contact distance is 0
/// either answer is right within it.
pub const ROUNDING: f64 = 1.0e-12;

/// How many cases proptest tries by itself: the `PROPTEST_CASES` at which each property tries its default number.
const DEFAULT_CASES: u64 = 256;

/// Tries `test` on `cases` values of a strategy, or as many times more as the environment asks for, and fails with the
/// smallest value that it fails on.
#[track_caller]
pub fn for_all<S: Strategy>(file: &'static str, cases: u32, strategy: S, test: impl Fn(S::Value))
where
    S::Value: Debug,
{
    let asked = asked_for_cases();
    let chosen = ProptestConfig::default();
    let factor = if asked { u64::from(chosen.cases) } else { DEFAULT_CASES };
    let config = ProptestConfig {
        cases: (u64::from(cases) * factor).div_ceil(DEFAULT_CASES) as u32,
        // The same cases everywhere, unless more or others are asked for.
        rng_seed: if asked { chosen.rng_seed } else { RngSeed::Fixed(u64::from(cases)) },
        source_file: Some(file),
        ..chosen
    };
    let outcome = TestRunner::new(config).run(&strategy, |value| {
        test(value);
        Ok(())
    });
    match outcome {
        Ok(()) => {}
        Err(TestError::Fail(reason, value)) => panic!("{reason}\nfor {value:?}"),
        Err(TestError::Abort(reason)) => panic!("no cases: {reason}"),
    }
}

/// Whether the environment says how many cases to try.
fn asked_for_cases() -> bool {
    std::env::var_os("PROPTEST_CASES").is_some()
}

/// Counts what a property had to do with: one that never met its subject proves nothing.
#[derive(Default)]
pub struct Count(Cell<usize>);

impl Count {
    pub fn add(&self, count: usize) {
        self.0.set(self.0.get() + count);
    }

    pub fn get(&self) -> usize {
        self.0.get()
    }

    #[track_caller]
    pub fn assert_at_least(&self, least: usize, what: &str) {
        println!("{} {what}", self.0.get());
        // The limit is for the default number of cases.
        let least = if asked_for_cases() { 1 } else { least };
        assert!(self.0.get() >= least, "only {} {what}: the cases show nothing", self.0.get());
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BroadPhase {
    Tree,
    BruteForce,
}

pub const EXACT_METHODS: [ContactMethod; 3] = [ContactMethod::Closest, ContactMethod::Exact, ContactMethod::Polygon];

/// How a world detects.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    pub method: ContactMethod,
    pub broad_phase: BroadPhase,
    pub threads: usize,
}

impl Setup {
    pub const REFINED: Self = Self { method: ContactMethod::Exact, broad_phase: BroadPhase::Tree, threads: 1 };

    /// The exact methods over both broad phases.
    pub fn exact() -> impl Iterator<Item = Self> {
        EXACT_METHODS.into_iter().flat_map(|method| {
            [BroadPhase::Tree, BroadPhase::BruteForce].map(|broad_phase| Self { method, broad_phase, threads: 1 })
        })
    }

    /// Every method, by the default broad phase.
    pub fn methods() -> [Self; 5] {
        let [closest, refined, polygon] = EXACT_METHODS;
        [ContactMethod::BoundingSphere, ContactMethod::Circumsphere, closest, refined, polygon]
            .map(|method| Self { method, ..Self::REFINED })
    }
}

/// A surface to spawn.
#[derive(Clone, Debug)]
pub struct Body {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    pub transform: Transform,
    pub self_collision: bool,
}

impl Body {
    pub fn new(mesh: &Mesh) -> Self {
        Self {
            positions: points(mesh),
            triangles: mesh.triangles.clone(),
            transform: Transform::IDENTITY,
            self_collision: true,
        }
    }
}

pub fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

/// What was found between two of a world's surfaces, which may be one.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    pub sides: [usize; 2],
    pub touching: Vec<TouchingPair>,
    pub contacts: Vec<CompactContact>,
}

/// Surfaces in a headless app.
pub struct SmallWorld {
    pub app: App,
    pub entities: Vec<Entity>,
}

impl SmallWorld {
    /// A world of surfaces that touch within `distance`.
    pub fn new(bodies: &[Body], distance: f32, setup: Setup) -> Self {
        if setup.threads != 1 {
            ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(3).build());
        }
        let mut app = App::new();
        match setup.broad_phase {
            BroadPhase::Tree => app.add_plugins(DeformableCollisionPlugins::new(Update)),
            BroadPhase::BruteForce => app
                .add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>())
                .add_plugins(BruteForceBroadPhasePlugin),
        };
        app.insert_resource(CircumsphereSettings { threads: setup.threads, ..Default::default() });
        let entities = bodies
            .iter()
            .map(|body| {
                let surface = DeformableSurface::from_mesh(&body.positions, &body.triangles).expect("it is valid");
                // Half of a number is exact: two halves are the distance again.
                let thickness = SurfaceThickness::World(0.5 * distance);
                let entity = app.world_mut().spawn((surface, thickness, setup.method, body.transform)).id();
                if body.self_collision {
                    app.world_mut().entity_mut(entity).insert(SelfCollision);
                }
                entity
            })
            .collect();
        Self { app, entities }
    }

    pub fn write(&mut self, body: usize, positions: &[Vec3]) {
        self.app.world_mut().get_mut::<SurfacePositions>(self.entities[body]).expect("it was spawned").0 =
            positions.to_vec();
    }

    /// One tick, and what it found: every surface with itself where that collides, and with every later one.
    pub fn tick(&mut self) -> Vec<Found> {
        self.app.update();
        for &entity in &self.entities {
            let status = self.app.world().get::<SurfaceStatus>(entity).expect("it was spawned");
            assert_eq!(*status, SurfaceStatus::Active, "a valid surface is set aside");
        }
        let store = self.app.world().resource::<ContactStore>();
        let place = |side: ContactSide| {
            self.entities.iter().position(|&entity| entity == side.entity()).expect("there is nothing else")
        };
        let found: Vec<Found> = store
            .pairs()
            .iter()
            .map(|pair| Found {
                sides: [place(pair.a), place(pair.b)],
                touching: pair.touching.to_vec(),
                contacts: pair.contacts.to_vec(),
            })
            .filter(|found| !found.touching.is_empty() || !found.contacts.is_empty())
            .collect();
        assert_numbers(&found);
        found
    }
}

/// Fails where a stored number is NaN.
pub fn assert_numbers(found: &[Found]) {
    for Found { touching, contacts, .. } in found {
        assert!(touching.iter().all(|pair| pair.distance >= 0.0 && pair.distance.is_finite()), "{touching:?}");
        for contact in contacts {
            let weights = [contact.barycentric_a, contact.barycentric_b];
            assert!(weights.iter().flatten().all(|weight| weight.is_finite()), "{contact:?}");
            assert!(contact.distance.is_finite() && contact.point_b.is_finite(), "{contact:?}");
            assert!((contact.normal.length() - 1.0).abs() <= 1.0e-5, "no unit normal: {contact:?}");
        }
    }
}

/// The touching pairs between two surfaces of a world.
pub fn between(found: &[Found], sides: [usize; 2]) -> &[TouchingPair] {
    found.iter().find(|found| found.sides == sides).map_or(&[], |found| &found.touching)
}

pub fn wide(positions: &[Vec3]) -> Vec<DVec3> {
    positions.iter().map(|position| position.as_dvec3()).collect()
}

/// Mean edge of a mesh by the reference.
pub fn mean_edge(mesh: &Mesh) -> f64 {
    let positions = wide(&points(mesh));
    mean_edge_length(&positions, &mesh.triangles, &exact_weld(&positions))
}

/// Touching pairs of one mesh by brute force, welded at rest, up to past the end of the band.
pub fn truth_within(rest: &[Vec3], positions: &[DVec3], triangles: &[[u32; 3]], distance: f64) -> Vec<ReferencePair> {
    touching_pairs_brute_force(positions, triangles, &exact_weld(&wide(rest)), distance)
}

/// Touching pairs of two meshes by brute force.
pub fn truth_between(a: (&[DVec3], &[[u32; 3]]), b: (&[DVec3], &[[u32; 3]]), distance: f64) -> Vec<ReferencePair> {
    touching_pairs_between_brute_force(a.0, a.1, b.0, b.1, distance)
}

/// Two lists of corners, of the first and the second side of a pair, with what decides where either answer is right.
pub struct Judge<'a> {
    pub corners: [(&'a [DVec3], &'a [[u32; 3]]); 2],
    pub distance: f64,
    /// How far a pair's distance may be from the contact distance for either answer to be right, besides [`ROUNDING`].
    pub band: f64,
}

impl Judge<'_> {
    fn triangle(&self, side: usize, triangle: u32) -> [DVec3; 3] {
        let (positions, triangles) = self.corners[side];
        triangles[triangle as usize].map(|vertex| positions[vertex as usize])
    }

    fn extent(&self, triangle_a: u32, triangle_b: u32) -> f64 {
        let (a, b) = (self.triangle(0, triangle_a), self.triangle(1, triangle_b));
        a.iter().chain(&b).map(|corner| corner.distance(a[0])).fold(0.0, f64::max)
    }

    /// Fails where a pair is missed or false, or a distance is wrong. `truth` has to reach past the band.
    pub fn assert_right(&self, what: &str, found: &[TouchingPair], truth: &[ReferencePair]) {
        let mut expected = truth.iter().peekable();
        let mut named = found.iter().peekable();
        let key = |pair: &TouchingPair| (pair.triangle_a, pair.triangle_b);
        loop {
            let order = match (named.peek(), expected.peek()) {
                (None, None) => return,
                (Some(_), None) => std::cmp::Ordering::Less,
                (None, Some(_)) => std::cmp::Ordering::Greater,
                (Some(found), Some(truth)) => key(found).cmp(&(truth.triangle_a, truth.triangle_b)),
            };
            let is_named = order.is_le().then(|| named.next()).flatten();
            let is_true = order.is_ge().then(|| expected.next()).flatten();
            let (a, b) = is_true
                .map(|pair| (pair.triangle_a, pair.triangle_b))
                .or(is_named.map(key))
                .expect("one of them is there");
            let slack = self.band + ROUNDING * self.extent(a, b);
            match (is_named, is_true) {
                (Some(found), Some(truth)) => {
                    let size = self.extent(a, b);
                    let error = (found.distance - truth.distance).abs();
                    assert!(truth.distance <= self.distance + slack, "{what}: {found:?} is false, it is {truth:?}");
                    assert!(
                        error <= self.band + SEPARATION_TOLERANCE * size.max(self.distance),
                        "{what}: the distance of {found:?} is wrong by {error}: {truth:?}"
                    );
                }
                (Some(found), None) => panic!("{what}: {found:?} is false: {:?}", self.pair(a, b)),
                (None, Some(truth)) => assert!(
                    truth.distance > self.distance - slack,
                    "{what}: missed {truth:?}, which is within {}: {:?}",
                    self.distance,
                    self.pair(a, b)
                ),
                (None, None) => unreachable!("the loop has ended"),
            }
        }
    }

    fn pair(&self, a: u32, b: u32) -> [[DVec3; 3]; 2] {
        [self.triangle(0, a), self.triangle(1, b)]
    }
}
