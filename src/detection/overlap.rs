//! Stage 5: candidates whose spheres overlap, and the contacts of enclosing balls.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::CandidateTrianglePairs,
    diagnostics::DetectionDiagnostics,
    parallel::collect_chunks,
    sides::{SphereQuery, SphereRows, pair_settings, with_balls, with_caps},
};
use crate::{
    kernel::{
        pair::FoundPairs,
        pair_order::sort_pairs,
        sphere_pairs::{ball_contacts, overlapping_balls, overlapping_caps},
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

/// What the sphere methods found, one entry for each pair of surfaces in [`CandidateTrianglePairs`], sorted; empty where
/// a pair's method does not use spheres.
#[derive(Resource, Clone, Debug, Default)]
pub struct SphereContacts {
    /// Touching pairs and contacts.
    pub pairs: Vec<FoundPairs>,
}

/// Tests spheres for overlap.
pub struct OverlapPlugin;

impl Plugin for OverlapPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<OverlappingTrianglePairs>().init_resource::<SphereContacts>().init_resource::<SphereRows>();
        let systems = (test_overlap, touch_by_balls).chain();
        app.add_systems(SurfaceDetection, systems.in_set(SurfaceDetectionSystems::Overlap));
    }
}

#[expect(clippy::too_many_arguments, reason = "the first of the sphere stages prepares for the others")]
fn test_overlap(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut overlapping: ResMut<OverlappingTrianglePairs>,
    mut rows: ResMut<SphereRows>,
    mut spare: Local<Vec<[u32; 2]>>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    let (mut pairs_in, mut pairs_out) = (0, 0);
    overlapping.pairs.resize_with(candidates.pairs.len(), Vec::new);
    rows.update(&active, &surfaces, &candidates);
    for (pair, overlapping) in candidates.pairs.iter().zip(&mut overlapping.pairs) {
        overlapping.clear();
        let pair_settings = pair_settings(pair, &settings);
        let (triangles, threads) = (&pair.triangles, settings.threads);
        let append = |list: &mut Vec<[u32; 2]>, mut later: Vec<[u32; 2]>| list.append(&mut later);
        match pair.method {
            ContactMethod::BoundingSphere => with_balls(&active, &surfaces, pair, &rows, |a, b| {
                let work = |chunk: &[[u32; 2]], kept: &mut _| overlapping_balls(a, b, chunk, &pair_settings, kept);
                collect_chunks(triangles, threads, overlapping, work, append);
            }),
            ContactMethod::Circumsphere => with_caps(&active, &surfaces, pair, &rows, |a, b| {
                let work = |chunk: &[[u32; 2]], kept: &mut _| overlapping_caps(a, b, chunk, &pair_settings, kept);
                collect_chunks(triangles, threads, overlapping, work, append);
            }),
            ContactMethod::Closest | ContactMethod::Refined | ContactMethod::Polygon => continue,
        };
        sort_pairs(overlapping, pair_settings.same_surface, &mut spare);
        pairs_in += pair.triangles.len();
        pairs_out += overlapping.len();
    }
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
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = Instant::now();
    let (mut pairs_in, mut pairs_out) = (0, 0);
    contacts.pairs.resize_with(candidates.pairs.len(), FoundPairs::default);
    for ((pair, overlapping), found) in candidates.pairs.iter().zip(&overlapping.pairs).zip(&mut contacts.pairs) {
        found.clear();
        if pair.method != ContactMethod::BoundingSphere {
            continue;
        }
        let pair_settings = pair_settings(pair, &settings);
        with_balls(&active, &surfaces, pair, &rows, |a, b| {
            let work = |chunk: &[[u32; 2]], found: &mut _| ball_contacts(a, b, chunk, &pair_settings, found);
            collect_chunks(overlapping, settings.threads, found, work, FoundPairs::append_sorted);
        });
        pairs_in += overlapping.len();
        pairs_out += found.touching.len();
    }
    if pairs_in > 0 {
        diagnostics.finish("ball contacts", start, pairs_in, pairs_out);
    }
}
