//! Finds pairs of triangles by a spatial hash (Teschner et al. 2003), uniform or hierarchical. The table is filled anew
//! whenever a pair of surfaces has changed.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{BroadPhaseSystems, CandidateWriter, SurfaceBoxes};
use crate::{
    detection::parallel::Threads,
    kernel::spatial_hash::{HashKind, HashSettings, SpatialHash},
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
};

/// Finds pairs by the cells of a grid. To use it, disable [`TreeBroadPhasePlugin`](super::TreeBroadPhasePlugin) and add
/// this plugin:
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_circumsphere::detection::{SpatialHashBroadPhasePlugin, TreeBroadPhasePlugin};
/// # let mut app = App::new();
/// app.add_plugins((
///     DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>(),
///     SpatialHashBroadPhasePlugin::default(),
/// ));
/// # app.update();
/// ```
///
/// [`DetectionDiagnostics`](crate::detection::DetectionDiagnostics) tells how many cells are occupied and crowded.
#[derive(Clone, Copy, Debug, Default)]
pub struct SpatialHashBroadPhasePlugin {
    /// The side of a cell, in the unit of the positions of the surfaces. Default: `None`, twice the mean size of the
    /// boxes, for each pair of surfaces. So does a value that is not positive and finite.
    pub cell_size: Option<f32>,
}

/// Finds pairs by the cells of several grids, whose cells fit triangles of different sizes. To use it, disable
/// [`TreeBroadPhasePlugin`](super::TreeBroadPhasePlugin) and add this plugin:
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_circumsphere::detection::{HierarchicalSpatialHashBroadPhasePlugin, TreeBroadPhasePlugin};
/// # let mut app = App::new();
/// app.add_plugins((
///     DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>(),
///     HierarchicalSpatialHashBroadPhasePlugin::default(),
/// ));
/// # app.update();
/// ```
///
/// Each grid has cells of four times the size of those of the next finer one.
#[derive(Clone, Copy, Debug, Default)]
pub struct HierarchicalSpatialHashBroadPhasePlugin {
    /// The side of the finest cells, rounded up to a power of two, in the unit of the positions of the surfaces. Smaller
    /// boxes share these cells. Default: `None`, 1/4096 of the mean size of the boxes, for each pair of surfaces. So
    /// does a value that is not positive and finite.
    pub cell_size: Option<f32>,
}

impl Plugin for SpatialHashBroadPhasePlugin {
    fn build(&self, app: &mut App) {
        add_hash(app, HashSettings { kind: HashKind::Uniform, cell_size: self.cell_size });
    }
}

impl Plugin for HierarchicalSpatialHashBroadPhasePlugin {
    fn build(&self, app: &mut App) {
        add_hash(app, HashSettings { kind: HashKind::Hierarchical, cell_size: self.cell_size });
    }
}

fn add_hash(app: &mut App, hash_settings: HashSettings) {
    let pair_triangles =
        move |mut candidates: CandidateWriter, settings: Res<CircumsphereSettings>, mut hash: Local<SpatialHash>| {
            let threads = Threads(settings.threads);
            candidates.write_counted(|surfaces, pairs| match surfaces {
                SurfaceBoxes::Own(side) => hash.self_pairs(&threads, &hash_settings, side.boxes, pairs),
                SurfaceBoxes::Between([first, second]) => {
                    hash.pairs_between(&threads, &hash_settings, [first.boxes, second.boxes], pairs)
                }
            });
            hash.rest();
        };
    app.add_systems(SurfaceDetection, pair_triangles.in_set(BroadPhaseSystems::PairTriangles));
}
