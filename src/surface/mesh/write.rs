//! Writes surfaces that the response or the game has moved to their meshes.
//!
//! Last in the flow: positions come in, positions and normals in the mesh asset go out.

use std::collections::HashMap;

use bevy_asset::{AssetId, Assets};
use bevy_ecs::{prelude::*, query::QueryData};
use bevy_mesh::{Mesh, Mesh3d, VertexAttributeValues, morph::MeshMorphWeights, skinning::SkinnedMesh};
use bytemuck::cast_slice;
use glam::Vec3;

use super::{SurfaceMeshError, SurfaceMeshNotWritten, WriteSurfaceToMesh, components::MeshLink, source::MeshSources};
use crate::{
    kernel::mesh::{smooth_normal::CreaseAngle, topology::SurfaceTopology, vertex_normals::vertex_normals},
    surface::components::{DeformableSurface, SurfacePositions, SurfaceStatus},
};

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct WrittenItem {
    entity: Entity,
    options: Ref<'static, WriteSurfaceToMesh>,
    mesh: &'static Mesh3d,
    surface: &'static DeformableSurface,
    positions: Ref<'static, SurfacePositions>,
    status: &'static SurfaceStatus,
    link: &'static mut MeshLink,
    skinned: Has<SkinnedMesh>,
    morphed: Has<MeshMorphWeights>,
}

/// Writes surfaces to their meshes.
pub(super) fn write_meshes(
    mut commands: Commands,
    meshes: Option<ResMut<Assets<Mesh>>>,
    mut sources: ResMut<MeshSources>,
    mut surfaces: Query<WrittenItem>,
    drawn: Query<(Entity, &Mesh3d)>,
    mut messages: MessageWriter<SurfaceMeshNotWritten>,
    mut normals: Local<Vec<Vec3>>,
) {
    let Some(mut meshes) = meshes else { return };
    let mut due: HashMap<AssetId<Mesh>, Entity> = HashMap::new();
    for mut item in &mut surfaces {
        if item.is_due(&mut sources) {
            due.insert(item.mesh.id(), item.entity);
        }
    }
    if due.is_empty() {
        return;
    }
    let shared = drawn.iter().filter(|(entity, mesh)| due.get(&mesh.id()).is_some_and(|owner| owner != entity));
    let sharers: HashMap<AssetId<Mesh>, Entity> = shared.map(|(entity, mesh)| (mesh.id(), entity)).collect();
    for mut item in &mut surfaces {
        let Some(&owner) = due.get(&item.mesh.id()) else { continue };
        if !item.is_due(&mut sources) {
            continue;
        }
        let other = sharers.get(&item.mesh.id()).map(|&sharer| if sharer == item.entity { owner } else { sharer });
        let written = match other {
            Some(other) => Err(SurfaceMeshError::Shared(other)),
            None if item.skinned || item.morphed => Err(SurfaceMeshError::Deformed),
            None => item.write(&mut meshes, &mut normals),
        };
        match written {
            Ok(()) => {
                if let Some(known) = item.link.made.as_ref().and_then(|made| sources.positions_mut(made.key)) {
                    known.copy_from_slice(&item.positions.0);
                }
                item.link.written = Some(item.positions.last_changed());
                item.link.not_written = None;
            }
            Err(reason) => {
                if item.link.not_written.as_ref() != Some(&reason) {
                    let entity = item.entity;
                    log::error!("surface {entity} is not written to its mesh: {reason}");
                    let message = SurfaceMeshNotWritten { entity, reason: reason.clone() };
                    commands.trigger(message.clone());
                    messages.write(message);
                    item.link.not_written = Some(reason);
                }
            }
        }
    }
}

impl WrittenItemItem<'_, '_> {
    /// Whether the surface is elsewhere than its mesh.
    fn is_due(&mut self, sources: &mut MeshSources) -> bool {
        let changed = self.positions.last_changed();
        let is_old = self.link.written == Some(changed) && !self.options.is_changed();
        if is_old || *self.status != SurfaceStatus::Active {
            return false;
        }
        let Some(known) = self.link.made.as_ref().and_then(|made| sources.positions_mut(made.key)) else {
            return false;
        };
        let is_same = cast_slice::<Vec3, u8>(known) == cast_slice::<Vec3, u8>(&self.positions.0);
        if is_same && !(self.options.is_changed() && self.link.written.is_some()) {
            self.link.written = Some(changed);
            return false;
        }
        known.len() == self.positions.0.len()
    }

    fn write(&self, meshes: &mut Assets<Mesh>, normals: &mut Vec<Vec3>) -> Result<(), SurfaceMeshError> {
        let only_in_render_world = |_| SurfaceMeshError::OnlyInRenderWorld;
        let mut mesh = meshes.get_mut(self.mesh.id()).ok_or(SurfaceMeshError::NoPositions)?;
        // Checked before the mesh is marked as changed.
        let has_normals = mesh.try_contains_attribute(Mesh::ATTRIBUTE_NORMAL).map_err(only_in_render_world)?;
        let mut attribute = |name, values: &[Vec3]| match mesh.try_attribute_mut_option(name) {
            Ok(Some(VertexAttributeValues::Float32x3(old))) => {
                old.clear();
                old.extend_from_slice(cast_slice(values));
            }
            // Compressed normals stay as they are.
            Ok(_) | Err(_) => {}
        };
        attribute(Mesh::ATTRIBUTE_POSITION, &self.positions.0);
        if has_normals {
            let topology: &SurfaceTopology = self.surface.topology();
            let crease = CreaseAngle::new(self.options.crease_angle);
            vertex_normals(topology, &self.positions.0, crease, normals);
            attribute(Mesh::ATTRIBUTE_NORMAL, normals);
        }
        Ok(())
    }
}
