//! The physics scenes of the examples: the same to the last bit from run to run and for any number of threads, finite, and
//! moved as they say. The measures that judge them are held to closed forms.

mod motion;
mod programs;
mod repeats;
mod truth;

use bevy_circumsphere::prelude::*;
use circumsphere_examples::{headless, scenes};
use scenes::{Extent, Scene, Variation, scene};

/// A small version of a scene on so many threads.
fn small(name: &str, threads: usize) -> Scene {
    let detection = CircumsphereSettings { threads, ..CircumsphereSettings::default() };
    varied(name, &Variation { detection, ..Variation::default() })
}

/// A small version of a scene.
fn varied(name: &str, variation: &Variation) -> Scene {
    let variation = Variation { extent: Extent::Small, ..*variation };
    scene(name, &variation, headless::recording::Recorder::default()).expect("there is such a scene")
}

fn play(scene: &mut Scene, ticks: u32) {
    (0..ticks).for_each(|_| scene.tick());
}
