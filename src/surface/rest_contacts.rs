//! Contacts of a surface with itself that are there at rest, and are none.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use super::{checked::first_non_finite, components::DeformableSurface};
use crate::kernel::{
    exact::rest_pairs::RestPairs,
    mesh::{
        ids::{TriangleId, VertexId},
        topology::SurfaceTopology,
    },
};

/// Leaves out the contacts of a surface with [itself](super::SelfCollision) that it has in its rest shape: pairs of its
/// triangles that cross or are near each other there make no contact and no impact, in whatever shape the surface is, with
/// every [`ContactMethod`](super::ContactMethod), and the response does not part them. For layers that are sewn together,
/// hems, pockets, and thick cloth whose triangles are smaller than the contact distance.
///
/// The pairs are found once, by [`new`](Self::new). Default: without the component, none is left out, except for
/// neighbors. If the entity gets another mesh, insert it anew: a surface with a component of another mesh is
/// [quarantined](super::QuarantineReason::RestContacts).
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # use glam::Vec3;
/// # let mut world = bevy_ecs::world::World::new();
/// # let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// // A hem: two layers that are 0.01 apart.
/// let positions: Vec<Vec3> = (0..6).map(|vertex| corners[vertex % 3] + Vec3::Z * 0.01 * (vertex / 3) as f32).collect();
/// let (surface, positions) = DeformableSurface::from_mesh(&positions, &[[0, 1, 2], [3, 4, 5]])?;
/// let thickness = 0.02;
/// let sewn = RestContactsIgnored::new(&surface, &positions.0, 2.0 * thickness)?;
/// assert_eq!(sewn.pairs().collect::<Vec<_>>(), [[TriangleId(0), TriangleId(1)]]);
/// world.spawn((surface, positions, SurfaceThickness::World(thickness), SelfCollision, sewn));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Component, Clone, Debug)]
#[component(immutable)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug))]
pub struct RestContactsIgnored {
    topology: Arc<SurfaceTopology>,
    pairs: Arc<RestPairs>,
}

/// Why the contacts of a rest shape cannot be found.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum RestContactsError {
    /// The number of positions differs from the number of vertices of the mesh.
    #[error("there are {found} positions, but the mesh has {expected} vertices")]
    PositionCount {
        /// The number of vertices of the mesh.
        expected: usize,
        /// The number of positions.
        found: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("the position of vertex {} is not finite", .0.0)]
    NonFinitePosition(VertexId),
    /// The distance is negative, NaN, or infinite.
    #[error("the distance is {0}: give a finite one of 0 or more, usually twice the thickness")]
    Distance(f32),
}

impl RestContactsIgnored {
    /// Finds the pairs of triangles that cross or are no farther apart than `distance` where the vertices of `surface` are
    /// at the `rest` positions. `distance` is in the unit of these positions, and usually the contact distance of the
    /// surface with itself: twice its thickness. 0 leaves out only what crosses or touches at rest.
    ///
    /// # Errors
    /// If there is not one finite position for each vertex, or if the distance is negative or not finite.
    pub fn new(surface: &DeformableSurface, rest: &[Vec3], distance: f32) -> Result<Self, RestContactsError> {
        let topology = surface.topology();
        let (expected, found) = (topology.vertex_count(), rest.len());
        if expected != found {
            return Err(RestContactsError::PositionCount { expected, found });
        }
        if let Some(vertex) = first_non_finite(rest) {
            return Err(RestContactsError::NonFinitePosition(vertex));
        }
        if !(distance.is_finite() && distance >= 0.0) {
            return Err(RestContactsError::Distance(distance));
        }
        let pairs = RestPairs::within(topology, rest, distance);
        Ok(Self { topology: Arc::clone(topology), pairs: Arc::new(pairs) })
    }

    /// The pairs that are left out, sorted, the lower triangle of each first.
    pub fn pairs(&self) -> impl Iterator<Item = [TriangleId; 2]> + '_ {
        self.pairs.iter().map(|pair| pair.map(TriangleId))
    }

    /// Whether it was made for a mesh.
    pub(super) fn is_of(&self, mesh: &Arc<SurfaceTopology>) -> bool {
        let own = &self.topology;
        Arc::ptr_eq(own, mesh) || own.triangles() == mesh.triangles() && own.weld() == mesh.weld()
    }

    /// The pairs, shared.
    pub(super) fn shared(&self) -> Arc<RestPairs> {
        Arc::clone(&self.pairs)
    }
}
