//! Stage 5: candidates whose spheres overlap.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::CandidateTrianglePairs,
    diagnostics::DetectionDiagnostics,
    parallel::map_chunks,
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
        app.init_resource::<OverlappingTrianglePairs>();
        app.add_systems(SurfaceDetection, test_overlap.in_set(SurfaceDetectionSystems::Overlap));
    }
}

fn test_overlap(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut overlapping: ResMut<OverlappingTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    let (mut pairs_in, mut pairs_out) = (0, 0);
    overlapping.pairs.resize_with(candidates.pairs.len(), Vec::new);
    for (pair, overlapping) in candidates.pairs.iter().zip(&mut overlapping.pairs) {
        overlapping.clear();
        let pair_settings = pair_settings(pair, &settings);
        let threads = settings.threads;
        let chunks = match pair.method {
            ContactMethod::BoundingSphere => with_balls(&active, &surfaces, pair, |a, b| {
                map_chunks(&pair.triangles, threads, |chunk| {
                    let mut kept = Vec::new();
                    overlapping_balls(a, b, chunk, &pair_settings, &mut kept);
                    kept
                })
            }),
            ContactMethod::Circumsphere => with_caps(&active, &surfaces, pair, |a, b| {
                map_chunks(&pair.triangles, threads, |chunk| {
                    let mut kept = Vec::new();
                    overlapping_caps(a, b, chunk, &pair_settings, &mut kept);
                    kept
                })
            }),
            ContactMethod::Closest | ContactMethod::Refined | ContactMethod::Polygon => continue,
        };
        overlapping.extend(chunks.into_iter().flatten().flatten());
        pairs_in += pair.triangles.len();
        pairs_out += overlapping.len();
    }
    if pairs_in > 0 {
        diagnostics.finish("overlap", start, pairs_in, pairs_out);
    }
}
