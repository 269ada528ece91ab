//! Contacts that flicker, and how long their ends wait.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use circumsphere_support::random::Random;
use glam::Vec3;

use crate::world::{
    Announcement::{self, Ended, Started},
    THIN, all, app, at, ball, insert, keep_journal, messages, place, points, sheet, spawn, write_positions,
};

/// A sheet with events, and a ball or a rigid ball that touches it or not.
struct Flicker {
    app: App,
    sheet: Entity,
    ball: Entity,
}

impl Flicker {
    fn new(with_shape: bool, of_sheet: impl Bundle, of_ball: impl Bundle) -> Self {
        let mut app = app();
        keep_journal(&mut app, Update);
        let sheet = spawn(&mut app, &sheet(), (THIN, ContactEventsEnabled, of_sheet));
        let away = at(0.1, 3.0, 0.2);
        let ball = if with_shape {
            app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), away, of_ball)).id()
        } else {
            spawn(&mut app, &ball(), (THIN, away, of_ball))
        };
        Self { app, sheet, ball }
    }

    fn tick(&mut self, touches: bool) -> Vec<Announcement> {
        place(&mut self.app, self.ball, Vec3::new(0.1, if touches { 0.52 } else { 3.0 }, 0.2));
        self.app.update();
        assert_eq!(!all(&mut self.app).is_empty(), touches, "contacts themselves do not wait");
        messages(&mut self.app)
    }

    /// A contact that has begun and is absent for the first time, with its end waiting.
    fn waiting(with_shape: bool) -> Self {
        let mut flicker = Self::new(with_shape, ContactEventHold(100), ());
        assert_eq!(flicker.tick(true), [Started(flicker.sheet, flicker.ball)]);
        assert_eq!(flicker.tick(false), []);
        flicker
    }

    fn ended(&self) -> [Announcement; 1] {
        [Ended(self.sheet, self.ball)]
    }
}

/// What is heard in each tick, from the ticks with contact alone: times of contact with at most `hold` ticks between
/// them are one, which ends in tick `hold + 1` without contact.
fn expected(touches: &[bool], hold: usize) -> Vec<[bool; 2]> {
    let mut heard = vec![[false; 2]; touches.len()];
    let with_contact: Vec<usize> = (0..touches.len()).filter(|&tick| touches[tick]).collect();
    for together in with_contact.chunk_by(|tick, next| next - tick <= hold + 1) {
        heard[together[0]][0] = true;
        if let Some(end) = heard.get_mut(together[together.len() - 1] + hold + 1) {
            end[1] = true;
        }
    }
    heard
}

#[test]
fn gaps_up_to_the_hold_are_not_heard() {
    let mut random = Random::new(282);
    let touches: Vec<bool> = (0..300).map(|_| random.below(3) == 0).collect();
    for hold in [0, 1, 2, 5] {
        for with_shape in [false, true] {
            let mut flicker = if hold == 0 {
                Flicker::new(with_shape, (), ())
            } else {
                // The larger one of both sides counts.
                Flicker::new(with_shape, ContactEventHold(1), ContactEventHold(hold))
            };
            let expected = expected(&touches, hold as usize);
            let mut count = 0;
            for (tick, (&touches, [starts, ends])) in touches.iter().zip(expected).enumerate() {
                let heard = flicker.tick(touches);
                let (sheet, ball) = (flicker.sheet, flicker.ball);
                let mut all = vec![Ended(sheet, ball); usize::from(ends)];
                all.extend(starts.then_some(Started(sheet, ball)));
                assert_eq!(heard, all, "hold {hold}, tick {tick}");
                count += heard.len();
            }
            assert!(count > 2, "the contact ends and starts again: {count} messages");
        }
    }
}

#[test]
fn a_side_that_no_longer_takes_part_does_not_wait() {
    for with_shape in [false, true] {
        for of_ball in [false, true] {
            let check = |what: &str, change: &dyn Fn(&mut App, Entity)| {
                let mut flicker = Flicker::waiting(with_shape);
                let changed = if of_ball { flicker.ball } else { flicker.sheet };
                change(&mut flicker.app, changed);
                flicker.app.update();
                let mut heard = messages(&mut flicker.app);
                heard.retain(|heard| !matches!(heard, Announcement::Quarantined(..)));
                assert_eq!(heard, flicker.ended(), "{what}, shape {with_shape}, ball {of_ball}");
                flicker.app.update();
                assert_eq!(messages(&mut flicker.app), [], "{what}");
            };
            check("despawned", &|app, entity| _ = app.world_mut().despawn(entity));
            check("disabled", &|app, entity| insert(app, entity, SurfaceDisabled));
            check("only queried", &|app, entity| insert(app, entity, QueryOnly));
            check("teleported", &|app, entity| insert(app, entity, Teleported));
            check("in other layers", &|app, entity| {
                insert(app, entity, SurfaceLayers { memberships: 2, filters: 2 });
            });
            check("quarantined", &|app, entity| insert(app, entity, at(0.0, f32::NAN, 0.0)));
        }
    }
}

#[test]
fn a_hold_that_is_taken_back_ends_what_waits() {
    let mut flicker = Flicker::waiting(false);
    insert(&mut flicker.app, flicker.sheet, ContactEventHold(2));
    assert_eq!(flicker.tick(false), []);
    assert_eq!(flicker.tick(false), flicker.ended());
    let mut flicker = Flicker::waiting(false);
    let sheet = flicker.sheet;
    flicker.app.world_mut().entity_mut(sheet).remove::<(ContactEventHold, ContactEventsEnabled)>();
    assert_eq!(flicker.tick(false), [], "nobody listens");
}

#[test]
fn a_contact_of_a_surface_with_itself_waits_too() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let mesh = sheet();
    let flat = points(&mesh);
    // The last row of vertices comes back over the sheet.
    let folded: Vec<Vec3> =
        flat.iter().map(|point| if point.x > 1.9 { Vec3::new(0.4, 0.05, point.z) } else { *point }).collect();
    let extra = (THIN, SelfCollision, ContactEventsEnabled, ContactEventHold(1));
    let sheet = spawn(&mut app, &mesh, extra);
    let mut tick = |positions: &[Vec3]| {
        write_positions(&mut app, sheet, positions);
        app.update();
        (!all(&mut app).is_empty(), messages(&mut app))
    };
    assert_eq!(tick(&flat), (false, vec![]));
    assert_eq!(tick(&folded), (true, vec![Started(sheet, sheet)]));
    assert_eq!(tick(&flat), (false, vec![]));
    assert_eq!(tick(&folded), (true, vec![]));
    assert_eq!(tick(&flat), (false, vec![]));
    assert_eq!(tick(&flat), (false, vec![Ended(sheet, sheet)]));
}
