//! Pairs of triangles by a bounding volume tree per surface, refitted every tick.

use std::{sync::Arc, time::Instant};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    BroadPhaseSystems, CandidateTrianglePairs, Frame, OtherSide, SurfacePair, brute_force::pair_with_shape_brute_force,
    shape_bounds,
};
use crate::{
    detection::{
        DetectionDiagnostics, TriangleBounds,
        parallel::append_ranges,
        sides::{pair_settings, surface_sides},
    },
    kernel::{
        leaf_triangles::{LeafTriangles, PairCull},
        topology::SurfaceTopology,
        tree::BoxTree,
    },
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// Leaves whose pairs one thread looks for at a time.
const LEAVES_AT_ONCE: usize = 64;

/// A tree is built anew once its boxes have grown by this factor relative to the surface: a refitted tree answers
/// correctly however old it is, only ever more slowly.
const REBUILD_DECAY: f32 = 1.5;

/// The tree over a surface's triangles, and the mesh it was built for.
#[derive(Component, Default)]
pub struct SurfaceTree {
    tree: BoxTree,
    triangles: LeafTriangles,
    /// How many times the boxes had been computed when the triangles followed them last.
    triangles_followed: u64,
    topology: Option<Arc<SurfaceTopology>>,
    /// How many times the boxes had been computed when the tree followed them last.
    followed: u64,
}

impl SurfaceTree {
    /// The tree over the surface's [`TriangleBounds`], in the surface's own frame; empty before the first detection.
    #[must_use]
    pub fn tree(&self) -> &BoxTree {
        &self.tree
    }
}

/// Finds pairs by trees. The default.
pub struct TreeBroadPhasePlugin;

impl Plugin for TreeBroadPhasePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            SurfaceDetection,
            (update_trees, pair_triangles).chain().in_set(BroadPhaseSystems::PairTriangles),
        );
    }
}

fn update_trees(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<(&SurfacePositions, &TriangleBounds, &mut SurfaceTree)>,
) {
    let start = Instant::now();
    let culled = culled_surfaces(&active, &candidates);
    for (surface, culled) in active.surfaces.iter().zip(culled) {
        let Ok((positions, bounds, mut tree)) = surfaces.get_mut(surface.entity) else { continue };
        let tree = &mut *tree;
        if tree.topology.as_ref().is_some_and(|topology| Arc::ptr_eq(topology, &surface.topology)) {
            if tree.followed != bounds.computed() {
                tree.tree.refit(&bounds.triangles);
                if tree.tree.decay() > REBUILD_DECAY {
                    tree.tree.rebuild(&bounds.triangles);
                    diagnostics.trees_rebuilt += 1;
                }
            }
        } else {
            let build = Instant::now();
            tree.tree.rebuild(&bounds.triangles);
            tree.topology = Some(Arc::clone(&surface.topology));
            diagnostics.first_tree_builds += build.elapsed();
        }
        tree.followed = bounds.computed();
        if culled && tree.triangles_followed != tree.followed {
            tree.triangles.update(&tree.tree, &surface.topology, &positions.0);
            tree.triangles_followed = tree.followed;
        }
    }
    let start = start + diagnostics.first_tree_builds;
    diagnostics.finish("tree update", start, 0, 0);
}

/// For each active surface whether a traversal asks about its triangles.
fn culled_surfaces(active: &ActiveSurfaces, candidates: &CandidateTrianglePairs) -> Vec<bool> {
    let mut culled = vec![false; active.surfaces.len()];
    for pair in &candidates.pairs {
        if let OtherSide::Surface(second) = pair.second {
            culled[pair.first] = true;
            culled[second] = true;
        }
    }
    culled
}

/// The tree and triangles of a surface in the frame of a pair, where that is not the surface's own.
#[derive(Default)]
struct MovedTree {
    tree: BoxTree,
    triangles: LeafTriangles,
}

fn pair_triangles(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut moved: Local<MovedTree>,
    surfaces: Query<(&SurfacePositions, &TriangleBounds, &SurfaceTree)>,
) {
    let start = Instant::now();
    let mut overlapping = 0;
    for pair in &mut candidates.pairs {
        let first = &active.surfaces[pair.first];
        let Ok((own, bounds, tree)) = surfaces.get(first.entity) else { continue };
        let threads = settings.threads;
        match pair.second {
            OtherSide::Surface(second) => {
                let second = &active.surfaces[second];
                let Ok((other, _, other_tree)) = surfaces.get(second.entity) else { continue };
                let slabs = slab_range(&active, pair, &settings, own, other);
                // The spheres' method counts by planes, and must count the same whoever finds its pairs.
                let centroids = pair.method.is_exact();
                let mut list = std::mem::take(&mut pair.triangles);
                if pair.is_self() {
                    let cull = PairCull { triangles: [&tree.triangles; 2], neighbors: true, slabs, centroids };
                    overlapping +=
                        append_ranges(tree.tree.leaf_count(), LEAVES_AT_ONCE, threads, &mut list, |leaves, pairs| {
                            tree.tree.self_pairs_of(leaves, Some(&cull), pairs)
                        });
                } else {
                    let mut sides = [(&tree.tree, &tree.triangles), (&other_tree.tree, &other_tree.triangles)];
                    if !pair.moved_bounds.is_empty() {
                        // The moved surface's tree keeps its structure; only its boxes are those of the common frame.
                        let (place, surface) = if pair.frame == Frame::First { (1, second) } else { (0, first) };
                        moved.tree.copy_structure(sides[place].0);
                        moved.tree.refit(&pair.moved_bounds);
                        let MovedTree { tree, triangles } = &mut *moved;
                        triangles.update(tree, &surface.topology, &pair.moved_positions);
                        sides[place] = (tree, triangles);
                    }
                    let cull = slabs.map(|range| PairCull {
                        triangles: [sides[0].1, sides[1].1],
                        neighbors: false,
                        slabs: Some(range),
                        centroids,
                    });
                    overlapping +=
                        append_ranges(sides[0].0.leaf_count(), LEAVES_AT_ONCE, threads, &mut list, |leaves, pairs| {
                            sides[0].0.pairs_of(leaves, sides[1].0, cull.as_ref(), pairs)
                        });
                }
                pair.triangles = list;
            }
            OtherSide::Shape(place) => {
                let shape = &active.shapes[place];
                if let Some(reach) = shape_bounds(pair, shape, first, settings.margin()) {
                    tree.tree.query(&reach, |triangle| pair.triangles.push([triangle, 0]));
                } else {
                    // A shape without a box, a half-space, has nothing to ask the tree with.
                    pair_with_shape_brute_force(pair, shape, first, settings.margin(), &bounds.triangles);
                }
                overlapping += pair.triangles.len();
            }
        }
    }
    let count = candidates.triangle_pair_count();
    diagnostics.finish("broad phase", start, overlapping, count);
}

/// The distance beyond which slabs that part two triangles decide, where a pair's method goes by that; in the unit of
/// the pair's frame.
fn slab_range(
    active: &ActiveSurfaces,
    pair: &SurfacePair,
    settings: &CircumsphereSettings,
    own: &SurfacePositions,
    other: &SurfacePositions,
) -> Option<f32> {
    if pair.method == ContactMethod::BoundingSphere {
        return None;
    }
    let pair_settings = pair_settings(pair, settings);
    let [a, b] = surface_sides(active, pair, own, other)?;
    pair_settings.cull.then(|| (pair_settings.range / pair_settings.scale) as f32 + a.rounding() + b.rounding())
}
