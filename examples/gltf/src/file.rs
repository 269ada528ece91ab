//! Writes a walking character in a skirt as a binary glTF file.

use circumsphere_support::scenes::{Character, CharacterFineness, character_skirt};
use glam::{Mat4, Quat, Vec3};
use serde_json::{Value, json};

use crate::buffer::{Buffer, UNSIGNED_BYTE, animation};

/// Walking speed, in meters per second.
pub const SPEED: f64 = 5.0;

/// Key frames of the animation per second, with straight lines in between.
pub const RATE: usize = 60;

/// Duration of the animation, in seconds.
pub const DURATION: usize = 5;

/// The meshes of the file.
pub const SKIN: &str = "Skin";
pub const SKIRT: &str = "Skirt";

/// The attribute that may say how far the vertices of the skirt get from the skin. Bevy leaves the underscore out.
pub const PAINT: &str = "_GARMENT";

/// The rings and segments of the skirt.
pub const SKIRT_SIZE: (usize, usize) = (20, 48);

/// The character of the file.
#[must_use]
pub fn character() -> Character {
    Character::new(CharacterFineness::Finest, SPEED)
}

/// The character, skinned to the joints `Torso` and `Leg`, an animation of both, and a skirt that stands around the
/// character at time 0. The same bytes on every platform.
#[must_use]
pub fn character_file() -> Vec<u8> {
    write(|_| json!({}))
}

/// The same with a number painted on each vertex of the skirt, in the attribute [`PAINT`].
#[must_use]
pub fn painted_character_file(paint: &[f32]) -> Vec<u8> {
    let values: Vec<[f32; 1]> = paint.iter().map(|&value| [value]).collect();
    write(|buffer| json!({ PAINT: buffer.add_floats(&values, "SCALAR") }))
}

/// Writes a file with these attributes of the skirt, beside positions and normals.
fn write(skirt_attributes: impl FnOnce(&mut Buffer) -> Value) -> Vec<u8> {
    let character = character();
    let mut buffer = Buffer::default();
    let shares: Vec<f32> = character.leg_shares().iter().map(|&share| share as f32).collect();
    let influences: Vec<[f32; 4]> = shares.iter().map(|&share| [1.0 - share, share, 0.0, 0.0]).collect();
    let joints: Vec<u8> = influences.iter().flat_map(|_| [0, 1, 0, 0]).collect();
    let attributes = json!({
        "JOINTS_0": buffer.add(&joints, UNSIGNED_BYTE, "VEC4", influences.len()),
        "WEIGHTS_0": buffer.add_floats(&influences, "VEC4"),
    });
    let skin = buffer.add_mesh(SKIN, character.rest(), attributes);
    let attributes = skirt_attributes(&mut buffer);
    let skirt = buffer.add_mesh(SKIRT, &character_skirt(SKIRT_SIZE.0, SKIRT_SIZE.1), attributes);
    let (hip, _) = character.leg_pose(0.0);
    let bind_poses = [Mat4::IDENTITY, Mat4::from_translation(-Vec3::from(hip))].map(|pose| pose.to_cols_array());
    let bind_poses = buffer.add_floats(&bind_poses, "MAT4");
    let times: Vec<f64> = (0..=DURATION * RATE).map(|key| key as f64 / RATE as f64).collect();
    let input = buffer.add_floats(&times.iter().map(|&time| [time as f32]).collect::<Vec<_>>(), "SCALAR");
    let torso: Vec<([f32; 3], [f32; 4])> = times.iter().map(|&time| character.torso_pose(time)).collect();
    let places: Vec<[f32; 3]> = torso.iter().map(|&(place, _)| place).collect();
    let turns: Vec<[f32; 4]> = torso.iter().map(|&(_, turn)| turn).collect();
    let swings: Vec<[f32; 4]> = times
        .iter()
        .zip(&turns)
        .map(|(&time, &turn)| {
            let (_, leg) = character.leg_pose(time);
            (Quat::from_array(turn).inverse() * Quat::from_array(leg)).normalize().to_array()
        })
        .collect();
    let outputs = [
        (buffer.add_floats(&places, "VEC3"), 1, "translation"),
        (buffer.add_floats(&turns, "VEC4"), 1, "rotation"),
        (buffer.add_floats(&swings, "VEC4"), 2, "rotation"),
    ];
    let root = json!({
        "asset": { "version": "2.0", "generator": "bevy_circumsphere" },
        "scene": 0,
        "scenes": [{ "name": "Character", "nodes": [0] }],
        "nodes": [
            { "name": "Character", "children": [1, 3, 4] },
            { "name": "Torso", "children": [2] },
            { "name": "Leg", "translation": hip },
            { "name": SKIN, "mesh": 0, "skin": 0 },
            { "name": SKIRT, "mesh": 1 },
        ],
        "meshes": [skin, skirt],
        "skins": [{ "joints": [1, 2], "inverseBindMatrices": bind_poses }],
        "animations": [animation("Walk", input, &outputs)],
    });
    buffer.into_file(root)
}
