//! Stage 7: the exact test of candidates, for the methods that miss nothing and for rigid shapes.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, OtherSide, SurfacePair},
    diagnostics::DetectionDiagnostics,
    parallel::map_chunks,
    settle::SettleBuffers,
    sides::{pair_settings, surface_sides},
};
use crate::{
    kernel::{
        pair::FoundPairs,
        refine::{refine_closest, refine_pairs, refine_shape},
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// What the exact test found, one entry for each pair of surfaces in [`CandidateTrianglePairs`]; empty where a pair is
/// tested by spheres.
#[derive(Resource, Clone, Debug, Default)]
pub struct RefinedTrianglePairs {
    /// Touching pairs and contacts.
    pub pairs: Vec<FoundPairs>,
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
    mut buffers: Local<SettleBuffers>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    surfaces: Query<&SurfacePositions>,
) {
    let start = Instant::now();
    let (mut pairs_in, mut pairs_out, mut examined) = (0, 0, 0);
    refined.pairs.resize_with(candidates.pairs.len(), FoundPairs::default);
    for (pair, refined) in candidates.pairs.iter().zip(&mut refined.pairs) {
        refined.clear();
        if !pair.method.is_exact() {
            continue;
        }
        refine_pair(&active, pair, &settings, &surfaces, refined, &mut buffers);
        pairs_in += pair.triangles.len();
        pairs_out += refined.touching.len();
        examined += refined.examined;
    }
    diagnostics.pairs_examined = examined;
    if pairs_in > 0 {
        diagnostics.finish("refine", start, pairs_in, pairs_out);
    }
}

/// Does nothing where a surface is gone.
fn refine_pair(
    active: &ActiveSurfaces,
    pair: &SurfacePair,
    settings: &CircumsphereSettings,
    surfaces: &Query<&SurfacePositions>,
    refined: &mut FoundPairs,
    buffers: &mut SettleBuffers,
) {
    let pair_settings = pair_settings(pair, settings);
    let first = &active.surfaces[pair.first];
    let Ok(own) = surfaces.get(first.entity) else { return };
    let mut collect = |work: &(dyn Fn(&[[u32; 2]], &mut FoundPairs) + Sync)| {
        let chunks = map_chunks(&pair.triangles, settings.threads, |chunk| {
            let mut found = FoundPairs::default();
            work(chunk, &mut found);
            found
        });
        for chunk in chunks {
            refined.append(chunk);
        }
    };
    match pair.second {
        OtherSide::Surface(second) => {
            let Ok(other) = surfaces.get(active.surfaces[second].entity) else { return };
            let Some([a, b]) = surface_sides(active, pair, own, other) else { return };
            let test = if pair.method == ContactMethod::Closest { refine_closest } else { refine_pairs };
            collect(&|chunk, found| test(&a, &b, chunk, &pair_settings, found));
            buffers.settle([&a, &b], &pair.triangles, &pair_settings, settings.threads, &mut refined.contacts);
        }
        OtherSide::Shape(place) => {
            let (shape, pose) = (&active.shapes[place].geometry, &pair.relative_pose);
            collect(&|chunk, found| {
                refine_shape(&first.topology, &own.0, pose, shape, chunk, &pair_settings, found);
            });
        }
    }
}
