//! Stage 4: spheres and cones follow the triangles.

use std::time::Instant;

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    bounds::TriangleBounds,
    broad_phase::CandidateTrianglePairs,
    curvature::TriangleCurvature,
    diagnostics::DetectionDiagnostics,
    memory::DetectionMemory,
    parallel::Threads,
    sphere_memory::{SpherePart, SphereSource, check_spheres},
};
use crate::{
    kernel::spheres::{
        circumsphere::{Ball, OffsetSpheres, RecipeSettings, enclosing_balls_on},
        cone::SafetyCones,
        curvature::CurvatureEstimator,
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// The smallest ball around each triangle, of the last tick in which a pair of the surface was tested by
/// them; empty where the surface's own method is more exact.
#[derive(Component, Clone, Debug, Default)]
pub struct EnclosingBalls(pub Vec<Ball>);

/// The offset sphere of each triangle, of the last tick in which a pair of the surface was tested by
/// them; empty where the surface's own method is more exact.
#[derive(Component, Clone, Debug, Default)]
pub struct Circumspheres(pub OffsetSpheres);

/// The safety cone of each triangle, of the last tick in which a pair of the surface was tested by
/// them; empty where the surface's own method is more exact.
#[derive(Component, Clone, Debug, Default)]
pub struct TriangleCones(pub SafetyCones);

/// Refits balls, spheres and cones.
pub struct RefitPlugin;

impl Plugin for RefitPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<DetectionMemory>();
        app.add_systems(
            SurfaceDetection,
            (check_spheres, refit_balls, refit_spheres).chain().in_set(SurfaceDetectionSystems::Refit),
        );
    }
}

fn refit_balls(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut used: Local<Vec<bool>>,
    settings: Res<CircumsphereSettings>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<(Ref<SurfacePositions>, &TriangleBounds, &mut EnclosingBalls)>,
) {
    memory.surfaces_to_update(&active, &candidates, ContactMethod::BoundingSphere, &mut used);
    let start = Instant::now();
    let mut any_made = false;
    for (surface, used) in active.surfaces.iter().zip(used.iter().copied()) {
        let Ok((positions, bounds, mut balls)) = surfaces.get_mut(surface.entity) else { continue };
        if used {
            let source = SphereSource { computed: bounds.computed_of(&positions), curvature: None };
            if memory.spheres.holds(surface.entity, SpherePart::Balls, source, balls.last_changed()) {
                continue;
            }
            any_made = true;
            enclosing_balls_on(&Threads(settings.threads), &positions.0, surface.topology.triangles(), &mut balls.0);
            memory.spheres.seal(surface.entity, SpherePart::Balls, source, balls.last_changed());
        } else if surface.method > ContactMethod::BoundingSphere && balls.0.capacity() > 0 {
            *balls = EnclosingBalls::default();
        }
    }
    if any_made {
        diagnostics.finish("refit balls", start, 0, 0);
    }
}

#[expect(clippy::too_many_arguments, reason = "what spheres are made from, and what is remembered of them")]
fn refit_spheres(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut used: Local<Vec<bool>>,
    settings: Res<CircumsphereSettings>,
    mut last: Local<Option<(RecipeSettings, CurvatureEstimator)>>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<(
        Ref<SurfacePositions>,
        &TriangleBounds,
        Ref<TriangleCurvature>,
        &mut Circumspheres,
        &mut TriangleCones,
    )>,
) {
    memory.surfaces_to_update(&active, &candidates, ContactMethod::Circumsphere, &mut used);
    let start = Instant::now();
    let mut any_made = false;
    let made_with = (settings.recipe(), settings.estimator);
    // A new delta is for the next refresh to heed; anything else makes other spheres of the same shape.
    let changed = last.is_some_and(|(recipe, estimator)| {
        (RecipeSettings { delta: recipe.delta, ..made_with.0 }, made_with.1) != (recipe, estimator)
    });
    *last = Some(made_with);
    for (surface, used) in active.surfaces.iter().zip(used.iter().copied()) {
        let Ok((positions, bounds, curvature, mut spheres, mut cones)) = surfaces.get_mut(surface.entity) else {
            continue;
        };
        if surface.method > ContactMethod::Circumsphere {
            // The method was changed: what no pair asks for takes no memory.
            if !spheres.0.radii.is_empty() {
                *spheres = Circumspheres::default();
                *cones = TriangleCones::default();
            }
        } else if (surface.fresh || changed) && !spheres.0.radii.is_empty() {
            spheres.0.forget();
        }
        if used {
            let source =
                SphereSource { computed: bounds.computed_of(&positions), curvature: Some(curvature.last_changed()) };
            if memory.spheres.holds(surface.entity, SpherePart::Spheres, source, spheres.last_changed())
                && memory.spheres.holds(surface.entity, SpherePart::Cones, source, cones.last_changed())
            {
                // Nothing about them but their age changes.
                spheres.bypass_change_detection().0.rest();
                continue;
            }
            any_made = true;
            let share = Threads(settings.threads);
            diagnostics.recipes_refreshed += spheres.0.refit_on(
                &share,
                &positions.0,
                surface.topology.triangles(),
                &curvature.0.curvatures,
                &curvature.0.dihedrals,
                settings.recipe(),
                &mut cones.0,
            );
            if settings.widen_cones {
                cones.0.widen_on(&share, &curvature.0.spreads);
            }
            memory.spheres.seal(surface.entity, SpherePart::Spheres, source, spheres.last_changed());
            memory.spheres.seal(surface.entity, SpherePart::Cones, source, cones.last_changed());
        }
    }
    if any_made {
        diagnostics.finish("refit", start, 0, 0);
    }
}
