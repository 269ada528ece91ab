//! Why a surface cannot be a body.

#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::kernel::{mesh::ids::VertexId, tetrahedra::topology::TetrahedraError};

/// Largest coordinate of a body, in world units, and largest component of its velocity, in world units per second.
/// Squares and triple products of such numbers are finite in f64. The solver works in f32: what overflows there is no
/// number at the end, and counts as out of range as well.
pub(super) const MOST_COORDINATE: f64 = 1.0e15;

/// Why a surface cannot be a body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Clone, Debug, PartialEq))]
pub enum XpbdBodyError {
    /// The body was made for other triangles, or for vertices that coincided differently, than its surface has now, and
    /// the surface has not taken part in a tick since.
    #[error("the body was made for a different mesh than its surface has now: make it again with XpbdBody::new")]
    Mesh,
    /// The number of values does not match the number of vertices of the mesh.
    #[error("there are {found} {what}, but the mesh has {expected} vertices")]
    Count {
        /// What was counted.
        what: &'static str,
        /// Number of vertices of the mesh.
        expected: usize,
        /// Number of values found.
        found: usize,
    },
    /// A coordinate of the rest shape is NaN or infinite.
    #[error("the position of vertex {} is not finite", .0.0)]
    NonFinitePosition(VertexId),
    /// A velocity is NaN or infinite.
    #[error("the velocity of vertex {} is not finite", .0.0)]
    NonFiniteVelocity(VertexId),
    /// A vertex would leave the range in which positions and velocities can be computed. The body was not moved and its
    /// velocities were set to zero. Look for a force, velocity, or stiffness that is far too large.
    #[error("vertex {} would move beyond {MOST_COORDINATE:e} or to NaN; the body was stopped where it was", .0.0)]
    OutOfRange(VertexId),
    /// An inverse mass is negative, NaN or infinite.
    #[error("the inverse mass of vertex {} is {}; it must be finite and 0 or more, where 0 pins the vertex", .0.0, .1)]
    InverseMass(VertexId, f32),
    /// The entity has a [`TetrahedralBody`](crate::TetrahedralBody) with other tetrahedra than the body, which may have
    /// none.
    #[error("the body has other tetrahedra than its entity's TetrahedralBody: make it with XpbdBody::tetrahedral")]
    Tetrahedra,
    /// Tetrahedra that were read cannot be used.
    #[error(transparent)]
    Unusable(#[from] TetrahedraError),
    /// A value of the material is out of range.
    #[error("{what} is {value}; it must be {range}")]
    Material {
        /// Name of the value.
        what: &'static str,
        /// The value.
        value: f32,
        /// Its valid range.
        range: &'static str,
    },
}
