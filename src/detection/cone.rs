//! Stage 6: overlapping spheres whose line between the centers lies in both safety cones, and their contacts.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::CandidateTrianglePairs,
    diagnostics::DetectionDiagnostics,
    overlap::{OverlappingTrianglePairs, SphereContacts},
    parallel::collect_chunks,
    sides::{SphereQuery, SphereRows, pair_settings, with_caps},
};
use crate::{
    kernel::{pair::FoundPairs, sphere_pairs::meeting_caps},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod},
};

/// The pairs whose caps meet, one list for each pair of surfaces in [`CandidateTrianglePairs`]; empty where a pair is
/// not tested by cones.
#[derive(Resource, Clone, Debug, Default)]
pub struct MeetingCaps {
    /// Pairs of triangles, in the order of the contacts they may give.
    pub pairs: Vec<Vec<[u32; 2]>>,
}

/// Tests cones.
pub struct ConePlugin;

impl Plugin for ConePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<MeetingCaps>().init_resource::<SphereContacts>().init_resource::<SphereRows>();
        app.add_systems(SurfaceDetection, test_cones.in_set(SurfaceDetectionSystems::Cone));
    }
}

#[expect(clippy::too_many_arguments, reason = "the last of the sphere stages writes pairs and contacts")]
fn test_cones(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    overlapping: Res<OverlappingTrianglePairs>,
    rows: Res<SphereRows>,
    settings: Res<CircumsphereSettings>,
    mut meeting: ResMut<MeetingCaps>,
    mut contacts: ResMut<SphereContacts>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    let (mut pairs_in, mut pairs_out) = (0, 0);
    meeting.pairs.resize_with(candidates.pairs.len(), Vec::new);
    contacts.pairs.resize_with(candidates.pairs.len(), FoundPairs::default);
    let lists = overlapping.pairs.iter().zip(&mut meeting.pairs).zip(&mut contacts.pairs);
    for (pair, ((overlapping, meeting), found)) in candidates.pairs.iter().zip(lists) {
        meeting.clear();
        if pair.method != ContactMethod::Circumsphere {
            continue;
        }
        found.clear();
        let pair_settings = pair_settings(pair, &settings);
        let mut results = (std::mem::take(meeting), std::mem::take(found));
        with_caps(&active, &surfaces, pair, &rows, |a, b| {
            collect_chunks(
                overlapping,
                settings.threads,
                &mut results,
                |chunk, (meeting, found)| meeting_caps(a, b, chunk, &pair_settings, meeting, found),
                |(meeting, found), mut later| {
                    meeting.append(&mut later.0);
                    found.append_sorted(later.1);
                },
            );
        });
        (*meeting, *found) = results;
        pairs_in += overlapping.len();
        pairs_out += meeting.len();
    }
    if candidates.pairs.iter().any(|pair| pair.method == ContactMethod::Circumsphere) {
        diagnostics.finish("cone", start, pairs_in, pairs_out);
    }
}
