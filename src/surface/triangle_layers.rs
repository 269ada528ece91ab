//! Layers of single triangles.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::components::SurfaceLayers;

/// Layers for each triangle of a surface, or of a [rigid shape](super::RigidShape) made of triangles. Two triangles of
/// surfaces that meet by their own [`SurfaceLayers`] touch only if their layers meet too, also two triangles of one
/// surface with [`SelfCollision`](super::SelfCollision). Triangles of a surface without this component, and solids, count
/// with the layers of the whole. For a collar that is pinned to a neck while the rest of the shirt lies on the body.
///
/// Per triangle, not per vertex, because pairs of triangles touch: a vertex between two groups would belong to both.
///
/// Pairs that do not meet make no contact and no impact, with every [`ContactMethod`](super::ContactMethod), and the
/// response lets them pass. Queries see the surface as a whole. Default: without the component, all triangles meet. A
/// surface whose number of triangles differs is [quarantined](super::QuarantineReason::TriangleLayers).
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # use glam::Vec3;
/// # let mut world = bevy_ecs::world::World::new();
/// # let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
/// const BODY: u32 = 1;
/// const CLOTHES: u32 = 2;
/// let clothes = SurfaceLayers { memberships: CLOTHES, filters: u32::MAX };
/// let collar = SurfaceLayers { filters: !BODY, ..clothes };
/// let (shirt, positions) = DeformableSurface::from_mesh(&corners, &[[0, 1, 2], [1, 3, 2]])?;
/// // The first triangle is the collar.
/// let layers = TriangleLayers::new([collar, clothes]);
/// world.spawn((shirt, positions, clothes, layers));
/// # Ok::<(), TopologyError>(())
/// ```
#[derive(Component, Clone, Debug, PartialEq, Eq)]
#[component(immutable)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(from = "Vec<SurfaceLayers>", into = "Vec<SurfaceLayers>"))]
pub struct TriangleLayers(Arc<[SurfaceLayers]>);

impl TriangleLayers {
    /// The layers of each triangle, in the order of the mesh that the surface was made from.
    #[must_use]
    pub fn new(layers: impl IntoIterator<Item = SurfaceLayers>) -> Self {
        Self(layers.into_iter().collect())
    }

    /// The layers of each triangle.
    #[must_use]
    pub fn layers(&self) -> &[SurfaceLayers] {
        &self.0
    }

    /// The layers, shared.
    pub(super) fn shared(&self) -> Arc<[SurfaceLayers]> {
        Arc::clone(&self.0)
    }
}

impl From<Vec<SurfaceLayers>> for TriangleLayers {
    fn from(layers: Vec<SurfaceLayers>) -> Self {
        Self(layers.into())
    }
}

impl From<TriangleLayers> for Vec<SurfaceLayers> {
    fn from(layers: TriangleLayers) -> Self {
        layers.0.to_vec()
    }
}
