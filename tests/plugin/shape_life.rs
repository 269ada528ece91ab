//! A rigid shape that is replaced, hidden, removed, and inserted again: only its current state counts.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::{entity_disabling::Disabled, prelude::*};
use circumsphere_support::scenes::{Diagonals, cuboid, grid};

use crate::shape_kinds::trimesh;
use crate::world::{
    Announcement::{Ended, Started},
    THIN, app, assert_near, at, ball, between, deepest, insert, keep_journal, messages, rounding, sheet, spawn, status,
};

/// A shape whose lowest point is `reach` below its center.
fn of_reach(kind: &str, reach: f32) -> RigidShape {
    RigidShape(match kind {
        "mesh" => trimesh(&cuboid([reach; 3], 2)),
        "other mesh" => trimesh(&cuboid([reach; 3], 1)),
        "ball" => SharedShape::ball(reach),
        "cuboid" => SharedShape::cuboid(0.3, reach, 0.3),
        kind => panic!("{kind}"),
    })
}

const KINDS: [&str; 4] = ["mesh", "other mesh", "ball", "cuboid"];

/// A sheet, and a shape above the inside of one of its faces.
fn scene(kind: &str) -> (App, Entity, Entity) {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let shape = app.world_mut().spawn((of_reach(kind, 0.4), at(0.1, 0.42, 0.2))).id();
    app.update();
    assert_reach(&mut app, sheet, shape, 0.4, kind);
    (app, sheet, shape)
}

#[track_caller]
fn assert_reach(app: &mut App, sheet: Entity, shape: Entity, reach: f32, what: impl std::fmt::Debug + Copy) {
    assert_eq!(status(app, shape), SurfaceStatus::Active, "{what:?}");
    let contacts = between(app, sheet, shape);
    assert!(!contacts.is_empty(), "{what:?}");
    assert_near(deepest(&contacts).distance, 0.42 - reach, rounding(1.0), what);
}

/// Hides an entity from queries.
fn hide(app: &mut App, entity: Entity) {
    insert(app, entity, Disabled);
}

fn show(app: &mut App, entity: Entity) {
    app.world_mut().entity_mut(entity).remove::<Disabled>();
}

#[test]
fn a_shape_replaced_while_its_entity_is_disabled_is_the_new_one_when_it_is_back() {
    for first in KINDS {
        for second in KINDS {
            for ticks in [[0, 0], [0, 1], [1, 0], [1, 1], [3, 2]] {
                let what = (first, second, ticks);
                let (mut app, sheet, shape) = scene(first);
                hide(&mut app, shape);
                for _ in 0..ticks[0] {
                    app.update();
                    assert_eq!(between(&mut app, sheet, shape), [], "{what:?}");
                }
                insert(&mut app, shape, of_reach(second, 0.41));
                for _ in 0..ticks[1] {
                    app.update();
                    assert_eq!(between(&mut app, sheet, shape), [], "{what:?}");
                }
                show(&mut app, shape);
                for _ in 0..2 {
                    app.update();
                    assert_reach(&mut app, sheet, shape, 0.41, what);
                }
                // Back to the first kind, while hidden again.
                hide(&mut app, shape);
                app.update();
                insert(&mut app, shape, of_reach(first, 0.39));
                app.update();
                show(&mut app, shape);
                app.update();
                assert_reach(&mut app, sheet, shape, 0.39, what);
                // Replaced and restored while hidden.
                hide(&mut app, shape);
                app.update();
                insert(&mut app, shape, of_reach(second, 0.37));
                insert(&mut app, shape, of_reach(first, 0.405));
                app.update();
                show(&mut app, shape);
                app.update();
                assert_reach(&mut app, sheet, shape, 0.405, what);
            }
        }
    }
}

#[test]
fn another_shape_may_appear_in_the_tick_in_which_the_first_one_is_hidden() {
    for first in KINDS {
        for second in KINDS {
            let what = (first, second);
            let (mut app, sheet, shape) = scene(first);
            hide(&mut app, shape);
            let other = app.world_mut().spawn((of_reach(second, 0.38), at(0.1, 0.42, 0.2))).id();
            app.update();
            assert_reach(&mut app, sheet, other, 0.38, what);
            assert_eq!(between(&mut app, sheet, shape), [], "{what:?}");
            insert(&mut app, shape, of_reach(second, 0.41));
            app.update();
            hide(&mut app, other);
            show(&mut app, shape);
            app.update();
            assert_reach(&mut app, sheet, shape, 0.41, what);
            assert_eq!(between(&mut app, sheet, other), [], "{what:?}");
            show(&mut app, other);
            app.update();
            assert_reach(&mut app, sheet, shape, 0.41, what);
            assert_reach(&mut app, sheet, other, 0.38, what);
            // Removed while hidden: nothing of it remains.
            hide(&mut app, other);
            app.world_mut().entity_mut(other).remove::<RigidShape>();
            app.update();
            show(&mut app, other);
            app.update();
            assert_eq!(between(&mut app, sheet, other), [], "{what:?}");
            assert!(app.world().get::<SurfacePositions>(other).is_none(), "{what:?}");
        }
    }
}

#[test]
fn a_shape_that_was_removed_and_inserted_again_is_the_new_one() {
    for first in KINDS {
        for second in KINDS {
            for ticks in [0, 1, 2] {
                let what = (first, second, ticks);
                let (mut app, sheet, shape) = scene(first);
                app.world_mut().entity_mut(shape).remove::<RigidShape>();
                for _ in 0..ticks {
                    app.update();
                    assert_eq!(between(&mut app, sheet, shape), [], "{what:?}");
                }
                insert(&mut app, shape, of_reach(second, 0.41));
                app.update();
                assert_reach(&mut app, sheet, shape, 0.41, what);
                assert_eq!(app.world().get::<SurfacePositions>(shape).is_some(), second.ends_with("mesh"), "{what:?}");
            }
        }
    }
}

#[test]
fn contacts_of_a_disabled_entity_end_and_start_again() {
    for kind in KINDS {
        let mut app = app();
        keep_journal(&mut app, Update);
        let sheet = spawn(&mut app, &sheet(), (THIN, ContactEventsEnabled));
        let shape = app.world_mut().spawn((of_reach(kind, 0.4), at(0.1, 0.42, 0.2))).id();
        app.update();
        assert_eq!(messages(&mut app), [Started(sheet, shape)], "{kind}");
        hide(&mut app, shape);
        app.update();
        assert_eq!(messages(&mut app), [Ended(sheet, shape)], "{kind}");
        insert(&mut app, shape, of_reach("ball", 0.4));
        app.update();
        assert_eq!(messages(&mut app), [], "{kind}");
        show(&mut app, shape);
        app.update();
        assert_eq!(messages(&mut app), [Started(sheet, shape)], "{kind}");
    }
}

#[test]
fn the_side_on_which_something_was_is_forgotten_while_a_mesh_is_hidden() {
    for hidden in [true, false] {
        let mut app = app();
        let floor = trimesh(&grid(8, 8, 4.0, 4.0, Diagonals::Uniform));
        let floor = app.world_mut().spawn(RigidShape(floor)).id();
        let body = spawn(&mut app, &ball(), (THIN, Sidedness::TwoSided, at(0.1, 0.52, 0.2)));
        app.update();
        if hidden {
            hide(&mut app, floor);
        }
        insert(&mut app, body, at(0.1, 0.48, 0.2));
        app.update();
        show(&mut app, floor);
        app.update();
        let contacts = between(&mut app, body, floor);
        let lowest = contacts.iter().min_by(|a, b| a.points.0.y.total_cmp(&b.points.0.y)).expect("the bodies touch");
        assert!((lowest.distance > 0.0) == hidden, "{hidden} {lowest:?}");
    }
}

#[test]
fn a_shape_on_a_surface_is_ignored() {
    for kind in KINDS {
        // The shape is added before the surface, with it, or after it.
        for order in 0..3 {
            let mut app = app();
            let sheet = spawn(&mut app, &sheet(), THIN);
            let far = at(0.1, 0.53, 0.2);
            let shape = of_reach(kind, 0.52);
            let body = match order {
                0 => {
                    let body = app.world_mut().spawn((shape, far)).id();
                    insert(&mut app, body, (crate::world::surface(&ball()), THIN));
                    body
                }
                1 => spawn(&mut app, &ball(), (THIN, far, shape)),
                _ => {
                    let body = spawn(&mut app, &ball(), (THIN, far));
                    app.update();
                    insert(&mut app, body, shape);
                    body
                }
            };
            for _ in 0..2 {
                app.update();
                let contacts = between(&mut app, body, sheet);
                assert!(!contacts.is_empty(), "{kind} {order}");
                // The distance is that of the ball's lowest vertex, not of the shape 0.02 below it.
                assert_near(deepest(&contacts).distance, 0.03, rounding(1.0), (kind, order));
                for contact in &contacts {
                    assert_eq!((contact.a, contact.b), (ContactSide::Surface(body), ContactSide::Surface(sheet)));
                }
            }
            // Without the surface, the shape counts.
            app.world_mut().entity_mut(body).remove::<DeformableSurface>();
            insert(&mut app, body, of_reach(kind, 0.51));
            app.update();
            let contacts = between(&mut app, sheet, body);
            assert!(!contacts.is_empty(), "{kind} {order}");
            assert_near(deepest(&contacts).distance, 0.02, rounding(1.0), (kind, order));
            assert_eq!(contacts[0].b, ContactSide::Shape(body));
        }
    }
}
