//! The tree over triangle boxes: build, refit, search; the triangles in its leaves with their planes; lists of near pairs.

pub mod leaf_triangles;
pub mod moved_triangles;
pub mod near_pairs;
pub mod tree;
