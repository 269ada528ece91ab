//! Two recordings of the same ticks are equal, and recording does not change the results.

use bevy_circumsphere::{debug::RerunSettings, prelude::*};

use crate::{
    recording::{Recording, Row, path},
    world::{Recorded, Scene, everything, near},
};

/// Rows without their identifiers, which contain the wall-clock time.
fn rows(recording: &Recording) -> Vec<Row> {
    let id = rerun::log::RowId::ZERO;
    recording.rows.iter().map(|row| Row { id, ..row.clone() }).collect()
}

fn record(settings: RerunSettings, method: ContactMethod) -> Vec<Row> {
    let mut recorded = Recorded::new(settings);
    let scene = Scene::spawn(&mut recorded.app, method);
    for tick in 0..6 {
        scene.advance(&mut recorded.app, tick);
        recorded.app.update();
    }
    rows(recorded.take())
}

#[test]
fn two_recordings_of_the_same_ticks_have_the_same_rows() {
    for settings in [everything(), near(), RerunSettings { bytes_per_tick: 40_000, ..everything() }] {
        for method in [ContactMethod::Circumsphere, ContactMethod::Exact] {
            let settings = RerunSettings { times: false, ..settings.clone() };
            let (one, other) = (record(settings.clone(), method), record(settings, method));
            assert!(one.len() > 90, "{} rows", one.len());
            assert_eq!(one.len(), other.len());
            for (one, other) in one.iter().zip(&other) {
                assert!(one == other, "{method:?}: {:?} differs: {one:?} {other:?}", one.path);
            }
        }
    }
}

#[test]
fn wall_clock_times_are_what_makes_recordings_differ() {
    let (one, other) = (record(everything(), ContactMethod::Exact), record(everything(), ContactMethod::Exact));
    let differing: Vec<&Row> = one.iter().zip(&other).filter(|(one, other)| one != other).map(|(one, _)| one).collect();
    assert!(!differing.is_empty());
    assert!(differing.iter().all(|row| row.path.starts_with(&path(&["series", "milliseconds"]))));
}

#[test]
fn without_times_there_are_no_milliseconds() {
    let rows = record(RerunSettings { times: false, ..everything() }, ContactMethod::Exact);
    assert!(rows.iter().filter(|row| row.path.starts_with(&path(&["series"]))).count() > 60);
    assert!(!rows.iter().any(|row| row.path.starts_with(&path(&["series", "milliseconds"]))));
}
