//! Records surfaces, contacts and stage times of every tick for the Rerun viewer.
//!
//! Reads what the tick left behind and changes nothing of it. Timeline `tick`; entities `surfaces/NAME`, `contacts/points`,
//! `contacts/normals`, `milliseconds/STAGE` and `pairs/STAGE`.

use std::sync::Arc;

use ::rerun::{Arrows3D, Mesh3D, Points3D, RecordingStream, RecordingStreamResult, Scalars, TriangleIndices};
use bevy_app::prelude::*;
use bevy_ecs::{
    entity::EntityHashMap,
    prelude::*,
    schedule::{InternedScheduleLabel, ScheduleLabel},
};
use glam::Vec3;

use crate::{
    contacts::{ContactStore, SurfaceContacts},
    detection::DetectionDiagnostics,
    kernel::topology::SurfaceTopology,
    schedule::DeformableSystems,
    surface::{ActiveSurfaces, SurfacePositions},
};

/// Logs every tick to a recording stream: to a file, a viewer, or wherever the stream leads.
pub struct DeformableRerunPlugin {
    recording: RecordingStream,
    schedule: InternedScheduleLabel,
}

impl DeformableRerunPlugin {
    /// Logs to `recording`, in the schedule that was given to
    /// [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins).
    #[must_use]
    pub fn new(recording: RecordingStream, schedule: impl ScheduleLabel) -> Self {
        Self { recording, schedule: schedule.intern() }
    }
}

/// The stream, and for each surface the mesh that was logged last.
#[derive(Resource)]
struct Recording {
    stream: RecordingStream,
    meshes: EntityHashMap<Arc<SurfaceTopology>>,
}

impl Plugin for DeformableRerunPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(Recording { stream: self.recording.clone(), meshes: EntityHashMap::default() });
        app.add_systems(self.schedule, log_tick.in_set(DeformableSystems::Log));
    }
}

fn log_tick(
    mut recording: ResMut<Recording>,
    active: Res<ActiveSurfaces>,
    store: Res<ContactStore>,
    contacts: SurfaceContacts,
    diagnostics: Res<DetectionDiagnostics>,
    surfaces: Query<(&SurfacePositions, Option<&Name>)>,
) {
    let Recording { stream, meshes } = &mut *recording;
    stream.set_time_sequence("tick", i64::try_from(store.tick).unwrap_or(i64::MAX));
    let logged = log_surfaces(stream, meshes, &active, &surfaces)
        .and_then(|()| log_contacts(stream, &contacts))
        .and_then(|()| log_stages(stream, &diagnostics));
    if let Err(error) = logged {
        log::warn!("a tick could not be recorded: {error}");
    }
}

fn log_surfaces(
    stream: &RecordingStream,
    meshes: &mut EntityHashMap<Arc<SurfaceTopology>>,
    active: &ActiveSurfaces,
    surfaces: &Query<(&SurfacePositions, Option<&Name>)>,
) -> RecordingStreamResult<()> {
    for surface in &active.surfaces {
        let Ok((positions, name)) = surfaces.get(surface.entity) else { continue };
        let name = name.map_or_else(|| surface.entity.to_string(), |name| name.as_str().replace('/', " "));
        let path = format!("surfaces/{name}");
        if !meshes.get(&surface.entity).is_some_and(|mesh| Arc::ptr_eq(mesh, &surface.topology)) {
            let triangles = surface.topology.triangles().iter().map(|&[a, b, c]| TriangleIndices::from((a, b, c)));
            stream.log_static(path.as_str(), &Mesh3D::update_fields().with_triangle_indices(triangles))?;
            meshes.insert(surface.entity, Arc::clone(&surface.topology));
        }
        let mut world = Vec::new();
        surface.pose.transform_points(&positions.0, &mut world);
        let positions = world.iter().map(Vec3::to_array);
        stream.log(path.as_str(), &Mesh3D::update_fields().with_vertex_positions(positions))?;
    }
    Ok(())
}

fn log_contacts(stream: &RecordingStream, contacts: &SurfaceContacts) -> RecordingStreamResult<()> {
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for contact in contacts.iter() {
        points.push(contact.points().1.to_array());
        // Long enough to be seen beside a surface whose thickness is that of the contact distance.
        normals.push((contact.normal() * (4.0 * contact.contact_distance())).to_array());
    }
    stream.log("contacts/points", &Points3D::new(points.iter().copied()))?;
    stream.log("contacts/normals", &Arrows3D::from_vectors(normals).with_origins(points))
}

fn log_stages(stream: &RecordingStream, diagnostics: &DetectionDiagnostics) -> RecordingStreamResult<()> {
    for stage in &diagnostics.stages {
        let name = stage.name;
        stream.log(format!("milliseconds/{name}"), &Scalars::single(stage.duration.as_secs_f64() * 1.0e3))?;
        stream.log(format!("pairs/{name}"), &Scalars::single(stage.pairs_out as f64))?;
    }
    Ok(())
}
