//! Stage 6: finds the overlapping spheres whose line between the centers lies in both safety cones, and their contacts.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::{
    detection::{
        pair_contacts::{PairContacts, SharedList},
        pairs::CandidateTrianglePairs,
        parallel::{CHUNK, for_each_weighed},
        reuse::DetectionMemory,
        sides::{SphereQuery, SphereRows, pair_settings, with_caps, with_osculating},
        spheres::{
            lists::{PassedAndFound, SphereBuffers, SphereTests},
            overlap::{OverlappingTrianglePairs, SphereContacts},
        },
        state::SurfaceStates,
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        capacity,
        pair::{FoundPairs, PairSettings},
        spheres::{
            contacts::{cap_contacts, meeting_caps},
            osculating_contacts::{OsculatingSide, osculating_contacts},
            pairs::CapSide,
        },
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::{CircumsphereSettings, SphereContactDetail},
    surface::{ActiveSurfaces, ContactMethod},
};

/// The pairs whose caps meet, one list for each pair of surfaces in [`CandidateTrianglePairs`]. Empty if a pair is not
/// tested by cones.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct MeetingCaps {
    pub(crate) pairs: Vec<SharedList<[u32; 2]>>,
}

impl MeetingCaps {
    /// Pairs of triangles, in the order of the candidates.
    #[must_use]
    pub fn pairs(&self) -> &[SharedList<[u32; 2]>] {
        &self.pairs
    }
}

/// Tests cones.
pub struct ConePlugin;

impl Plugin for ConePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<MeetingCaps>()
            .init_resource::<SphereContacts>()
            .init_resource::<SphereRows>()
            .init_resource::<DetectionMemory>();
        app.add_systems(SurfaceDetection, test_cones.in_set(SurfaceDetectionSystems::Cone));
    }
}

#[expect(clippy::too_many_arguments, reason = "the last sphere stage writes pairs and contacts")]
fn test_cones(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    overlapping: Res<OverlappingTrianglePairs>,
    mut rows: ResMut<SphereRows>,
    settings: Res<CircumsphereSettings>,
    mut meeting: ResMut<MeetingCaps>,
    mut contacts: ResMut<SphereContacts>,
    mut both: Local<Vec<(SharedList<[u32; 2]>, PairContacts)>>,
    buffers: Local<SphereBuffers>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    states: Res<SurfaceStates>,
    surfaces: SphereQuery,
) {
    let start = StageWatch::start("cone");
    let kept_before = memory.kept_count();
    memory.carry(&mut meeting.pairs);
    if memory.kept_count() < kept_before {
        // The previous stage kept these pairs and made no rows for them. Existing rows may belong to other surfaces.
        rows.clear();
    }
    let count = candidates.pairs.len();
    meeting.pairs.resize_with(count, SharedList::default);
    contacts.pairs.resize_with(count, PairContacts::default);
    both.clear();
    both.extend(meeting.pairs.drain(..).zip(contacts.pairs.drain(..)));
    let uses_cones =
        |place: usize| !memory.keeps(place) && candidates.pairs[place].method == ContactMethod::Circumsphere;
    for_each_weighed(
        &mut both,
        settings.threads,
        CHUNK,
        |place, _| if memory.keeps(place) { 0 } else { overlapping.pairs[place].len() },
        |place, (meeting, contacts), threads| {
            let (pair, overlapping) = (&candidates.pairs[place], &overlapping.pairs[place]);
            if memory.keeps(place) {
                return;
            }
            *meeting = SharedList::default();
            if !uses_cones(place) {
                return;
            }
            let pair_settings = pair_settings(pair, &settings);
            let with_points = settings.sphere_contacts == SphereContactDetail::Points;
            let buffers = (threads, &*buffers);
            if pair.is_smooth(&active) {
                with_osculating(&active, states.all(), &surfaces, pair, |a, b| {
                    let tests = OsculatingTests { a, b, settings: &pair_settings };
                    *meeting = contacts.find_spheres(overlapping, &pair_settings, buffers, &tests, with_points);
                });
                return;
            }
            with_caps(&active, states.all(), &surfaces, pair, &rows, |a, b| {
                let tests = CapTests { a, b, settings: &pair_settings };
                *meeting = contacts.find_spheres(overlapping, &pair_settings, buffers, &tests, with_points);
            });
        },
    );
    for (meeting_caps, found) in both.drain(..) {
        meeting.pairs.push(meeting_caps);
        contacts.pairs.push(found);
    }
    capacity::trim(&mut both, count);
    capacity::trim(&mut meeting.pairs, count);
    capacity::trim(&mut contacts.pairs, count);
    if !candidates.pairs.iter().any(|pair| pair.method == ContactMethod::Circumsphere) {
        buffers.clear();
    }
    let tested = overlapping.pairs.iter().enumerate().filter(|&(place, _)| uses_cones(place));
    let pairs_in = tested.map(|(_, overlapping)| overlapping.len()).sum();
    let pairs_out = memory.changed(&meeting.pairs).map(|list| list.len()).sum();
    if (0..candidates.pairs.len()).any(uses_cones) {
        diagnostics.finish(start, pairs_in, pairs_out);
    }
}

/// Tests the caps of a pair of surfaces.
struct CapTests<'a> {
    a: &'a CapSide<'a>,
    b: &'a CapSide<'a>,
    settings: &'a PairSettings,
}

impl SphereTests for CapTests<'_> {
    fn find(&self, pairs: &[[u32; 2]], (passed, found): &mut PassedAndFound) {
        meeting_caps(self.a, self.b, pairs, self.settings, passed, found);
    }

    fn write(&self, pairs: &[[u32; 2]], found: &mut FoundPairs) {
        cap_contacts(self.a, self.b, pairs, self.settings, found);
    }
}

/// Finds the contacts of a pair with a smooth surface.
struct OsculatingTests<'a> {
    a: &'a OsculatingSide<'a>,
    b: &'a OsculatingSide<'a>,
    settings: &'a PairSettings,
}

impl SphereTests for OsculatingTests<'_> {
    fn find(&self, pairs: &[[u32; 2]], (passed, found): &mut PassedAndFound) {
        osculating_contacts(self.a, self.b, pairs, self.settings, passed, found);
    }

    fn write(&self, pairs: &[[u32; 2]], found: &mut FoundPairs) {
        osculating_contacts(self.a, self.b, pairs, self.settings, &mut Vec::new(), found);
    }
}
