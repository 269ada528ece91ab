//! The stable scene: a cloth that meets itself falls onto a ball and hangs over it.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{Diagonals, grid, icosphere};

use super::{Stage, Variation};
use crate::headless::recording::Recorder;

/// Radius of the ball around the origin, in meters.
pub const BALL_RADIUS: f32 = 0.3;

/// The cloth and the ball.
pub struct ClothDrop {
    pub stage: Stage,
    pub cloth: Entity,
    pub ball: Entity,
}

/// A square meter of cloth of `cells` by `cells`, a little above a ball.
pub fn cloth_drop(cells: usize, variation: &Variation, recorder: Recorder) -> ClothDrop {
    let mut stage = Stage::new(variation, recorder);
    let ball = stage.add_obstacle(&icosphere(4, BALL_RADIUS), ());
    // Off center, and turned against the ball's mesh: a scene that is symmetric balances on chances.
    let mesh = grid(cells, cells, 1.0, 1.0, Diagonals::Alternating);
    let mesh = mesh.rotate([0.0, 1.0, 0.0], 0.3).translate([0.02, BALL_RADIUS + 0.05, 0.01]);
    let thickness = SurfaceThickness::World(0.002);
    let mut material = XpbdMaterial::CLOTH;
    if let Ok(m) = std::env::var("BEND") { material.bend_compliance = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("STRETCH") { material.stretch_compliance = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("DAMP") { material.damping = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("DRAG") { material.drag = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("ITER") { stage.app.world_mut().resource_mut::<XpbdSettings>().iterations = m.parse().unwrap(); }
    let cloth = stage.add_body(&mesh, material, |body| body, thickness);
    if std::env::var("NOSELF").is_err() { stage.app.world_mut().entity_mut(cloth).insert(SelfCollision); }
    if std::env::var("CCD").is_ok() { stage.app.world_mut().entity_mut(cloth).insert(SweptCollision); }
    if let Ok(m) = std::env::var("MARGIN") { stage.app.world_mut().resource_mut::<CircumsphereSettings>().margin = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("SUB") { stage.app.world_mut().resource_mut::<XpbdSettings>().substeps = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("PUSH") { stage.app.world_mut().resource_mut::<XpbdSettings>().push_out_speed = m.parse().unwrap(); }
    ClothDrop { stage, cloth, ball }
}
