//! Why a surface or shape cannot be used.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::kernel::{exact::rigid_shape::ShapeError, mesh::ids::VertexId, pose::PoseError};

/// Why a surface or shape was quarantined.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Clone, Debug, PartialEq))]
pub enum QuarantineReason {
    /// A coordinate is NaN or infinite.
    #[error("the position of vertex {} is not finite", .0.0)]
    NonFinitePosition(VertexId),
    /// The number of positions differs from the number of vertices of the mesh.
    #[error("there are {found} positions, but the mesh has {expected} vertices")]
    PositionCount {
        /// The number of vertices of the mesh.
        expected: usize,
        /// The number of positions.
        found: usize,
    },
    /// The thickness is negative or not finite.
    #[error("the thickness {0} is negative or not finite")]
    Thickness(f32),
    /// The number of its [thicknesses](super::VertexThickness) differs from the number of vertices of the mesh.
    #[error("there is a thickness for {found} vertices, but the mesh has {expected}")]
    VertexThicknessCount {
        /// The number of vertices of the mesh.
        expected: usize,
        /// The number of thicknesses.
        found: usize,
    },
    /// A [thickness](super::VertexThickness) is negative or not finite.
    #[error("the thickness {thickness} of vertex {} is negative or not finite", .vertex.0)]
    VertexThickness {
        /// The first such vertex.
        vertex: VertexId,
        /// Its thickness.
        thickness: f32,
    },
    /// Its [`RestContactsIgnored`](super::RestContactsIgnored) was made for another mesh.
    #[error("RestContactsIgnored was made for another mesh than the surface has now: make it again for this one")]
    RestContacts,
    /// The number of its [`TriangleLayers`](super::TriangleLayers) differs from the number of triangles of the mesh.
    #[error("there are layers for {found} triangles, but the mesh has {expected}")]
    TriangleLayers {
        /// The number of triangles of the mesh.
        expected: usize,
        /// The number of triangles that have layers.
        found: usize,
    },
    /// The transform cannot be used.
    #[error(transparent)]
    Pose(#[from] PoseError),
    /// The entity or one of its parents has no transform, or a parent has Bevy's `Disabled`.
    #[error("the transform or that of a parent is missing, or a parent is Disabled")]
    MissingTransform,
    /// The surface or shape extends farther in the world than contacts in f32 can represent.
    #[error("it reaches beyond 8e37 world units: move it closer to the origin, or give it a smaller scale or size")]
    OutOfRange,
    /// The transforms of the entity and its parents scale by so little that nearby points, seen from its frame, exceed
    /// f32.
    #[error(
        "the transform and those of its parents scale by less than 1e-30: use a larger scale and smaller positions"
    )]
    TinyScale,
    /// The shape cannot be used.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// The [mesh](super::mesh::SurfaceFromMesh) cannot be used.
    #[cfg(feature = "mesh")]
    #[error(transparent)]
    Mesh(#[from] super::mesh::SurfaceMeshError),
}

/// A surface or shape cannot be used and was quarantined. Sent once. When it can be used again, its
/// [`SurfaceStatus`](crate::SurfaceStatus) becomes active without a message.
#[derive(Message, EntityEvent, Clone, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Message, Event, Clone, Debug, PartialEq))]
pub struct SurfaceQuarantined {
    /// The surface or shape.
    pub entity: Entity,
    /// The reason.
    pub reason: QuarantineReason,
}
