//! Scenes whose bodies come to rest fall asleep, and then cost next to nothing.

use std::time::Instant;

use bevy_circumsphere::response::{XpbdDiagnostics, XpbdSettings};

use crate::{
    headless, play,
    scenes::{Scene, Variation, scene},
};

/// The least duration of a tick, in seconds, which other work on the machine disturbs least.
fn least_tick(scene: &mut Scene, ticks: usize) -> f64 {
    let durations = (0..ticks).map(|_| {
        let start = Instant::now();
        scene.tick();
        start.elapsed().as_secs_f64()
    });
    durations.fold(f64::INFINITY, f64::min)
}

#[test]
fn a_pile_at_rest_sleeps_and_costs_a_twentieth_of_one_in_motion() {
    let response = XpbdSettings { sleep_speed: 0.02, ..XpbdSettings::default() };
    let variation = Variation { response, ..Variation::default() };
    let mut scene = scene("pile", &variation, headless::recording::Recorder::default()).expect("the scene exists");
    let asleep = |scene: &Scene| scene.stage.app.world().resource::<XpbdDiagnostics>().asleep;
    let bodies = scene.stage.bodies.len();
    play(&mut scene, 60);
    assert_eq!(asleep(&scene), 0);
    let in_motion = least_tick(&mut scene, 60);
    while asleep(&scene) < bodies {
        assert!(scene.stage.ticks < 1200, "{} of {bodies} asleep after 20 s", asleep(&scene));
        scene.tick();
    }
    let at_rest = least_tick(&mut scene, 60);
    assert_eq!(asleep(&scene), bodies, "woken by nothing");
    assert!(at_rest < 0.05 * in_motion, "{at_rest} s at rest, {in_motion} s in motion");
}
