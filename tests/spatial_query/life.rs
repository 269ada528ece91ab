//! What queries see, and when: filters, components, ticks, and threads.

use std::sync::{
    Mutex,
    atomic::{AtomicUsize, Ordering},
};

use bevy_app::prelude::*;
use bevy_circumsphere::{ContactStore, RayHit, detection::SurfaceStates, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, grid, icosphere},
};
use glam::Vec3;

use crate::world::{ALL, app, query, random_vector, spawn, wavy, write_positions};

/// The entities along a ray from above, in order.
fn from_above(app: &mut App) -> Vec<Entity> {
    query(app, |query| query.ray_hits(Vec3::new(0.1, 9.0, 0.2), Vec3::NEG_Y, 20.0, &ALL))
        .iter()
        .map(|hit| hit.entity)
        .collect()
}

fn sheet(app: &mut App, height: f32, extra: impl Bundle) -> Entity {
    spawn(app, &grid(4, 4, 2.0, 2.0, Diagonals::Uniform), (Transform::from_xyz(0.0, height, 0.0), extra))
}

#[test]
fn before_the_first_detection_there_is_nothing_to_find() {
    let mut app = app();
    sheet(&mut app, 0.0, ());
    app.world_mut().spawn(RigidShape(SharedShape::ball(1.0)));
    query(&mut app, |query| {
        assert_eq!(query.cast_ray(Vec3::Y, Vec3::NEG_Y, 5.0, &ALL), None);
        assert_eq!(query.ray_hits(Vec3::Y, Vec3::NEG_Y, 5.0, &ALL), []);
        assert_eq!(query.closest_point(Vec3::Y, f32::INFINITY, &ALL), None);
        assert_eq!(query.ball_intersections(Vec3::Y, 5.0, &ALL), []);
        assert_eq!(query.cast_ball(Vec3::Y, 0.5, Vec3::NEG_Y, 5.0, &ALL), None);
    });
    app.update();
    assert!(!from_above(&mut app).is_empty());
}

#[test]
fn what_takes_no_part_is_not_found_and_comes_back() {
    let mut app = app();
    let sheets: Vec<Entity> = (0..4).map(|height| sheet(&mut app, 3.0 - height as f32, ())).collect();
    app.update();
    assert_eq!(from_above(&mut app), sheets);
    let positions = app.world().get::<SurfacePositions>(sheets[1]).expect("it is a surface").clone();
    app.world_mut().entity_mut(sheets[0]).insert(SurfaceDisabled);
    write_positions(&mut app, sheets[1], vec![Vec3::NAN; positions.0.len()]);
    write_positions(&mut app, sheets[2], Vec::new());
    app.update();
    assert_eq!(from_above(&mut app), sheets[3..]);
    app.world_mut().entity_mut(sheets[0]).remove::<SurfaceDisabled>();
    write_positions(&mut app, sheets[1], positions.0.clone());
    write_positions(&mut app, sheets[2], positions.0);
    app.world_mut().despawn(sheets[3]);
    app.update();
    assert_eq!(from_above(&mut app), sheets[..3]);
}

#[test]
fn what_is_only_queried_is_found_and_touches_nothing() {
    let mut app = app();
    let thick = SurfaceThickness::World(0.2);
    let fold = || (thick, SelfCollision, ContactEventsEnabled);
    let upper = sheet(&mut app, 0.1, fold());
    let lower = sheet(&mut app, 0.0, fold());
    let ball = app.world_mut().spawn(RigidShape(SharedShape::ball(0.5))).id();
    app.update();
    let touching = |app: &App| app.world().resource::<ContactStore>().touching_count();
    assert!(touching(&app) > 0);
    assert_eq!(from_above(&mut app)[..1], [ball]);
    for entity in [upper, lower] {
        app.world_mut().entity_mut(entity).insert(QueryOnly);
    }
    app.update();
    assert_eq!(touching(&app), 0);
    assert_eq!(app.world().resource::<ContactStore>().pairs().len(), 0);
    let found = from_above(&mut app);
    assert!(found.contains(&upper) && found.contains(&lower) && found.contains(&ball), "{found:?}");
    app.world_mut().entity_mut(lower).remove::<QueryOnly>();
    app.world_mut().entity_mut(ball).insert(QueryOnly);
    app.update();
    assert!(from_above(&mut app).contains(&ball));
    let pairs = app.world().resource::<ContactStore>().pairs();
    assert!(pairs.iter().all(|pair| (pair.a.entity(), pair.b.entity()) == (lower, lower)));
    app.world_mut().entity_mut(ball).remove::<QueryOnly>();
    app.update();
    assert!(touching(&app) > 0);
}

#[test]
fn filters_choose_by_layer_entity_and_side() {
    let mut app = app();
    let layer = |group: u32| SurfaceLayers { memberships: 1 << group, filters: u32::MAX };
    let sheets: Vec<Entity> = (0..3).map(|number| sheet(&mut app, 2.0 - number as f32, layer(number))).collect();
    let down = spawn(
        &mut app,
        &grid(4, 4, 2.0, 2.0, Diagonals::Uniform),
        Transform { scale: Vec3::splat(1.0), ..Transform::from_xyz(0.0, -1.0, 0.0) }
            .with_rotation(glam::Quat::from_rotation_x(std::f32::consts::PI)),
    );
    app.update();
    let all = sheets.clone();
    query(&mut app, move |query| {
        let hits = |filter: &SurfaceQueryFilter| {
            let hits = query.ray_hits(Vec3::new(0.1, 9.0, 0.2), Vec3::NEG_Y, 20.0, filter);
            let first = query.cast_ray(Vec3::new(0.1, 9.0, 0.2), Vec3::NEG_Y, 20.0, filter);
            assert_eq!(first, hits.first().copied());
            hits.iter().map(|hit| hit.entity).collect::<Vec<_>>()
        };
        assert_eq!(hits(&ALL), [all[0], all[1], all[2], down]);
        let second = SurfaceLayers { memberships: u32::MAX, filters: 0b10 };
        assert_eq!(hits(&ALL.with_layers(second)), [all[1]]);
        assert_eq!(hits(&ALL.excluding(&[all[0], down])), [all[1], all[2]]);
        let chosen = all[2];
        let predicate = move |entity: Entity| entity == chosen;
        assert_eq!(hits(&ALL.with_predicate(&predicate)), [all[2]]);
        assert_eq!(hits(&ALL.culling_back_faces()), all);
        let closest = query.closest_point(Vec3::new(0.0, 5.0, 0.0), 10.0, &ALL.excluding(&all));
        assert_eq!(closest.map(|closest| closest.entity), Some(down));
    });
}

/// Rays at a surface, as bits.
fn bits(query: &SurfaceQuery, seed: u64) -> Vec<Option<[u32; 9]>> {
    let mut random = Random::new(seed);
    (0..400)
        .map(|_| {
            let (origin, target) = (random_vector(&mut random) * 4.0, random_vector(&mut random));
            query.cast_ray(origin, target - origin, f32::INFINITY, &ALL).map(|hit: RayHit| {
                let numbers =
                    [hit.distance, hit.point.x, hit.point.y, hit.point.z, hit.normal.x, hit.normal.y, hit.normal.z];
                let mut bits = [0; 9];
                for (bits, number) in bits.iter_mut().zip(numbers) {
                    *bits = number.to_bits();
                }
                bits[7] = hit.triangle.map_or(u32::MAX, |triangle| triangle.0);
                bits[8] = u32::from(hit.is_back_face);
                bits
            })
        })
        .collect()
}

#[test]
fn many_threads_that_ask_at_once_get_the_same_answers() {
    let mesh = icosphere(4, 1.0);
    let mut app = app();
    let entity = spawn(&mut app, &mesh, ());
    app.update();
    // Every tick the tree is behind, and all threads want it first.
    for tick in 0..4 {
        write_positions(&mut app, entity, wavy(&mesh, f64::from(tick)));
        app.update();
        assert!(!app.world().resource::<SurfaceStates>().get(entity).expect("it was detected").is_tree_current());
        let answers = query(&mut app, |query| {
            let answers = Mutex::new(Vec::new());
            std::thread::scope(|scope| {
                for _ in 0..4 {
                    scope.spawn(|| {
                        let found = bits(query, 5);
                        answers.lock().expect("no thread panics").push(found);
                    });
                }
            });
            answers.into_inner().expect("no thread panics")
        });
        assert!(answers[0].iter().flatten().count() > 50 && answers[0].iter().any(Option::is_none));
        assert!(answers.iter().all(|other| *other == answers[0]));
        // The same as in a fresh app.
        let mut fresh = crate::world::app();
        let other = spawn(&mut fresh, &mesh, ());
        write_positions(&mut fresh, other, wavy(&mesh, f64::from(tick)));
        fresh.update();
        assert!(query(&mut fresh, |query| bits(query, 5)) == answers[0], "tick {tick}");
    }
}

#[test]
fn systems_can_query_side_by_side_and_between_ticks() {
    static HITS: AtomicUsize = AtomicUsize::new(0);
    fn ask(query: SurfaceQuery) {
        let hit = query.cast_ray(Vec3::new(0.1, 9.0, 0.2), Vec3::NEG_Y, 20.0, &SurfaceQueryFilter::default());
        HITS.fetch_add(usize::from(hit.is_some()), Ordering::Relaxed);
    }
    let mut app = app();
    app.add_systems(PreUpdate, ask);
    app.add_systems(Update, (ask, ask).in_set(DeformableSystems::Respond));
    app.add_systems(Update, ask.in_set(DeformableSystems::Predict));
    let entity = sheet(&mut app, 0.0, ());
    app.update();
    // Before the first detection nothing, after it both.
    assert_eq!(HITS.swap(0, Ordering::Relaxed), 2);
    // Between `Prepare` and `Detect`, the state of the last detection.
    sheet(&mut app, -1.0, SurfaceOrder(7));
    app.world_mut().get_mut::<Transform>(entity).expect("it has one").translation.x = 100.0;
    app.update();
    assert_eq!(HITS.swap(0, Ordering::Relaxed), 4);
}

#[test]
fn queries_do_not_change_what_is_detected() {
    let mesh = grid(20, 20, 2.0, 2.0, Diagonals::Alternating);
    let run = |asks: bool| {
        let mut app = app();
        let thick = SurfaceThickness::World(0.05);
        let moving = spawn(&mut app, &mesh, (thick, SelfCollision));
        spawn(&mut app, &icosphere(3, 0.5), (thick, Transform::from_xyz(0.0, -0.4, 0.0)));
        let mut all = Vec::new();
        for tick in 0..12 {
            write_positions(&mut app, moving, wavy(&mesh, f64::from(tick) * 0.2));
            app.update();
            if asks {
                assert!(query(&mut app, |query| bits(query, 9).iter().flatten().count()) > 20);
            }
            all.push(app.world().resource::<ContactStore>().contacts().map(|contact| format!("{contact:?}")).collect());
        }
        all
    };
    let without: Vec<Vec<String>> = run(false);
    assert!(without.iter().all(|contacts| contacts.len() > 10));
    assert!(without == run(true));
}
