//! Why a mesh cannot be a surface, or cannot be written.

use bevy_ecs::prelude::*;
use bevy_mesh::{PrimitiveTopology, VertexFormat};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::kernel::mesh::validation::TopologyError;

/// Why a mesh cannot be used as a surface, or why a surface cannot be written to its mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceMeshError {
    /// The app has no `Assets<Mesh>`, or the entity is skinned and there is no `Assets<SkinnedMeshInverseBindposes>`.
    #[error("the app has no assets of type {0}: add AssetPlugin and MeshPlugin, which are part of DefaultPlugins")]
    NoAssets(&'static str),
    /// The data of the mesh was moved to the render world.
    #[error(
        "the data of its mesh is in the render world only: create or load the mesh with RenderAssetUsages::MAIN_WORLD \
         beside RENDER_WORLD"
    )]
    OnlyInRenderWorld,
    /// The mesh consists of points or lines.
    #[error("its mesh is a {0:?}: only a TriangleList or a TriangleStrip can be a surface")]
    Topology(PrimitiveTopology),
    /// The mesh has no positions.
    #[error("its mesh has no attribute Vertex_Position")]
    NoPositions,
    /// The positions are compressed, or have two components.
    #[error("the positions of its mesh have the format {0:?}: use Float32x3")]
    PositionFormat(VertexFormat),
    /// The positions and triangles of the mesh cannot be a surface.
    #[error("its mesh cannot be a surface: {0}")]
    Unusable(#[from] TopologyError),
    /// The entity has a `SkinnedMesh`, but its mesh has no joint indices and weights.
    #[error("it has a SkinnedMesh, but its mesh has no attributes Vertex_JointIndex and Vertex_JointWeight")]
    NoInfluences,
    /// Joint indices or weights have another format than Bevy's shaders read.
    #[error(
        "joint indices must be Uint16x4 and weights Float32x4, Unorm16x4, or Unorm8x4, one of each for every vertex"
    )]
    InfluenceFormat,
    /// A vertex is moved by a joint that does not exist.
    #[error("vertex {vertex} is moved by joint {joint}, but its SkinnedMesh has {joints} joints with bind poses")]
    JointOutOfRange {
        /// The vertex.
        vertex: usize,
        /// The index of the joint.
        joint: u16,
        /// The number of joints that have an inverse bind pose.
        joints: usize,
    },
    /// A joint, or one of its parents, was despawned or has no transform.
    #[error("its joint {0}, or a parent of it, does not exist, has no Transform, or is Disabled")]
    MissingJoint(Entity),
    /// The displacements of the morph targets are no multiple of the vertices.
    #[error("its mesh has {displacements} morph displacements, which is no multiple of its {vertices} vertices")]
    MorphTargets {
        /// The number of vertices.
        vertices: usize,
        /// The number of displacements.
        displacements: usize,
    },
    /// A surface cannot be written to its mesh, because another entity has the same mesh.
    #[error("its mesh is shared with {0}: give the entity a mesh of its own, a clone added to Assets<Mesh>")]
    Shared(Entity),
    /// A surface cannot be written to its mesh, because Bevy deforms the mesh when it draws it.
    #[error("its mesh is skinned or morphed when it is drawn: remove SkinnedMesh and MeshMorphWeights from the entity")]
    Deformed,
}

/// A surface with [`WriteSurfaceToMesh`](super::WriteSurfaceToMesh) was not written to its mesh. Sent once, until
/// writing has succeeded or fails for another reason. Contacts go on.
#[derive(Message, EntityEvent, Clone, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Message, Event, Clone, Debug, PartialEq))]
pub struct SurfaceMeshNotWritten {
    /// The surface.
    pub entity: Entity,
    /// The reason.
    pub reason: SurfaceMeshError,
}
