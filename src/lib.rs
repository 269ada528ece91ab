#![doc = include_str!("doc_links.md")]
#![doc = include_str!("../README.md")]

// For what unit tests share with the tests outside.
#[cfg(test)]
extern crate self as bevy_circumsphere;

mod contacts;
#[cfg(any(feature = "gizmos", feature = "rerun"))]
pub mod debug;
pub mod detection;
mod diagnostics;
/// The pages of `docs/`. They contain no code, and are compiled into the documentation only.
#[cfg(any(doc, doctest))]
pub mod docs {
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/guide.md")]
    pub mod guide {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/methods.md")]
    pub mod methods {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/performance.md")]
    pub mod performance {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/broad_phases.md")]
    pub mod broad_phases {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/replay.md")]
    pub mod replay {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/experiments.md")]
    pub mod experiments {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/rerun.md")]
    pub mod rerun {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/tetrahedra.md")]
    pub mod tetrahedra {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/thin_walls.md")]
    pub mod thin_walls {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/architecture.md")]
    pub mod architecture {}
    #[doc = include_str!("doc_links.md")]
    #[doc = include_str!("../docs/glossary.md")]
    pub mod glossary {}
}
/// What surfaces, shapes, and contacts are described in.
pub mod geometry {
    pub use crate::kernel::{
        ccd::ImpactCause,
        contact::{CompactContact, ContactKey, TouchingPair, feature_number},
        exact::rigid_shape::ShapeError,
        mesh::{
            bounds::Aabb,
            feature::{Feature, FeatureKind, FeaturePair},
            ids::{EdgeId, TetrahedronId, TriangleId, VertexId},
            smooth_normal::CreaseAngle,
            topology::{SurfaceTopology, TopologyReport},
            validation::TopologyError,
        },
        pair_fate::PairFate,
        pose::{Pose, PoseError},
        spheres::{contacts::SphereContact, curvature::CurvatureEstimator},
        tetrahedra::topology::{TetrahedraError, TetrahedraReport, TetrahedralTopology},
    };

    /// Turns thin-walled meshes into single-layer sheets with thickness, when assets are made.
    #[cfg(feature = "thin-wall")]
    pub use crate::kernel::thin_wall;
}
/// Pure geometry, for this crate and its own tests, benches, and reports. It may change in any version.
#[doc(hidden)]
pub mod kernel;
#[cfg(feature = "diagnostic")]
mod measurements;
mod plugins;
#[cfg(feature = "reflect")]
mod reflect;
pub mod response;
mod rollback;
mod schedule;
mod settings;
mod spatial_query;
mod surface;

pub use contacts::*;
#[cfg(feature = "picking")]
pub use spatial_query::SurfacePickingPlugin;
pub use spatial_query::{ClosestPoint, RayHit, ShapeHit, SurfaceOverlap, SurfaceQuery, SurfaceQueryFilter};
pub use surface::*;

pub use detection::{Containments, TetrahedralContainmentPlugin, VertexContainment};
#[cfg(feature = "diagnostic")]
pub use measurements::CollisionDiagnosticsPlugin;
pub use plugins::DeformableCollisionPlugins;
#[cfg(feature = "reflect")]
pub use reflect::ReflectPlugin;
pub use rollback::{CollisionHistory, RollbackPlugin};
pub use schedule::{DeformableSystems, SurfaceDetection, SurfaceDetectionSystems};
pub use settings::{CircumsphereSettings, SphereContactDetail};

/// What most games need: `use bevy_circumsphere::prelude::*;`.
pub mod prelude {
    #[cfg(feature = "mesh")]
    pub use crate::surface::{
        DrivenMesh, SurfaceFromMesh, SurfaceFromMeshHierarchy, SurfaceJoints, SurfaceMeshError, SurfaceMeshNotWritten,
        SurfaceSettings, WriteSurfaceToMesh,
    };
    pub use crate::{
        contacts::{
            Contact, Impact, SmoothNormals, StencilEntry, SurfaceContactEnd, SurfaceContactStart, SurfaceContacts,
            SurfaceImpacts,
        },
        detection::{Containments, TetrahedralContainmentPlugin, VertexContainment},
        geometry::{
            ContactKey, Feature, FeatureKind, ImpactCause, TetrahedraError, TetrahedronId, TopologyError, TriangleId,
            VertexId,
        },
        plugins::DeformableCollisionPlugins,
        schedule::DeformableSystems,
        settings::{CircumsphereSettings, SphereContactDetail},
        spatial_query::{RayHit, SurfaceQuery, SurfaceQueryFilter},
        surface::{
            CandidatePair, ContactEventHold, ContactEventsEnabled, ContactFilter, ContactMethod, ContactSide,
            DeformableSurface, QuarantineReason, QueryOnly, RestContactsIgnored, RigidShape, SelfCollision, Sidedness,
            SurfaceDisabled, SurfaceFrame, SurfaceLayers, SurfaceOrder, SurfacePositions, SurfaceQuarantined,
            SurfaceShape, SurfaceStatus, SurfaceThickness, SweptCollision, SweptTarget, Teleported, TetrahedralBody,
            TriangleLayers, VertexThickness,
        },
    };
    pub use parry3d::shape::SharedShape;
}
