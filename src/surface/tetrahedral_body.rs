//! Bodies made of tetrahedra. Their surface is a [`DeformableSurface`] like any other.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use super::components::{DeformableSurface, SurfacePositions};
use crate::kernel::tetrahedra::topology::{TetrahedraError, TetrahedralTopology};

/// Fills a surface with tetrahedra, so that
/// [`TetrahedralContainmentPlugin`](crate::TetrahedralContainmentPlugin) finds what is inside.
///
/// Create one with [`from_mesh`](Self::from_mesh). The positions are those of the surface, [`SurfacePositions`], and
/// vertices inside the body are among them.
#[derive(Component, Clone, Debug)]
#[component(immutable)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug))]
pub struct TetrahedralBody {
    topology: Arc<TetrahedralTopology>,
}

impl TetrahedralBody {
    /// Creates a body and its surface from vertex positions and tetrahedra. Spawn the returned bundle.
    ///
    /// Tetrahedra are vertex numbers, wound in any way. The surface consists of the faces that have one tetrahedron,
    /// wound outward. Its vertices have the same numbers. Degenerate and inverted tetrahedra are accepted: see
    /// [`TetrahedralTopology::report`].
    ///
    /// ```
    /// # use bevy_circumsphere::prelude::*;
    /// # use glam::Vec3;
    /// # let mut world = bevy_ecs::world::World::new();
    /// let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    /// let (body, surface, positions) = TetrahedralBody::from_mesh(&positions, &[[0, 1, 2, 3]])?;
    /// assert!(surface.topology().is_closed());
    /// assert!(body.topology().report().inverted.is_empty());
    /// world.spawn((body, surface, positions, SelfCollision));
    /// # Ok::<(), TetrahedraError>(())
    /// ```
    ///
    /// # Errors
    /// If there is no tetrahedron or no surface, a vertex number is out of range, a position is not finite, or there
    /// are too many elements. See [`TetrahedraError`].
    pub fn from_mesh(
        positions: &[Vec3],
        tetrahedra: &[[u32; 4]],
    ) -> Result<(Self, DeformableSurface, SurfacePositions), TetrahedraError> {
        let topology = TetrahedralTopology::new(positions, tetrahedra)?;
        let (surface, positions) = DeformableSurface::from_mesh(positions, topology.surface())?;
        Ok((Self { topology: Arc::new(topology) }, surface, positions))
    }

    /// Another body with the same tetrahedra, which are shared, not copied. Give it an
    /// [instance](DeformableSurface::instance) of the surface too, and its own [`SurfacePositions`].
    #[must_use]
    pub fn instance(&self) -> Self {
        self.clone()
    }

    /// The tetrahedra and their surface.
    #[must_use]
    pub fn topology(&self) -> &Arc<TetrahedralTopology> {
        &self.topology
    }
}
