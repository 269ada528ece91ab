//! Finds pairs of triangles by comparing every box with every other. The reference for all other broad phases, and the
//! fastest one for a handful of triangles.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{BroadPhaseSystems, CandidateWriter, SurfaceBoxes};
use crate::{
    kernel::mesh::bounds::{pairs_between_brute_force, self_pairs_brute_force},
    schedule::SurfaceDetection,
};

/// Finds pairs by comparing all boxes. To use it, disable [`TreeBroadPhasePlugin`](super::TreeBroadPhasePlugin) and add
/// this plugin:
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_circumsphere::detection::{BruteForceBroadPhasePlugin, TreeBroadPhasePlugin};
/// # let mut app = App::new();
/// app.add_plugins((
///     DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>(),
///     BruteForceBroadPhasePlugin,
/// ));
/// ```
pub struct BruteForceBroadPhasePlugin;

impl Plugin for BruteForceBroadPhasePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SurfaceDetection, pair_triangles.in_set(BroadPhaseSystems::PairTriangles));
    }
}

fn pair_triangles(mut candidates: CandidateWriter) {
    candidates.write(|surfaces, pairs| match surfaces {
        SurfaceBoxes::Own(side) => self_pairs_brute_force(side.boxes, pairs),
        SurfaceBoxes::Between([first, second]) => pairs_between_brute_force(first.boxes, second.boxes, pairs),
    });
}
