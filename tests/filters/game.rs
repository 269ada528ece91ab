//! A filter of the game.

use std::{
    collections::BTreeSet,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
};

use bevy_circumsphere::{ContactStore, detection::DetectionDiagnostics, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, crumpled_sheet, grid, icosphere};
use glam::Vec3;

use crate::world::World;

/// A pair as the filter sees it, and whether it may touch.
type Asked = (CandidatePair, bool);

/// An arbitrary answer that depends on everything that the filter is told.
fn answer(pair: &CandidatePair) -> bool {
    let second = pair.triangle_b.map_or(5, |triangle| 2 * triangle.0);
    !(pair.triangle_a.0 + second + pair.b.entity().index_u32()).is_multiple_of(3)
}

/// A cloth on itself, in a ball, in a rigid mesh, and on a solid.
fn scene(method: ContactMethod) -> World {
    let mut world = World::detecting();
    world.app.world_mut().resource_mut::<CircumsphereSettings>().threads = 1;
    let thickness = SurfaceThickness::World(0.15);
    let cloth = crumpled_sheet(200, 0.0);
    let ball = icosphere(3, 4.0);
    // The later one is the first side.
    world.spawn(&ball.clone().translate(cloth.positions[60]), (thickness, method, SurfaceOrder(3)));
    world.spawn(&cloth, (thickness, method, SelfCollision, SurfaceOrder(2)));
    let points = ball.positions.iter().map(|&point| Vec3::from(point)).collect();
    let trimesh = SharedShape::trimesh(points, ball.triangles).expect("the mesh is sound");
    for shape in [trimesh, SharedShape::ball(4.0)] {
        let place = Transform::from_translation(Vec3::from(cloth.positions[75]));
        world.app.world_mut().spawn((RigidShape(shape), place));
    }
    world
}

/// The touching pairs, as the filter would see them. For a solid, the triangle is `None`.
fn touching(world: &World) -> Vec<CandidatePair> {
    let store = world.app.world().resource::<ContactStore>();
    let pairs = store.pairs().iter().flat_map(|pair| {
        let has_triangles = world.app.world().get::<SurfacePositions>(pair.b.entity()).is_some();
        pair.touching.iter().map(move |touching| CandidatePair {
            a: pair.a,
            triangle_a: TriangleId(touching.triangle_a),
            b: pair.b,
            triangle_b: has_triangles.then_some(TriangleId(touching.triangle_b)),
        })
    });
    pairs.collect()
}

#[test]
fn exactly_the_pairs_that_the_filter_refuses_are_missing() {
    for method in ContactMethod::ALL {
        let mut without = scene(method);
        without.app.update();
        let all = touching(&without);
        let expected: Vec<CandidatePair> = all.iter().copied().filter(answer).collect();
        let sides: BTreeSet<_> = expected.iter().map(|pair| [pair.a.entity(), pair.b.entity()]).collect();
        assert!(sides.len() == 6 && expected.len() + 20 < all.len(), "{method:?}: {sides:?}");
        let mut with = scene(method);
        let asked: Arc<Mutex<Vec<Asked>>> = Arc::default();
        let log = Arc::clone(&asked);
        with.app.insert_resource(ContactFilter::new(move |pair| {
            let may_touch = answer(pair);
            log.lock().expect("no thread has panicked").push((*pair, may_touch));
            may_touch
        }));
        with.app.update();
        assert_eq!(touching(&with), expected, "{method:?}");
        let asked = asked.lock().expect("no thread has panicked");
        let candidates: BTreeSet<String> = asked.iter().map(|(pair, _)| format!("{pair:?}")).collect();
        assert_eq!(candidates.len(), asked.len(), "no pair is asked about twice");
        assert!(all.iter().all(|pair| candidates.contains(&format!("{pair:?}"))));
        let filter =
            with.app.world().resource::<DetectionDiagnostics>().stages.iter().find(|stage| stage.name == "filter");
        let filter = filter.expect("the stage ran");
        let left = asked.iter().filter(|(_, may_touch)| *may_touch).count();
        assert_eq!([filter.pairs_in, filter.pairs_out], [asked.len(), left], "only candidates are asked about");
    }
}

#[test]
fn without_a_filter_no_stage_runs() {
    let mut world = scene(ContactMethod::Exact);
    world.app.update();
    let stages = &world.app.world().resource::<DetectionDiagnostics>().stages;
    assert!(stages.iter().any(|stage| stage.name == "exact"));
    assert!(!stages.iter().any(|stage| stage.name == "filter"));
}

#[test]
fn what_does_not_change_is_not_asked_about_until_the_filter_changes() {
    let mut world = scene(ContactMethod::Exact);
    let asked = Arc::new(Mutex::new(0));
    let refuses = Arc::new(AtomicBool::new(false));
    let (count, switch) = (Arc::clone(&asked), Arc::clone(&refuses));
    let new_filter = move || {
        let (count, switch) = (Arc::clone(&count), Arc::clone(&switch));
        ContactFilter::new(move |_| {
            *count.lock().expect("no thread has panicked") += 1;
            !switch.load(Ordering::Relaxed)
        })
    };
    let mut tick = |change: &dyn Fn(&mut World)| {
        change(&mut world);
        world.app.update();
        let count = std::mem::take(&mut *asked.lock().expect("no thread has panicked"));
        (count, touching(&world).len())
    };
    let (_, all) = tick(&|_| {});
    let (first, touching) = tick(&|world| world.app.insert_resource(new_filter()).update());
    assert!(first > 0);
    assert_eq!(touching, all);
    refuses.store(true, Ordering::Relaxed);
    assert_eq!(tick(&|_| {}), (0, all), "the game has not said that the filter has changed");
    assert_eq!(tick(&|world| world.app.world_mut().resource_mut::<ContactFilter>().set_changed()), (first, 0));
    refuses.store(false, Ordering::Relaxed);
    assert_eq!(tick(&|world| _ = world.app.insert_resource(new_filter())), (first, all));
    refuses.store(true, Ordering::Relaxed);
    assert_eq!(tick(&|world| _ = world.app.insert_resource(new_filter())), (first, 0));
    assert_eq!(tick(&|world| _ = world.app.world_mut().remove_resource::<ContactFilter>()), (0, all));
}

#[test]
fn sweeps_and_the_guard_ask_the_filter() {
    for refuses in [false, true] {
        let mut world = World::responding();
        let thin = SurfaceThickness::World(0.01);
        let floor = world.spawn(&grid(2, 2, 4.0, 4.0, Diagonals::Uniform), (thin, SurfaceOrder(2)));
        let falling = world.shoot_down((thin, SurfaceOrder(5)));
        if refuses {
            // The sides come in the order of contacts, whatever the guard calls first.
            world.app.insert_resource(ContactFilter::new(move |pair| {
                assert_eq!([pair.a.entity(), pair.b.entity()], [floor, falling]);
                assert!(pair.triangle_a.0 < 8 && pair.triangle_b.is_some_and(|triangle| triangle.0 < 2));
                false
            }));
        }
        world.tick();
        let impacts = world
            .app
            .world_mut()
            .run_system_cached(|impacts: SurfaceImpacts| impacts.iter().count())
            .expect("the system runs");
        let height = world.height(falling);
        assert_eq!(height < 0.0, refuses, "it is at {height}");
        assert!(impacts == 0 || !refuses);
    }
}
