//! The stages between positions and contacts. Each is a small plugin, a thin adapter of the kernel.
//!
//! bounds → broad phase → curvature → refit → overlap → cone → exact → swept. Each stage reads what earlier ones wrote,
//! and writes its own component or resource. Results are lists with one entry for each pair of surfaces that the broad
//! phase found.

mod bounds;
mod broad_phase;
mod exact;
mod pair_contacts;
mod pair_fates;
mod pairs;
mod parallel;
mod reuse;
mod sides;
mod spheres;
mod state;
mod swept;
mod team;
mod tetrahedra;

pub use bounds::BoundsPlugin;
#[cfg(feature = "rerun")]
pub(crate) use broad_phase::UsedHash;
pub use broad_phase::{
    BoxSide, BroadPhasePlugin, BroadPhaseSystems, BruteForceBroadPhasePlugin, CandidateWriter,
    HierarchicalSpatialHashBroadPhasePlugin, NormalConeCullingPlugin, SpatialHashBroadPhasePlugin, SurfaceBoxes,
    TreeBroadPhasePlugin,
};
pub use exact::{ExactPlugin, ExactTrianglePairs};
pub use pair_contacts::{PairContacts, SharedList};
pub use pair_fates::PairFates;
pub(crate) use pairs::moved_box;
#[cfg(any(feature = "gizmos", feature = "rerun"))]
pub(crate) use pairs::surfaces_with_method;
pub use pairs::{CandidateTrianglePairs, Frame, OtherSide, SurfacePair};
pub(crate) use parallel::Threads;
pub(crate) use reuse::DetectionMemory;
#[cfg(feature = "rerun")]
pub(crate) use reuse::is_same_list;
pub use reuse::near_lists::KeptPairs;
pub(crate) use sides::is_one_sided;
pub(crate) use spheres::lists::FoundBySpheres;
pub use spheres::{
    cone::{ConePlugin, MeetingCaps},
    curvature::CurvaturePlugin,
    overlap::{OverlapPlugin, OverlappingTrianglePairs, SphereContacts},
    refit::RefitPlugin,
};
pub use state::{SurfaceState, SurfaceStates};
pub(crate) use swept::{ImpactReader, ImpactsRead, Sweeping, SweptHistory};
pub use swept::{SweptImpact, SweptImpacts, SweptPair, SweptPlugin};
pub use tetrahedra::{Containments, TetrahedralContainmentPlugin, VertexContainment};

pub use crate::diagnostics::{DetectionDiagnostics, StageDiagnostics};
