//! Which joint moves a place on a skinned surface.

use bevy_ecs::{prelude::*, system::SystemParam};
use bevy_mesh::skinning::SkinnedMesh;

use super::{components::MeshLink, source::MeshSources};
use crate::{
    kernel::mesh::{ids::TriangleId, skinning::dominant_joint},
    surface::components::DeformableSurface,
};

/// Tells which joint of a skinned mesh moves a place on its surface, such as where a bullet hit or what touches.
///
/// For surfaces that [`SurfaceFromMesh`](crate::SurfaceFromMesh) has made of a
/// [`SkinnedMesh`](bevy_mesh::skinning::SkinnedMesh).
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_ecs::prelude::*;
/// # use bevy_math::Vec3;
/// fn shoot(surfaces: SurfaceQuery, joints: SurfaceJoints, names: Query<&Name>) {
///     let hit = surfaces.cast_ray(Vec3::ZERO, Vec3::X, 100.0, &SurfaceQueryFilter::default());
///     if let Some(hit) = hit
///         && let Some(bone) = joints.dominant(hit.entity, hit.triangle, hit.barycentric)
///     {
///         println!("hit in the {:?}", names.get(bone));
///     }
/// }
/// # bevy_ecs::system::IntoSystem::into_system(shoot);
/// ```
#[derive(SystemParam)]
pub struct SurfaceJoints<'w, 's> {
    sources: Res<'w, MeshSources>,
    skins: Query<'w, 's, (&'static MeshLink, &'static SkinnedMesh, &'static DeformableSurface)>,
}

impl SurfaceJoints<'_, '_> {
    /// The joint with the largest weight at the place on `triangle` with these weights of its corners: the weights of the
    /// mesh's vertices, interpolated. Of several joints, the one that comes first in the skin.
    ///
    /// `None` if `triangle` is `None`, as where a solid was hit, or does not exist, if the surface was not made from a
    /// skinned mesh, or if no joint moves the place.
    #[must_use]
    pub fn dominant(
        &self,
        surface: Entity,
        triangle: impl Into<Option<TriangleId>>,
        barycentric: [f32; 3],
    ) -> Option<Entity> {
        let (link, skin, surface) = self.skins.get(surface).ok()?;
        let influences = self.sources.influences(link.made.as_ref()?.key)?;
        // Triangles name the vertices of the mesh, also where these are welded.
        let corners = surface.topology.triangles().get(triangle.into()?.index())?;
        let joint = dominant_joint(corners.map(|corner| &influences[corner as usize]), barycentric)?;
        skin.joints.get(usize::from(joint)).copied()
    }
}
