//! The geometry kernel against f64 arithmetic, closed forms, parry, and brute force.

mod bounded_pairs;
mod ccd;
#[path = "../truth/tests/reference/common.rs"]
mod common;
mod compounds;
mod cone;
mod convex_shapes;
mod curvature;
mod exact;
mod flat_regions;
mod last_first;
mod leaf_triangles;
mod moved_triangles;
mod narrow_phase;
mod pose;
mod refine;
mod shape_extremes;
mod shapes;
mod smooth_normal;
mod spatial_hash;
mod sphere_contacts;
mod spheres;
mod steadiness;
mod surface_tree;
mod topology;
mod tree;
mod truth;
