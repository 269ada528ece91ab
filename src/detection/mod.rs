//! The stages between positions and contacts: one small plugin each, a thin adapter over the kernel.
//!
//! bounds → broad phase → curvature → refit → overlap → cone → refine → swept. Each stage reads what earlier ones wrote and
//! writes its own components or resource, aligned with the pairs of surfaces that the broad phase found.

mod bounds;
pub mod broad_phase;
mod cone;
mod corner_rows;
mod curvature;
mod diagnostics;
mod kept_pairs;
mod memory;
mod overlap;
mod pair_contacts;
mod pair_fates;
mod parallel;
mod refine;
mod refit;
mod settle;
mod sides;
mod sphere_lists;
mod sphere_memory;
mod swept;

pub(crate) use bounds::moved_box;
pub use bounds::{BoundsPlugin, TriangleBounds};
pub use broad_phase::{
    BroadPhasePlugin, BruteForceBroadPhasePlugin, CandidateTrianglePairs, ParryBroadPhasePlugin, SurfacePair,
    TreeBroadPhasePlugin,
};
pub use cone::{ConePlugin, MeetingCaps};
pub use corner_rows::SurfaceRows;
pub use curvature::{CurvaturePlugin, TriangleCurvature};
pub use diagnostics::{DetectionDiagnostics, StageDiagnostics};
pub use kept_pairs::KeptPairs;
pub(crate) use memory::{DetectionMemory, StageList};
pub use overlap::{OverlapPlugin, OverlappingTrianglePairs, SphereContacts};
pub use pair_contacts::{PairContacts, SharedList};
pub use pair_fates::PairFates;
pub(crate) use parallel::Threads;
pub use refine::{RefinePlugin, RefinedTrianglePairs};
pub use refit::{Circumspheres, EnclosingBalls, RefitPlugin, TriangleCones};
pub(crate) use sides::is_one_sided;
pub(crate) use sphere_lists::SphereLists;
pub use swept::{PreviousPositions, SweptPlugin};
