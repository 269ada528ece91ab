//! Stage 2: finds which surfaces and shapes are near each other, and which of their triangles may be.
//!
//! [`BroadPhasePlugin`] pairs surfaces. One algorithm plugin beside it pairs their triangles. Every algorithm results
//! in the same contacts. To use your own, disable [`TreeBroadPhasePlugin`] and add a system in
//! [`BroadPhaseSystems::PairTriangles`] that calls [`CandidateWriter::write`].

mod brute_force;
mod custom;
mod filter;
mod patches;
mod spatial_hash;
mod tree;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use crate::{
    detection::{
        pairs::{
            CandidateTrianglePairs, GROWTH_SLACK, OtherSide, PairLists, SurfacePair, moved_box, shape_pair,
            surface_pair,
        },
        reuse::{DetectionMemory, near_lists::KeptPairs},
        state::SurfaceStates,
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{bvh::tree::BoxTree, capacity, mesh::bounds::Aabb},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactFilter},
};

pub use brute_force::BruteForceBroadPhasePlugin;
pub use custom::{BoxSide, CandidateWriter, SurfaceBoxes};
#[cfg(feature = "rerun")]
pub(crate) use spatial_hash::UsedHash;
pub use spatial_hash::{HierarchicalSpatialHashBroadPhasePlugin, SpatialHashBroadPhasePlugin};
pub(super) use tree::{MovedLeaves, Traversal, needed::Needed};
pub use tree::{NormalConeCullingPlugin, TreeBroadPhasePlugin};

/// A tree is rebuilt when its boxes have grown by this factor relative to the whole. A refitted tree gives correct
/// results at any age, but becomes slower.
const REBUILD_DECAY: f32 = 1.5;

/// The steps of the broad phase, in this order.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BroadPhaseSystems {
    /// Pairs surfaces and shapes whose boxes overlap.
    PairSurfaces,
    /// Pairs triangles whose boxes overlap and that no slab separates.
    PairTriangles,
    /// Leaves out pairs of triangles that make no contact although their surfaces meet, see
    /// [`RestContactsIgnored`](crate::RestContactsIgnored), [`TriangleLayers`](crate::TriangleLayers), and
    /// [`ContactFilter`](crate::ContactFilter).
    Filter,
}

/// Pairs surfaces and shapes. Needs one algorithm plugin beside it.
pub struct BroadPhasePlugin;

impl Plugin for BroadPhasePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<CandidateTrianglePairs>().init_resource::<DetectionMemory>().init_resource::<KeptPairs>();
        app.configure_sets(
            SurfaceDetection,
            (BroadPhaseSystems::PairSurfaces, BroadPhaseSystems::PairTriangles, BroadPhaseSystems::Filter)
                .chain()
                .in_set(SurfaceDetectionSystems::BroadPhase),
        );
        app.add_systems(
            SurfaceDetection,
            (
                (pair_surfaces, patches::bend_surfaces).chain().in_set(BroadPhaseSystems::PairSurfaces),
                filter::leave_out.in_set(BroadPhaseSystems::Filter),
            ),
        );
    }
}

/// State and buffers that are kept from tick to tick.
#[derive(Default)]
struct PairingBuffers {
    bounds: Vec<Aabb>,
    tree: BoxTree,
    places: Vec<[u32; 2]>,
    with_shapes: Vec<[usize; 2]>,
    /// The pairs of the last tick, until they are kept or their lists are reused.
    last: Vec<Option<SurfacePair>>,
    /// The names of those pairs, ascending.
    last_names: Vec<(bool, usize, usize)>,
}

impl PairingBuffers {
    /// Refits the tree over the surfaces, or rebuilds it.
    fn update_tree(&mut self, surfaces: &[ActiveSurface]) {
        self.bounds.clear();
        self.bounds.extend(surfaces.iter().map(|surface| surface.world_bounds));
        let Self { bounds, tree, .. } = self;
        if tree.len() == bounds.len() {
            tree.refit(bounds);
        }
        if tree.len() != bounds.len() || tree.decay() > REBUILD_DECAY {
            tree.rebuild(bounds);
        }
    }

    /// The pair of two sides from the last detection, and its index there, if nothing about them has changed.
    fn keep(&mut self, memory: &DetectionMemory, first: usize, second: OtherSide) -> Option<(SurfacePair, u32)> {
        let (last_first, last_second) = memory.last_sides(first, second)?;
        let place = self.last_names.binary_search(&name(last_first, last_second)).ok()?;
        Some((SurfacePair { first, second, ..self.last[place].take()? }, place as u32))
    }

    /// The lists that two sides had in the last detection, cleared, and the index of their pair there.
    fn reuse(&mut self, memory: &DetectionMemory, first: usize, second: OtherSide) -> (PairLists, Option<u32>) {
        let former = memory.former_sides(first, second).and_then(|(first, second)| {
            let place = self.last_names.binary_search(&name(first, second)).ok()?;
            Some((self.last[place].take()?, place as u32))
        });
        let Some((pair, place)) = former else { return Default::default() };
        let mut lists = (pair.triangles, pair.moved_triangles, pair.moved_positions);
        capacity::clear(&mut lists.0);
        capacity::clear(&mut lists.1);
        capacity::clear(&mut lists.2);
        (lists, Some(place))
    }
}

fn pair_surfaces(
    active: Res<ActiveSurfaces>,
    (settings, game): (Res<CircumsphereSettings>, Option<Res<ContactFilter>>),
    mut candidates: ResMut<CandidateTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut buffers: Local<PairingBuffers>,
    states: Res<SurfaceStates>,
) {
    let start = StageWatch::start("pair surfaces");
    let surfaces = &active.surfaces;
    if surfaces.is_empty() {
        buffers.tree = BoxTree::default();
    }
    buffers.update_tree(surfaces);
    capacity::trim(&mut buffers.bounds, surfaces.len());
    let mut places = std::mem::take(&mut buffers.places);
    places.clear();
    buffers.tree.self_pairs(&mut places);
    places.retain(|&[first, second]| surfaces[first as usize].meets(&surfaces[second as usize]));
    let selves = surfaces.iter().enumerate().filter(|(_, surface)| surface.self_collision);
    places.extend(selves.map(|(place, _)| [place as u32, place as u32]));
    places.sort_unstable();

    memory.begin(&active, &settings, game.map(|game| game.last_changed()), states.all());
    buffers.last_names.clear();
    buffers.last_names.extend(candidates.pairs.iter().map(|pair| name(pair.first, pair.second)));
    buffers.last.clear();
    buffers.last.extend(candidates.pairs.drain(..).map(Some));
    // Rounded up, like the boxes.
    let bulge = |place: usize| {
        let in_world = f64::from(states.all()[place].bounds.bulge()) * surfaces[place].pose.largest_scale();
        in_world as f32 * GROWTH_SLACK
    };
    for &[first, second] in &places {
        let [first, second] = [first as usize, second as usize];
        if let Some((pair, origin)) = buffers.keep(&memory, first, OtherSide::Surface(second)) {
            memory.keep_pair(origin);
            candidates.pairs.push(pair);
            continue;
        }
        let (lists, former) = buffers.reuse(&memory, first, OtherSide::Surface(second));
        memory.add_pair(former);
        let bulge = bulge(first) + bulge(second);
        candidates.pairs.push(SurfacePair { bulge, ..surface_pair(surfaces, first, second, lists) });
    }
    let mut with_shapes = std::mem::take(&mut buffers.with_shapes);
    with_shapes.clear();
    for (place, shape) in active.shapes.iter().enumerate() {
        let meet = |surface: u32| {
            let surface = &surfaces[surface as usize];
            !surface.rigid && surface.layers.interacts_with(shape.layers)
        };
        match shape.geometry.bounds() {
            // The boxes of the surfaces include half the margin. A shape has no box that includes the other half.
            Some(bounds) => {
                let reach = moved_box(&bounds, &shape.pose).grown(0.5 * shape.margin);
                buffers.tree.query(&reach, |surface| {
                    with_shapes.extend(meet(surface).then_some([surface as usize, place]));
                });
            }
            None => with_shapes.extend(
                (0..surfaces.len() as u32).filter(|&surface| meet(surface)).map(|surface| [surface as usize, place]),
            ),
        }
    }
    with_shapes.sort_unstable();
    for &[first, place] in &with_shapes {
        if let Some((pair, origin)) = buffers.keep(&memory, first, OtherSide::Shape(place)) {
            memory.keep_pair(origin);
            candidates.pairs.push(pair);
            continue;
        }
        let (lists, former) = buffers.reuse(&memory, first, OtherSide::Shape(place));
        memory.add_pair(former);
        let pair = shape_pair(&surfaces[first], first, &active.shapes[place], place, lists);
        candidates.pairs.push(SurfacePair { bulge: bulge(first), ..pair });
    }
    memory.end_pairs();
    let count = candidates.pairs.len();
    capacity::trim(&mut candidates.pairs, count);
    // Frees the lists of pairs that no longer exist.
    buffers.last.clear();
    capacity::trim(&mut buffers.last, count);
    capacity::trim(&mut buffers.last_names, count);
    buffers.places = places;
    capacity::trim(&mut buffers.places, count);
    buffers.with_shapes = with_shapes;
    capacity::trim(&mut buffers.with_shapes, count);
    diagnostics.finish(start, surfaces.len() + active.shapes.len(), count);
}

/// The sort key of pairs: by their surfaces, with shapes last.
fn name(first: usize, second: OtherSide) -> (bool, usize, usize) {
    match second {
        OtherSide::Surface(second) => (false, first, second),
        OtherSide::Shape(shape) => (true, first, shape),
    }
}
