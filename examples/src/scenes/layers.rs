//! Sheets of cloth that fall onto each other and the ground.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, grid};
use glam::Vec3;

use super::{Scene, Stage, Variation};
use crate::headless::recording::Recorder;

/// Half the contact distance, in meters.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.002);

/// Initial vertical gap between the sheets, in meters.
const GAP: f32 = 0.02;

/// Ten sheets of half a meter above the ground, each rotated a little relative to the one below.
pub fn layers(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    stage.add_shape("ground", SharedShape::halfspace(Vec3::Y), Transform::IDENTITY);
    let (count, cells) = variation.extent.pick((3_u8, 6), (10, 20));
    for layer in (0..count).map(f32::from) {
        let sheet = grid(cells, cells, 0.5, 0.5, Diagonals::Alternating);
        let sheet = sheet.rotate([0.0, 1.0, 0.0], 0.21 * layer).translate([0.0, 0.05 + GAP * layer, 0.0]);
        stage.add_body("sheet", &sheet, XpbdMaterial::CLOTH, |body| body, (SelfCollision, THICKNESS));
    }
    Scene::new(stage, 180)
}
