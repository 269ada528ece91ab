//! The efficiency scene: soft bodies of mixed shapes drop into a ribbed tray.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use circumsphere_support::scenes::{PILE_BODIES, pile_body, pile_start, pile_tray};

use super::{Scene, Stage, Variation};
use crate::headless::recording::Recorder;

/// Half the contact distance, in meters.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.001);

/// Foam rubber.
const FOAM: XpbdMaterial = XpbdMaterial { drag: 0.5, ..XpbdMaterial::SOFT };

/// A hundred soft bodies above the tray.
pub fn pile(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    stage.add_obstacle("tray", &pile_tray(), THICKNESS);
    for index in 0..variation.extent.pick(6, PILE_BODIES) {
        let body = pile_body(index).translate(pile_start(index));
        stage.add_body("soft body", &body, FOAM, |body| body, THICKNESS);
    }
    Scene::new(stage, 300)
}
