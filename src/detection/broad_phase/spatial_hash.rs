//! Finds pairs of triangles by a spatial hash (Teschner et al. 2003), uniform or hierarchical. The table is filled anew
//! whenever a pair of surfaces has changed.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

#[cfg(feature = "rerun")]
use super::custom::{MovedBoxes, surface_boxes};
use super::{BroadPhaseSystems, CandidateWriter, SurfaceBoxes};
use crate::{
    detection::parallel::Threads,
    kernel::spatial_hash::{HashKind, HashSettings, SpatialHash},
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
};
#[cfg(feature = "rerun")]
use crate::{
    detection::{
        pairs::{OtherSide, PairLists, SurfacePair, surface_pair},
        state::SurfaceStates,
    },
    kernel::spatial_hash::{OccupiedCell, occupied_cells},
    surface::ActiveSurfaces,
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

/// What the hash is made of that pairs triangles.
#[derive(Resource, Clone, Copy, Debug)]
pub(crate) struct UsedHash(HashSettings);

#[cfg(feature = "rerun")]
impl UsedHash {
    /// The cells that the hash fills for a pair of surfaces, in its frame, with the triangles in them: those of the second
    /// surface follow those of the first. None for a pair with a shape.
    pub(crate) fn occupied_cells(
        self,
        active: &ActiveSurfaces,
        states: &SurfaceStates,
        pair: &SurfacePair,
    ) -> Vec<OccupiedCell> {
        let OtherSide::Surface(second) = pair.second else { return Vec::new() };
        let mut copy = surface_pair(&active.surfaces, pair.first, second, PairLists::default());
        copy.bulge = pair.bulge;
        let mut moved = MovedBoxes::default();
        match surface_boxes(active, states.all(), (&mut copy, second), &mut moved) {
            SurfaceBoxes::Own(side) => occupied_cells(&self.0, side.boxes, None),
            SurfaceBoxes::Between([first, second]) => occupied_cells(&self.0, first.boxes, Some(second.boxes)),
        }
    }
}

fn add_hash(app: &mut App, settings: HashSettings) {
    app.insert_resource(UsedHash(settings))
        .add_systems(SurfaceDetection, pair_triangles.in_set(BroadPhaseSystems::PairTriangles));
}

fn pair_triangles(
    mut candidates: CandidateWriter,
    settings: Res<CircumsphereSettings>,
    used: Res<UsedHash>,
    mut hash: Local<SpatialHash>,
) {
    let threads = Threads(settings.threads);
    candidates.write_counted(|surfaces, pairs| match surfaces {
        SurfaceBoxes::Own(side) => hash.self_pairs(&threads, &used.0, side.boxes, pairs),
        SurfaceBoxes::Between([first, second]) => {
            hash.pairs_between(&threads, &used.0, [first.boxes, second.boxes], pairs)
        }
    });
    hash.rest();
}
