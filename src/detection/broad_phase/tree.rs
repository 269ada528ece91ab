//! Pairs of triangles by a bounding volume tree per surface, refitted every tick.

use std::{sync::Arc, time::Instant};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    BroadPhaseSystems, CandidateTrianglePairs, Frame, OtherSide, brute_force::pair_with_shape_brute_force, shape_bounds,
};
use crate::{
    detection::{DetectionDiagnostics, TriangleBounds},
    kernel::{ids::TriangleId, topology::SurfaceTopology, tree::BoxTree},
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
    surface::ActiveSurfaces,
};

/// A tree is built anew once its boxes have grown by this factor relative to the surface: a refitted tree answers
/// correctly however old it is, only ever more slowly.
const REBUILD_DECAY: f32 = 1.5;

/// The tree over a surface's triangles, and the mesh it was built for.
#[derive(Component, Default)]
pub struct SurfaceTree {
    tree: BoxTree,
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
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<(&TriangleBounds, &mut SurfaceTree)>,
) {
    let start = Instant::now();
    for surface in &active.surfaces {
        let Ok((bounds, mut tree)) = surfaces.get_mut(surface.entity) else { continue };
        if tree.topology.as_ref().is_some_and(|topology| Arc::ptr_eq(topology, &surface.topology)) {
            if tree.followed == bounds.computed() {
                continue;
            }
            tree.tree.refit(&bounds.triangles);
            if tree.tree.decay() > REBUILD_DECAY {
                tree.tree.rebuild(&bounds.triangles);
                diagnostics.trees_rebuilt += 1;
            }
        } else {
            let build = Instant::now();
            tree.tree.rebuild(&bounds.triangles);
            tree.topology = Some(Arc::clone(&surface.topology));
            diagnostics.first_tree_builds += build.elapsed();
        }
        tree.followed = bounds.computed();
    }
    let start = start + diagnostics.first_tree_builds;
    diagnostics.finish("tree update", start, 0, 0);
}

fn pair_triangles(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut moved: Local<BoxTree>,
    surfaces: Query<(&TriangleBounds, &SurfaceTree)>,
) {
    let start = Instant::now();
    for pair in &mut candidates.pairs {
        let first = &active.surfaces[pair.first];
        let Ok((bounds, tree)) = surfaces.get(first.entity) else { continue };
        match pair.second {
            _ if pair.is_self() => {
                let apart = |[a, b]: [u32; 2]| !first.topology.share_vertex(TriangleId(a), TriangleId(b));
                tree.tree.self_pairs_where(apart, &mut pair.triangles);
            }
            OtherSide::Surface(second) => {
                let Ok((_, other)) = surfaces.get(active.surfaces[second].entity) else { continue };
                if pair.moved_bounds.is_empty() {
                    tree.tree.pairs_with(&other.tree, &mut pair.triangles);
                } else {
                    // The moved surface's tree keeps its structure; only its boxes are those of the common frame.
                    moved.copy_structure(if pair.frame == Frame::First { &other.tree } else { &tree.tree });
                    moved.refit(&pair.moved_bounds);
                    match pair.frame {
                        Frame::First => tree.tree.pairs_with(&moved, &mut pair.triangles),
                        Frame::Second => moved.pairs_with(&other.tree, &mut pair.triangles),
                    }
                }
            }
            OtherSide::Shape(place) => {
                let shape = &active.shapes[place];
                if let Some(reach) = shape_bounds(pair, shape, first, settings.margin()) {
                    tree.tree.query(&reach, |triangle| pair.triangles.push([triangle, 0]));
                } else {
                    // A shape without a box, a half-space, has nothing to ask the tree with.
                    pair_with_shape_brute_force(pair, shape, first, settings.margin(), &bounds.triangles);
                }
            }
        }
    }
    let count = candidates.triangle_pair_count();
    diagnostics.finish("broad phase", start, 0, count);
}
