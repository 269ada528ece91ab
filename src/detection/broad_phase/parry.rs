//! Pairs of triangles by parry's own tree, on one thread: what [`TreeBroadPhasePlugin`](super::TreeBroadPhasePlugin) is
//! compared with, stage for stage.

use std::{
    collections::HashMap,
    sync::Arc,
    time::{Duration, Instant},
};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use parry3d::{
    bounding_volume,
    partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace},
};

use super::{
    BroadPhaseSystems, CandidateTrianglePairs, Frame, OtherSide, brute_force::pair_with_shape_brute_force, fill_pairs,
    shape_bounds,
};
use crate::{
    detection::{DetectionDiagnostics, DetectionMemory, TriangleBounds},
    kernel::mesh::{bounds::Aabb, ids::TriangleId, topology::SurfaceTopology},
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, SurfacePositions},
};

/// Finds pairs by [parry's tree](Bvh), one to a surface, built once and refitted wherever its boxes have moved. Drops no pair
/// of boxes that overlap, neighbors excepted. Disable [`TreeBroadPhasePlugin`](super::TreeBroadPhasePlugin) and add this:
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_circumsphere::detection::{ParryBroadPhasePlugin, TreeBroadPhasePlugin};
/// # let mut app = App::new();
/// app.add_plugins((
///     DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>(),
///     ParryBroadPhasePlugin,
/// ));
/// ```
pub struct ParryBroadPhasePlugin;

impl Plugin for ParryBroadPhasePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SurfaceDetection, pair_triangles.in_set(BroadPhaseSystems::PairTriangles));
    }
}

/// The tree over the boxes of a surface.
struct ParryTree {
    tree: Bvh,
    topology: Arc<SurfaceTopology>,
    /// How many times the boxes had been computed when the tree followed them last.
    followed: u64,
}

/// All of them, and what parry works in.
#[derive(Default)]
struct ParryTrees {
    trees: HashMap<Entity, ParryTree>,
    workspace: BvhWorkspace,
}

impl ParryTrees {
    /// Returns how long a first build took.
    fn follow(&mut self, surface: &ActiveSurface, bounds: &TriangleBounds) -> Duration {
        let boxes = (0u32..).zip(bounds.triangles().iter().map(parry_box));
        let followed = bounds.computed();
        match self.trees.get_mut(&surface.entity).filter(|tree| Arc::ptr_eq(&tree.topology, &surface.topology)) {
            Some(tree) if tree.followed == followed => {}
            Some(tree) => {
                for (triangle, bounds) in boxes {
                    tree.tree.insert_or_update_partially(bounds, triangle, 0.0);
                }
                tree.tree.refit(&mut self.workspace);
                tree.followed = followed;
            }
            None => {
                let build = Instant::now();
                let boxes = boxes.map(|(triangle, bounds)| (triangle as usize, bounds));
                let tree = Bvh::from_iter(BvhBuildStrategy::Binned, boxes);
                let tree = ParryTree { tree, topology: Arc::clone(&surface.topology), followed };
                self.trees.insert(surface.entity, tree);
                return build.elapsed();
            }
        }
        Duration::ZERO
    }
}

fn parry_box(bounds: &Aabb) -> bounding_volume::Aabb {
    bounding_volume::Aabb::new(bounds.min, bounds.max)
}

fn pair_triangles(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    candidates: ResMut<CandidateTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut trees: Local<ParryTrees>,
    surfaces: Query<(&SurfacePositions, &TriangleBounds)>,
) {
    let start = Instant::now();
    trees.trees.retain(|entity, _| active.surfaces.iter().any(|surface| surface.entity == *entity));
    for surface in &active.surfaces {
        let Ok((_, bounds)) = surfaces.get(surface.entity) else { continue };
        diagnostics.first_tree_builds += trees.follow(surface, bounds);
    }
    let start = start + diagnostics.first_tree_builds;
    diagnostics.finish("tree update", start, 0, 0);

    let ParryTrees { trees, workspace } = &mut *trees;
    fill_pairs(candidates, &mut memory, &mut diagnostics, |pair| {
        let first = &active.surfaces[pair.first];
        let Ok((positions, bounds)) = surfaces.get(first.entity) else { return };
        let tree = &trees[&first.entity].tree;
        let mut found = std::mem::take(&mut pair.triangles);
        match pair.second {
            _ if pair.is_self() => {
                tree.traverse_bvtt_single_tree::<false>(workspace, &mut |a, b| {
                    if !first.topology.share_vertex(TriangleId(a), TriangleId(b)) {
                        found.push([a.min(b), a.max(b)]);
                    }
                });
            }
            OtherSide::Surface(second) => {
                let second = &active.surfaces[second];
                let Ok((other_positions, other_bounds)) = surfaces.get(second.entity) else { return };
                // The boxes of one side ask the tree of the other one: those of the side that is moved, else of the second.
                let asks_first = pair.is_moved() && pair.frame == Frame::Second;
                let (asking, own, own_bounds, asked) = if asks_first {
                    (first, positions, bounds, &trees[&second.entity].tree)
                } else {
                    (second, other_positions, other_bounds, tree)
                };
                let mut ask = |triangle, bounds| {
                    let other = |other| if asks_first { [triangle, other] } else { [other, triangle] };
                    found.extend(asked.intersect_aabb(&parry_box(bounds)).map(other));
                };
                if pair.is_moved() {
                    let mut boxes = Vec::new();
                    pair.mover(asking, own, settings.margin()).move_all(&mut boxes);
                    for (triangle, bounds) in &boxes {
                        ask(*triangle, bounds);
                    }
                } else {
                    for (triangle, bounds) in (0..).zip(own_bounds.triangles()) {
                        ask(triangle, bounds);
                    }
                }
            }
            OtherSide::Shape(place) => {
                let shape = &active.shapes[place];
                if let Some(reach) = shape_bounds(pair, shape, first, settings.margin()) {
                    found.extend(tree.intersect_aabb(&parry_box(&reach)).map(|triangle| [triangle, 0]));
                } else {
                    // A shape without a box, a half-space, has nothing to ask the tree with.
                    pair_with_shape_brute_force(pair, shape, first, settings.margin(), bounds.triangles());
                    found.append(&mut pair.triangles);
                }
            }
        }
        pair.triangles = found;
    });
}
