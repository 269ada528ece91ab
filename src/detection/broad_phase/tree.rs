//! Pairs triangles by a bounding volume tree per surface, which is refitted if a pair searches it, and by lists of near
//! pairs, which need no search.

use core::time::Duration;
use std::{
    ops::Range,
    sync::atomic::{AtomicUsize, Ordering},
};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use self::{
    lists::{look_closer, make_list, mark_idle_trees},
    needed::{NeededTriangles, mark_needed_triangles},
    update::update_each,
};
use crate::{
    detection::{
        broad_phase::{BroadPhaseSystems, custom::pair_with_shape},
        pairs::{CandidateTrianglePairs, Frame, GROWTH_SLACK, OtherSide, SurfacePair, shape_bounds},
        parallel::{Buffers, Threads, append_ranges, for_each_weighed},
        reuse::{
            DetectionMemory,
            near_lists::{KeptPairs, ListUse},
        },
        sides::{pair_settings, surface_sides},
        state::{SurfaceState, SurfaceStates, tree::Outcome},
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        bvh::{
            leaf_triangles::{LeafMesh, LeafTriangles, PairCull},
            moved_triangles::Reach,
            near_pairs::BoundedPairs,
            tree::{BoxTree, LEAF_WIDTH, LEAVES_TOGETHER},
        },
        capacity,
    },
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
    surface::ActiveSurfaces,
};

mod lists;
pub(super) mod needed;
mod normal_cones;
mod update;

pub use normal_cones::NormalConeCullingPlugin;

/// Leaves whose pairs one thread finds at a time: at least and at most. Adjacent leaves have the same leaves near them.
/// What one thread has loaded of those, the next must load again: on two threads, 256 take 0.93 of the time of 64.
const LEAST_AT_ONCE: usize = 64;
const MOST_AT_ONCE: usize = 256;

/// Tasks per thread if there are few leaves.
const PARTS_OF_A_THREAD: usize = 4;

/// Half the number of leaves from which a pair is worth several threads.
const LEAVES_OF_ONE: usize = 256;

/// The cost of finding what of one surface reaches another, in leaves.
const LEAVES_LOOKED_AT: usize = 16;

/// Entries of a list that are scanned in the time that the pairs of a leaf take.
const PAIRS_OF_A_LEAF: usize = 2000;

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

#[expect(clippy::too_many_arguments, reason = "a stage reads the results of earlier stages and ticks")]
fn update_trees(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    memory: Res<DetectionMemory>,
    mut kept: ResMut<KeptPairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut idle: Local<Vec<bool>>,
    mut needed: Local<Vec<NeededTriangles>>,
    mut states: ResMut<SurfaceStates>,
) {
    let start = StageWatch::start("tree update");
    kept.begin(&active, &candidates, &settings, &memory, states.all());
    mark_idle_trees(&active, &candidates, &memory, &kept, &mut idle);
    update_each(
        &active,
        &mut states,
        settings.threads,
        |place, SurfaceState { tree, bounds, .. }, surface, threads| {
            // A tree is built when its surface appears, not when something first comes near it.
            let rests = idle[place] && tree.is_of(surface);
            tree.outcome = if rests { Outcome::default() } else { tree.update(surface, bounds, threads) };
        },
    );
    let mut first_builds = Duration::ZERO;
    for Outcome { is_rebuilt, first_build } in states.all().iter().map(|state| state.tree.outcome) {
        diagnostics.trees_rebuilt += usize::from(is_rebuilt);
        first_builds += first_build;
    }
    // Several threads may build several trees at the same time.
    diagnostics.first_tree_builds += first_builds.min(start.elapsed());
    for_each_weighed(
        &mut candidates.pairs,
        settings.threads,
        LEAVES_OF_ONE,
        |place, pair| usize::from(pair.is_moved() && !memory.keeps(place)) * LEAVES_LOOKED_AT,
        |place, pair, _| {
            if !memory.keeps(place) {
                move_triangles(&active, pair, states.all());
            }
        },
    );
    mark_needed_triangles(&active, &candidates, &settings, &memory, &kept, states.all(), &mut needed);
    update_each(
        &active,
        &mut states,
        settings.threads,
        |place, SurfaceState { tree, bounds, .. }, surface, threads| {
            if !idle[place] {
                tree.update_triangles(&needed[place], surface, bounds, threads);
            }
        },
    );
    capacity::trim(&mut needed, active.surfaces.len());
    let first_builds = diagnostics.first_tree_builds;
    diagnostics.finish(start.without(first_builds), 0, 0);
}

/// Transforms the triangles of a pair's moved surface that reach the box of the other one.
fn move_triangles(active: &ActiveSurfaces, pair: &mut SurfacePair, states: &[SurfaceState]) {
    let OtherSide::Surface(second) = pair.second else { return };
    let sides = match pair.frame {
        Frame::First => [second, pair.first],
        Frame::Second => [pair.first, second],
    };
    if !pair.is_moved() {
        return;
    }
    let surface = &active.surfaces[sides[0]];
    let [SurfaceState { tree, bounds, .. }, other] = sides.map(|place| &states[place]);
    let target = other.tree.tree.bounds();
    let reach = Reach::new(&pair.relative_pose, &target);
    let mut reaching = std::mem::take(&mut pair.moved_triangles);
    let mut mover = pair.mover(surface, bounds.positions());
    tree.tree.visit_reaching(&reach, |items| {
        let before = reaching.len();
        mover.move_triangles(items, &mut reaching);
        let mut kept = before;
        for place in before..reaching.len() {
            reaching[kept] = reaching[place];
            kept += usize::from(reaching[kept].1.overlaps(&target));
        }
        reaching.truncate(kept);
    });
    pair.moved_triangles = reaching;
}

/// Triangles in the frame of another surface, as the leaves of a tree without nodes.
#[derive(Default)]
pub(in crate::detection) struct MovedLeaves {
    leaves: BoxTree,
    triangles: LeafTriangles,
}

#[expect(clippy::too_many_arguments, reason = "a stage reads the results of earlier stages and ticks")]
fn pair_triangles(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    memory: Res<DetectionMemory>,
    mut kept: ResMut<KeptPairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    buffers: Local<Buffers<MovedLeaves>>,
    spare: Local<Buffers<Vec<[u32; 2]>>>,
    spare_lists: Local<Buffers<BoundedPairs>>,
    states: Res<SurfaceStates>,
) {
    let start = StageWatch::start("broad phase");
    let states = states.all();
    let leaf_count = |place: usize| active.surfaces[place].topology.triangles().len() / LEAF_WIDTH;
    let weight = |pair: &SurfacePair| match pair.second {
        OtherSide::Surface(second) => leaf_count(pair.first).min(leaf_count(second)),
        OtherSide::Shape(_) => 1,
    };
    let triangle_count = |pair: &SurfacePair| match pair.second {
        OtherSide::Surface(second) if !pair.is_self() => LEAF_WIDTH * (leaf_count(pair.first) + leaf_count(second)),
        _ => LEAF_WIDTH * leaf_count(pair.first),
    };
    let overlapping = AtomicUsize::new(0);
    for_each_weighed(
        &mut kept.lists,
        settings.threads,
        LEAVES_OF_ONE,
        |place, list| match list.list_use {
            ListUse::None => 0,
            ListUse::Made => weight(&candidates.pairs[place]),
            ListUse::Reused => list.pairs.len() / PAIRS_OF_A_LEAF,
        },
        |place, list, threads| {
            if list.list_use == ListUse::Made {
                make_list(&active, &settings, &candidates.pairs[place], list, states, &spare_lists, threads);
            }
            if list.list_use != ListUse::None {
                overlapping.fetch_add(list.pairs.len(), Ordering::Relaxed);
                let pair = &candidates.pairs[place];
                let glanced_at = look_closer(&active, pair, list, states, threads);
                list.find_near(triangle_count(pair), glanced_at);
            }
        },
    );
    for_each_weighed(
        &mut candidates.pairs,
        settings.threads,
        LEAVES_OF_ONE,
        |place, pair| {
            let is_found = memory.keeps(place) || kept.list_use(place) != ListUse::None;
            if is_found { 0 } else { weight(pair) }
        },
        |place, pair, threads| {
            if memory.keeps(place) || kept.list_use(place) != ListUse::None {
                return;
            }
            let found = match pair.second {
                OtherSide::Surface(second) => buffers.with(|moved| {
                    pair_surface(&active, &settings, pair, second, states, moved, &spare, threads).unwrap_or_default()
                }),
                OtherSide::Shape(place) => pair_shape(&active, pair, place, states),
            };
            overlapping.fetch_add(found, Ordering::Relaxed);
        },
    );
    if candidates.pairs.is_empty() {
        buffers.clear();
        spare.clear();
        spare_lists.clear();
    }
    kept.count(&mut diagnostics);
    kept.hand_over(&mut candidates.pairs);
    let count = memory.changed(&candidates.pairs).map(|pair| pair.triangles.len()).sum();
    diagnostics.finish(start, overlapping.into_inner(), count);
}

/// Two trees in one frame. One is visited leaf by leaf, and the other one is searched for what is near. Also defines
/// which pairs are dropped.
pub(in crate::detection) struct Traversal<'a> {
    leaves: &'a BoxTree,
    tree: &'a BoxTree,
    is_self: bool,
    /// Whether the leaves belong to the second surface.
    is_reversed: bool,
    /// `None` if nothing is dropped.
    cull: Option<PairCull<'a>>,
}

impl<'a> Traversal<'a> {
    /// `moved` is memory for the triangles of a moved surface. `None` if the moved surface has no triangles near the
    /// other one.
    pub(in crate::detection) fn new(
        active: &ActiveSurfaces,
        pair: &SurfacePair,
        settings: &CircumsphereSettings,
        [own, other]: [&'a SurfaceState; 2],
        moved: &'a mut MovedLeaves,
    ) -> Option<Self> {
        let mut sides = [own, other].map(|state| (&state.tree.tree, &state.tree.triangles));
        let mut side = usize::from(sides[1].0.leaf_count() < sides[0].0.leaf_count());
        let slabs = slab_range(active, pair, settings, [own, other]).unwrap_or(f32::INFINITY);
        if let Some(surface) = pair.moved_surface(active) {
            if pair.moved_triangles.is_empty() {
                return None;
            }
            side = usize::from(pair.frame == Frame::First);
            moved.leaves.collect_leaves(&pair.moved_triangles);
            if slabs.is_finite() {
                let mesh = LeafMesh {
                    positions: &pair.moved_positions,
                    scale: pair.relative_pose.largest_scale() as f32 * GROWTH_SLACK,
                    ..[own, other][side].bounds.leaf_mesh(&surface.topology)
                };
                moved.triangles.update(&moved.leaves, &mesh);
            }
            sides[side] = (&moved.leaves, &moved.triangles);
        }
        let is_self = pair.is_self();
        let ((leaves, triangles), (tree, tree_triangles)) = (sides[side], sides[1 - side]);
        let cull = (is_self || slabs.is_finite()).then_some(PairCull {
            triangles: [triangles, tree_triangles],
            neighbors: is_self,
            slabs,
            // `Circumsphere` tests planes itself, and must drop the same pairs whatever finds its candidates. It loses no
            // pair of a smooth surface.
            search_from: own.tree.search_from(slabs),
            planes_only: !pair.method.is_exact() && !pair.is_smooth(active),
        });
        Some(Self { leaves, tree, is_self, is_reversed: side == 1, cull })
    }

    /// The number of leaves that one thread handles at a time, a multiple of the number that search together.
    fn leaves_at_once(&self, threads: usize) -> usize {
        let even = self.leaves.leaf_count() / (PARTS_OF_A_THREAD * Threads(threads).most());
        even.clamp(LEAST_AT_ONCE, MOST_AT_ONCE) / LEAVES_TOGETHER * LEAVES_TOGETHER
    }

    /// Appends the pairs of triangles whose boxes overlap and that are not dropped. If the traversal is reversed, the
    /// triangle of the second surface comes first. Returns the number of pairs before slabs drop any.
    fn append(&self, leaves: Range<usize>, cull: Option<&PairCull<'_>>, pairs: &mut Vec<[u32; 2]>) -> usize {
        if self.is_self {
            self.tree.self_pairs_of(leaves, cull, pairs)
        } else {
            self.leaves.pairs_of(leaves, self.tree, cull, pairs)
        }
    }

    /// Appends these pairs and those within a skin, with bounds. Does nothing if the traversal drops nothing. Returns
    /// the number of pairs before slabs drop any.
    fn append_bounded(&self, leaves: Range<usize>, range: f32, skin: f32, pairs: &mut BoundedPairs) -> usize {
        match &self.cull {
            Some(cull) if self.is_self => self.tree.bounded_self_pairs_of(leaves, range, skin, cull, pairs),
            Some(cull) => self.leaves.bounded_pairs_of(leaves, self.tree, range, skin, cull, pairs),
            None => 0,
        }
    }

    fn append_dropped_by_slabs(&self, leaves: Range<usize>, dropped: &mut Vec<[u32; 2]>) {
        let Some(cull) = self.cull.as_ref().filter(|cull| cull.slabs.is_finite()) else { return };
        let (mut all, mut kept) = (Vec::new(), Vec::new());
        self.append(leaves.clone(), Some(&PairCull { slabs: f32::INFINITY, search_from: &[], ..*cull }), &mut all);
        self.append(leaves, Some(cull), &mut kept);
        let mut kept = kept.into_iter().peekable();
        dropped.extend(all.into_iter().filter(|pair| kept.next_if_eq(pair).is_none()));
    }

    /// The pairs of triangles that only slabs have dropped.
    pub(in crate::detection) fn pairs_dropped_by_slabs(&self, threads: usize) -> Vec<[u32; 2]> {
        let mut dropped = Vec::new();
        append_ranges(
            self.leaves.leaf_count(),
            self.leaves_at_once(threads),
            &Threads(threads),
            &Buffers::default(),
            &mut dropped,
            |part, dropped| {
                self.append_dropped_by_slabs(part, dropped);
                0
            },
        );
        if self.is_reversed {
            for triangles in &mut dropped {
                triangles.reverse();
            }
        }
        dropped
    }

    /// Whether two triangles are such a pair. In a self-collision, the lower one comes first.
    pub(in crate::detection) fn is_dropped_by_slabs(&self, mut triangles: [u32; 2]) -> bool {
        if self.is_reversed {
            triangles.reverse();
        }
        let mut dropped = Vec::new();
        for leaf in 0..self.leaves.leaf_count() {
            // In a self-collision, a pair is found from the earlier one of its leaves.
            let items = self.leaves.leaf_items(leaf);
            if items.contains(&triangles[0]) || self.is_self && items.contains(&triangles[1]) {
                self.append_dropped_by_slabs(leaf..leaf + 1, &mut dropped);
            }
        }
        dropped.contains(&triangles)
    }
}

/// Pairs the triangles of two surfaces, or of one with itself. Returns how many pairs of boxes overlap, or `None` if
/// nothing is near.
#[expect(clippy::too_many_arguments, reason = "what a stage reads and where it writes")]
fn pair_surface(
    active: &ActiveSurfaces,
    settings: &CircumsphereSettings,
    pair: &mut SurfacePair,
    second: usize,
    states: &[SurfaceState],
    moved: &mut MovedLeaves,
    spare: &Buffers<Vec<[u32; 2]>>,
    threads: usize,
) -> Option<usize> {
    let traversal = Traversal::new(active, pair, settings, [&states[pair.first], &states[second]], moved)?;
    let (leaf_count, at_once) = (traversal.leaves.leaf_count(), traversal.leaves_at_once(threads));
    let found = append_ranges(leaf_count, at_once, &Threads(threads), spare, &mut pair.triangles, |part, pairs| {
        traversal.append(part, traversal.cull.as_ref(), pairs)
    });
    if traversal.is_reversed {
        for triangles in &mut pair.triangles {
            triangles.reverse();
        }
    }
    Some(found)
}

/// Pairs the triangles of a surface with a shape. Returns how many boxes overlap.
fn pair_shape(active: &ActiveSurfaces, pair: &mut SurfacePair, place: usize, states: &[SurfaceState]) -> usize {
    let (first, shape) = (&active.surfaces[pair.first], &active.shapes[place]);
    let SurfaceState { tree, bounds, .. } = &states[pair.first];
    if let Some(reach) = shape_bounds(pair, shape, first) {
        tree.tree.query(&reach, |triangle| pair.triangles.push([triangle, 0]));
    } else {
        // A half-space has no box to search the tree with.
        pair_with_shape(active, pair, place, bounds.triangles());
    }
    pair.triangles.len()
}

/// The distance beyond which slabs drop a pair of triangles, in the unit of the pair's frame. `None` if the pair's
/// method does not use slabs.
fn slab_range(
    active: &ActiveSurfaces,
    pair: &SurfacePair,
    settings: &CircumsphereSettings,
    states: [&SurfaceState; 2],
) -> Option<f32> {
    if !pair.has_slabs(settings) {
        return None;
    }
    let pair_settings = pair_settings(pair, settings);
    let [a, b] = surface_sides(active, pair, states)?;
    Some((pair_settings.range / pair_settings.scale) as f32 + a.rounding() + b.rounding())
}
