//! Stage 5: finds the candidates whose spheres overlap, and the contacts of enclosing balls.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::{
    detection::{
        pair_contacts::{PairContacts, SharedList},
        pairs::{CandidateTrianglePairs, SurfacePair},
        parallel::{Buffers, CHUNK, Threads, append_chunks, for_each_weighed},
        reuse::DetectionMemory,
        sides::{SphereQuery, SphereRows, pair_settings, with_balls, with_caps},
        spheres::lists::{PassedAndFound, SphereBuffers, SphereTests},
        state::SurfaceStates,
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        capacity,
        pair::{FoundPairs, PairSettings},
        spheres::{
            contacts::{ball_contacts, overlapping_ball_contacts},
            pairs::{BallSide, overlapping_caps},
        },
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::{CircumsphereSettings, SphereContactDetail},
    surface::{ActiveSurfaces, ContactMethod},
};

/// The candidates whose spheres are within range, one list for each pair of surfaces in [`CandidateTrianglePairs`].
/// Empty if a pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct OverlappingTrianglePairs {
    pub(crate) pairs: Vec<SharedList<[u32; 2]>>,
}

impl OverlappingTrianglePairs {
    /// Pairs of triangles, in the order of the candidates.
    #[must_use]
    pub fn pairs(&self) -> &[SharedList<[u32; 2]>] {
        &self.pairs
    }
}

/// The results of the sphere methods, one entry for each pair of surfaces in [`CandidateTrianglePairs`]. Empty if a
/// pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct SphereContacts {
    pub(crate) pairs: Vec<PairContacts>,
}

impl SphereContacts {
    /// Touching pairs and contacts. In a self-collision, contacts are sorted by the lower triangle, whichever comes
    /// first. Both lists are empty with [`SphereContactDetail::Distances`].
    #[must_use]
    pub fn pairs(&self) -> &[PairContacts] {
        &self.pairs
    }
}

/// Tests spheres for overlap.
pub struct OverlapPlugin;

impl Plugin for OverlapPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<OverlappingTrianglePairs>()
            .init_resource::<SphereContacts>()
            .init_resource::<SphereRows>()
            .init_resource::<DetectionMemory>();
        app.add_systems(SurfaceDetection, test_overlap.in_set(SurfaceDetectionSystems::Overlap));
    }
}

#[expect(clippy::too_many_arguments, reason = "the first sphere stage prepares rows for the others")]
fn test_overlap(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut overlapping: ResMut<OverlappingTrianglePairs>,
    mut contacts: ResMut<SphereContacts>,
    mut both: Local<Vec<(SharedList<[u32; 2]>, PairContacts)>>,
    mut memory: ResMut<DetectionMemory>,
    mut rows: ResMut<SphereRows>,
    spare: Local<Buffers<Vec<[u32; 2]>>>,
    buffers: Local<SphereBuffers>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    states: Res<SurfaceStates>,
    surfaces: SphereQuery,
) {
    let start = StageWatch::start("overlap");
    memory.carry(&mut overlapping.pairs);
    memory.carry(&mut contacts.pairs);
    let count = candidates.pairs.len();
    overlapping.pairs.resize_with(count, SharedList::default);
    contacts.pairs.resize_with(count, PairContacts::default);
    both.clear();
    both.extend(overlapping.pairs.drain(..).zip(contacts.pairs.drain(..)));
    let uses_spheres = |pair: &SurfacePair| !pair.method.is_exact();
    if memory.changed(&candidates.pairs).any(uses_spheres) {
        let pairs = memory.changed(&candidates.pairs);
        rows.update(&active, states.all(), &surfaces, pairs, &Threads(settings.threads));
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
            if !uses_spheres(pair) {
                contacts.forget_spheres();
                return;
            }
            if pair.triangles.is_empty() {
                return;
            }
            let pair_settings = pair_settings(pair, &settings);
            if pair.method == ContactMethod::Circumsphere {
                let mut kept = room;
                if pair.is_smooth(&active) {
                    // Osculating spheres of flat regions are too large to part anything that slabs have not parted.
                    kept.extend_from_slice(&pair.triangles);
                    overlapping.put(kept);
                    return;
                }
                with_caps(&active, states.all(), &surfaces, pair, &rows, |a, b| {
                    let test = |chunk: &[[u32; 2]], kept: &mut _| overlapping_caps(a, b, chunk, &pair_settings, kept);
                    append_chunks(&pair.triangles, threads, &spare, &mut kept, test, Vec::append);
                });
                overlapping.put(kept);
                return;
            }
            with_balls(&active, states.all(), &surfaces, pair, &rows, |a, b| {
                let tests = BallTests { a, b, settings: &pair_settings };
                *overlapping = contacts.find_spheres(
                    &pair.triangles,
                    &pair_settings,
                    (threads, &buffers),
                    &tests,
                    settings.sphere_contacts == SphereContactDetail::Points,
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
    let pairs_out = memory.changed(&overlapping.pairs).map(|list| list.len()).sum();
    if pairs_in > 0 {
        diagnostics.finish(start, pairs_in, pairs_out);
    }
}

/// Tests the enclosing balls of a pair of surfaces.
struct BallTests<'a> {
    a: &'a BallSide<'a>,
    b: &'a BallSide<'a>,
    settings: &'a PairSettings,
}

impl SphereTests for BallTests<'_> {
    fn find(&self, pairs: &[[u32; 2]], (passed, found): &mut PassedAndFound) {
        overlapping_ball_contacts(self.a, self.b, pairs, self.settings, passed, found);
    }

    fn write(&self, pairs: &[[u32; 2]], found: &mut FoundPairs) {
        ball_contacts(self.a, self.b, pairs, self.settings, found);
    }
}
