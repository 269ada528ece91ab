//! Stage 6: overlapping spheres whose line between the centers lies in both safety cones.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::CandidateTrianglePairs,
    diagnostics::DetectionDiagnostics,
    overlap::OverlappingTrianglePairs,
    parallel::map_chunks,
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
        app.init_resource::<MeetingCaps>();
        app.add_systems(SurfaceDetection, test_cones.in_set(SurfaceDetectionSystems::Cone));
    }
}

fn test_cones(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    overlapping: Res<OverlappingTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut meeting: ResMut<MeetingCaps>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    let (mut pairs_in, mut pairs_out) = (0, 0);
    meeting.pairs.resize_with(candidates.pairs.len(), Vec::new);
    for ((pair, overlapping), meeting) in candidates.pairs.iter().zip(&overlapping.pairs).zip(&mut meeting.pairs) {
        meeting.clear();
        if pair.method != ContactMethod::Circumsphere {
            continue;
        }
        let pair_settings = pair_settings(pair, &settings);
        let chunks = with_caps(&active, &surfaces, pair, |a, b| {
            map_chunks(overlapping, settings.threads, |chunk| {
                let mut kept = Vec::new();
                meeting_caps(a, b, chunk, &pair_settings, &mut kept);
                kept
            })
        });
        meeting.extend(chunks.into_iter().flatten().flatten());
        pairs_in += overlapping.len();
        pairs_out += meeting.len();
    }
    if candidates.pairs.iter().any(|pair| pair.method == ContactMethod::Circumsphere) {
        diagnostics.finish("cone", start, pairs_in, pairs_out);
    }
}
