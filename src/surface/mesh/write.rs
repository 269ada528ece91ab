//! Writes surfaces that the response or the game has moved to their meshes.
//!
//! Last in the flow: positions come in, positions and normals in the mesh asset go out.

use std::collections::HashMap;

use bevy_asset::{AssetId, Assets};
use bevy_ecs::{prelude::*, query::QueryData, system::SystemParam};
use bevy_mesh::{Mesh, Mesh3d, VertexAttributeValues, morph::MeshMorphWeights, skinning::SkinnedMesh};
use bytemuck::cast_slice;
use glam::Vec3;

use super::{SurfaceMeshError, SurfaceMeshNotWritten, WriteSurfaceToMesh, components::MeshLink, source::MeshSources};
use crate::{
    kernel::mesh::{smooth_normal::CreaseAngle, topology::SurfaceTopology, vertex_normals::vertex_normals},
    surface::components::{DeformableSurface, SurfacePositions, SurfaceStatus},
};

/// The meshes that are to be written, and the entities that write them.
pub(super) type Due = HashMap<AssetId<Mesh>, Entity>;

/// Writes meshes, and reports those that cannot be written.
#[derive(SystemParam)]
pub(super) struct MeshWriter<'w, 's> {
    meshes: Option<ResMut<'w, Assets<Mesh>>>,
    drawn: Query<'w, 's, (Entity, &'static Mesh3d, Has<SkinnedMesh>, Has<MeshMorphWeights>)>,
    commands: Commands<'w, 's>,
    messages: MessageWriter<'w, SurfaceMeshNotWritten>,
}

impl MeshWriter<'_, '_> {
    /// A mesh, if it is loaded.
    pub(super) fn get(&self, id: AssetId<Mesh>) -> Option<&Mesh> {
        self.meshes.as_ref()?.get(id)
    }

    /// For each mesh that is due, an entity that has it beside the one that writes it.
    pub(super) fn sharers(&self, due: &Due) -> Due {
        let shared = self.drawn.iter().filter(|(entity, mesh, ..)| due.get(&mesh.id()).is_some_and(|by| by != entity));
        shared.map(|(entity, mesh, ..)| (mesh.id(), entity)).collect()
    }

    /// Why the entity may not write its mesh, or nothing.
    pub(super) fn refusal(&self, entity: Entity, due: &Due, sharers: &Due) -> Option<SurfaceMeshError> {
        let (_, mesh, is_skinned, is_morphed) = self.drawn.get(entity).ok()?;
        let sharer = sharers.get(&mesh.id()).map(|&sharer| if sharer == entity { due[&mesh.id()] } else { sharer });
        let deformed = || (is_skinned || is_morphed).then_some(SurfaceMeshError::Deformed);
        sharer.map(SurfaceMeshError::Shared).or_else(deformed)
    }

    /// Writes positions to a mesh. If it has normals, writes these too.
    pub(super) fn write(
        &mut self,
        id: AssetId<Mesh>,
        positions: &[Vec3],
        topology: &SurfaceTopology,
        crease_angle: f32,
        normals: &mut Vec<Vec3>,
    ) -> Result<(), SurfaceMeshError> {
        let only_in_render_world = |_| SurfaceMeshError::OnlyInRenderWorld;
        let mesh = self.meshes.as_mut().and_then(|meshes| meshes.get_mut(id));
        let mut mesh = mesh.ok_or(SurfaceMeshError::NoAssets("Mesh"))?;
        // Checked before the mesh is marked as changed.
        let has_normals = mesh.try_contains_attribute(Mesh::ATTRIBUTE_NORMAL).map_err(only_in_render_world)?;
        let mut attribute = |name, values: &[Vec3]| {
            // Normals that are compressed stay as they are.
            if let Ok(Some(VertexAttributeValues::Float32x3(old))) = mesh.try_attribute_mut_option(name) {
                old.clear();
                old.extend_from_slice(cast_slice(values));
            }
        };
        attribute(Mesh::ATTRIBUTE_POSITION, positions);
        if has_normals {
            vertex_normals(topology, positions, CreaseAngle::new(crease_angle), normals);
            attribute(Mesh::ATTRIBUTE_NORMAL, normals);
        }
        Ok(())
    }

    /// Reports that a mesh was not written, unless the last report was the same.
    pub(super) fn report(&mut self, entity: Entity, reason: SurfaceMeshError, last: &mut Option<SurfaceMeshError>) {
        if last.as_ref() == Some(&reason) {
            return;
        }
        log::error!("the mesh of {entity} is not written: {reason}");
        let message = SurfaceMeshNotWritten { entity, reason: reason.clone() };
        self.commands.trigger(message.clone());
        self.messages.write(message);
        *last = Some(reason);
    }
}

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
}

/// Writes surfaces to their meshes.
pub(super) fn write_meshes(
    mut sources: ResMut<MeshSources>,
    mut surfaces: Query<WrittenItem>,
    mut writer: MeshWriter,
    mut normals: Local<Vec<Vec3>>,
) {
    let mut due = Due::new();
    for mut item in &mut surfaces {
        if item.is_due(&mut sources) {
            due.insert(item.mesh.id(), item.entity);
        }
    }
    if due.is_empty() {
        return;
    }
    let sharers = writer.sharers(&due);
    for mut item in &mut surfaces {
        let id = item.mesh.id();
        if !due.contains_key(&id) || !item.is_due(&mut sources) {
            continue;
        }
        let positions = &item.positions.0;
        let written = match writer.refusal(item.entity, &due, &sharers) {
            Some(reason) => Err(reason),
            None => writer.write(id, positions, item.surface.topology(), item.options.crease_angle, &mut normals),
        };
        match written {
            Ok(()) => {
                if let Some(known) = item.link.made.as_ref().and_then(|made| sources.positions_mut(made.key)) {
                    known.copy_from_slice(positions);
                }
                item.link.written = Some(item.positions.last_changed());
                item.link.not_written = None;
            }
            Err(reason) => writer.report(item.entity, reason, &mut item.link.not_written),
        }
    }
}

impl WrittenItemItem<'_, '_> {
    /// Whether the surface is elsewhere than its mesh.
    fn is_due(&mut self, sources: &mut MeshSources) -> bool {
        let changed = self.positions.last_changed();
        if self.link.written == Some(changed) || *self.status != SurfaceStatus::Active {
            return false;
        }
        let Some(known) = self.link.made.as_ref().and_then(|made| sources.positions_mut(made.key)) else {
            return false;
        };
        if cast_slice::<Vec3, u8>(known) == cast_slice::<Vec3, u8>(&self.positions.0) {
            self.link.written = Some(changed);
            return false;
        }
        known.len() == self.positions.0.len()
    }
}
