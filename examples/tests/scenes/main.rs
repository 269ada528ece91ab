//! The physics scenes of the examples: bit-identical from run to run and for any number of threads, finite, and moving
//! as described. Their measures are compared with closed forms.

mod motion;
mod programs;
mod repeats;
mod rest;
mod truth;

use bevy_circumsphere::prelude::*;
use circumsphere_examples::{headless, scenes};
use scenes::{Extent, Scene, Variation, scene};

/// A small version of a scene, on the given number of threads.
fn small(name: &str, threads: usize) -> Scene {
    let detection = CircumsphereSettings { threads, ..CircumsphereSettings::default() };
    varied(name, &Variation { detection, ..Variation::default() })
}

/// A small version of a scene.
fn varied(name: &str, variation: &Variation) -> Scene {
    let variation = Variation { extent: Extent::Small, ..*variation };
    scene(name, &variation, headless::recording::Recorder::default()).expect("the scene exists")
}

fn play(scene: &mut Scene, ticks: u32) {
    (0..ticks).for_each(|_| scene.tick());
}
