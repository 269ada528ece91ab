//! Gives surfaces meshes of their own, in the pose in which Bevy draws them now, for bodies that are drawn where the
//! response moves them.
//!
//! After surfaces were made from meshes, before they are gathered: the posed surface comes in, a mesh that is neither
//! skinned nor morphed goes out.

use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_ecs::{prelude::*, system::SystemParam};
use bevy_mesh::{Mesh, Mesh3d, MeshVertexAttribute, morph::MeshMorphWeights, skinning::SkinnedMesh};
use glam::Vec3;

use super::{
    SurfaceMeshError,
    components::{Made, MeshLink},
    source::{MeshSources, extracted},
};
use crate::{
    kernel::mesh::skinning::morph,
    surface::components::{DeformableSurface, SurfaceFrame, SurfacePositions},
};

/// The meshes of surfaces that [`SurfaceFromMesh`](super::SurfaceFromMesh) has made.
#[derive(SystemParam)]
pub(crate) struct OwnMeshes<'w, 's> {
    meshes: Option<ResMut<'w, Assets<Mesh>>>,
    sources: ResMut<'w, MeshSources>,
    links: Query<'w, 's, (&'static Mesh3d, &'static mut MeshLink)>,
}

impl OwnMeshes<'_, '_> {
    /// Adds what the parameter needs.
    pub(crate) fn init(app: &mut App) {
        app.init_resource::<MeshSources>();
    }

    /// The mesh that the surface of an entity was made from. `None` if it was not made from a mesh.
    pub(crate) fn get(&self, entity: Entity) -> Option<&Mesh> {
        let (mesh, link) = self.links.get(entity).ok()?;
        let made = link.made.as_ref().filter(|made| made.key.0 == mesh.id())?;
        self.meshes.as_ref()?.get(made.key.0)
    }

    /// The shape of a skinned mesh without its joints, in world units: joints of a moving character stretch the mesh.
    /// `None` if it is not skinned.
    pub(crate) fn unskinned(&self, entity: Entity) -> Option<Vec<Vec3>> {
        let made = self.links.get(entity).ok()?.1.made.as_ref()?;
        let joints = made.joints.as_ref()?;
        let source = self.sources.known(made.key)?;
        let mut rest = Vec::new();
        morph(&source.positions, &source.displacements, &made.weights, &mut rest);
        let scales: f32 = joints.iter().map(|joint| joint.matrix3.determinant().abs().cbrt()).sum();
        let scale = scales / joints.len().max(1) as f32;
        for position in &mut rest {
            *position *= scale;
        }
        Some(rest)
    }

    /// Gives the entity a copy of its mesh with these positions, in the frame of the entity, and without `paint`. It is
    /// no longer skinned or morphed, and its surface keeps its triangles.
    pub(crate) fn give(
        &mut self,
        commands: &mut Commands,
        entity: Entity,
        surface: &DeformableSurface,
        positions: Vec<Vec3>,
        paint: Option<MeshVertexAttribute>,
    ) -> Result<(), SurfaceMeshError> {
        let gone = || SurfaceMeshError::NoAssets("Mesh");
        let old = self.get(entity).ok_or_else(gone)?;
        let mut own = Mesh::new(old.primitive_topology(), old.asset_usage);
        let left_out = [Some(Mesh::ATTRIBUTE_JOINT_INDEX), Some(Mesh::ATTRIBUTE_JOINT_WEIGHT), paint];
        for (attribute, values) in old.try_attributes().map_err(extracted)? {
            if !left_out.iter().flatten().any(|left_out| left_out.id == attribute.id) {
                own.insert_attribute(*attribute, values.clone());
            }
        }
        let values: Vec<[f32; 3]> = positions.iter().map(Vec3::to_array).collect();
        own.insert_attribute(Mesh::ATTRIBUTE_POSITION, values);
        if let Some(indices) = old.try_indices_option().map_err(extracted)? {
            own.insert_indices(indices.clone());
        }
        let mesh = Mesh3d(self.meshes.as_mut().ok_or_else(gone)?.add(own));
        let (_, mut link) = self.links.get_mut(entity).map_err(|_| gone())?;
        let old = link.made.take().ok_or_else(gone)?;
        let key = (mesh.id(), old.key.1);
        let surface = surface.measured_on(&positions);
        let [triangles, version] = self.sources.insert(key, &surface, &positions);
        link.made = Some(Made { key, triangles, version, joints: None, weights: Vec::new() });
        let mut entity = commands.entity(entity);
        entity.try_insert((mesh, surface, SurfacePositions(positions), SurfaceFrame::Local));
        entity.try_remove::<(SkinnedMesh, MeshMorphWeights)>();
        Ok(())
    }
}
