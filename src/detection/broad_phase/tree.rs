//! Pairs of triangles by a bounding volume tree per surface, refitted every tick.

use std::{
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Instant,
};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    BroadPhaseSystems, CandidateTrianglePairs, Frame, OtherSide, REBUILD_DECAY, SurfacePair,
    brute_force::pair_with_shape_brute_force, moved::Reach, shape_bounds,
};
use crate::{
    detection::{
        DetectionDiagnostics, TriangleBounds,
        parallel::{Buffers, append_ranges, for_each_weighed},
        sides::{pair_settings, surface_sides},
    },
    kernel::{
        leaf_triangles::{LeafTriangles, PairCull},
        topology::SurfaceTopology,
        tree::{BoxTree, LEAF_WIDTH},
    },
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// Leaves whose pairs one thread looks for at a time.
const LEAVES_AT_ONCE: usize = 64;

/// Leaves of a pair that are worth more than one thread, by half.
const LEAVES_OF_ONE: usize = 256;

/// How many leaves of work it is to find out what of one surface reaches another.
const LEAVES_LOOKED_AT: usize = 16;

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

type TreesToUpdate<'w, 's> =
    Query<'w, 's, (&'static SurfacePositions, &'static TriangleBounds, &'static mut SurfaceTree)>;

fn update_trees(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut culled: Local<Vec<bool>>,
    mut surfaces: TreesToUpdate,
) {
    let start = Instant::now();
    for surface in &active.surfaces {
        let Ok((_, bounds, mut tree)) = surfaces.get_mut(surface.entity) else { continue };
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
    }
    let trees = surfaces.as_readonly();
    for_each_weighed(
        &mut candidates.pairs,
        settings.threads,
        LEAVES_OF_ONE,
        |_, pair| usize::from(pair.is_moved()) * LEAVES_LOOKED_AT,
        |_, pair, _| move_triangles(&active, &settings, pair, &trees),
    );
    mark_culled_surfaces(&active, &candidates, &mut culled);
    for (surface, &culled) in active.surfaces.iter().zip(&*culled) {
        let Ok((positions, _, mut tree)) = surfaces.get_mut(surface.entity) else { continue };
        let tree = &mut *tree;
        if culled && tree.triangles_followed != tree.followed {
            tree.triangles.update(&tree.tree, &surface.topology, &positions.0);
            tree.triangles_followed = tree.followed;
        }
    }
    let start = start + diagnostics.first_tree_builds;
    diagnostics.finish("tree update", start, 0, 0);
}

/// Brings over what of a pair's moved surface reaches the other one's box.
fn move_triangles(
    active: &ActiveSurfaces,
    settings: &CircumsphereSettings,
    pair: &mut SurfacePair,
    surfaces: &Query<(&SurfacePositions, &TriangleBounds, &SurfaceTree)>,
) {
    let OtherSide::Surface(second) = pair.second else { return };
    let sides = match pair.frame {
        Frame::First => [second, pair.first],
        Frame::Second => [pair.first, second],
    };
    let [surface, other] = sides.map(|place| &active.surfaces[place]);
    if !pair.is_moved() {
        return;
    }
    let (Ok((own, _, tree)), Ok((.., other_tree))) = (surfaces.get(surface.entity), surfaces.get(other.entity)) else {
        return;
    };
    let target = other_tree.tree.bounds();
    let reach = Reach::new(&pair.relative_pose, &target);
    if !reach.is_reached_by(&tree.tree.bounds()) {
        return;
    }
    let mut reaching = std::mem::take(&mut pair.moved_triangles);
    let mut mover = pair.mover(surface, own, settings.margin());
    tree.tree.visit_where(
        |bounds| reach.is_reached_by(bounds),
        |items| {
            let bounds = items.iter().map(|&triangle| (triangle, mover.bounds(triangle)));
            reaching.extend(bounds.filter(|(_, bounds)| bounds.overlaps(&target)));
        },
    );
    pair.moved_triangles = reaching;
}

/// Marks for each active surface whether a traversal asks about its triangles where they are: of one that is moved it asks
/// about those that were brought over.
fn mark_culled_surfaces(active: &ActiveSurfaces, candidates: &CandidateTrianglePairs, culled: &mut Vec<bool>) {
    culled.clear();
    culled.resize(active.surfaces.len(), false);
    for pair in &candidates.pairs {
        if let OtherSide::Surface(second) = pair.second {
            let reached = !pair.moved_triangles.is_empty();
            culled[pair.first] |= !pair.is_moved() || (reached && pair.frame == Frame::First);
            culled[second] |= !pair.is_moved() || (reached && pair.frame == Frame::Second);
        }
    }
}

/// Triangles in the frame of another surface, as the leaves of a tree without nodes.
#[derive(Default)]
struct MovedLeaves {
    leaves: BoxTree,
    triangles: LeafTriangles,
}

type TreeQuery<'w, 's> = Query<'w, 's, (&'static SurfacePositions, &'static TriangleBounds, &'static SurfaceTree)>;

fn pair_triangles(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    buffers: Local<Buffers<MovedLeaves>>,
    surfaces: TreeQuery,
) {
    let start = Instant::now();
    let leaf_count = |place: usize| active.surfaces[place].topology.triangles().len() / LEAF_WIDTH;
    let weight = |pair: &SurfacePair| match pair.second {
        OtherSide::Surface(second) => leaf_count(pair.first).min(leaf_count(second)),
        OtherSide::Shape(_) => 1,
    };
    let overlapping = AtomicUsize::new(0);
    for_each_weighed(
        &mut candidates.pairs,
        settings.threads,
        LEAVES_OF_ONE,
        |_, pair| weight(pair),
        |_, pair, threads| {
            let found = match pair.second {
                OtherSide::Surface(_) if pair.is_self() => pair_itself(&active, &settings, pair, &surfaces, threads),
                OtherSide::Surface(second) => buffers.with(|moved| {
                    pair_surface(&active, &settings, pair, second, &surfaces, moved, threads).unwrap_or_default()
                }),
                OtherSide::Shape(place) => pair_shape(&active, &settings, pair, place, &surfaces),
            };
            overlapping.fetch_add(found, Ordering::Relaxed);
        },
    );
    let count = candidates.triangle_pair_count();
    diagnostics.finish("broad phase", start, overlapping.into_inner(), count);
}

/// Pairs the triangles of one surface. Returns how many boxes overlap, here and in the following.
fn pair_itself(
    active: &ActiveSurfaces,
    settings: &CircumsphereSettings,
    pair: &mut SurfacePair,
    surfaces: &TreeQuery,
    threads: usize,
) -> usize {
    let Ok((own, _, tree)) = surfaces.get(active.surfaces[pair.first].entity) else { return 0 };
    let slabs = slab_range(active, pair, settings, own, own);
    let cull = PairCull { triangles: [&tree.triangles; 2], neighbors: true, slabs, centroids: pair.method.is_exact() };
    append_ranges(tree.tree.leaf_count(), LEAVES_AT_ONCE, threads, &mut pair.triangles, |leaves, pairs| {
        tree.tree.self_pairs_of(leaves, Some(&cull), pairs)
    })
}

/// Pairs the triangles of two surfaces. `None` where one of them is gone.
fn pair_surface(
    active: &ActiveSurfaces,
    settings: &CircumsphereSettings,
    pair: &mut SurfacePair,
    second: usize,
    surfaces: &TreeQuery,
    moved: &mut MovedLeaves,
    threads: usize,
) -> Option<usize> {
    let (own, _, own_tree) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (other, _, other_tree) = surfaces.get(active.surfaces[second].entity).ok()?;
    let mut sides = [(&own_tree.tree, &own_tree.triangles), (&other_tree.tree, &other_tree.triangles)];
    // The side that is gone through leaf by leaf, while the other one is asked what is near.
    let mut side = usize::from(sides[1].0.leaf_count() < sides[0].0.leaf_count());
    let slabs = slab_range(active, pair, settings, own, other);
    if let Some(surface) = pair.moved_surface(active) {
        if pair.moved_triangles.is_empty() {
            return Some(0);
        }
        side = if pair.frame == Frame::First { 1 } else { 0 };
        moved.leaves.collect_leaves(&pair.moved_triangles);
        if slabs.is_some() {
            moved.triangles.update(&moved.leaves, &surface.topology, &pair.moved_positions);
        }
        sides[side] = (&moved.leaves, &moved.triangles);
    }
    let ((leaves, triangles), (tree, tree_triangles)) = (sides[side], sides[1 - side]);
    // The spheres' method counts by planes, and must count the same whoever finds its pairs.
    let centroids = pair.method.is_exact();
    let cull = slabs.map(|range| PairCull {
        triangles: [triangles, tree_triangles],
        neighbors: false,
        slabs: Some(range),
        centroids,
    });
    let found = append_ranges(leaves.leaf_count(), LEAVES_AT_ONCE, threads, &mut pair.triangles, |part, pairs| {
        leaves.pairs_of(part, tree, cull.as_ref(), pairs)
    });
    if side == 1 {
        pair.triangles.iter_mut().for_each(|triangles| triangles.reverse());
    }
    Some(found)
}

/// Pairs the triangles of a surface with a shape.
fn pair_shape(
    active: &ActiveSurfaces,
    settings: &CircumsphereSettings,
    pair: &mut SurfacePair,
    place: usize,
    surfaces: &TreeQuery,
) -> usize {
    let (first, shape) = (&active.surfaces[pair.first], &active.shapes[place]);
    let Ok((_, bounds, tree)) = surfaces.get(first.entity) else { return 0 };
    if let Some(reach) = shape_bounds(pair, shape, first, settings.margin()) {
        tree.tree.query(&reach, |triangle| pair.triangles.push([triangle, 0]));
    } else {
        // A shape without a box, a half-space, has nothing to ask the tree with.
        pair_with_shape_brute_force(pair, shape, first, settings.margin(), &bounds.triangles);
    }
    pair.triangles.len()
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
