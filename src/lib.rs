#![doc = include_str!("../README.md")]

pub mod contacts;
#[cfg(feature = "rerun")]
pub mod debug;
pub mod detection;
pub mod kernel;
mod plugins;
pub mod response;
pub mod schedule;
pub mod settings;
pub mod surface;

pub use contacts::*;
pub use surface::*;

pub use plugins::DeformableCollisionPlugins;
pub use schedule::{DeformableSystems, SurfaceDetection, SurfaceDetectionSystems};
pub use settings::CircumsphereSettings;

/// What most games need: `use bevy_circumsphere::prelude::*;`.
pub mod prelude {
    pub use crate::{
        contacts::{
            Contact, ContactSide, Impact, SmoothNormals, StencilEntry, SurfaceContactEnded, SurfaceContactStarted,
            SurfaceContacts, SurfaceImpacts, SurfaceQuarantined,
        },
        kernel::{
            ccd::ImpactCause,
            contact::ContactKey,
            mesh::{
                feature::{Feature, FeatureKind},
                ids::{TriangleId, VertexId},
                topology::TopologyError,
            },
        },
        plugins::DeformableCollisionPlugins,
        schedule::DeformableSystems,
        settings::CircumsphereSettings,
        surface::{
            ContactEventsEnabled, ContactMethod, DeformableSurface, QuarantineReason, RigidShape, SelfCollision,
            Sidedness, SurfaceDisabled, SurfaceFrame, SurfaceLayers, SurfaceOrder, SurfacePositions, SurfaceStatus,
            SurfaceThickness, SweptCollision, SweptTarget, Teleported,
        },
    };
    pub use parry3d::shape::SharedShape;
}
