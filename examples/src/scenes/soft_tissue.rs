//! The precision scene: an instrument presses into a soft organ, slides over it, and lifts.

use bevy_circumsphere::{
    prelude::*,
    response::{SurfaceFriction, XpbdMaterial, XpbdSettings},
};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{
    INSTRUMENT_END, INSTRUMENT_SLIDE_END, INSTRUMENT_SLIDE_START, instrument, instrument_pose, organ,
};
use glam::{Quat, Vec3};

use super::{Scene, Stage, Variation, stage::tick_at};
use crate::headless::recording::Recorder;

/// Half the contact distance, in meters.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.0005);

/// The organ is attached to its base below this height, in meters.
const HELD_BELOW: f32 = -0.02;

/// A skin as heavy as an organ of 1.5 liters, soft enough to yield to a finger.
const TISSUE: XpbdMaterial = XpbdMaterial {
    area_density: 20.0,
    stretch_compliance: 1.0e-4,
    bend_compliance: 1.0e1,
    volume_compliance: 0.0,
    damping: 100.0,
    drag: 2.0,
    ..XpbdMaterial::CLOTH
};

/// Low friction, because tissue is wet.
const FRICTION: SurfaceFriction = SurfaceFriction { static_coefficient: 0.2, dynamic_coefficient: 0.1 };

/// An organ that is held at its base, and an instrument that comes down on it, slides for two seconds, and lifts.
///
/// There is no gravity: the rest shape is the shape that the organ has under its own weight.
pub fn soft_tissue(variation: &Variation, recorder: Recorder) -> Scene {
    let response = XpbdSettings { gravity: Vec3::ZERO, ..variation.response };
    let mut stage = Stage::new(&Variation { response, ..*variation }, recorder);
    let tissue = organ(variation.extent.pick(2, 4));
    let held: Vec<VertexId> = (0..)
        .zip(&tissue.positions)
        .filter(|(_, position)| position[1] < HELD_BELOW)
        .map(|(v, _)| VertexId(v))
        .collect();
    stage.add_body("organ", &tissue, TISSUE, |body| body.pinned(held), (THICKNESS, FRICTION));
    let tool = stage.add_moving_obstacle("instrument", &instrument(), (THICKNESS, FRICTION, pose(0.0)));
    let mut scene = Scene::new(stage, tick_at(INSTRUMENT_END)).animated(move |stage, time| {
        *stage.app.world_mut().get_mut::<Transform>(tool).expect("the instrument is never removed") = pose(time);
    });
    // The ticks in which it slides steadily.
    scene.settled = tick_at(INSTRUMENT_SLIDE_START + 0.5)..tick_at(INSTRUMENT_SLIDE_END - 0.3);
    scene
}

fn pose(time: f64) -> Transform {
    let (translation, rotation) = instrument_pose(time);
    Transform::from_translation(Vec3::from(translation)).with_rotation(Quat::from_array(rotation))
}
