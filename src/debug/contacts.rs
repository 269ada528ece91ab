//! How long the normals of contacts are drawn.

use bevy_ecs::{entity::EntityHashMap, prelude::*};

use super::tick::Detected;
use crate::{contacts::StoredPair, surface::DeformableSurface};

/// Normals are half as long as the mean edge of the finer side.
pub(super) struct NormalLengths {
    /// Mean edges in world units.
    edges: EntityHashMap<f32>,
}

impl NormalLengths {
    pub(super) fn new(detected: &Detected, surfaces: &Query<&DeformableSurface>) -> Self {
        let edges = detected.active.surfaces.iter().filter_map(|active| {
            Some((active.entity, surfaces.get(active.entity).ok()?.mean_edge() * active.pose.scale() as f32))
        });
        Self { edges: edges.collect() }
    }

    /// The length for a pair; 0 if its surfaces are gone.
    pub(super) fn of(&self, pair: &StoredPair) -> f32 {
        let sides = [pair.a.entity(), pair.b.entity()];
        let finer = sides.iter().filter_map(|side| self.edges.get(side)).copied().reduce(f32::min);
        0.5 * finer.unwrap_or(0.0)
    }
}
