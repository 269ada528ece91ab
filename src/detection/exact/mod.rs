//! Stage 7: tests candidates exactly, for the exact methods and for rigid shapes.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

pub(super) use self::smooth::refine_pair;
use self::{penetration::PenetrationBuffers, rows::fill_rows};
use crate::{
    detection::{
        pair_contacts::PairContacts,
        pairs::{CandidateTrianglePairs, OtherSide, SurfacePair},
        parallel::{Buffers, CHUNK, Threads, append_chunks, for_each_weighed},
        reuse::{
            DetectionMemory,
            near_lists::{KeptPairs, ListUse},
        },
        sides::{pair_settings, side_on_shape, surface_sides},
        state::{SurfaceState, SurfaceStates},
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        capacity,
        exact::{
            pair_order::PairSorter,
            stage::{closest_pairs, exact_pairs},
            unique::UniqueFeatures,
        },
        pair::{FoundPairs, can_penetrate},
        smooth::on_shape::patch_shape_pairs,
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod},
};

mod penetration;
mod rows;
mod smooth;

/// The results of the exact test, one entry for each pair of surfaces in [`CandidateTrianglePairs`]. Empty if a pair is
/// tested by spheres. The last stage keeps two-sided contacts on their sides, in these lists.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct ExactTrianglePairs {
    pub(crate) pairs: Vec<PairContacts>,
}

impl ExactTrianglePairs {
    /// Touching pairs and contacts.
    #[must_use]
    pub fn pairs(&self) -> &[PairContacts] {
        &self.pairs
    }
}

/// Tests candidates exactly.
pub struct ExactPlugin;

impl Plugin for ExactPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<ExactTrianglePairs>().init_resource::<DetectionMemory>().init_resource::<KeptPairs>();
        app.add_systems(SurfaceDetection, test_exactly.in_set(SurfaceDetectionSystems::Exact));
    }
}

#[expect(clippy::too_many_arguments, reason = "a stage reads the results of earlier stages and ticks")]
fn test_exactly(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut results: ResMut<ExactTrianglePairs>,
    spare: Local<Buffers<FoundPairs>>,
    buffers: Local<Buffers<ExactBuffers>>,
    mut memory: ResMut<DetectionMemory>,
    mut kept: ResMut<KeptPairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut row_counts: Local<Vec<usize>>,
    mut states: ResMut<SurfaceStates>,
) {
    let start = StageWatch::start("exact");
    memory.carry(&mut results.pairs);
    results.pairs.resize_with(candidates.pairs.len(), PairContacts::default);
    fill_rows(&active, memory.changed(&candidates.pairs), settings.threads, &mut row_counts, states.all_mut());
    let states = states.all();
    for_each_weighed(
        &mut results.pairs,
        settings.threads,
        CHUNK,
        |place, _| if memory.keeps(place) { 0 } else { candidates.pairs[place].triangles.len() },
        |place, found_of_pair, threads| {
            if memory.keeps(place) {
                return;
            }
            let pair = &candidates.pairs[place];
            let mut found = found_of_pair.begin();
            found.wants_lower_bounds = kept.list_use(place) != ListUse::None;
            if pair.method.is_exact() && !pair.triangles.is_empty() {
                buffers.with(|buffers| {
                    test_pair(&active, pair, &settings, states, threads, &mut found, &spare, buffers);
                });
            }
            found_of_pair.finish(found);
        },
    );
    capacity::trim(&mut results.pairs, candidates.pairs.len());
    if !candidates.pairs.iter().any(|pair| pair.method.is_exact()) {
        spare.clear();
        buffers.clear();
    }
    for (place, results) in results.pairs.iter().enumerate().filter(|&(place, _)| !memory.keeps(place)) {
        kept.learn(place, results.lower_bounds());
    }
    let tested = memory.changed(&candidates.pairs).filter(|pair| pair.method.is_exact());
    let pairs_in: usize = tested.map(|pair| pair.triangles.len()).sum();
    let pairs_out = memory.changed(&results.pairs).map(|results| results.touching.len()).sum();
    let examined = memory.changed(&results.pairs).map(|results| results.examined).sum();
    diagnostics.pairs_examined = examined;
    if pairs_in > 0 {
        diagnostics.finish(start, pairs_in, pairs_out);
    }
}

/// Memory of the stage.
#[derive(Default)]
struct ExactBuffers {
    sorter: PairSorter,
    penetrations: PenetrationBuffers,
    unique: UniqueFeatures,
}

#[expect(clippy::too_many_arguments, reason = "what a stage reads and where it writes")]
fn test_pair(
    active: &ActiveSurfaces,
    pair: &SurfacePair,
    settings: &CircumsphereSettings,
    states: &[SurfaceState],
    threads: usize,
    found: &mut FoundPairs,
    spare: &Buffers<FoundPairs>,
    ExactBuffers { sorter, penetrations, unique }: &mut ExactBuffers,
) {
    let true_settings = pair_settings(pair, settings);
    let bulge = f64::from(pair.bulge);
    // Flat pairs are tested as they are, and so are smooth ones that are flat.
    let pair_settings = if bulge > 0.0 { true_settings.widened(bulge) } else { true_settings };
    let own = &states[pair.first];
    // Results are stored in the order of their triangles. Sorting the pairs takes less time than sorting the results.
    let triangles = sorter.unique(&pair.triangles, pair_settings.same_surface, &Threads(threads));
    // A list of near pairs expects lower bounds in the order of the candidates.
    found.wants_lower_bounds &= std::ptr::eq(triangles, &raw const *pair.triangles);
    unique.clear();
    match pair.second {
        OtherSide::Surface(second) => {
            let other = &states[second];
            let Some([mut a, mut b]) = surface_sides(active, pair, [own, other]) else { return };
            (a.rows, b.rows) = (own.rows.current(&own.bounds), other.rows.current(&other.bounds));
            let test = if pair.method == ContactMethod::Closest { closest_pairs } else { exact_pairs };
            // On patches, thickness counts when contacts have moved there.
            let [flat_a, flat_b] = if bulge > 0.0 { [a.evenly_thick(), b.evenly_thick()] } else { [a, b] };
            let work = |chunk: &[[u32; 2]], found: &mut _| test(&flat_a, &flat_b, chunk, &pair_settings, found);
            if can_penetrate([&a, &b], &pair_settings) {
                // This may drop the contact of one pair of triangles and keep that of another with the same
                // features, so repeats are dropped afterwards.
                collect(triangles, threads, spare, None, found, work);
                penetrations.resolve([&a, &b], triangles, &pair_settings, threads, found);
                unique.drop_repeats(found, 0);
            } else {
                collect(triangles, threads, spare, Some(unique), found, work);
            }
            if bulge > 0.0 {
                refine_pair([&a, &b], &true_settings, threads, found);
            }
        }
        OtherSide::Shape(place) => {
            let (shape, side) = (&active.shapes[place].geometry, side_on_shape(active, pair, own));
            collect(triangles, threads, spare, Some(unique), found, |chunk, found| {
                patch_shape_pairs(&side, shape, chunk, &true_settings, found);
            });
        }
    }
}

/// Appends what `work` finds in chunks of pairs. With `unique`, drops repeats while they are in the CPU cache.
fn collect(
    pairs: &[[u32; 2]],
    threads: usize,
    spare: &Buffers<FoundPairs>,
    mut unique: Option<&mut UniqueFeatures>,
    found: &mut FoundPairs,
    work: impl Fn(&[[u32; 2]], &mut FoundPairs) + Sync,
) {
    if Threads(threads).are_one(pairs.len().div_ceil(CHUNK)) {
        for chunk in pairs.chunks(CHUNK) {
            let first_shared = found.shared.len();
            work(chunk, found);
            if let Some(unique) = &mut unique {
                unique.drop_repeats(found, first_shared);
            }
        }
        return;
    }
    let wants_lower_bounds = found.wants_lower_bounds;
    let work = |chunk: &[[u32; 2]], found: &mut FoundPairs| {
        found.wants_lower_bounds = wants_lower_bounds;
        work(chunk, found);
    };
    append_chunks(pairs, threads, spare, found, work, |found, later| match &mut unique {
        Some(unique) => unique.append(found, later),
        None => found.append(later),
    });
}
