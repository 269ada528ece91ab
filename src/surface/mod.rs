//! The components that a game spawns, and the snapshot of the tick that is made of them.
//!
//! `Prepare` reads and validates components once a tick. The stages work on the snapshot. A surface that cannot be used
//! is quarantined with a reason, and the others go on.

mod active;
mod checked;
mod components;
mod contact_filter;
#[cfg(feature = "mesh")]
mod mesh;
mod named;
mod pair_filter;
mod prepare;
mod quarantine;
mod query_only;
mod rest_contacts;
mod rigid_shape;
#[cfg(feature = "serde")]
mod serialized;
mod spheres;
mod swept;
mod tetrahedral_body;
mod triangle_layers;
mod vertex_thickness;

pub(crate) use active::SideOrder;
pub use active::{ActiveShape, ActiveSurface, ActiveSurfaces, ContactSide};
pub(crate) use checked::{CheckedPositions, first_non_finite};
pub use components::{
    ContactEventHold, ContactEventsEnabled, ContactMethod, DeformableSurface, SelfCollision, Sidedness, SurfaceBuilder,
    SurfaceDisabled, SurfaceFrame, SurfaceLayers, SurfaceOrder, SurfacePositions, SurfaceShape, SurfaceStatus,
    SurfaceThickness, Teleported,
};
pub use contact_filter::{CandidatePair, ContactFilter};
#[cfg(feature = "mesh")]
pub use mesh::{
    DrivenMesh, SurfaceFromMesh, SurfaceFromMeshHierarchy, SurfaceJoints, SurfaceMeshError, SurfaceMeshNotWritten,
    SurfaceMeshPlugin, SurfaceSettings, WriteSurfaceToMesh,
};
#[cfg(feature = "mesh")]
pub(crate) use mesh::{MeshSystems, OwnMeshes};
pub(crate) use named::Named;
pub(crate) use pair_filter::{FilterSide, PairFilter};
pub use prepare::SurfacePlugin;
pub(crate) use prepare::{GatherSurfaces, PendingQuarantines, Transforms};
pub use quarantine::{QuarantineReason, SurfaceQuarantined};
pub use query_only::QueryOnly;
pub use rest_contacts::{RestContactsError, RestContactsIgnored};
pub use rigid_shape::RigidShape;
pub(crate) use spheres::SphereSource;
pub use spheres::{Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature};
pub use swept::{PreviousPositions, SweptCollision, SweptTarget};
pub use tetrahedral_body::TetrahedralBody;
pub use triangle_layers::TriangleLayers;
pub(crate) use vertex_thickness::ThicknessList;
pub use vertex_thickness::VertexThickness;
