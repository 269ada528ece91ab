//! Continuous collision detection: when triangles whose vertices move in straight lines first come close.
//!
//! The stage of fast motion. Positions at the start and at the end of a step come in, times of impact in 0 to 1 go out,
//! in stages that each narrow the one before: the boxes of [`sweep_tree`], [`triangle_pair`] and the feature pairs of
//! [`feature`], which everything rests on. [`sweep`](mod@sweep) is all of it for two meshes. A reported time is never later than the true one, and no impact is missed: every bound takes the rounding of its
//! own arithmetic into account. What that costs is a resolution of [`RESOLUTION`] times the size of a pair, below which
//! features that pass each other count as meeting.

mod advance;
pub mod feature;
pub mod pair_list;
mod parting;
pub mod sweep;
pub mod sweep_tree;
pub mod triangle_pair;

pub use advance::{ImpactCause, MOST_STEPS, RESOLUTION};
pub use feature::{FeatureImpact, edge_edge_impact, vertex_face_impact};
pub use pair_list::{MovingSide, PairImpact, first_impacts};
pub use sweep::{SWEEP_PART, Sweep, SweepBuffers, SweepLeaves, SweptMesh, drift, sort_impacts, sweep};
pub use sweep_tree::{SweepTree, TreeWork, outward_box};
pub use triangle_pair::{CommonVertices, MovingTriangle, TriangleImpact, triangle_pair_impact};
