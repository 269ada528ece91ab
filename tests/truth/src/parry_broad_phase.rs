//! Pairs of triangles from parry's tree, on one thread. The default broad phase is compared with it stage by stage.

use std::collections::HashMap;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    SurfaceDetection,
    detection::{BoxSide, BroadPhaseSystems, CandidateWriter, SurfaceBoxes},
};
use bevy_ecs::prelude::*;
use parry3d::{
    bounding_volume::Aabb,
    partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace},
};

/// Finds pairs with [parry's tree](Bvh). Each surface has one tree, which is built once and refitted wherever its boxes
/// have moved. Keeps every pair of overlapping boxes. To use it, disable the
/// [`TreeBroadPhasePlugin`](bevy_circumsphere::detection::TreeBroadPhasePlugin) and add this plugin.
pub struct ParryBroadPhasePlugin;

impl Plugin for ParryBroadPhasePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SurfaceDetection, pair_triangles.in_set(BroadPhaseSystems::PairTriangles));
    }
}

/// The trees of all surfaces by entity, each with the version of its boxes, and parry's workspace.
#[derive(Default)]
struct ParryTrees {
    trees: HashMap<Entity, (Bvh, u64, usize)>,
    workspace: BvhWorkspace,
}

impl ParryTrees {
    /// Updates the tree of a surface whose boxes were not transformed.
    fn follow(&mut self, side: &BoxSide<'_>, version: u64) {
        let boxes = || side.boxes.iter().map(|bounds| Aabb::new(bounds.min, bounds.max));
        match self.trees.get_mut(&side.entity).filter(|(.., count)| *count == side.boxes.len()) {
            Some((_, followed, _)) if *followed == version => {}
            Some((tree, followed, _)) => {
                for (triangle, bounds) in (0..).zip(boxes()) {
                    tree.insert_or_update_partially(bounds, triangle, 0.0);
                }
                tree.refit(&mut self.workspace);
                *followed = version;
            }
            None => {
                let tree = Bvh::from_iter(BvhBuildStrategy::Binned, boxes().enumerate());
                self.trees.insert(side.entity, (tree, version, side.boxes.len()));
            }
        }
    }
}

fn pair_triangles(mut candidates: CandidateWriter, mut trees: Local<ParryTrees>) {
    candidates.write(|surfaces, pairs| match surfaces {
        SurfaceBoxes::Own(side) => {
            trees.follow(&side, side.version.expect("a single surface is not transformed"));
            let ParryTrees { trees, workspace } = &mut *trees;
            let (tree, ..) = &trees[&side.entity];
            tree.traverse_bvtt_single_tree::<false>(workspace, &mut |a: u32, b: u32| pairs.push([a.min(b), a.max(b)]));
        }
        SurfaceBoxes::Between([first, second]) => {
            // The boxes of one side query the tree of the other. The side whose boxes were transformed queries,
            // otherwise the second.
            let is_first_asked = first.version.is_some();
            let (asked, asking) = if is_first_asked { (first, second) } else { (second, first) };
            trees.follow(&asked, asked.version.expect("one side is in its own frame"));
            let (tree, ..) = &trees.trees[&asked.entity];
            for (triangle, bounds) in (0..).zip(asking.boxes) {
                let other = |other| if is_first_asked { [other, triangle] } else { [triangle, other] };
                pairs.extend(tree.intersect_aabb(&Aabb::new(bounds.min, bounds.max)).map(other));
            }
        }
    });
}
