//! Stage 7: the exact test of candidates, for the methods that miss nothing and for rigid shapes.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, OtherSide, SurfacePair},
    diagnostics::DetectionDiagnostics,
    parallel::map_chunks,
};
use crate::{
    kernel::refine::{RefineSettings, RefinedPairs, SurfaceSide, refine_pairs, refine_shape, settle_penetrations},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// What the exact test found, one entry for each pair of surfaces in [`CandidateTrianglePairs`]; empty where a pair's
/// method is not exact.
#[derive(Resource, Clone, Debug, Default)]
pub struct RefinedTrianglePairs {
    /// Touching pairs and contacts.
    pub pairs: Vec<RefinedPairs>,
}

/// Tests candidates exactly.
pub struct RefinePlugin;

impl Plugin for RefinePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<RefinedTrianglePairs>();
        app.add_systems(SurfaceDetection, refine.in_set(SurfaceDetectionSystems::Refine));
    }
}

fn refine(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut refined: ResMut<RefinedTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: Query<&SurfacePositions>,
) {
    let start = diagnostics.start();
    let (mut pairs_in, mut pairs_out, mut examined) = (0, 0, 0);
    refined.pairs.resize_with(candidates.pairs.len(), RefinedPairs::default);
    for (pair, refined) in candidates.pairs.iter().zip(&mut refined.pairs) {
        refined.clear();
        if pair.method < ContactMethod::Refined {
            continue;
        }
        let _ = refine_pair(&active, pair, &settings, &surfaces, refined);
        pairs_in += pair.triangles.len();
        pairs_out += refined.touching.len();
        examined += refined.examined;
    }
    diagnostics.pairs_examined = examined;
    if pairs_in > 0 {
        diagnostics.finish("refine", start, pairs_in, pairs_out);
    }
}

fn refine_pair(
    active: &ActiveSurfaces,
    pair: &SurfacePair,
    settings: &CircumsphereSettings,
    surfaces: &Query<&SurfacePositions>,
    refined: &mut RefinedPairs,
) -> Option<()> {
    let first = &active.surfaces[pair.first];
    let refine_settings = RefineSettings {
        contact_distance: f64::from(pair.contact_distance),
        reported_distance: f64::from(pair.reported_distance),
        range: f64::from(pair.range),
        scale: pair.frame_pose.scale(),
        cull: pair.method != ContactMethod::Polygon,
        same_surface: pair.is_self(),
    };
    let own = &surfaces.get(first.entity).ok()?.0;
    match pair.second {
        OtherSide::Surface(place) => {
            let second = &active.surfaces[place];
            let other = &surfaces.get(second.entity).ok()?.0;
            let [positions_a, positions_b] = pair.positions(own, other);
            let [pose_a, pose_b] = pair.poses();
            let a = SurfaceSide {
                topology: &first.topology,
                positions: positions_a,
                one_sided: first.one_sided,
                mirrored: pose_a.is_mirrored(),
            };
            let b = SurfaceSide {
                topology: &second.topology,
                positions: positions_b,
                one_sided: second.one_sided,
                mirrored: pose_b.is_mirrored(),
            };
            let chunks = map_chunks(&pair.triangles, settings.threads, |chunk| {
                let mut found = RefinedPairs::default();
                refine_pairs(&a, &b, chunk, &refine_settings, &mut found);
                found
            });
            for chunk in chunks {
                refined.append(chunk);
            }
            settle_penetrations(&a, &b, &pair.triangles, &refine_settings, &mut refined.contacts);
        }
        OtherSide::Shape(place) => {
            let shape = &active.shapes[place].geometry;
            let chunks = map_chunks(&pair.triangles, settings.threads, |chunk| {
                let mut found = RefinedPairs::default();
                let pose = &pair.relative_pose;
                refine_shape(&first.topology, own, pose, shape, chunk, &refine_settings, &mut found);
                found
            });
            for chunk in chunks {
                refined.append(chunk);
            }
        }
    }
    Some(())
}
