//! The stages between positions and contacts. Each is a small plugin, a thin adapter of the kernel.
//!
//! bounds → broad phase → curvature → refit → overlap → cone → exact → swept. Each stage reads what earlier ones wrote,
//! and writes its own component or resource. Results are lists with one entry for each pair of surfaces that the broad
//! phase found.

mod bounds;
mod broad_phase;
mod cone;
mod corner_rows;
mod curvature;
mod exact;
mod kept_pairs;
mod memory;
mod overlap;
mod pair_contacts;
mod pair_fates;
mod parallel;
mod refit;
mod settle;
mod sides;
mod sphere_lists;
mod state;
mod swept;

pub use broad_phase::{
    BoxSide, BroadPhasePlugin, BroadPhaseSystems, BruteForceBroadPhasePlugin, CandidateTrianglePairs, CandidateWriter,
    Frame, OtherSide, SurfaceBoxes, SurfacePair, TreeBroadPhasePlugin,
};
pub use swept::{SweptImpact, SweptImpacts, SweptPair, SweptPlugin};

pub use crate::diagnostics::{DetectionDiagnostics, StageDiagnostics};
pub use bounds::BoundsPlugin;
pub(crate) use bounds::moved_box;
#[cfg(feature = "rerun")]
pub(crate) use broad_phase::surfaces_with_method;
pub use cone::{ConePlugin, MeetingCaps};
pub use curvature::CurvaturePlugin;
pub use exact::{ExactPlugin, ExactTrianglePairs};
pub use kept_pairs::KeptPairs;
pub(crate) use memory::DetectionMemory;
pub use overlap::{OverlapPlugin, OverlappingTrianglePairs, SphereContacts};
pub use pair_contacts::{PairContacts, SharedList};
pub use pair_fates::PairFates;
pub(crate) use parallel::Threads;
pub use refit::RefitPlugin;
pub(crate) use sides::is_one_sided;
pub(crate) use sphere_lists::FoundBySpheres;
pub use state::{SurfaceState, SurfaceStates};
