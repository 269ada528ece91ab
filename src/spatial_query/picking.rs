//! A backend for `bevy_picking`: which surfaces pointers are over.

use bevy_app::prelude::*;
use bevy_camera::{
    Camera,
    visibility::{InheritedVisibility, RenderLayers},
};
use bevy_ecs::prelude::*;
use bevy_picking::backend::prelude::{HitData, Pickable, PickingSystems, PointerHits, RayMap};

use super::{RayHit, SurfaceQuery, SurfaceQueryFilter};
use crate::detection::SurfaceStates;

/// Lets `bevy_picking` find surfaces and rigid shapes under pointers, so that observers of `PointerOver`, `PointerClick`, and the
/// like work on meshes that deform. Add it beside the plugins of `bevy_picking` and
/// [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins): without one of them it does nothing. Where a mesh is a surface, leave out
/// Bevy's `MeshPickingPlugin` or its hits: it sees the mesh as it was loaded.
///
/// - Pointers hit what the last detection saw: surfaces in the pose in which they were last drawn.
/// - `Pickable`, `RenderLayers`, and `InheritedVisibility` of the surface's entity count as they do for meshes. An entity that
///   does not block what is below it is reported together with what is.
/// - The hit has the position and the unit normal in the world. `HitData::extra_as::<RayHit>()` returns the [`RayHit`], with
///   the triangle and the place on it.
pub struct SurfacePickingPlugin;

impl Plugin for SurfacePickingPlugin {
    fn build(&self, app: &mut App) {
        let is_complete = resource_exists::<RayMap>.and_then(resource_exists::<SurfaceStates>);
        app.add_systems(PreUpdate, report_hits.in_set(PickingSystems::Backend).run_if(is_complete));
    }

    fn finish(&self, app: &mut App) {
        let world = app.world();
        if !(world.contains_resource::<RayMap>() && world.contains_resource::<SurfaceStates>()) {
            log::warn!("pointers find no surfaces: add the plugins of bevy_picking and DeformableCollisionPlugins");
        }
    }
}

fn report_hits(
    rays: Res<RayMap>,
    surfaces: SurfaceQuery,
    cameras: Query<(&Camera, Option<&RenderLayers>)>,
    targets: Query<(Option<&Pickable>, Option<&RenderLayers>, Option<&InheritedVisibility>)>,
    mut hits: MessageWriter<PointerHits>,
) {
    for (&id, ray) in rays.iter() {
        let Ok((camera, camera_layers)) = cameras.get(id.camera) else { continue };
        let everywhere = RenderLayers::default();
        let camera_layers = camera_layers.unwrap_or(&everywhere);
        let can_be_hit = |entity: Entity| {
            targets.get(entity).is_ok_and(|(pickable, layers, visibility)| {
                pickable.is_none_or(|pickable| pickable.is_hoverable)
                    && visibility.is_none_or(|visibility| visibility.get())
                    && camera_layers.intersects(layers.unwrap_or(&everywhere))
            })
        };
        let mut found: Vec<Entity> = Vec::new();
        let mut picks = Vec::new();
        loop {
            let filter = SurfaceQueryFilter::default().excluding(&found).with_predicate(&can_be_hit);
            let Some(hit) = surfaces.cast_ray(ray.origin, *ray.direction, f32::INFINITY, &filter) else { break };
            picks.push((hit.entity, hit_data(id.camera, hit)));
            let blocks = |pickable: &Pickable| pickable.should_block_lower;
            if targets.get(hit.entity).is_ok_and(|(pickable, ..)| pickable.is_none_or(blocks)) {
                break;
            }
            found.push(hit.entity);
        }
        if !picks.is_empty() {
            hits.write(PointerHits::new(id.pointer, picks, camera.order as f32));
        }
    }
}

fn hit_data(camera: Entity, hit: RayHit) -> HitData {
    HitData::new_with_extra(camera, hit.distance, Some(hit.point), Some(hit.normal), hit)
}
