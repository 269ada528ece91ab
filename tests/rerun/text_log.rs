//! The log reports every event in the tick in which it happened.

use bevy_circumsphere::{debug::RerunSettings, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use glam::Vec3;

use crate::world::{Recorded, THIN, everything, nothing, place, sheet, spawn, spawn_shape};

/// The lines of one kind of message in the last tick, and their level.
fn lines(recorded: &Recorded, kind: &str) -> (Vec<String>, Option<String>) {
    let Some(row) = recorded.last.row(&["log", kind]) else { return Default::default() };
    assert_eq!(row.tick(), recorded.number());
    let texts = row.components.texts("TextLog:text");
    assert_eq!(texts.len(), 1);
    let level = row.components.texts("TextLog:level").pop();
    (texts[0].lines().map(str::to_owned).collect(), level)
}

#[test]
fn contacts_start_and_end_in_the_log_though_nobody_asked_and_in_ticks_that_are_not_recorded() {
    for every in [1, 3] {
        let mut recorded = Recorded::new(RerunSettings { every, ..nothing() });
        let app = &mut recorded.app;
        spawn(app, "below", &sheet(4), THIN);
        let at = |x: f32| Transform::from_xyz(x, 0.03, 0.0);
        let movers: Vec<Entity> = (0..3)
            .map(|number| spawn(app, &format!("mover {number}"), &sheet(1), (THIN, at(5.0 * number as f32))))
            .collect();
        let floor = spawn_shape(app, "floor", SharedShape::halfspace(Vec3::Y), Transform::from_xyz(0.0, -0.01, 0.0));
        let mut journal = Vec::new();
        for tick in 0..9 {
            match tick {
                3 => place(&mut recorded.app, movers[0], |transform| transform.translation.y = 4.0),
                // Two at once, one above the other.
                4 => {
                    place(&mut recorded.app, movers[1], |transform| transform.translation.x = -0.5);
                    place(&mut recorded.app, movers[2], |transform| *transform = Transform::from_xyz(0.5, -0.03, 0.0));
                }
                6 => drop(recorded.app.world_mut().despawn(movers[1])),
                7 => drop(recorded.app.world_mut().entity_mut(floor).insert(SurfaceDisabled)),
                _ => {}
            }
            recorded.tick();
            let (started, level) = lines(&recorded, "contacts started");
            assert!(level.is_none_or(|level| level == "INFO"));
            let (ended, _) = lines(&recorded, "contacts ended");
            for (what, lines) in [("started", started), ("ended", ended)] {
                for line in lines {
                    journal.push((tick, what, line));
                }
            }
        }
        let of = |tick: i32, what: &str, pair: &str| {
            let found = journal.iter().filter(|(at, other, line)| *at == tick && *other == what && line.contains(pair));
            assert_eq!(found.count(), 1, "{pair} {what} at {tick}: {journal:#?}");
        };
        of(0, "started", "below with mover 0");
        of(0, "started", "below with floor");
        of(3, "ended", "below with mover 0");
        of(4, "started", "below with mover 1");
        of(4, "started", "below with mover 2");
        of(4, "started", "mover 2 with floor");
        of(6, "ended", "below with mover 1");
        of(7, "ended", "below with floor");
        of(7, "ended", "mover 2 with floor");
        let unexpected: Vec<_> = journal.iter().filter(|(tick, ..)| [1, 2, 5, 8].contains(tick)).collect();
        assert!(unexpected.is_empty(), "{unexpected:?}");
    }
}

#[test]
fn all_quarantines_of_a_tick_are_told_by_name_with_their_reason() {
    for every in [1, 4] {
        let mut recorded = Recorded::new(RerunSettings { every, ..nothing() });
        let app = &mut recorded.app;
        let first = spawn(app, "sleeve", &sheet(1), THIN);
        let second = spawn(app, "collar", &sheet(1), (THIN, Transform::from_xyz(0.0, 3.0, 0.0)));
        recorded.tick();
        assert!(lines(&recorded, "quarantines").0.is_empty());
        let world = recorded.app.world_mut();
        world.get_mut::<SurfacePositions>(first).expect("the entity is a surface").0[2].x = f32::INFINITY;
        world.entity_mut(second).insert(SurfaceThickness::World(-1.0));
        recorded.tick();
        let (told, level) = lines(&recorded, "quarantines");
        assert_eq!(level.as_deref(), Some("WARN"));
        assert_eq!(told.len(), 4, "{told:?}");
        let told: Vec<String> = told.chunks(2).map(|lines| lines.join(" ")).collect();
        assert!(told.iter().any(|told| told.contains("sleeve") && told.contains("vertex 2")), "{told:?}");
        assert!(told.iter().any(|told| told.contains("collar") && told.contains("-1")), "{told:?}");
        recorded.tick();
        assert!(lines(&recorded, "quarantines").0.is_empty(), "reported once");
    }
}

#[test]
fn what_was_never_active_is_named_in_its_quarantine_too() {
    let mut recorded = Recorded::new(nothing());
    let app = &mut recorded.app;
    let sheared = Transform::from_scale(Vec3::new(1.0, 2.0, 1.0));
    spawn(app, "hem", &sheet(1), (THIN, sheared));
    spawn_shape(app, "post", SharedShape::ball(1.0), sheared);
    let unnamed = crate::world::spawn_unnamed(app, &sheet(1), (THIN, sheared));
    recorded.tick();
    let (told, _) = lines(&recorded, "quarantines");
    // The reason is on a line of its own.
    assert_eq!(told.len(), 6, "{told:?}");
    for name in ["hem".to_owned(), "post".to_owned(), format!("surface {unnamed}")] {
        let place = told.iter().position(|line| *line == format!("{name} is set aside:"));
        assert!(told[place.expect("the entity has a name") + 1].starts_with("the transform"), "{told:?}");
    }
}

#[test]
fn a_surface_that_is_thinned_away_is_a_warning_once() {
    let mut recorded = Recorded::new(RerunSettings { bytes_per_tick: 0, ..everything() });
    let app = &mut recorded.app;
    spawn(app, "below", &sheet(4), (THIN, ContactMethod::Circumsphere));
    spawn(app, "above", &sheet(4), (THIN, ContactMethod::Circumsphere, Transform::from_xyz(0.1, 0.03, 0.1)));
    recorded.tick();
    let (told, level) = lines(&recorded, "warnings");
    assert_eq!(level.as_deref(), Some("WARN"));
    for layer in ["meshes", "contacts", "pairs", "spheres", "cones", "curvature", "recipe_age", "tree"] {
        let found = told.iter().filter(|line| line.starts_with(layer) && line.contains("recorded"));
        assert_eq!(found.count(), 1, "{layer}: {told:?}");
    }
    assert!(told[told.len() - 1].contains("bytes_per_tick"), "{told:?}");
    for _ in 0..3 {
        recorded.tick();
        assert_eq!(lines(&recorded, "warnings").0, Vec::<String>::new(), "reported once");
    }
    recorded.settings().bytes_per_tick = 1 << 30;
    recorded.tick();
    assert_eq!(lines(&recorded, "warnings").0, Vec::<String>::new());
    assert_eq!(recorded.viewer.below(&["meshes"]).len(), 2);
    recorded.settings().bytes_per_tick = 10;
    recorded.tick();
    let (told, _) = lines(&recorded, "warnings");
    assert!(told.len() >= 6, "warnings start again: {told:?}");
}
