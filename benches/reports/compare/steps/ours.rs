//! Our ticks with the response: whole updates of a headless app.

use bevy_circumsphere::{
    CircumsphereSettings,
    prelude::*,
    response::{XpbdMaterial, XpbdSettings},
};
use bevy_transform::components::Transform;
use circumsphere_examples::{
    headless::recording::Recorder,
    scenes::{Stage, Variation},
};
use circumsphere_reports::cloth_scenes::{ClothScene, Obstacle};

use super::{super::measure::timed, Played};

/// Plays the scene with default settings and this number of threads.
pub fn play(scene: &ClothScene, threads: usize) -> Played {
    let detection = CircumsphereSettings { threads, ..CircumsphereSettings::default() };
    let mut stage = Stage::new(&Variation { detection, ..Variation::default() }, Recorder::default());
    let thickness = SurfaceThickness::World(scene.thickness);
    match &scene.obstacle {
        Obstacle::Ball(radius) => stage.add_shape("ball", SharedShape::ball(*radius), Transform::IDENTITY),
        Obstacle::Closed(mesh) | Obstacle::Ground(mesh) => stage.add_obstacle("obstacle", mesh, thickness),
    };
    let cloth = stage.add_body("cloth", &scene.cloth, XpbdMaterial::CLOTH, |body| body, (SelfCollision, thickness));
    (0..scene.fall).for_each(|_| stage.tick());
    let milliseconds = (0..scene.measured).map(|_| timed(|| stage.tick()).0.as_secs_f64() * 1.0e3).collect();
    let substeps = stage.app.world().resource::<XpbdSettings>().substeps;
    Played {
        milliseconds,
        substeps: vec![substeps; scene.measured],
        end: stage.positions(cloth).iter().map(glam::Vec3::to_array).collect(),
    }
}
