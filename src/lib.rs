#![doc = include_str!("../README.md")]

pub mod contacts;
#[cfg(feature = "rerun")]
pub mod debug;
pub mod detection;
mod diagnostics;
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
pub use settings::{CircumsphereSettings, SphereContactDetail};

/// What most games need: `use bevy_circumsphere::prelude::*;`.
pub mod prelude {
    pub use crate::{
        contacts::{
            Contact, Impact, SmoothNormals, StencilEntry, SurfaceContactEnd, SurfaceContactStart, SurfaceContacts,
            SurfaceImpacts,
        },
        kernel::{
            ccd::ImpactCause,
            contact::ContactKey,
            mesh::{
                feature::{Feature, FeatureKind},
                ids::{TriangleId, VertexId},
                validation::TopologyError,
            },
        },
        plugins::DeformableCollisionPlugins,
        schedule::DeformableSystems,
        settings::{CircumsphereSettings, SphereContactDetail},
        surface::{
            ContactEventsEnabled, ContactMethod, ContactSide, DeformableSurface, QuarantineReason, RigidShape,
            SelfCollision, Sidedness, SurfaceDisabled, SurfaceFrame, SurfaceLayers, SurfaceOrder, SurfacePositions,
            SurfaceQuarantined, SurfaceStatus, SurfaceThickness, SweptCollision, SweptTarget, Teleported,
        },
    };
    pub use parry3d::shape::SharedShape;
}
