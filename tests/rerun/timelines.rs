//! Rows have the store's tick and the clock's time, and no other times. A stream that the game passes in keeps its own.

use std::{collections::BTreeSet, time::Duration};

use bevy_app::prelude::*;
use bevy_circumsphere::{ContactStore, debug::DeformableRerunPlugin, prelude::*};
use bevy_ecs::prelude::*;
use bevy_time::{Fixed, Time, TimePlugin, TimeUpdateStrategy};
use rerun::Scalars;

use crate::{
    recording::Recording,
    world::{Recorded, Scene, everything, stream},
};

/// The clock's time in the schedule of each tick.
#[derive(Resource, Default)]
struct Clock(Vec<(u64, Duration)>);

fn read_clock(time: Res<Time>, store: Res<ContactStore>, mut clock: ResMut<Clock>) {
    clock.0.push((store.tick(), time.elapsed()));
}

/// Compares the times of all rows with the clock, and returns the number of rows.
fn compare(recording: &Recording, clock: &[(u64, Duration)]) -> usize {
    let expected: BTreeSet<(i64, i64)> = clock
        .iter()
        .map(|(tick, time)| (tick.cast_signed(), i64::try_from(time.as_nanos()).expect("the time fits in an i64")))
        .collect();
    let mut found = BTreeSet::new();
    let mut count = 0;
    for row in recording.rows.iter().filter(|row| !row.times.is_empty()) {
        let names: Vec<&str> = row.times.keys().map(String::as_str).collect();
        assert_eq!(names, ["simulated_time", "tick"], "{:?}", row.path);
        found.insert((row.times["tick"], row.times["simulated_time"]));
        count += 1;
    }
    assert_eq!(found, expected);
    count
}

#[test]
fn rows_stand_at_the_tick_of_the_store_and_the_time_of_the_clock() {
    let mut recorded = Recorded::with(everything(), DeformableCollisionPlugins::new(Update), |app| {
        app.add_plugins(TimePlugin).init_resource::<Clock>();
        app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_micros(12_345)));
        app.add_systems(Update, read_clock.in_set(DeformableSystems::Log));
    });
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    for tick in 0..4 {
        scene.advance(&mut recorded.app, tick);
        recorded.app.update();
    }
    recorded.take();
    let clock = &recorded.app.world().resource::<Clock>().0;
    assert!(clock.len() == 4 && clock[3].1 > clock[1].1);
    assert!(compare(&recorded.last, clock) > 100);
}

#[test]
fn every_fixed_tick_of_an_update_has_a_time_of_its_own() {
    let mut recorded = Recorded::with(everything(), DeformableCollisionPlugins::default(), |app| {
        app.add_plugins(TimePlugin).init_resource::<Clock>();
        app.insert_resource(Time::<Fixed>::from_hz(60.0)).insert_resource(TimeUpdateStrategy::FixedTimesteps(3));
        app.add_systems(FixedPostUpdate, read_clock.in_set(DeformableSystems::Log));
    });
    Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
    for _ in 0..4 {
        recorded.app.update();
    }
    recorded.take();
    let clock = &recorded.app.world().resource::<Clock>().0;
    assert!(clock.len() >= 9, "{} ticks", clock.len());
    let steps: BTreeSet<Duration> = clock.windows(2).map(|pair| pair[1].1.abs_diff(pair[0].1)).collect();
    assert_eq!(steps.len(), 1, "ticks are one time step apart");
    assert!(compare(&recorded.last, clock) > 200);
}

#[test]
fn without_a_clock_there_is_only_the_tick() {
    let mut recorded = Recorded::new(everything());
    Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    recorded.tick();
    recorded.tick();
    assert!(recorded.last.rows.len() > 20);
    for row in recorded.last.rows.iter().filter(|row| !row.times.is_empty()) {
        assert_eq!(row.times.keys().collect::<Vec<_>>(), ["tick"]);
        assert_eq!(row.tick(), 2);
    }
}

#[test]
fn a_stream_that_was_handed_in_keeps_its_clock_and_what_its_owner_logs() {
    let (own, storage) = stream();
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), DeformableRerunPlugin::to_stream(own.clone())));
    Scene::spawn(&mut app, ContactMethod::Circumsphere);
    own.set_time_sequence("frame", 77);
    own.set_time_sequence("tick", 1000);
    for frame in 0..3 {
        own.log("mine", &Scalars::single(f64::from(frame))).expect("the value can be logged");
        app.update();
    }
    own.log("mine", &Scalars::single(3.0)).expect("the value can be logged");
    let recording = Recording::of(storage.take());
    let mine = recording.below(&["mine"]);
    assert_eq!(mine.iter().map(|row| row.components.scalar()).collect::<Vec<_>>(), [0.0, 1.0, 2.0, 3.0]);
    for row in &mine {
        assert_eq!((row.times["frame"], row.times["tick"]), (77, 1000), "the owner's clock has been changed");
    }
    let ours: Vec<_> = recording.rows.iter().filter(|row| row.path != ["mine"] && !row.times.is_empty()).collect();
    assert!(ours.len() > 60);
    let ticks: BTreeSet<i64> = ours.iter().map(|row| row.tick()).collect();
    assert_eq!(ticks, BTreeSet::from([1, 2, 3]));
    assert!(ours.iter().all(|row| row.times.len() == 1), "the owner's clock has been used");
}
