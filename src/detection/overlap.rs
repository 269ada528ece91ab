//! Stage 5: candidates whose spheres overlap, and the contacts of enclosing balls.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, SurfacePair},
    diagnostics::DetectionDiagnostics,
    memory::{DetectionMemory, StageList},
    pair_contacts::{PairContacts, SharedList},
    parallel::{Buffers, CHUNK, Threads, append_chunks, for_each_weighed},
    sides::{SphereQuery, SphereRows, pair_settings, surface_entities, with_balls, with_caps},
    sphere_lists::{SphereBuffers, SphereReaders},
    sphere_memory::check_spheres,
};
use crate::{
    kernel::{
        capacity,
        pair::PairSettings,
        spheres::{
            contacts::{ball_contacts, overlapping_ball_contacts},
            pairs::overlapping_caps,
        },
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod},
};

/// The candidates that come within range as spheres, one list for each pair of surfaces in
/// [`CandidateTrianglePairs`]; empty where a pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
pub struct OverlappingTrianglePairs {
    /// Pairs of triangles, in the order of the candidates.
    pub pairs: Vec<SharedList<[u32; 2]>>,
}

/// What the sphere methods found, one entry for each pair of surfaces in [`CandidateTrianglePairs`]; empty where a
/// pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
pub struct SphereContacts {
    /// Touching pairs and contacts; where a surface meets itself, contacts are sorted by the lower triangle, whichever stands
    /// first. Where nobody has read those of the last few ticks, mostly they are not written before somebody reads them.
    pub pairs: Vec<PairContacts>,
}

/// Tests spheres for overlap.
pub struct OverlapPlugin;

impl Plugin for OverlapPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<OverlappingTrianglePairs>()
            .init_resource::<SphereContacts>()
            .init_resource::<SphereRows>()
            .init_resource::<SphereReaders>()
            .init_resource::<DetectionMemory>();
        app.add_systems(
            SurfaceDetection,
            (check_spheres, test_overlap).chain().in_set(SurfaceDetectionSystems::Overlap),
        );
    }
}

#[expect(clippy::too_many_arguments, reason = "the first of the sphere stages prepares for the others")]
fn test_overlap(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut overlapping: ResMut<OverlappingTrianglePairs>,
    mut contacts: ResMut<SphereContacts>,
    mut both: Local<Vec<(SharedList<[u32; 2]>, PairContacts)>>,
    mut memory: ResMut<DetectionMemory>,
    mut rows: ResMut<SphereRows>,
    mut readers: ResMut<SphereReaders>,
    spare: Local<Buffers<Vec<[u32; 2]>>>,
    buffers: Local<SphereBuffers>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    memory.reads(StageList::Candidates, candidates.last_changed());
    memory.writes(StageList::Overlapping, overlapping.last_changed());
    memory.writes(StageList::SphereContacts, contacts.last_changed());
    readers.update(contacts.pairs.iter());
    memory.carry(&mut overlapping.pairs);
    memory.carry(&mut contacts.pairs);
    let count = candidates.pairs.len();
    overlapping.pairs.resize_with(count, SharedList::default);
    contacts.pairs.resize_with(count, PairContacts::default);
    both.clear();
    both.extend(overlapping.pairs.drain(..).zip(contacts.pairs.drain(..)));
    memory.seal(StageList::Overlapping, overlapping.last_changed());
    memory.seal(StageList::SphereContacts, contacts.last_changed());
    let uses_spheres = |pair: &SurfacePair| !pair.method.is_exact();
    for (place, (_, contacts)) in both.iter_mut().enumerate() {
        if memory.keeps(place) {
            contacts.rest_spheres();
        } else {
            contacts.release_spheres();
        }
    }
    let is_whole = memory.is_whole();
    if memory.changed(&candidates.pairs).any(uses_spheres) {
        let pairs = memory.changed(&candidates.pairs);
        rows.update(&active, &surfaces, pairs, &Threads(settings.threads));
    } else if !candidates.pairs.iter().any(uses_spheres) {
        rows.clear();
    }
    for_each_weighed(
        &mut both,
        settings.threads,
        CHUNK,
        |place, _| if memory.keeps(place) { 0 } else { candidates.pairs[place].triangles.len() },
        |place, (overlapping, contacts), threads| {
            if memory.keeps(place) {
                return;
            }
            let pair = &candidates.pairs[place];
            let room = overlapping.take();
            overlapping.put(Vec::new());
            contacts.clear();
            let Some(sides) = surface_entities(&active, pair).filter(|_| uses_spheres(pair)) else {
                contacts.forget_spheres();
                return;
            };
            if pair.triangles.is_empty() {
                return;
            }
            let pair_settings = pair_settings(pair, &settings);
            // A broad phase of our own has left out neighbors: nobody has to look for them again.
            let test_settings = PairSettings { same_surface: pair_settings.same_surface && !is_whole, ..pair_settings };
            if pair.method == ContactMethod::Circumsphere {
                let mut kept = room;
                with_caps(&active, &surfaces, pair, &rows, |a, b| {
                    let test = |chunk: &[[u32; 2]], kept: &mut _| overlapping_caps(a, b, chunk, &test_settings, kept);
                    append_chunks(&pair.triangles, threads, &spare, &mut kept, test, Vec::append);
                });
                overlapping.put(kept);
                return;
            }
            with_balls(&active, &surfaces, pair, &rows, |a, b| {
                // Only lists of our own have every pair once.
                let spheres = rows.kept(&active, pair).filter(|_| is_whole && !readers.expect(sides));
                *overlapping = contacts.find_spheres(
                    sides,
                    &pair.triangles,
                    (spheres, pair_settings),
                    (threads, &buffers),
                    |chunk, (kept, found)| overlapping_ball_contacts(a, b, chunk, &test_settings, kept, found),
                    |chunk, found| ball_contacts(a, b, chunk, &pair_settings, found),
                );
            });
        },
    );
    for (passed, found) in both.drain(..) {
        overlapping.pairs.push(passed);
        contacts.pairs.push(found);
    }
    capacity::trim(&mut both, count);
    capacity::trim(&mut overlapping.pairs, count);
    capacity::trim(&mut contacts.pairs, count);
    if !candidates.pairs.iter().any(uses_spheres) {
        spare.clear();
        buffers.clear();
    }
    let tested = memory.changed(&candidates.pairs).filter(|pair| uses_spheres(pair));
    let pairs_in: usize = tested.map(|pair| pair.triangles.len()).sum();
    let pairs_out = memory.changed(&overlapping.pairs).map(SharedList::len).sum();
    if pairs_in > 0 {
        diagnostics.finish("overlap", start, pairs_in, pairs_out);
    }
}
