//! Stage 5: candidates whose spheres overlap, and the contacts of enclosing balls.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, SurfacePair},
    diagnostics::DetectionDiagnostics,
    memory::{DetectionMemory, StageList, check_spheres},
    pair_contacts::PairContacts,
    parallel::{Buffers, CHUNK, Threads, append_chunks, for_each_weighed},
    sides::{SphereQuery, SphereRows, pair_settings, with_balls, with_caps},
};
use crate::{
    kernel::{
        pair::FoundPairs,
        pair_order::PairSorter,
        sphere_contacts::ball_contacts,
        sphere_pairs::{overlapping_balls, overlapping_caps},
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod},
};

/// The candidates that come within range as spheres, one list for each pair of surfaces in
/// [`CandidateTrianglePairs`]; empty where a pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
pub struct OverlappingTrianglePairs {
    /// Pairs of triangles, in the order of the contacts they may give.
    pub pairs: Vec<Vec<[u32; 2]>>,
}

/// What the sphere methods found, one entry for each pair of surfaces in [`CandidateTrianglePairs`]; empty where a
/// pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
pub struct SphereContacts {
    /// Touching pairs and contacts; where a surface meets itself, contacts are sorted by the lower triangle, whichever stands
    /// first.
    pub pairs: Vec<PairContacts>,
}

/// Tests spheres for overlap.
pub struct OverlapPlugin;

impl Plugin for OverlapPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<OverlappingTrianglePairs>()
            .init_resource::<SphereContacts>()
            .init_resource::<SphereRows>()
            .init_resource::<DetectionMemory>();
        let systems = (check_spheres, test_overlap, touch_by_balls).chain();
        app.add_systems(SurfaceDetection, systems.in_set(SurfaceDetectionSystems::Overlap));
    }
}

#[expect(clippy::too_many_arguments, reason = "the first of the sphere stages prepares for the others")]
fn test_overlap(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut overlapping: ResMut<OverlappingTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut rows: ResMut<SphereRows>,
    spare: Local<Buffers<Vec<[u32; 2]>>>,
    sorters: Local<Buffers<PairSorter>>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    memory.reads(StageList::Candidates, candidates.last_changed());
    memory.writes(StageList::Overlapping, overlapping.last_changed());
    memory.carry(&mut overlapping.pairs);
    let uses_spheres = |pair: &SurfacePair| !pair.method.is_exact();
    if memory.changed(&candidates.pairs).any(uses_spheres) {
        rows.update(&active, &surfaces, &candidates, &Threads(settings.threads));
    }
    overlapping.pairs.resize_with(candidates.pairs.len(), Vec::new);
    memory.seal(StageList::Overlapping, overlapping.last_changed());
    for_each_weighed(
        &mut overlapping.pairs,
        settings.threads,
        CHUNK,
        |place, _| if memory.keeps(place) { 0 } else { candidates.pairs[place].triangles.len() },
        |place, overlapping, threads| {
            if memory.keeps(place) {
                return;
            }
            let pair = &candidates.pairs[place];
            overlapping.clear();
            if pair.triangles.is_empty() || !uses_spheres(pair) {
                return;
            }
            let pair_settings = pair_settings(pair, &settings);
            let mut keep = |test: &(dyn Fn(&[[u32; 2]], &mut Vec<[u32; 2]>) + Sync)| {
                append_chunks(&pair.triangles, threads, &spare, overlapping, test, Vec::append);
            };
            if pair.method == ContactMethod::BoundingSphere {
                with_balls(&active, &surfaces, pair, &rows, |a, b| {
                    keep(&|chunk, kept| overlapping_balls(a, b, chunk, &pair_settings, kept));
                });
            } else {
                with_caps(&active, &surfaces, pair, &rows, |a, b| {
                    keep(&|chunk, kept| overlapping_caps(a, b, chunk, &pair_settings, kept));
                });
            }
            sorters.with(|sorter| sorter.sort(overlapping, pair_settings.same_surface, &Threads(threads)));
        },
    );
    let pairs_in: usize =
        memory.changed(&candidates.pairs).filter(|pair| uses_spheres(pair)).map(|pair| pair.triangles.len()).sum();
    let pairs_out = memory.changed(&overlapping.pairs).map(Vec::len).sum();
    if pairs_in > 0 {
        diagnostics.finish("overlap", start, pairs_in, pairs_out);
    }
}

#[expect(clippy::too_many_arguments, reason = "the last of the sphere stages writes contacts")]
fn touch_by_balls(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    overlapping: Res<OverlappingTrianglePairs>,
    rows: Res<SphereRows>,
    settings: Res<CircumsphereSettings>,
    mut contacts: ResMut<SphereContacts>,
    spare: Local<Buffers<FoundPairs>>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    memory.reads(StageList::Candidates, candidates.last_changed());
    memory.reads(StageList::Overlapping, overlapping.last_changed());
    memory.writes(StageList::SphereContacts, contacts.last_changed());
    memory.carry(&mut contacts.pairs);
    contacts.pairs.resize_with(candidates.pairs.len(), PairContacts::default);
    memory.seal(StageList::SphereContacts, contacts.last_changed());
    let uses_balls =
        |place: usize| !memory.keeps(place) && candidates.pairs[place].method == ContactMethod::BoundingSphere;
    for_each_weighed(
        &mut contacts.pairs,
        settings.threads,
        CHUNK,
        |place, _| overlapping.pairs[place].len(),
        |place, found, threads| {
            if memory.keeps(place) {
                return;
            }
            let (pair, overlapping) = (&candidates.pairs[place], &overlapping.pairs[place]);
            let mut touching = found.begin();
            if !overlapping.is_empty() && uses_balls(place) {
                let pair_settings = pair_settings(pair, &settings);
                with_balls(&active, &surfaces, pair, &rows, |a, b| {
                    let work = |chunk: &[[u32; 2]], found: &mut _| ball_contacts(a, b, chunk, &pair_settings, found);
                    append_chunks(overlapping, threads, &spare, &mut touching, work, FoundPairs::append_sorted);
                });
                touching.sort_touching();
            }
            found.finish(touching);
        },
    );
    let tested = (0..candidates.pairs.len()).filter(|&place| uses_balls(place));
    let counts = tested.map(|place| [overlapping.pairs[place].len(), contacts.pairs[place].touching.len()]);
    let [pairs_in, pairs_out] = counts.fold([0; 2], |sums, counts| [sums[0] + counts[0], sums[1] + counts[1]]);
    if pairs_in > 0 {
        diagnostics.finish("ball contacts", start, pairs_in, pairs_out);
    }
}
