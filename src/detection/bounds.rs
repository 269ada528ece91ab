//! Stage 1: takes a snapshot of positions, and computes the boxes of surfaces in the world. Boxes of the
//! triangles of flat surfaces follow on demand, where something is near.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{parallel::for_each_weighed, state::SurfaceStates};
use crate::{
    detection::pairs::frame_growth,
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        capacity,
        mesh::{bounds::Aabb, curved_edges::MOST_UNEVEN},
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, CheckedPositions, Named, SurfacePositions, SurfaceShape},
};

/// Half the number of triangles from which a surface is worth several threads.
const TRIANGLES_OF_ONE: usize = 65_536;

/// Computes the boxes.
pub struct BoundsPlugin;

impl Plugin for BoundsPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<CircumsphereSettings>().init_resource::<SurfaceStates>();
        app.add_systems(SurfaceDetection, compute_bounds.in_set(SurfaceDetectionSystems::Bounds));
    }
}

fn compute_bounds(
    mut active: ResMut<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut states: ResMut<SurfaceStates>,
    mut surfaces: Query<(Ref<SurfacePositions>, &mut CheckedPositions)>,
    names: Query<&Name>,
) {
    diagnostics.begin_detection();
    let start = StageWatch::start(DetectionDiagnostics::FIRST_DETECTION_STAGE);
    // A system in `Predict` may have written positions or despawned a surface since `Prepare`. A surface that cannot be
    // used is skipped in this detection. The next `Prepare` reports the reason, if there still is one.
    active.surfaces.retain(|surface| {
        surfaces.get_mut(surface.entity).is_ok_and(|(positions, mut checked)| {
            positions.0.len() == surface.topology.vertex_count() && checked.check(&positions).is_ok()
        })
    });
    states.align(&active.surfaces, |entity| surfaces.contains(entity));
    for surface in &mut active.surfaces {
        let [own, other] = surface.solver_margins.map(|margin| settings.margin().max(margin));
        (surface.own_margin, surface.margin) = (own, other.max(own));
    }
    for shape in &mut active.shapes {
        shape.margin = settings.margin().max(shape.solver_margin);
    }
    let all_positions = surfaces.as_readonly();
    let ActiveSurfaces { surfaces, .. } = &mut *active;
    for_each_weighed(
        states.all_mut(),
        settings.threads,
        TRIANGLES_OF_ONE,
        |place, _| surfaces[place].topology.triangles().len(),
        |place, state, threads| {
            let surface = &surfaces[place];
            let Ok((positions, _)) = all_positions.get(surface.entity) else { return };
            let growth = frame_growth(surface.thickness, surface.margin, surface.pose.scale());
            let crease = (surface.shape == SurfaceShape::Smooth).then(|| settings.crease());
            state.has_moved = state.bounds.update(&positions, &surface.topology, growth, crease, threads);
            state.bounds.update_in_world(&surface.pose);
            if state.has_moved {
                state.queried.retire();
            }
            (state.one_sided, state.query_layers) = (surface.one_sided, surface.query_layers);
        },
    );
    for (surface, state) in surfaces.iter_mut().zip(states.all_mut()) {
        if let Some(unevenness) = state.bounds.take_unevenness().filter(|unevenness| *unevenness > MOST_UNEVEN) {
            log::warn!(
                "surface {} is Smooth, but does not fit a smooth body (unevenness {unevenness:.2} of at most \
                 {MOST_UNEVEN}): its patches may be farther from the body than its triangles. Use SurfaceShape::Flat, or \
                 a mesh with its vertices on the body and without narrow rounded edges; a smaller crease_angle keeps more \
                 edges sharp",
                Named(surface.entity, names.get(surface.entity).ok())
            );
        }
        diagnostics.surfaces_unmoved += usize::from(!state.has_moved);
        surface.world_bounds = state.bounds.in_world.map_or(Aabb::EMPTY, |(_, in_world)| in_world);
    }
    let count = surfaces.len();
    capacity::trim(surfaces, count);
    diagnostics.finish(start, 0, 0);
}
