//! Stage 5: candidates whose spheres overlap.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, SurfacePair},
    diagnostics::DetectionDiagnostics,
    memory::{DetectionMemory, StageList, check_spheres},
    parallel::{CHUNK, append_chunks, for_each_weighed},
    sides::{SphereQuery, pair_settings, with_balls, with_caps},
};
use crate::{
    kernel::sphere_pairs::{overlapping_balls, overlapping_caps},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod},
};

/// The candidates that come within range as spheres, one list for each pair of surfaces in
/// [`CandidateTrianglePairs`]; empty where a pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
pub struct OverlappingTrianglePairs {
    /// Pairs of triangles.
    pub pairs: Vec<Vec<[u32; 2]>>,
}

/// Tests spheres for overlap.
pub struct OverlapPlugin;

impl Plugin for OverlapPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<OverlappingTrianglePairs>().init_resource::<DetectionMemory>();
        let systems = (check_spheres, test_overlap).chain();
        app.add_systems(SurfaceDetection, systems.in_set(SurfaceDetectionSystems::Overlap));
    }
}

fn test_overlap(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut overlapping: ResMut<OverlappingTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    memory.reads(StageList::Candidates, candidates.last_changed());
    memory.writes(StageList::Overlapping, overlapping.last_changed());
    memory.carry(&mut overlapping.pairs);
    overlapping.pairs.resize_with(candidates.pairs.len(), Vec::new);
    memory.seal(StageList::Overlapping, overlapping.last_changed());
    let uses_spheres =
        |pair: &SurfacePair| matches!(pair.method, ContactMethod::BoundingSphere | ContactMethod::Circumsphere);
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
                append_chunks(&pair.triangles, threads, overlapping, test, |kept, mut later| kept.append(&mut later));
            };
            if pair.method == ContactMethod::BoundingSphere {
                with_balls(&active, &surfaces, pair, |a, b| {
                    keep(&|chunk, kept| overlapping_balls(a, b, chunk, &pair_settings, kept));
                });
            } else {
                with_caps(&active, &surfaces, pair, |a, b| {
                    keep(&|chunk, kept| overlapping_caps(a, b, chunk, &pair_settings, kept));
                });
            }
        },
    );
    let pairs_in: usize =
        memory.changed(&candidates.pairs).filter(|pair| uses_spheres(pair)).map(|pair| pair.triangles.len()).sum();
    let pairs_out = memory.changed(&overlapping.pairs).map(Vec::len).sum();
    if pairs_in > 0 {
        diagnostics.finish("overlap", start, pairs_in, pairs_out);
    }
}
