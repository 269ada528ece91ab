//! A steady tick on one thread allocates no memory: every stage reuses buffers from earlier ticks.
//!
//! This is a separate program with a single test, because the allocator counts everything in the process. Systems
//! between the stages read the count, so allocations by the app and the schedule do not matter.

use std::{alloc::System, collections::BTreeMap};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore, SurfaceDetection, SurfaceDetectionSystems,
    detection::{
        BroadPhaseSystems, CandidateTrianglePairs, HierarchicalSpatialHashBroadPhasePlugin,
        SpatialHashBroadPhasePlugin, TreeBroadPhasePlugin,
    },
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, crumpled_sheet, icosphere, torus};
use glam::Vec3;
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Ticks in which buffers may grow. The scene alternates between two states.
const WARM: usize = 8;

/// Ticks in which buffers must not grow.
const STEADY: usize = 6;

/// Stages that still allocate, listed so that they can be removed. A stage stays here only while it allocates with at
/// least one method.
const STILL_ALLOCATE: [&str; 1] = ["exact"];

/// The number of allocations before the first stage and after each stage, tick by tick.
#[derive(Resource, Default)]
struct Counts(Vec<(&'static str, usize)>);

fn asked() -> usize {
    let stats = HEAP.stats();
    stats.allocations + stats.reallocations
}

fn count(after: &'static str) -> impl Fn(ResMut<Counts>) {
    move |mut counts| counts.0.push((after, asked()))
}

fn add_counters(app: &mut App) {
    use SurfaceDetectionSystems as Stage;
    app.insert_resource(Counts(Vec::with_capacity(1_000)));
    app.add_systems(
        SurfaceDetection,
        (
            count("start").before(Stage::Bounds),
            count("bounds").after(Stage::Bounds).before(Stage::BroadPhase),
            count("pair surfaces").after(BroadPhaseSystems::PairSurfaces).before(BroadPhaseSystems::PairTriangles),
            count("pair triangles").after(Stage::BroadPhase).before(Stage::Curvature),
            count("curvature").after(Stage::Curvature).before(Stage::Refit),
            count("refit").after(Stage::Refit).before(Stage::Overlap),
            count("overlap").after(Stage::Overlap).before(Stage::Cone),
            count("cone").after(Stage::Cone).before(Stage::Exact),
            count("exact").after(Stage::Exact).before(Stage::Contacts),
            count("contacts").after(Stage::Contacts),
        ),
    );
}

fn positions(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

/// A crumpled sheet with self-collision, two linked rings with a ball in both, a floor, and a rigid ball.
struct Scene {
    app: App,
    bodies: Vec<(Entity, [(Vec<Vec3>, Transform); 2])>,
}

#[derive(Clone, Copy, Debug)]
enum BroadPhase {
    Tree,
    SpatialHash,
    HierarchicalHash,
}

impl Scene {
    fn new(method: ContactMethod, broad_phase: BroadPhase) -> Self {
        let mut app = App::new();
        let plugins = DeformableCollisionPlugins::new(Update).build();
        match broad_phase {
            BroadPhase::Tree => app.add_plugins(plugins),
            BroadPhase::SpatialHash => app
                .add_plugins(plugins.disable::<TreeBroadPhasePlugin>())
                .add_plugins(SpatialHashBroadPhasePlugin::default()),
            BroadPhase::HierarchicalHash => app
                .add_plugins(plugins.disable::<TreeBroadPhasePlugin>())
                .add_plugins(HierarchicalSpatialHashBroadPhasePlugin::default()),
        };
        app.init_resource::<Time>();
        app.insert_resource(CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() });
        add_counters(&mut app);
        let mut bodies = Vec::new();
        let mut spawn = |states: [Mesh; 2], places: [Transform; 2], is_sheet: bool| {
            let [first, second] = [positions(&states[0]), positions(&states[1])];
            let surface = DeformableSurface::from_mesh(&first, &states[0].triangles).expect("a mesh");
            let mut entity = app.world_mut().spawn((surface, method, SurfaceThickness::MeanEdges(0.05), places[0]));
            if is_sheet {
                entity.insert(SelfCollision);
            }
            bodies.push((entity.id(), [(first, places[0]), (second, places[1])]));
        };
        spawn([0.0, 0.05].map(|phase| crumpled_sheet(5_000, phase)), [Transform::IDENTITY; 2], true);
        let ring = || [torus(2.0, 0.6, 30, 16), torus(2.02, 0.61, 30, 16)];
        let at = |x: f32| Transform::from_xyz(x, 30.0, 0.0);
        spawn(ring(), [at(0.0), at(0.05)], false);
        let upright = Transform::from_xyz(1.9, 30.2, 0.1).with_rotation(glam::Quat::from_xyzw(0.6, 0.0, 0.0, 0.8));
        spawn(ring(), [upright; 2], false);
        spawn([icosphere(3, 1.0), icosphere(3, 1.01)], [at(1.0), at(1.02)], false);
        app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
        app.world_mut().spawn((RigidShape(SharedShape::ball(1.0)), at(-2.0)));
        app.finish();
        app.cleanup();
        Self { app, bodies }
    }

    fn tick(&mut self, tick: usize) {
        for (body, states) in &self.bodies {
            let (positions, place) = &states[tick % 2];
            let mut body = self.app.world_mut().entity_mut(*body);
            body.get_mut::<SurfacePositions>().expect("it has positions").0.clone_from(positions);
            *body.get_mut::<Transform>().expect("it has a transform") = *place;
        }
        self.app.update();
    }
}

#[test]
fn a_steady_tick_on_one_thread_asks_for_no_memory() {
    let before = asked();
    drop(std::hint::black_box(Box::new(before)));
    assert_eq!(asked(), before + 1, "the allocator does not count");
    let mut faults = Vec::new();
    let mut still = STILL_ALLOCATE.to_vec();
    let hashes = [BroadPhase::SpatialHash, BroadPhase::HierarchicalHash].map(|hash| (ContactMethod::Exact, hash));
    for (method, broad_phase) in ContactMethod::ALL.map(|method| (method, BroadPhase::Tree)).into_iter().chain(hashes) {
        let mut scene = Scene::new(method, broad_phase);
        (0..WARM).for_each(|tick| scene.tick(tick));
        let mut candidates = Vec::new();
        let mut by_stage: BTreeMap<&str, usize> = BTreeMap::new();
        for tick in WARM..WARM + STEADY {
            scene.app.world_mut().resource_mut::<Counts>().0.clear();
            scene.tick(tick);
            let world = scene.app.world();
            let counts = &world.resource::<Counts>().0;
            assert_eq!(counts.len(), 10, "every stage ran once");
            for stage in counts.windows(2) {
                *by_stage.entry(stage[1].0).or_default() += stage[1].1 - stage[0].1;
            }
            candidates.push(world.resource::<CandidateTrianglePairs>().triangle_pair_count());
            let store = world.resource::<ContactStore>();
            assert!(store.pairs().len() >= 5 && store.contact_count() > 5_000, "{method:?}: too little touches");
        }
        assert!(candidates[0] != candidates[1] && candidates[0] > 10_000, "{method:?}: nothing moves: {candidates:?}");
        println!("{method:?}, {broad_phase:?}: {by_stage:?}");
        for (stage, count) in by_stage {
            if count > 0 && !STILL_ALLOCATE.contains(&stage) {
                faults.push(format!("{method:?}, {broad_phase:?}, {stage}: {count} in {STEADY} ticks"));
            }
            still.retain(|&listed| listed != stage || count == 0);
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
    assert!(still.is_empty(), "these no longer allocate and can be removed from the list: {still:?}");
}
