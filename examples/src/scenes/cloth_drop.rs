//! The stability scene: a self-colliding cloth falls onto a ball and drapes over it.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use circumsphere_support::scenes::{Diagonals, Mesh, grid, icosphere};

use super::{Extent, Scene, Stage, Variation};
use crate::headless::recording::Recorder;

/// Radius of the ball around the origin, in meters.
pub const BALL_RADIUS: f32 = 0.3;

/// Half the contact distance, in meters.
pub const THICKNESS: f32 = 0.002;

/// The ball as a mesh.
pub fn ball_mesh(extent: Extent) -> Mesh {
    icosphere(extent.pick(2, 4), BALL_RADIUS)
}

/// A square meter of cloth, slightly above the ball.
pub fn cloth_above_ball(extent: Extent) -> Mesh {
    let cells = extent.pick(12, 40);
    // Off center, and rotated relative to the ball's mesh. In a symmetric scene, rounding would decide to which side
    // the cloth slides.
    let cloth = grid(cells, cells, 1.0, 1.0, Diagonals::Alternating);
    cloth.rotate([0.0, 1.0, 0.0], 0.3).translate([0.02, BALL_RADIUS + 0.05, 0.01])
}

/// A cloth above a ball that is a mesh.
pub fn cloth_drop(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    let thickness = SurfaceThickness::World(THICKNESS);
    stage.add_obstacle("ball", &ball_mesh(variation.extent), thickness);
    let cloth = cloth_above_ball(variation.extent);
    stage.add_body("cloth", &cloth, XpbdMaterial::CLOTH, |body| body, (SelfCollision, thickness));
    Scene::new(stage, 300)
}
