//! Leaves regions out of a self-collision that are too flat to come near themselves.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{TreeBroadPhasePlugin, pair_triangles, slab_range, update_trees};
use crate::{
    detection::{
        broad_phase::BroadPhaseSystems,
        pairs::{CandidateTrianglePairs, OtherSide},
        reuse::{
            DetectionMemory,
            near_lists::{KeptList, KeptPairs, ListUse},
        },
        state::{SurfaceState, SurfaceStates},
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{bvh::flat_regions::TreeOfMesh, mesh::motion::Motion},
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
    surface::ActiveSurfaces,
};

/// Lets [`TreeBroadPhasePlugin`] leave out regions of a self-colliding surface that are so
/// flat that nothing in one comes near anything else in it. Contacts are the same with and without it.
///
/// A region is left out if its normals lie in a cone of less than 90 degrees and its contour, seen along the axis, does
/// not come near itself (Volino and Magnenat-Thalmann 1994, extended from crossings to distances). The regions are kept
/// until the surface has moved too far within itself. Where that does not pay, they are looked for more and more
/// rarely. Only for exact methods, and not for smooth surfaces, whose patches are not flat. Does nothing unless the plugin
/// of the tree was added before.
pub struct NormalConeCullingPlugin;

impl Plugin for NormalConeCullingPlugin {
    fn build(&self, app: &mut App) {
        if app.is_plugin_added::<TreeBroadPhasePlugin>() {
            let find = find_flat_regions.after(update_trees).before(pair_triangles);
            app.add_systems(SurfaceDetection, find.in_set(BroadPhaseSystems::PairTriangles));
        }
    }
}

fn find_flat_regions(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    candidates: Res<CandidateTrianglePairs>,
    memory: Res<DetectionMemory>,
    kept: Res<KeptPairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut states: ResMut<SurfaceStates>,
) {
    let start = StageWatch::start("normal cones");
    let (mut leaves, mut left_out) = (0, 0);
    for (number, pair) in candidates.pairs.iter().enumerate().filter(|(_, pair)| pair.is_self()) {
        let OtherSide::Surface(place) = pair.second else { continue };
        let is_traversed = !memory.keeps(number) && kept.list_use(number) != ListUse::Reused;
        if !is_traversed || !pair.method.is_exact() || pair.is_smooth(&active) {
            continue;
        }
        let own = &states.all()[place];
        let Some(range) = slab_range(&active, pair, &settings, [own, own]) else { continue };
        let skin = kept.lists.get(number).filter(|list| list.list_use == ListUse::Made).map_or(0.0, KeptList::skin);
        let SurfaceState { tree, bounds, .. } = &mut states.all_mut()[place];
        let motion = if settings.memory { bounds.motion_since(tree.regions_version) } else { Motion::UNKNOWN };
        let surface = TreeOfMesh {
            tree: &tree.tree,
            triangles: &tree.triangles,
            topology: &active.surfaces[place].topology,
            positions: bounds.positions(),
        };
        tree.flat_regions.update(&surface, range + skin, &motion);
        tree.regions_version = tree.version;
        leaves += tree.tree.leaf_count();
        left_out += tree.flat_regions.leaf_count();
    }
    diagnostics.finish(start, leaves, left_out);
}
