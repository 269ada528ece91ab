//! A garment on a moving character: tethered to the skin of a walking body, and colliding with it and with itself.

use bevy_circumsphere::{
    prelude::*,
    response::{XpbdMaterial, XpbdTethers},
};
use circumsphere_support::scenes::{
    CHARACTER_EASE, Character, CharacterFineness, character_skirt, character_waist_vertices,
};
use glam::Vec3;

use super::{Scene, Stage, Variation, stage::tick_at};
use crate::headless::recording::Recorder;

/// Walking time after the character has reached its speed, in seconds.
const WALK: f64 = 4.0;

/// The longest distance of a vertex from its place on the body: at the waist, and how much more a ring below has.
const LONGEST: f32 = 0.05;
const LONGER: f32 = 0.4;

/// How far every vertex stays in front of the body.
const CLEARANCE: f32 = 0.004;

/// A character in a tethered skirt. Both have the default thickness. The game moves only the body.
pub fn garment(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    let fineness = variation.extent.pick(CharacterFineness::Coarse, CharacterFineness::Finest);
    let character = Character::new(fineness, variation.walking_speed);
    let body = stage.add_moving_obstacle("body", character.rest(), SurfaceFrame::World);
    let (rings, segments) = variation.extent.pick((8, 24), (40, 48));
    let skirt = character_skirt(rings, segments);
    let points = |positions: &[[f32; 3]]| positions.iter().copied().map(Vec3::from).collect::<Vec<_>>();
    let skin = (&*points(&character.rest().positions), &*character.rest().triangles);
    let mut tethers = XpbdTethers::to_surface(body, skin, &points(&skirt.positions), f32::INFINITY, CLEARANCE);
    let waist = character_waist_vertices(segments);
    for tether in &mut tethers.tethers {
        let vertex = tether.vertex.index();
        if waist.contains(&vertex) {
            (tether.longest, tether.backstop) = (0.0, f32::INFINITY);
        } else {
            tether.longest = LONGEST + LONGER * (vertex / segments) as f32 / rings as f32;
        }
    }
    stage.add_body("skirt", &skirt, XpbdMaterial::CLOTH, |body| body, (SelfCollision, tethers));
    let mut scene = Scene::new(stage, tick_at(CHARACTER_EASE + WALK)).judged().animated(move |stage, time| {
        stage.move_vertices(body, character.positions(time).into_iter().map(Vec3::from).enumerate());
    });
    scene.settled = tick_at(CHARACTER_EASE)..scene.ticks;
    scene
}
