//! Continuous collision detection: when triangles whose vertices move in straight lines first come close.
//!
//! The stage for fast motion. Takes positions at the start and at the end of a step, and returns times of impact from 0
//! to 1. Each stage narrows the one before: the boxes of [`sweep_tree`], then [`triangle_pair`], then the feature pairs
//! of [`feature`], on which everything depends. [`sweep`](mod@sweep) is all of it for two meshes. A reported time is
//! never later than the true one, and no impact is missed: every bound accounts for the rounding of its own arithmetic.
//! The price is a resolution of [`RESOLUTION`] times the size of a pair, below which features that pass each other
//! count as meeting.

mod advance;
pub mod feature;
pub mod pair_list;
mod parting;
mod stars;
pub mod sweep;
pub mod sweep_tree;
pub mod triangle_pair;

pub use advance::{ImpactCause, MOST_STEPS, RESOLUTION};
pub use feature::{FeatureImpact, edge_edge_impact, vertex_face_impact};
pub use pair_list::{MovingSide, PairImpact, first_impacts};
pub use sweep::{ImpactList, SWEEP_PART, Sweep, SweepBuffers, SweepLeaves, SweptMesh, drift, sort_impacts, sweep};
pub use sweep_tree::{SweepTree, TreeWork, outward_box};
pub use triangle_pair::{CommonVertices, MovingTriangle, TriangleImpact, triangle_pair_impact};
