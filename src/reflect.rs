//! Registers the types of all components, resources, messages, and settings, for inspectors and scene files.

use bevy_app::prelude::*;

use crate::{
    contacts::{ContactStore, SurfaceContactEnd, SurfaceContactStart},
    detection::{
        CandidateTrianglePairs, Containments, DetectionDiagnostics, ExactTrianglePairs, MeetingCaps,
        OverlappingTrianglePairs, SphereContacts, SweptImpacts,
    },
    response::{
        RigidMass, RigidPart, RigidPush, SurfaceForces, SurfaceFriction, SurfaceReaction, SurfaceWind, XpbdBody,
        XpbdDiagnostics, XpbdSettings, XpbdTethers,
    },
    rollback::CollisionHistory,
    settings::CircumsphereSettings,
    surface::{
        ActiveSurfaces, Circumspheres, ContactEventHold, ContactEventsEnabled, ContactFilter, ContactMethod,
        DeformableSurface, EnclosingBalls, PreviousPositions, QueryOnly, RestContactsIgnored, RigidShape,
        SelfCollision, Sidedness, SurfaceDisabled, SurfaceFrame, SurfaceLayers, SurfaceOrder, SurfacePositions,
        SurfaceQuarantined, SurfaceShape, SurfaceStatus, SurfaceThickness, SweptCollision, SweptTarget, Teleported,
        TetrahedralBody, TriangleCones, TriangleCurvature, TriangleLayers, VertexThickness,
    },
};

/// Registers the types. Part of [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins) if the feature
/// `reflect` is on. Types whose parts depend on each other are opaque: they can be cloned and inserted, but their fields
/// cannot be edited.
pub struct ReflectPlugin;

/// Calls `register_type` for each type.
macro_rules! register {
    ($app:ident: $($name:ty),* $(,)?) => {
        $($app.register_type::<$name>();)*
    };
}

impl Plugin for ReflectPlugin {
    fn build(&self, app: &mut App) {
        register!(app:
            // Written by the game.
            CircumsphereSettings, ContactEventHold, ContactEventsEnabled, ContactFilter, ContactMethod, DeformableSurface, QueryOnly, RestContactsIgnored, RigidMass, RigidPart, RigidShape, SelfCollision,
            Sidedness, SurfaceDisabled, SurfaceForces, SurfaceFrame, SurfaceFriction, SurfaceLayers, SurfaceOrder,
            SurfacePositions, SurfaceShape, SurfaceThickness, SurfaceWind, SweptCollision, SweptTarget, Teleported, TetrahedralBody, TriangleLayers, VertexThickness, XpbdBody,
            XpbdSettings, XpbdTethers,
            // Written by the plugins.
            ActiveSurfaces, CandidateTrianglePairs, Circumspheres, CollisionHistory, ContactStore, Containments, DetectionDiagnostics, EnclosingBalls,
            ExactTrianglePairs, MeetingCaps, OverlappingTrianglePairs, PreviousPositions, RigidPush, SphereContacts,
            SurfaceContactEnd, SurfaceContactStart, SurfaceQuarantined, SurfaceReaction, SurfaceStatus, SweptImpacts, TriangleCones,
            TriangleCurvature, XpbdDiagnostics,
        );
        #[cfg(feature = "mesh")]
        register!(app:
            crate::surface::DrivenMesh, crate::surface::SurfaceFromMesh, crate::surface::SurfaceFromMeshHierarchy,
            crate::surface::SurfaceMeshNotWritten, crate::surface::WriteSurfaceToMesh,
            crate::response::XpbdGarment, crate::response::XpbdGarmentNotWorn, crate::response::XpbdGarments,
        );
        #[cfg(feature = "gizmos")]
        register!(app: crate::debug::DeformableGizmos);
        #[cfg(feature = "rerun")]
        register!(app: crate::debug::RerunSettings);
    }
}
