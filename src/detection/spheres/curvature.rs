//! Stage 3: computes curvature and dihedral angles of the surfaces that are tested by offset spheres.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use crate::{
    detection::{
        pairs::CandidateTrianglePairs,
        parallel::Threads,
        reuse::DetectionMemory,
        state::{SurfaceState, SurfaceStates},
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactMethod, SphereSource, TriangleCurvature},
};

/// Computes curvature.
pub struct CurvaturePlugin;

impl Plugin for CurvaturePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<DetectionMemory>();
        app.add_systems(SurfaceDetection, measure_curvature.in_set(SurfaceDetectionSystems::Curvature));
    }
}

/// What a surface's sphere data is computed from in this detection, and whether data from the same source may be
/// reused.
pub(in crate::detection) fn source(
    surface: &ActiveSurface,
    state: &SurfaceState,
    memory: &DetectionMemory,
    settings: &CircumsphereSettings,
) -> (SphereSource, bool) {
    let source = SphereSource { version: state.version(), settings: memory.settings_version() };
    (source, settings.memory && !surface.fresh)
}

#[expect(clippy::too_many_arguments, reason = "a stage reads what earlier stages wrote")]
fn measure_curvature(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    memory: Res<DetectionMemory>,
    states: Res<SurfaceStates>,
    mut used: Local<Vec<bool>>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<&mut TriangleCurvature>,
) {
    memory.surfaces_to_update(&active, &candidates, ContactMethod::Circumsphere, &mut used);
    let start = StageWatch::start("curvature");
    let mut any_made = false;
    for ((surface, state), used) in active.surfaces.iter().zip(states.all()).zip(used.iter().copied()) {
        let Ok(mut curvature) = surfaces.get_mut(surface.entity) else { continue };
        if used {
            let (source, is_reusable) = source(surface, state, &memory, &settings);
            if is_reusable && curvature.source == Some(source) {
                continue;
            }
            any_made = true;
            let share = Threads(settings.threads);
            if let Some(curved) = state.bounds.curved() {
                curvature.data.osculate_on(&share, state.positions(), surface.topology.triangles(), curved);
            } else {
                curvature.data.measure_on(&share, &surface.topology, state.positions(), settings.estimator);
            }
            curvature.source = Some(source);
        } else if surface.method > ContactMethod::Circumsphere && !curvature.curvatures.is_empty() {
            // The method has changed. Data that no pair needs takes no memory.
            *curvature = TriangleCurvature::default();
        }
    }
    if any_made {
        diagnostics.finish(start, 0, 0);
    }
}
