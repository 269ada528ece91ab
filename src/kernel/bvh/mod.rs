//! The bounding volume hierarchy over triangle boxes: build, refit, and search; the triangles in its leaves with their
//! planes; and the lists of near pairs.

pub mod flat_regions;
pub mod leaf_triangles;
pub mod moved_triangles;
pub mod near_pairs;
pub mod tree;
