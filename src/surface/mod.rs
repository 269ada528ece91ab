//! What a game spawns, and how it becomes one consistent picture of the tick.
//!
//! Components are read and validated once a tick in `Prepare`; the stages work from that picture. A surface that
//! cannot be used is set aside with a reason while the others go on.

mod active;
mod components;
mod prepare;
mod rigid_shape;
mod spheres;

pub(crate) use active::SideOrder;
pub use active::{ActiveShape, ActiveSurface, ActiveSurfaces, ContactSide};
pub(crate) use components::{CheckedPositions, first_non_finite};
pub use components::{
    ContactEventsEnabled, ContactMethod, DeformableSurface, PreviousPositions, SelfCollision, Sidedness,
    SurfaceBuilder, SurfaceDisabled, SurfaceFrame, SurfaceLayers, SurfaceOrder, SurfacePositions, SurfaceStatus,
    SurfaceThickness, SweptCollision, SweptTarget, Teleported,
};
pub(crate) use prepare::PendingQuarantines;
pub use prepare::{QuarantineReason, SurfacePlugin, SurfaceQuarantined};
pub use rigid_shape::RigidShape;
pub(crate) use spheres::SphereSource;
pub use spheres::{Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature};
