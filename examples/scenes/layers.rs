//! Sheets of cloth that fall on each other.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{Diagonals, grid};

use super::{Stage, Variation};
use crate::headless::recording::Recorder;

/// Sheets above the ground, each turned a little against the one below.
pub struct Layers {
    pub stage: Stage,
    pub sheets: Vec<Entity>,
}

/// `count` sheets of half a meter and `cells` by `cells`.
pub fn layers(count: usize, cells: usize, variation: &Variation, recorder: Recorder) -> Layers {
    let mut stage = Stage::new(variation, recorder);
    if let Ok(m) = std::env::var("PUSH") { stage.app.world_mut().resource_mut::<XpbdSettings>().push_out_speed = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("SUB") { stage.app.world_mut().resource_mut::<XpbdSettings>().substeps = m.parse().unwrap(); }
    if let Ok(m) = std::env::var("ITER") { stage.app.world_mut().resource_mut::<XpbdSettings>().iterations = m.parse().unwrap(); }
    stage.app.world_mut().spawn(RigidShape(SharedShape::halfspace(glam::Vec3::Y)));
    let thickness = SurfaceThickness::World(0.002);
    let sheets = (0..count)
        .map(|layer| {
            let mesh = grid(cells, cells, 0.5, 0.5, Diagonals::Alternating);
            let mesh = mesh.rotate([0.0, 1.0, 0.0], 0.21 * layer as f32).translate([0.0, 0.05 + 0.02 * layer as f32, 0.0]);
            stage.add_body(&mesh, XpbdMaterial::CLOTH, |body| body, (SelfCollision, SweptCollision, thickness))
        })
        .collect();
    Layers { stage, sheets }
}
