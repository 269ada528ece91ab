//! The last step of the broad phase: leaves out pairs of triangles that make no contact although their surfaces meet.

use bevy_ecs::prelude::*;

use crate::{
    detection::{
        pairs::CandidateTrianglePairs,
        reuse::{DetectionMemory, near_lists::KeptPairs},
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    surface::{ActiveSurfaces, ContactFilter, PairFilter},
};

/// Leaves out pairs in their order, on one thread. Pairs of surfaces without a filter cost nothing.
pub(super) fn leave_out(
    active: Res<ActiveSurfaces>,
    game: Option<Res<ContactFilter>>,
    mut candidates: ResMut<CandidateTrianglePairs>,
    memory: Res<DetectionMemory>,
    mut kept: ResMut<KeptPairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
) {
    let start = StageWatch::start("filter");
    let [mut asked, mut left] = [0; 2];
    for (place, pair) in candidates.pairs.iter_mut().enumerate() {
        if memory.keeps(place) {
            continue;
        }
        pair.any_left_out = false;
        let sides = pair.filter_sides(&active);
        let Some(filter) = PairFilter::between(&sides[0], &sides[1], pair.is_self(), game.as_deref()) else { continue };
        let before = pair.triangles.len();
        kept.retain_near(place, &mut pair.triangles, |triangles| filter.allows(triangles));
        pair.any_left_out = pair.triangles.len() < before;
        asked += before;
        left += pair.triangles.len();
    }
    if asked > 0 {
        diagnostics.finish(start, asked, left);
    }
}
