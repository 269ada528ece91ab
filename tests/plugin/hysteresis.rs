//! A pair held on the threshold of contact.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use glam::Vec3;

use crate::world::{
    Announcement::{Ended, Started},
    EXACT_METHODS, THIN, all, app, assert_near, at, ball, deepest, insert, keep_journal, messages, points, rounding,
    sheet, spawn, write_positions,
};

/// Heights around the contact distance of 0.1, a few units in the last place above and below.
fn trembling(tick: u32) -> f32 {
    let steps = [0i32, 3, -2, 4, -4, 1, 2, -1][tick as usize % 8];
    f32::from_bits(0.1_f32.to_bits().wrapping_add_signed(steps))
}

fn held_on_the_threshold(method: ContactMethod, margin: f32, with_shape: bool) {
    let mut app = app();
    keep_journal(&mut app, Update);
    app.insert_resource(CircumsphereSettings { margin, ..Default::default() });
    let sheet_mesh = sheet();
    let floor = spawn(&mut app, &sheet_mesh, (THIN, method, ContactEventsEnabled));
    let (other, threshold) = if with_shape {
        let shape = RigidShape(SharedShape::cuboid(0.5, 0.5, 0.5));
        (app.world_mut().spawn((shape, at(0.1, 0.5, 0.2))).id(), 0.5)
    } else {
        (spawn(&mut app, &ball(), (THIN, method, at(0.1, 0.5, 0.2))), 1.0)
    };
    let lower = |app: &mut App, depth: f32| {
        let moved: Vec<Vec3> = points(&sheet_mesh).iter().map(|point| *point - Vec3::Y * depth).collect();
        write_positions(app, floor, &moved);
        app.update();
        messages(app)
    };
    let started = vec![Started(floor, other)];
    let mut heard = Vec::new();
    for tick in 0..200 {
        heard.extend(lower(&mut app, trembling(tick) * threshold));
    }
    assert!(heard.is_empty() || heard == started, "{method:?}: {heard:?}");
    let touched = !heard.is_empty();
    assert!(touched, "{method:?}: never touched, not even at {:e}", trembling(4));
    // Contacts still end, and start again, when the surfaces really part and meet.
    assert_eq!(lower(&mut app, 1.2 * threshold), [Ended(floor, other)], "{method:?}");
    assert_eq!(lower(&mut app, 0.05 * threshold), started, "{method:?}");
}

#[test]
fn a_pair_held_on_the_threshold_starts_once_and_does_not_end() {
    for margin in [0.0, 0.3] {
        for method in EXACT_METHODS {
            held_on_the_threshold(method, margin, false);
            held_on_the_threshold(method, margin, true);
        }
    }
}

/// Moves a ball up and down around the height at which a coarse method starts to report contacts.
fn coarse_method_on_its_threshold(method: ContactMethod) {
    let mut app = app();
    keep_journal(&mut app, Update);
    let floor = spawn(&mut app, &sheet(), (THIN, method, ContactEventsEnabled));
    let ball = spawn(&mut app, &ball(), (THIN, method));
    let touches_at = |app: &mut App, height: f32| {
        insert(app, ball, at(0.1, height, 0.2));
        app.update();
        crate::world::store(app).touching_count() > 0
    };
    // Bisection down to neighboring floats.
    let (mut low, mut high) = (0.5_f32, 5.0_f32);
    assert!(touches_at(&mut app, low) && !touches_at(&mut app, high));
    while f32::from_bits(low.to_bits() + 1) < high {
        let middle = 0.5 * (low + high);
        if touches_at(&mut app, middle) { low = middle } else { high = middle }
    }
    touches_at(&mut app, 5.0);
    messages(&mut app);
    let mut heard = Vec::new();
    for tick in 0..200 {
        let height = f32::from_bits(low.to_bits().wrapping_add_signed([0, 3, -2, 4, -4, 1][tick % 6]));
        touches_at(&mut app, height);
        heard.extend(messages(&mut app));
    }
    assert_eq!(heard, [Started(floor, ball)], "{method:?} at {low}");
    touches_at(&mut app, low + 0.01);
    assert_eq!(messages(&mut app), [Ended(floor, ball)], "{method:?} at {low}");
}

#[test]
fn coarse_methods_do_not_flicker_on_their_threshold() {
    coarse_method_on_its_threshold(ContactMethod::BoundingSphere);
    coarse_method_on_its_threshold(ContactMethod::Circumsphere);
}

#[test]
fn contacts_themselves_have_no_hysteresis() {
    let mut app = app();
    spawn(&mut app, &sheet(), THIN);
    let ball = spawn(&mut app, &ball(), THIN);
    for (gap, seen) in [(0.0999, true), (0.1001, false), (0.0999, true), (0.10005, false)] {
        insert(&mut app, ball, at(0.1, 0.5 + gap, 0.2));
        app.update();
        let contacts = all(&mut app);
        assert_eq!(!contacts.is_empty(), seen, "{gap}");
        if seen {
            assert_near(deepest(&contacts).distance, gap, rounding(1.0), gap);
        }
    }
}
