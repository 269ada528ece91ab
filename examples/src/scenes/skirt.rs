//! Cloth on a character: a skirt hangs from the waist of a figure that begins to walk.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{
    self, FIGURE_EASE, FIGURE_LIMBS, FIGURE_STEP, Mesh, pelvis_offset, skirt_waist_vertices, walking_figure,
};
use glam::Vec3;

use super::{Scene, Stage, Variation, stage::tick_at};
use crate::headless::recording::Recorder;

/// Half the contact distance, in meters.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.003);

/// Limbs overlap at their joints, so they collide with cloth but not with each other.
const LIMBS: SurfaceLayers = SurfaceLayers { memberships: 2, filters: 1 };

/// Number of steps that the figure walks.
const STEPS: f64 = 4.0;

/// A figure in a skirt that stands, then walks in place.
pub fn skirt(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    let limbs: Vec<Entity> = FIGURE_LIMBS
        .iter()
        .zip(walking_figure(0.0))
        .map(|(name, limb)| stage.add_moving_obstacle(name, &limb, (THICKNESS, LIMBS)))
        .collect();
    let (rings, segments) = variation.extent.pick((8, 24), (24, 64));
    let cloth = scenes::skirt(rings, segments);
    let waist: Vec<(usize, Vec3)> =
        skirt_waist_vertices(segments).map(|vertex| (vertex, Vec3::from(cloth.positions[vertex]))).collect();
    let pins: Vec<VertexId> = waist.iter().map(|&(vertex, _)| VertexId(vertex as u32)).collect();
    let skirt =
        stage.add_body("skirt", &cloth, XpbdMaterial::CLOTH, |body| body.pinned(pins), (SelfCollision, THICKNESS));
    let mut scene = Scene::new(stage, tick_at(FIGURE_EASE + STEPS * FIGURE_STEP)).animated(move |stage, time| {
        for (&limb, Mesh { positions, .. }) in limbs.iter().zip(walking_figure(time)) {
            stage.move_vertices(limb, positions.into_iter().map(Vec3::from).enumerate());
        }
        let offset = Vec3::from(pelvis_offset(time)) - Vec3::from(pelvis_offset(0.0));
        stage.move_vertices(skirt, waist.iter().map(|&(vertex, start)| (vertex, start + offset)));
    });
    // Walking at full stride: only the second difference shows trembling.
    scene.settled = tick_at(FIGURE_EASE + FIGURE_STEP)..scene.ticks;
    scene
}
