//! A coarse surface that collides drives a finer mesh that is drawn.
//!
//! Last in the flow: the positions of the surface come in, positions and normals in the mesh asset go out.

use std::sync::Arc;

use bevy_asset::AssetId;
use bevy_ecs::{change_detection::Tick, prelude::*, query::QueryData};
use bevy_mesh::{Mesh, Mesh3d};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::{DAffine3, Vec3};

use super::{
    SurfaceMeshError,
    source::{positions_of, triangles_of},
    write::{Due, MeshWriter},
};
use crate::{
    kernel::mesh::{driven::DrivenMap, topology::SurfaceTopology},
    settings::CircumsphereSettings,
    surface::{
        components::{DeformableSurface, SurfaceFrame, SurfacePositions, SurfaceStatus},
        prepare::Transforms,
    },
};

/// Makes the mesh of this entity follow a surface, usually a coarser one that collides in its place. The surface may
/// be a body of the response, or be moved by the game in any other way.
///
/// When both are there for the first time, each vertex of the mesh remembers its place on the nearest triangle of the
/// surface, and its height over it along the smooth normal. At that time the mesh must fit the surface, as both are
/// placed in the world. From then on it is written whenever the surface or either pose has changed, between
/// [`DeformableSystems::Writeback`](crate::DeformableSystems::Writeback) and
/// [`DeformableSystems::Events`](crate::DeformableSystems::Events), with new normals if it has any. The map is made
/// anew if the entity gets another mesh or the surface other triangles.
///
/// The mesh must belong to the entity alone, and must not be skinned or morphed when it is drawn. If it cannot be
/// written, [`SurfaceMeshNotWritten`](super::SurfaceMeshNotWritten) is sent with the reason.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[require(Driven)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, PartialEq))]
pub struct DrivenMesh {
    /// The surface.
    pub surface: Entity,
    /// As in [`WriteSurfaceToMesh`](field@super::WriteSurfaceToMesh::crease_angle). Default: 1.
    pub crease_angle: f32,
}

impl DrivenMesh {
    /// Follows a surface.
    #[must_use]
    pub fn by(surface: Entity) -> Self {
        Self { surface, crease_angle: CircumsphereSettings::default().crease_angle }
    }
}

/// What a driven mesh was last written from.
#[derive(Component, Clone, Debug, Default)]
pub(super) struct Driven {
    map: Option<Bound>,
    not_written: Option<SurfaceMeshError>,
}

#[derive(Clone, Debug)]
struct Bound {
    mesh: AssetId<Mesh>,
    surface: Entity,
    coarse: Arc<SurfaceTopology>,
    fine: SurfaceTopology,
    map: DrivenMap,
    /// The change tick of the surface's positions, and the way from its frame to that of the mesh.
    written: Option<(Tick, DAffine3)>,
}

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct DrivenItem {
    entity: Entity,
    options: &'static DrivenMesh,
    mesh: &'static Mesh3d,
    driven: &'static mut Driven,
}

/// Writes meshes that follow a surface.
pub(super) fn drive_meshes(
    mut meshes: Query<DrivenItem>,
    surfaces: Query<(&DeformableSurface, Ref<SurfacePositions>, &SurfaceFrame, &SurfaceStatus)>,
    transforms: Transforms,
    mut writer: MeshWriter,
    mut buffers: Local<[Vec<Vec3>; 2]>,
) {
    let mut ways: Vec<(Entity, DAffine3)> = Vec::new();
    let mut due = Due::new();
    for item in &meshes {
        let Ok((surface, positions, frame, SurfaceStatus::Active)) = surfaces.get(item.options.surface) else {
            continue;
        };
        let own = transforms.global_affine(item.entity);
        let theirs = transforms.affine(item.options.surface, *frame);
        let (Ok(own), Ok(theirs)) = (own, theirs) else { continue };
        let way = own.inverse() * theirs;
        let now = Some((positions.last_changed(), way));
        if way.is_finite()
            && !item.driven.map.as_ref().is_some_and(|map| map.fits(&item, surface) && map.written == now)
        {
            due.insert(item.mesh.id(), item.entity);
            ways.push((item.entity, way));
        }
    }
    if due.is_empty() {
        return;
    }
    let sharers = writer.sharers(&due);
    for (entity, way) in ways {
        let Ok(mut item) = meshes.get_mut(entity) else { continue };
        let Ok((surface, positions, ..)) = surfaces.get(item.options.surface) else { continue };
        let written = match writer.refusal(entity, &due, &sharers) {
            Some(reason) => Err(reason),
            None => item.write(surface, &positions, way, &mut writer, &mut buffers),
        };
        match written {
            Ok(()) => item.driven.not_written = None,
            Err(reason) => writer.report(entity, reason, &mut item.driven.not_written),
        }
    }
}

impl Bound {
    /// Whether it was made for this mesh and surface.
    fn fits(&self, item: &DrivenItemReadOnlyItem<'_, '_>, surface: &DeformableSurface) -> bool {
        self.mesh == item.mesh.id()
            && self.surface == item.options.surface
            && Arc::ptr_eq(&self.coarse, surface.topology())
    }
}

impl DrivenItemItem<'_, '_> {
    fn write(
        &mut self,
        surface: &DeformableSurface,
        positions: &Ref<SurfacePositions>,
        way: DAffine3,
        writer: &mut MeshWriter,
        [points, normals]: &mut [Vec<Vec3>; 2],
    ) -> Result<(), SurfaceMeshError> {
        let coarse = surface.topology();
        let id = self.mesh.id();
        let is_same =
            |map: &Bound| map.mesh == id && map.surface == self.options.surface && Arc::ptr_eq(&map.coarse, coarse);
        if !self.driven.map.as_ref().is_some_and(is_same) {
            // Not loaded yet.
            let Some(mesh) = writer.get(id) else { return Ok(()) };
            let rest = positions_of(mesh)?;
            let fine = SurfaceTopology::new(rest, &triangles_of(mesh)?)?;
            points.clear();
            let back = way.inverse();
            points.extend(rest.iter().map(|point| back.transform_point3(point.as_dvec3()).as_vec3()));
            let map = DrivenMap::new(coarse, &positions.0, points);
            let coarse = Arc::clone(coarse);
            self.driven.map = Some(Bound { mesh: id, surface: self.options.surface, coarse, fine, map, written: None });
        }
        let Some(bound) = &mut self.driven.map else { return Ok(()) };
        bound.map.follow(coarse, &positions.0, points);
        for point in points.iter_mut() {
            *point = way.transform_point3(point.as_dvec3()).as_vec3();
        }
        writer.write(id, points, &bound.fine, self.options.crease_angle, normals)?;
        bound.written = Some((positions.last_changed(), way));
        Ok(())
    }
}
