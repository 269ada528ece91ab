//! A margin reports contacts that are near without touching.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use circumsphere_support::scenes::{icosphere, sheet_stack};
use glam::{Quat, Vec3};

use crate::world::{
    Announcement::{Ended, Started},
    THIN, all, app, assert_consistent, assert_near, at, ball, between, deepest, insert, keep_journal, messages,
    rounding, sheet, spawn, store,
};

fn set_margin(app: &mut App, margin: f32) {
    app.world_mut().resource_mut::<CircumsphereSettings>().margin = margin;
}

#[test]
fn beyond_the_contact_distance_only_a_margin_sees_and_separations_are_positive() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let sheet = spawn(&mut app, &sheet(), (THIN, ContactEventsEnabled));
    let ball = spawn(&mut app, &ball(), THIN);
    // Gaps larger than the contact distance of 0.1, and margins that do or do not reach them.
    for (gap, margin, seen) in [
        (0.15, 0.0, false),
        (0.15, 0.049, false),
        (0.15, 0.051, true),
        (0.5, 0.3, false),
        (0.5, 0.5, true),
        (3.0, 4.0, true),
    ] {
        set_margin(&mut app, margin);
        insert(&mut app, ball, at(0.1, 0.5 + gap, 0.2));
        app.update();
        let contacts = between(&mut app, sheet, ball);
        assert_eq!(!contacts.is_empty(), seen, "{gap} within {margin}");
        if seen {
            assert_near(deepest(&contacts).separation, gap - 0.1, rounding(4.0), gap);
        }
        for contact in &contacts {
            assert!(contact.separation > 0.0 && contact.separation <= margin, "{contact:?}");
            assert_consistent(app.world(), contact, 4.0);
        }
        assert_eq!(store(&app).touching_count(), 0);
        assert!(!is_touching(&mut app, sheet, ball));
        assert_eq!(messages(&mut app), []);
    }
    insert(&mut app, ball, at(0.1, 0.5 + 0.09, 0.2));
    app.update();
    assert!(is_touching(&mut app, sheet, ball) && is_touching(&mut app, ball, sheet));
    assert!(!is_touching(&mut app, ball, ball));
}

fn is_touching(app: &mut App, a: Entity, b: Entity) -> bool {
    let read = move |contacts: SurfaceContacts| contacts.is_touching(a, b);
    app.world_mut().run_system_once(read).expect("contacts can be read")
}

#[test]
fn touching_pairs_and_events_do_not_depend_on_the_margin() {
    for method in ContactMethod::ALL {
        let mut worlds = [0.0, 0.01, 0.2, 0.6].map(|margin| {
            let mut app = app();
            keep_journal(&mut app, Update);
            set_margin(&mut app, margin);
            let floor = spawn(&mut app, &sheet(), (THIN, method, ContactEventsEnabled));
            let turned = Quat::from_rotation_y(0.2);
            let ball = spawn(&mut app, &icosphere(2, 0.5), (THIN, method, at(0.1, 2.0, 0.2).with_rotation(turned)));
            spawn(&mut app, &sheet_stack(3, 0.15, 5), (THIN, method, SelfCollision, at(1.0, 0.05, 1.0)));
            app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), at(-1.0, 0.52, 0.3)));
            (app, floor, ball)
        });
        let mut found_any = false;
        for gap in [1.0, 0.3, 0.11, 0.05, -0.02, 0.05, 0.15, 1.0] {
            let results = worlds.each_mut().map(|(app, floor, ball)| {
                insert(app, *ball, at(0.1, 0.5 + gap, 0.2));
                app.update();
                let touching: Vec<_> = store(app).touching().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
                let heard = messages(app);
                let with_ball = heard.iter().find_map(|message| match message {
                    Started(a, b) if (a, b) == (floor, ball) => Some("started"),
                    Ended(a, b) if (a, b) == (floor, ball) => Some("ended"),
                    _ => None,
                });
                (touching, heard.len(), with_ball)
            });
            found_any |= !results[0].0.is_empty();
            for result in &results[1..] {
                assert!(*result == results[0], "{method:?} at {gap}: {:?} and {:?}", result.2, results[0].2);
            }
        }
        assert!(found_any);
    }
}

#[test]
fn a_margin_reaches_shapes_of_every_kind() {
    for (shape, reach) in [
        (SharedShape::ball(0.4), 0.4),
        (SharedShape::cuboid(0.4, 0.4, 0.4), 0.4),
        (SharedShape::capsule_y(0.2, 0.2), 0.4),
        (SharedShape::halfspace(Vec3::NEG_Y), 0.0),
        (SharedShape::cylinder(0.4, 0.2), 0.4),
    ] {
        for scale in [1.0, 0.5, 4.0] {
            let mut app = app();
            set_margin(&mut app, 0.2);
            spawn(&mut app, &sheet(), THIN);
            let shape = app.world_mut().spawn(RigidShape(shape.clone())).id();
            // Only the surface has a thickness, so contacts reach up to 0.05 + 0.2.
            for (gap, seen) in [(0.24, true), (0.26, false), (0.06, true), (0.04, true)] {
                insert(&mut app, shape, at(0.1, reach * scale + gap, 0.2).with_scale(Vec3::splat(scale)));
                app.update();
                let contacts = all(&mut app);
                assert_eq!(!contacts.is_empty(), seen, "{gap} at scale {scale}");
                if seen {
                    // parry's own queries use f32 with absolute tolerances.
                    assert_near(deepest(&contacts).separation, gap - 0.05, 1.0e-4, (gap, scale));
                }
            }
        }
    }
}

#[test]
fn a_margin_is_in_world_units_whatever_the_scale_of_a_surface() {
    for scale in [0.25, 1.0, 8.0] {
        let mut app = app();
        set_margin(&mut app, 0.2);
        let transform = at(0.0, 0.0, 0.0).with_scale(Vec3::splat(scale));
        let sheet = spawn(&mut app, &sheet().scale(1.0 / scale), (THIN, transform));
        let ball = spawn(&mut app, &ball(), THIN);
        for (gap, seen) in [(0.29, true), (0.31, false)] {
            insert(&mut app, ball, at(0.1, 0.5 + gap, 0.2));
            app.update();
            let contacts = between(&mut app, sheet, ball);
            assert_eq!(!contacts.is_empty(), seen, "{gap} at scale {scale}");
            if seen {
                assert_near(deepest(&contacts).separation, gap - 0.1, rounding(4.0), (gap, scale));
            }
        }
    }
}
