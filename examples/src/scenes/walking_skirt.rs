//! Cloth on a moving character: a skinned body with two bones walks in a circle, turns, and swings its leg.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use circumsphere_support::scenes::{
    CHARACTER_EASE, Character, CharacterFineness, character_skirt, character_waist_vertices,
};
use glam::Vec3;

use super::{Scene, Stage, Variation, stage::tick_at};
use crate::headless::recording::Recorder;

/// Walking time after the character has reached its speed, in seconds.
const WALK: f64 = 4.0;

/// A character in its skirt. Both have the default thickness.
pub fn walking_skirt(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    let fineness = variation.extent.pick(CharacterFineness::Coarse, CharacterFineness::Fine);
    let character = Character::new(fineness, variation.walking_speed);
    let body = stage.add_moving_obstacle("body", character.rest(), SurfaceFrame::World);
    let (rings, segments) = variation.extent.pick((8, 24), (20, 48));
    let skirt = character_skirt(rings, segments);
    let waist = skirt.positions[character_waist_vertices(segments)].to_vec();
    let pins: Vec<VertexId> = character_waist_vertices(segments).map(|vertex| VertexId(vertex as u32)).collect();
    let skirt = stage.add_body("skirt", &skirt, XpbdMaterial::CLOTH, |body| body.pinned(pins), SelfCollision);
    let mut scene = Scene::new(stage, tick_at(CHARACTER_EASE + WALK)).judged().animated(move |stage, time| {
        stage.move_vertices(body, character.positions(time).into_iter().map(Vec3::from).enumerate());
        stage.move_vertices(skirt, character.follow_torso(time, &waist).into_iter().map(Vec3::from).enumerate());
    });
    scene.settled = tick_at(CHARACTER_EASE)..scene.ticks;
    scene
}
