//! Stage 4: refits spheres and cones to the triangles.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use crate::{
    detection::{
        pairs::CandidateTrianglePairs, parallel::Threads, reuse::DetectionMemory, spheres::curvature::source,
        state::SurfaceStates,
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::spheres::{
        circumsphere::{RecipeSettings, enclosing_balls_on, enlarge_balls},
        curvature::CurvatureEstimator,
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{
        ActiveSurfaces, Circumspheres, ContactMethod, EnclosingBalls, SurfaceShape, TriangleCones, TriangleCurvature,
    },
};

/// Refits balls, spheres, and cones.
pub struct RefitPlugin;

impl Plugin for RefitPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<DetectionMemory>();
        app.add_systems(SurfaceDetection, (refit_balls, refit_spheres).chain().in_set(SurfaceDetectionSystems::Refit));
    }
}

#[expect(clippy::too_many_arguments, reason = "a stage reads what earlier stages wrote")]
fn refit_balls(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    memory: Res<DetectionMemory>,
    states: Res<SurfaceStates>,
    mut used: Local<Vec<bool>>,
    settings: Res<CircumsphereSettings>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<&mut EnclosingBalls>,
) {
    memory.surfaces_to_update(&active, &candidates, ContactMethod::BoundingSphere, &mut used);
    let start = StageWatch::start("refit balls");
    let mut any_made = false;
    for ((surface, state), used) in active.surfaces.iter().zip(states.all()).zip(used.iter().copied()) {
        let Ok(mut balls) = surfaces.get_mut(surface.entity) else { continue };
        if used {
            let (source, is_reusable) = source(surface, state, &memory, &settings);
            if is_reusable && balls.source == Some(source) {
                continue;
            }
            any_made = true;
            let share = Threads(settings.threads);
            enclosing_balls_on(&share, state.positions(), surface.topology.triangles(), &mut balls.data);
            if let Some(curved) = state.bounds.curved() {
                enlarge_balls(&mut balls.data, curved.heights());
            }
            balls.source = Some(source);
        } else if surface.method > ContactMethod::BoundingSphere && balls.capacity() > 0 {
            *balls = EnclosingBalls::default();
        }
    }
    if any_made {
        diagnostics.finish(start, 0, 0);
    }
}

#[expect(clippy::too_many_arguments, reason = "a stage reads the results of earlier stages and ticks")]
fn refit_spheres(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    memory: Res<DetectionMemory>,
    states: Res<SurfaceStates>,
    mut used: Local<Vec<bool>>,
    settings: Res<CircumsphereSettings>,
    mut last: Local<Option<(RecipeSettings, CurvatureEstimator)>>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut surfaces: Query<(&TriangleCurvature, &mut Circumspheres, &mut TriangleCones)>,
) {
    memory.surfaces_to_update(&active, &candidates, ContactMethod::Circumsphere, &mut used);
    let start = StageWatch::start("refit");
    let mut any_made = false;
    let made_with = (settings.recipe(), settings.estimator);
    // A new `refit_threshold` applies from the next refit on. Any other change requires other spheres for the same
    // shapes.
    let changed = last.is_some_and(|(recipe, estimator)| {
        (RecipeSettings { refit_threshold: recipe.refit_threshold, ..made_with.0 }, made_with.1) != (recipe, estimator)
    });
    *last = Some(made_with);
    for ((surface, state), used) in active.surfaces.iter().zip(states.all()).zip(used.iter().copied()) {
        let Ok((curvature, mut spheres, mut cones)) = surfaces.get_mut(surface.entity) else { continue };
        if surface.method > ContactMethod::Circumsphere {
            // The method has changed. Data that no pair needs takes no memory.
            if !spheres.radii.is_empty() {
                *spheres = Circumspheres::default();
                *cones = TriangleCones::default();
            }
        } else if (surface.fresh || changed) && !spheres.radii.is_empty() {
            spheres.data.forget();
            spheres.source = None;
        }
        if used {
            let (source, is_reusable) = source(surface, state, &memory, &settings);
            if is_reusable && spheres.source == Some(source) && cones.source == Some(source) {
                // Only the age of the recipes changes.
                spheres.bypass_change_detection().data.rest();
                continue;
            }
            any_made = true;
            let share = Threads(settings.threads);
            if surface.shape == SurfaceShape::Smooth {
                let (triangles, curvatures) = (surface.topology.triangles(), &curvature.curvatures);
                spheres.data.osculate_on(&share, state.positions(), triangles, curvatures, &mut cones.data);
                (spheres.source, cones.source) = (Some(source), Some(source));
                continue;
            }
            diagnostics.recipes_refreshed += spheres.data.refit_on(
                &share,
                state.positions(),
                surface.topology.triangles(),
                &curvature.curvatures,
                &curvature.dihedrals,
                settings.recipe(),
                &mut cones.data,
            );
            if settings.widen_cones {
                cones.data.widen_on(&share, &curvature.spreads);
            }
            (spheres.source, cones.source) = (Some(source), Some(source));
        }
    }
    if any_made {
        diagnostics.finish(start, 0, 0);
    }
}
