//! The f64 reference for every fast path: which triangles touch, how far apart they are, and when they first meet.
//!
//! Nothing here is tuned for speed, and nothing is shared with the production kernel, so the two cannot have the same
//! errors. Exact signs (Shewchuk's adaptive predicates, crate `robust`) decide whether two triangles share a point.
//! Distances are computed with orthonormal bases, whose rounding is equivalent to a perturbation of the last bits of
//! the input. f32 coordinates convert to f64 exactly, so stored f32 positions count as exact.

mod bodies;
mod box_tree;
mod curved_edges;
mod impact;
mod mesh_impacts;
mod mesh_pairs;
mod parry_broad_phase;
mod patches;
mod triangle_crossing;
mod triangle_pair;

pub use bodies::{BodyDistance, BodyFoot, BodyShape, SmoothBody};
pub use curved_edges::{CurvedMesh, PATCH_GUARD};
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
pub use patches::{ReferencePatch, patch_distance};
pub use triangle_crossing::triangles_cross;
pub use triangle_pair::{
    ClosestFeatures, ClosestKind, PointSegment, PointTriangle, SegmentSegment, TriangleSide, closest_features,
    point_segment, point_triangle, segment_segment, triangle_distance,
};
