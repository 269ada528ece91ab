//! Runs strategies, small worlds, and the reference.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    detection::{BruteForceBroadPhasePlugin, NormalConeCullingPlugin, TreeBroadPhasePlugin},
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

/// f64 rounding of the distance of two triangles that just touch, relative to their extent. At a contact distance of 0,
/// either answer is right within it.
pub const ROUNDING: f64 = 1.0e-12;

/// The number of cases that proptest runs by default: the value of `PROPTEST_CASES` at which each property runs its own
/// default number.
const DEFAULT_CASES: u64 = 256;

/// Runs `test` on `cases` values of a strategy, scaled by the environment. Panics with the smallest value that fails.
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
        // The same cases everywhere, unless the environment asks for others.
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

/// Whether the environment sets the number of cases.
fn asked_for_cases() -> bool {
    std::env::var_os("PROPTEST_CASES").is_some()
}

/// Counts how often a property was exercised. A property that never applies proves nothing.
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
        assert!(self.0.get() >= least, "only {} {what}, so the cases prove nothing", self.0.get());
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BroadPhase {
    Tree,
    TreeWithoutCones,
    BruteForce,
}

pub const EXACT_METHODS: [ContactMethod; 3] = [ContactMethod::Closest, ContactMethod::Exact, ContactMethod::Polygon];

/// How a world detects contacts.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    pub method: ContactMethod,
    pub broad_phase: BroadPhase,
    pub threads: usize,
}

impl Setup {
    pub const REFINED: Self = Self { method: ContactMethod::Exact, broad_phase: BroadPhase::Tree, threads: 1 };

    /// The exact methods with the tree, with and without normal cones, and with brute force.
    pub fn exact() -> impl Iterator<Item = Self> {
        EXACT_METHODS.into_iter().flat_map(|method| {
            [BroadPhase::Tree, BroadPhase::TreeWithoutCones, BroadPhase::BruteForce].map(|broad_phase| Self {
                method,
                broad_phase,
                threads: 1,
            })
        })
    }

    /// Every method with the default broad phase.
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

/// The results between two surfaces of a world, or within one.
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
            BroadPhase::TreeWithoutCones => {
                app.add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<NormalConeCullingPlugin>())
            }
            BroadPhase::BruteForce => app
                .add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>())
                .add_plugins(BruteForceBroadPhasePlugin),
        };
        app.insert_resource(CircumsphereSettings { threads: setup.threads, ..Default::default() });
        let entities = bodies
            .iter()
            .map(|body| {
                let surface = DeformableSurface::from_mesh(&body.positions, &body.triangles).expect("it is valid");
                // Halving is exact, so two halves sum to the distance.
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

    /// Runs one tick. Returns the results: each surface with itself if it has self-collision, and with every later one.
    pub fn tick(&mut self) -> Vec<Found> {
        self.app.update();
        for &entity in &self.entities {
            let status = self.app.world().get::<SurfaceStatus>(entity).expect("it was spawned");
            assert_eq!(*status, SurfaceStatus::Active, "a valid surface is quarantined");
        }
        let store = self.app.world().resource::<ContactStore>();
        let place = |side: ContactSide| {
            self.entities.iter().position(|&entity| entity == side.entity()).expect("only these surfaces exist")
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

/// Panics if a stored number is NaN.
pub fn assert_numbers(found: &[Found]) {
    for Found { touching, contacts, .. } in found {
        assert!(touching.iter().all(|pair| pair.distance >= 0.0 && pair.distance.is_finite()), "{touching:?}");
        for contact in contacts {
            let weights = [contact.barycentric_a, contact.barycentric_b];
            assert!(weights.iter().flatten().all(|weight| weight.is_finite()), "{contact:?}");
            assert!(contact.distance.is_finite() && contact.point_b.is_finite(), "{contact:?}");
            assert!((contact.normal.length() - 1.0).abs() <= 1.0e-5, "not a unit normal: {contact:?}");
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

/// Mean edge of a mesh according to the reference.
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

/// The corners of both sides of a pair, and what determines where either answer is right.
pub struct Judge<'a> {
    pub corners: [(&'a [DVec3], &'a [[u32; 3]]); 2],
    pub distance: f64,
    /// How far a distance may be from the contact distance for either answer to be right, in addition to [`ROUNDING`].
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

    /// Panics if a pair is missed or false, or if a distance is wrong. `truth` must reach past the band.
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
                .expect("one of them exists");
            let slack = self.band + ROUNDING * self.extent(a, b);
            match (is_named, is_true) {
                (Some(found), Some(truth)) => {
                    let size = self.extent(a, b);
                    let error = (found.distance - truth.distance).abs();
                    assert!(truth.distance <= self.distance + slack, "{what}: {found:?} is false, truth: {truth:?}");
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
