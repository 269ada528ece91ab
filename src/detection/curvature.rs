//! Stage 3: curvature and dihedral angles of the surfaces whose spheres are offset.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    bounds::TriangleBounds,
    broad_phase::CandidateTrianglePairs,
    diagnostics::DetectionDiagnostics,
    memory::DetectionMemory,
    parallel::Threads,
    sphere_memory::{SpherePart, SphereSource, check_spheres},
};
use crate::{
    kernel::spheres::curvature::Curvatures,
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// Curvature and dihedral angles of a surface's triangles, of the last tick in which a pair of it was tested by
/// offset spheres; empty where the surface's own method is more exact.
#[derive(Component, Clone, Debug, Default)]
pub struct TriangleCurvature(pub Curvatures);

/// Computes curvature.
pub struct CurvaturePlugin;

impl Plugin for CurvaturePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<DetectionMemory>();
        app.add_systems(
            SurfaceDetection,
            (check_spheres, measure_curvature).chain().in_set(SurfaceDetectionSystems::Curvature),
        );
    }
}

fn measure_curvature(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut memory: ResMut<DetectionMemory>,
    mut used: Local<Vec<bool>>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<(Ref<SurfacePositions>, &TriangleBounds, &mut TriangleCurvature)>,
) {
    memory.surfaces_to_update(&active, &candidates, ContactMethod::Circumsphere, &mut used);
    let start = Instant::now();
    let mut any_made = false;
    for (surface, used) in active.surfaces.iter().zip(used.iter().copied()) {
        let Ok((positions, bounds, mut curvature)) = surfaces.get_mut(surface.entity) else { continue };
        if used {
            let source = SphereSource { computed: bounds.computed_of(&positions), curvature: None };
            if memory.spheres.holds(surface.entity, SpherePart::Curvature, source, curvature.last_changed()) {
                continue;
            }
            any_made = true;
            let share = Threads(settings.threads);
            curvature.0.measure_on(&share, &surface.topology, &positions.0, settings.estimator);
            memory.spheres.seal(surface.entity, SpherePart::Curvature, source, curvature.last_changed());
        } else if surface.method > ContactMethod::Circumsphere && !curvature.0.curvatures.is_empty() {
            // The method was changed: what no pair asks for takes no memory.
            *curvature = TriangleCurvature::default();
        }
    }
    if any_made {
        diagnostics.finish("curvature", start, 0, 0);
    }
}
