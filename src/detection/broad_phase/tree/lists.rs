//! Lists of near pairs, as far as trees are concerned. Traversals make the lists. A tree is idle if all its pairs
//! reuse a list or are kept.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::{
    detection::{
        broad_phase::tree::{MovedLeaves, Traversal},
        pairs::{CandidateTrianglePairs, OtherSide, SurfacePair},
        parallel::{Buffers, Threads, append_parts},
        reuse::{
            DetectionMemory,
            near_lists::{KeptList, KeptPairs, ListUse},
        },
        state::SurfaceState,
    },
    kernel::bvh::near_pairs::{BoundedPairs, ListedTriangles},
    settings::CircumsphereSettings,
    surface::ActiveSurfaces,
};

/// Marks for each active surface whether its tree is idle: all its pairs, if any, are kept or reuse a list.
pub(super) fn mark_idle_trees(
    active: &ActiveSurfaces,
    candidates: &CandidateTrianglePairs,
    memory: &DetectionMemory,
    kept: &KeptPairs,
    idle: &mut Vec<bool>,
) {
    idle.clear();
    idle.resize(active.surfaces.len(), true);
    let asks = |place: usize| !memory.keeps(place) && kept.list_use(place) != ListUse::Reused;
    for (_, pair) in candidates.pairs.iter().enumerate().filter(|&(place, _)| asks(place)) {
        idle[pair.first] = false;
        if let OtherSide::Surface(second) = pair.second {
            idle[second] = false;
        }
    }
}

/// Makes the list of a pair of surfaces.
pub(super) fn make_list(
    active: &ActiveSurfaces,
    settings: &CircumsphereSettings,
    pair: &SurfacePair,
    list: &mut KeptList,
    states: &[SurfaceState],
    spare: &Buffers<BoundedPairs>,
    threads: usize,
) {
    let OtherSide::Surface(second) = pair.second else { return };
    let (skin, mut moved) = (list.skin(), MovedLeaves::default());
    let sides = [&states[pair.first], &states[second]];
    let Some(mut traversal) = Traversal::new(active, pair, settings, sides, &mut moved) else { return };
    let Some(cull) = traversal.cull.as_mut() else { return };
    let range = cull.slabs;
    if range.is_infinite() {
        return;
    }
    cull.slabs = range + skin;
    cull.search_from = states[pair.first].tree.search_from(cull.slabs);
    let looked_at = AtomicUsize::new(0);
    append_parts(
        traversal.leaves.leaf_count(),
        traversal.leaves_at_once(threads),
        &Threads(threads),
        spare,
        &mut list.pairs,
        |part, pairs| {
            looked_at.fetch_add(traversal.append_bounded(part, range, skin, pairs), Ordering::Relaxed);
        },
        BoundedPairs::append,
    );
    list.looked_at = looked_at.into_inner();
    if traversal.is_reversed {
        list.pairs.reverse();
    }
    let count = |place: usize| active.surfaces[place].topology.triangles().len();
    list.pairs.sort(count(pair.first).max(count(second)));
}

/// Looks for gaps between the triangles of pairs on a reused list whose bound is inconclusive. Returns the number of
/// those pairs. In a new list, the traversal has done so.
pub(super) fn look_closer(
    active: &ActiveSurfaces,
    pair: &SurfacePair,
    list: &mut KeptList,
    states: &[SurfaceState],
    threads: usize,
) -> usize {
    let OtherSide::Surface(second) = pair.second else { return 0 };
    if list.list_use != ListUse::Reused {
        return 0;
    }
    let sides = [pair.first, second];
    let triangles = sides.map(|place| active.surfaces[place].topology.triangles());
    let positions = sides.map(|place| states[place].positions());
    list.look_closer(&ListedTriangles { positions, triangles }, threads)
}
