//! The truth every fast path is judged by: which triangles touch, how far apart they are, and when they
//! first meet, in f64.
//!
//! Nothing here is tuned for speed and nothing is shared with the production kernel, so that an error of one is
//! not an error of the other. Whether two triangles share a point is decided by exact signs (Shewchuk's adaptive
//! predicates, crate `robust`); distances are computed with orthonormal bases, whose rounding equals a
//! perturbation of the input in its last bits. f32 coordinates convert to f64 exactly, so stored f32 positions are
//! taken at their word.

mod box_tree;
mod impact;
mod mesh_impacts;
mod mesh_pairs;
mod parry_broad_phase;
mod triangle_crossing;
mod triangle_pair;

pub use impact::{ImpactTruth, edge_edge_impact, triangle_impact, vertex_face_impact};
pub use mesh_impacts::{
    FeatureImpact, ImpactKind, MovingMesh, TriangleImpact, feature_impacts_brute_force, feature_impacts_tree,
    triangle_impacts_brute_force, triangle_impacts_tree,
};
pub use mesh_pairs::{
    Comparison, ReferencePair, box_pairs, compare, exact_weld, mean_edge_length, touching_pairs_between_brute_force,
    touching_pairs_between_tree, touching_pairs_brute_force, touching_pairs_tree,
};
pub use parry_broad_phase::ParryBroadPhasePlugin;
pub use triangle_crossing::triangles_cross;
pub use triangle_pair::{
    ClosestFeatures, ClosestKind, PointSegment, PointTriangle, SegmentSegment, TriangleSide, closest_features,
    point_segment, point_triangle, segment_segment, triangle_distance,
};
