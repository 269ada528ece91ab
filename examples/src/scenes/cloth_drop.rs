//! The stability scene: a self-colliding cloth falls onto a ball and drapes over it.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use circumsphere_support::scenes::{Diagonals, grid, icosphere};

use super::{Scene, Stage, Variation};
use crate::headless::recording::Recorder;

/// Radius of the ball around the origin, in meters.
const BALL_RADIUS: f32 = 0.3;

/// Half the contact distance, in meters.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.002);

/// A square meter of cloth, slightly above a ball.
pub fn cloth_drop(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    let (cells, level) = variation.extent.pick((12, 2), (40, 4));
    stage.add_obstacle("ball", &icosphere(level, BALL_RADIUS), THICKNESS);
    // Off center, and rotated relative to the ball's mesh. In a symmetric scene, rounding would decide to which side
    // the cloth slides.
    let cloth = grid(cells, cells, 1.0, 1.0, Diagonals::Alternating);
    let cloth = cloth.rotate([0.0, 1.0, 0.0], 0.3).translate([0.02, BALL_RADIUS + 0.05, 0.01]);
    stage.add_body("cloth", &cloth, XpbdMaterial::CLOTH, |body| body, (SelfCollision, THICKNESS));
    Scene::new(stage, 300)
}
