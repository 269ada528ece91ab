//! Stage 6: overlapping spheres whose line between the centers lies in both safety cones.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::CandidateTrianglePairs,
    diagnostics::DetectionDiagnostics,
    memory::{DetectionMemory, StageList},
    overlap::OverlappingTrianglePairs,
    parallel::{CHUNK, append_chunks, for_each_weighed},
    sides::{SphereQuery, pair_settings, with_caps},
};
use crate::{
    kernel::sphere_pairs::{CapPair, meeting_caps},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod},
};

/// The pairs whose caps meet, one list for each pair of surfaces in [`CandidateTrianglePairs`]; empty where a pair is
/// not tested by cones.
#[derive(Resource, Clone, Debug, Default)]
pub struct MeetingCaps {
    /// Pairs of triangles with their contact, in the frame of the pair.
    pub pairs: Vec<Vec<CapPair>>,
}

/// Tests cones.
pub struct ConePlugin;

impl Plugin for ConePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<MeetingCaps>().init_resource::<DetectionMemory>();
        app.add_systems(SurfaceDetection, test_cones.in_set(SurfaceDetectionSystems::Cone));
    }
}

#[expect(clippy::too_many_arguments, reason = "a stage reads what was found before it, and what is remembered")]
fn test_cones(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    overlapping: Res<OverlappingTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut meeting: ResMut<MeetingCaps>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    memory.reads(StageList::Candidates, candidates.last_changed());
    memory.reads(StageList::Overlapping, overlapping.last_changed());
    memory.writes(StageList::Meeting, meeting.last_changed());
    memory.carry(&mut meeting.pairs);
    meeting.pairs.resize_with(candidates.pairs.len(), Vec::new);
    memory.seal(StageList::Meeting, meeting.last_changed());
    let uses_cones =
        |place: usize| !memory.keeps(place) && candidates.pairs[place].method == ContactMethod::Circumsphere;
    for_each_weighed(
        &mut meeting.pairs,
        settings.threads,
        CHUNK,
        |place, _| if memory.keeps(place) { 0 } else { overlapping.pairs[place].len() },
        |place, meeting, threads| {
            let (pair, overlapping) = (&candidates.pairs[place], &overlapping.pairs[place]);
            if memory.keeps(place) {
                return;
            }
            meeting.clear();
            if overlapping.is_empty() || !uses_cones(place) {
                return;
            }
            let pair_settings = pair_settings(pair, &settings);
            with_caps(&active, &surfaces, pair, |a, b| {
                let test =
                    |chunk: &[[u32; 2]], kept: &mut Vec<CapPair>| meeting_caps(a, b, chunk, &pair_settings, kept);
                append_chunks(overlapping, threads, meeting, test, |kept, mut later| kept.append(&mut later));
            });
        },
    );
    let tested = overlapping.pairs.iter().enumerate().filter(|&(place, _)| uses_cones(place));
    let pairs_in = tested.map(|(_, overlapping)| overlapping.len()).sum();
    let pairs_out = memory.changed(&meeting.pairs).map(Vec::len).sum();
    if (0..candidates.pairs.len()).any(uses_cones) {
        diagnostics.finish("cone", start, pairs_in, pairs_out);
    }
}
