//! Apps that are put together in unusual ways.

use std::time::Duration;

use bevy_app::{TaskPoolOptions, TaskPoolPlugin, prelude::*};
use bevy_circumsphere::{
    ContactEventsPlugin, RollbackPlugin, SurfaceDetection,
    detection::{BruteForceBroadPhasePlugin, TreeBroadPhasePlugin},
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_ecs::prelude::*;
use bevy_time::{TimePlugin, TimeUpdateStrategy};
use bevy_transform::TransformPlugin;
use circumsphere_support::{
    scenes::{Mesh, icosphere, merge},
    warnings,
};
use glam::Vec3;

use crate::world::{
    Announcement::Started, Called, OVER_A_FACE, POOL_THREADS, THIN, all, app, app_in, assert_near, at, ball, between,
    deepest, fingerprint, insert, keep_journal, messages, of, place, points, rounding, set_ticks, sheet, spawn, status,
    store, surface, write_positions,
};

fn triangle() -> Mesh {
    Mesh { positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], triangles: vec![[0, 2, 1]] }
}

#[test]
fn an_empty_world_has_no_contacts() {
    let mut app = app();
    for tick in 1..4 {
        app.update();
        assert_eq!(store(&app).tick(), tick);
        assert_eq!(all(&mut app), []);
    }
    let never = app.world_mut().spawn_empty().id();
    assert_eq!(of(&mut app, never), []);
    assert_eq!(between(&mut app, never, never), []);
}

#[test]
fn one_triangle_touches_nothing_and_two_touch_each_other() {
    let mut app = app();
    let first = spawn(&mut app, &triangle(), (THIN, SelfCollision));
    app.update();
    assert_eq!(status(&app, first), SurfaceStatus::Active);
    assert_eq!(all(&mut app), []);
    let second = spawn(&mut app, &triangle(), (THIN, at(0.1, 0.04, 0.1)));
    app.update();
    let contacts = between(&mut app, first, second);
    assert_near(deepest(&contacts).distance, 0.04, rounding(1.0), "parallel triangles");
    let swapped = between(&mut app, second, first);
    assert_eq!(contacts.len(), swapped.len());
}

#[test]
fn a_surface_alone_with_itself_touches_itself() {
    let mut app = app();
    let balls = merge(&[icosphere(2, 0.5), icosphere(2, 0.5).translate([0.0, 1.03, 0.0])]);
    let surface = spawn(&mut app, &balls, (THIN, SelfCollision));
    app.update();
    assert_near(deepest(&between(&mut app, surface, surface)).distance, 0.03, rounding(1.5), "pole over pole");
}

fn sheet_and_ball(app: &mut App) -> [Entity; 2] {
    [
        spawn(app, &sheet(), (THIN, Called("sheet"), ContactEventsEnabled)),
        spawn(app, &ball(), (THIN, Called("ball"), at(0.1, 0.53, 0.2))),
    ]
}

#[track_caller]
fn assert_touches(app: &mut App, [sheet, ball]: [Entity; 2]) {
    assert_near(deepest(&between(app, sheet, ball)).distance, 0.03, rounding(1.0), "sheet and ball");
}

#[test]
fn plugins_added_after_the_surfaces_see_them() {
    let mut reference = app();
    sheet_and_ball(&mut reference);
    reference.update();
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere, ContactMethod::BoundingSphere] {
        let mut late = App::new();
        let bodies = sheet_and_ball(&mut late);
        for body in bodies {
            insert(&mut late, body, method);
        }
        late.update();
        late.add_plugins(DeformableCollisionPlugins::new(Update));
        keep_journal(&mut late, Update);
        let latest = spawn(&mut late, &ball(), (THIN, Called("latest"), method, at(1.0, 0.53, 0.2)));
        late.update();
        assert_eq!(status(&late, bodies[0]), SurfaceStatus::Active);
        assert_eq!(messages(&mut late), [Started(bodies[0], bodies[1]), Started(bodies[0], latest)], "{method:?}");
        if method == ContactMethod::Exact {
            assert_touches(&mut late, bodies);
            assert_eq!(fingerprint(&late)[0], fingerprint(&reference)[0]);
        }
        assert!(!of(&mut late, latest).is_empty(), "{method:?}");
    }
}

#[test]
fn shapes_from_before_the_plugins_are_seen() {
    let mut app = App::new();
    let shape = app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), at(0.1, 0.52, 0.2))).id();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let sheet = spawn(&mut app, &sheet(), THIN);
    app.update();
    assert_near(deepest(&between(&mut app, sheet, shape)).distance, 0.02, rounding(1.0), "shape");
}

#[test]
fn two_apps_in_one_process_know_nothing_of_each_other() {
    let (mut one, mut other) = (app(), app());
    let bodies = sheet_and_ball(&mut one);
    let others = sheet_and_ball(&mut other);
    place(&mut other, others[1], Vec3::Y * 4.0);
    one.update();
    other.update();
    assert_touches(&mut one, bodies);
    assert_eq!(all(&mut other), []);
    one.update();
    assert_eq!((store(&one).tick(), store(&other).tick()), (2, 1));
}

#[test]
fn every_schedule_can_host_detection() {
    for (name, mut app) in [
        ("First", app_in(First)),
        ("PreUpdate", app_in(PreUpdate)),
        ("PostUpdate", app_in(PostUpdate)),
        ("Last", app_in(Last)),
    ] {
        let bodies = sheet_and_ball(&mut app);
        app.update();
        assert_eq!(store(&app).tick(), 1, "{name}");
        assert_touches(&mut app, bodies);
    }
}

#[test]
fn detection_stands_beside_the_plugins_that_bring_clock_pools_and_transforms() {
    let mut app = App::new();
    let mut task_pool_options = TaskPoolOptions::default();
    task_pool_options.compute.min_threads = POOL_THREADS;
    task_pool_options.compute.max_threads = POOL_THREADS;
    let pools = TaskPoolPlugin { task_pool_options };
    app.add_plugins((DeformableCollisionPlugins::default(), pools, TimePlugin, TransformPlugin));
    set_ticks(&mut app, 1);
    app.finish();
    app.cleanup();
    let bodies = sheet_and_ball(&mut app);
    app.update();
    app.update();
    assert_touches(&mut app, bodies);
}

#[test]
fn detection_can_be_run_by_hand() {
    let mut app = app();
    let [sheet, ball] = sheet_and_ball(&mut app);
    app.world_mut().run_schedule(SurfaceDetection);
    assert_eq!((store(&app).tick(), store(&app).contact_count()), (1, 0), "nothing was prepared yet");
    app.update();
    assert_touches(&mut app, [sheet, ball]);

    // A solver detects again within a tick, with the positions of a substep.
    let moved: Vec<Vec3> = points(&crate::world::ball()).iter().map(|point| *point + Vec3::Y * 0.03).collect();
    write_positions(&mut app, ball, &moved);
    app.world_mut().run_schedule(SurfaceDetection);
    assert_eq!(store(&app).tick(), 3);
    assert_near(deepest(&between(&mut app, sheet, ball)).distance, 0.06, rounding(1.0), "by hand");
}

#[test]
fn detection_by_hand_survives_what_has_changed_since_it_was_prepared() {
    type Change = fn(&mut App, Entity);
    let changes: [(&str, Change); 6] = [
        ("despawned", |app, ball| {
            app.world_mut().despawn(ball);
        }),
        ("no surface any more", |app, ball| {
            app.world_mut().entity_mut(ball).remove::<DeformableSurface>();
        }),
        ("another mesh", |app, ball| insert(app, ball, surface(&icosphere(1, 0.5)))),
        ("no positions", |app, ball| write_positions(app, ball, &[])),
        ("more positions", |app, ball| write_positions(app, ball, &[Vec3::ZERO; 1000])),
        ("NaN", |app, ball| write_positions(app, ball, &[Vec3::NAN; 162])),
    ];
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere, ContactMethod::BoundingSphere] {
        for (name, change) in changes {
            let mut app = app();
            let bodies = sheet_and_ball(&mut app);
            let second = spawn(&mut app, &ball(), (THIN, Called("second"), at(-1.3, 0.53, 0.2)));
            for body in [bodies[0], bodies[1], second] {
                insert(&mut app, body, (method, SelfCollision));
            }
            app.update();
            let untouched = of(&mut app, second);
            assert!(!untouched.is_empty());
            change(&mut app, bodies[1]);
            app.world_mut().run_schedule(SurfaceDetection);
            assert_eq!(of(&mut app, second), untouched, "{method:?}, {name}");
            assert!(all(&mut app).iter().all(|contact| !contact.distance.is_nan()), "{method:?}, {name}");
            app.update();
            assert_eq!(of(&mut app, second), untouched, "{method:?}, {name}");
        }
    }
}

fn warnings_about(word: &str) -> usize {
    warnings::kept().iter().filter(|warning| warning.contains(word)).count()
}

#[test]
fn a_fixed_schedule_without_a_clock_warns_and_does_not_panic() {
    // No other test in this process uses this fixed schedule.
    let before = warnings_about("FixedFirst");
    let mut app = app_in(FixedFirst);
    let bodies = sheet_and_ball(&mut app);
    app.finish();
    app.cleanup();
    app.update();
    app.update();
    assert_eq!(store(&app).tick(), 0);
    assert_eq!(all(&mut app), []);
    assert_eq!(warnings_about("FixedFirst"), before + 1);
    // The schedule itself works: run by hand, it detects contacts.
    app.world_mut().run_schedule(FixedFirst);
    assert_touches(&mut app, bodies);

    // With a clock there is nothing to warn about, whichever plugin came first.
    let before = warnings_about("FixedLast");
    let mut app = app_in(FixedLast);
    app.add_plugins(TimePlugin);
    app.finish();
    app.cleanup();
    assert_eq!(warnings_about("FixedLast"), before);
}

#[test]
fn a_mesh_that_does_not_fit_a_smooth_body_warns_once() {
    let ball = icosphere(3, 1.0);
    let round: Vec<Vec3> = ball.positions.iter().copied().map(Vec3::from_array).collect();
    // Every second vertex lies beside the ball.
    let rough = round.iter().enumerate().map(|(vertex, position)| *position * if vertex % 2 == 0 { 1.0 } else { 1.03 });
    let warned = |positions: Vec<Vec3>, shape: SurfaceShape| {
        let mut app = app();
        let (surface, _) = DeformableSurface::from_mesh(&positions, &ball.triangles).expect("a ball is a mesh");
        let entity = app.world_mut().spawn((surface, SurfacePositions(positions), shape)).id();
        let before = warnings_about("does not fit a smooth body");
        app.update();
        app.world_mut().get_mut::<SurfacePositions>(entity).expect("it has positions").0[0] *= 1.001;
        app.update();
        warnings_about("does not fit a smooth body") - before
    };
    assert_eq!(warned(rough.clone().collect(), SurfaceShape::Smooth), 1);
    assert_eq!(warned(rough.collect(), SurfaceShape::Flat), 0);
    assert_eq!(warned(round.clone(), SurfaceShape::Smooth), 0);
}

#[test]
fn the_group_can_be_put_together_otherwise() {
    let mut reference = app();
    let bodies = sheet_and_ball(&mut reference);
    reference.update();
    assert_touches(&mut reference, bodies);

    let mut brute_force = App::new();
    brute_force.add_plugins(
        DeformableCollisionPlugins::new(Update)
            .build()
            .disable::<TreeBroadPhasePlugin>()
            .add(BruteForceBroadPhasePlugin),
    );
    sheet_and_ball(&mut brute_force);
    brute_force.update();
    assert_eq!(fingerprint(&brute_force), fingerprint(&reference));

    let mut silent = App::new();
    silent.add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<ContactEventsPlugin>());
    sheet_and_ball(&mut silent);
    silent.update();
    silent.update();
    assert_eq!(fingerprint(&silent), fingerprint(&reference));

    // The app's own settings are kept, whichever comes first.
    let mut own = App::new();
    own.insert_resource(CircumsphereSettings { margin: 0.5, ..Default::default() });
    own.add_plugins(DeformableCollisionPlugins::new(Update));
    let [_, ball] = sheet_and_ball(&mut own);
    place(&mut own, ball, OVER_A_FACE + Vec3::Y * 0.9);
    own.update();
    assert!(!all(&mut own).is_empty());
}

#[test]
fn a_volume_to_keep_on_an_open_mesh_is_warned_of_once() {
    let before = warnings_about("volume_compliance");
    let (closed, positions) = surface(&ball());
    XpbdBody::new(&closed, &positions, XpbdMaterial::SOFT).expect("the body is valid");
    let (open, positions) = surface(&sheet());
    XpbdBody::new(&open, &positions, XpbdMaterial::CLOTH).expect("the body is valid");
    assert_eq!(warnings_about("volume_compliance"), before, "there is nothing to warn about");
    for _ in 0..3 {
        XpbdBody::new(&open, &positions, XpbdMaterial::SOFT).expect("the body is valid");
    }
    assert_eq!(warnings_about("volume_compliance"), before + 1);
    assert_eq!(warnings_about("weld_within"), 1);
}

/// A cloth that falls onto a ball for half a second, with the plugins in an order.
fn fallen(order: [usize; 4]) -> (Vec<Vec3>, String) {
    let mut app = App::new();
    for plugin in order {
        match plugin {
            0 => app.add_plugins(DeformableCollisionPlugins::default()),
            1 => app.add_plugins(XpbdResponsePlugin::default()),
            2 => app.add_plugins((TaskPoolPlugin::default(), TimePlugin, TransformPlugin)),
            _ => app.add_plugins(RollbackPlugin::new(FixedPostUpdate)),
        };
    }
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs(1) / 64));
    let (cloth, positions) = surface(&sheet());
    let body = XpbdBody::new(&cloth, &positions, XpbdMaterial::CLOTH).unwrap();
    let cloth =
        app.world_mut().spawn((cloth, positions, body, Called("cloth"), SweptCollision, at(0.0, 0.6, 0.0))).id();
    app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), Called("ball")));
    for _ in 0..32 {
        app.update();
    }
    (app.world().get::<SurfacePositions>(cloth).unwrap().0.clone(), format!("{:?}", fingerprint(&app)))
}

#[test]
fn the_order_of_plugins_does_not_matter() {
    let expected = fallen([2, 0, 1, 3]);
    assert!(expected.0.iter().any(|position| position.y < -0.2), "it has fallen");
    assert!(expected.1.contains("ball"), "and touches the ball");
    for order in [[0, 1, 2, 3], [1, 0, 2, 3], [1, 2, 0, 3], [3, 1, 0, 2], [3, 2, 1, 0], [2, 3, 1, 0]] {
        assert!(fallen(order) == expected, "{order:?}");
    }
}

#[test]
fn adding_the_group_twice_is_refused_by_bevy() {
    let twice = std::panic::catch_unwind(|| {
        App::new()
            .add_plugins(DeformableCollisionPlugins::new(Update))
            .add_plugins(DeformableCollisionPlugins::default());
    });
    let refusal = twice.expect_err("it is refused");
    let message = refusal.downcast_ref::<String>().expect("Bevy says why");
    assert!(message.contains("DeformableSchedulePlugin") && message.contains("already added"), "{message}");
}
