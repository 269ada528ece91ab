//! Stage 5: candidates whose spheres overlap.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, OtherSide, SurfacePair},
    diagnostics::DetectionDiagnostics,
    parallel::map_chunks,
    refit::{Circumspheres, EnclosingBalls, TriangleCones},
};
use crate::{
    kernel::sphere_pairs::{BallSide, CapSide, overlapping_balls, overlapping_caps},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// The candidates that come within range as spheres, one list for each pair of surfaces in [`CandidateTrianglePairs`]; empty
/// where a pair's method does not use spheres.
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

/// The spheres of every surface.
pub(crate) type SphereQuery<'w, 's> =
    Query<'w, 's, (&'static SurfacePositions, &'static EnclosingBalls, &'static Circumspheres, &'static TriangleCones)>;

/// Calls `test` with the offset spheres of both sides of a pair.
pub(super) fn with_caps<T>(
    active: &ActiveSurfaces,
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    test: impl FnOnce(&CapSide<'_>, &CapSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (first, second) = (&active.surfaces[pair.first], &active.surfaces[second]);
    let (positions_a, _, spheres_a, cones_a) = surfaces.get(first.entity).ok()?;
    let (positions_b, _, spheres_b, cones_b) = surfaces.get(second.entity).ok()?;
    let [pose_a, pose_b] = pair.poses();
    let [positions_a, positions_b] = pair.positions(&positions_a.0, &positions_b.0);
    let a = CapSide {
        spheres: &spheres_a.0,
        cones: &cones_a.0,
        topology: &first.topology,
        positions: positions_a,
        pose: &pose_a,
        one_sided: first.one_sided && !pair.is_self(),
    };
    let b = CapSide {
        spheres: &spheres_b.0,
        cones: &cones_b.0,
        topology: &second.topology,
        positions: positions_b,
        pose: &pose_b,
        one_sided: second.one_sided && !pair.is_self(),
    };
    Some(test(&a, &b))
}

/// Calls `test` with the enclosing balls of both sides of a pair.
pub(crate) fn with_balls<T>(
    active: &ActiveSurfaces,
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    test: impl FnOnce(&BallSide<'_>, &BallSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (_, balls_a, ..) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (_, balls_b, ..) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [pose_a, pose_b] = pair.poses();
    Some(test(&BallSide { balls: &balls_a.0, pose: &pose_a }, &BallSide { balls: &balls_b.0, pose: &pose_b }))
}

fn test_overlap(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut overlapping: ResMut<OverlappingTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: SphereQuery,
) {
    let start = diagnostics.start();
    let (mut pairs_in, mut pairs_out) = (0, 0);
    overlapping.pairs.resize_with(candidates.pairs.len(), Vec::new);
    for (pair, overlapping) in candidates.pairs.iter().zip(&mut overlapping.pairs) {
        overlapping.clear();
        let adjacency = pair.is_self().then(|| &*active.surfaces[pair.first].topology);
        let reach = (f64::from(pair.range) / pair.frame_pose.scale()) as f32;
        let threads = settings.threads;
        let chunks = match pair.method {
            ContactMethod::BoundingSphere => with_balls(&active, &surfaces, pair, |a, b| {
                map_chunks(&pair.triangles, threads, |chunk| {
                    let mut kept = Vec::new();
                    overlapping_balls(a, b, adjacency, reach, chunk, &mut kept);
                    kept
                })
            }),
            ContactMethod::Circumsphere => with_caps(&active, &surfaces, pair, |a, b| {
                map_chunks(&pair.triangles, threads, |chunk| {
                    let mut kept = Vec::new();
                    overlapping_caps(a, b, adjacency, reach, chunk, &mut kept);
                    kept
                })
            }),
            ContactMethod::Refined | ContactMethod::Polygon => continue,
        };
        overlapping.extend(chunks.into_iter().flatten().flatten());
        pairs_in += pair.triangles.len();
        pairs_out += overlapping.len();
    }
    if pairs_in > 0 {
        diagnostics.finish("overlap", start, pairs_in, pairs_out);
    }
}
