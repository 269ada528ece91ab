//! Pure geometry: slices in, the caller's buffers out, no ECS type.
//!
//! Everything here can be used without Bevy's app. Later rooms (`surface`, `detection`, `contacts`) are adapters that
//! fetch components, call these functions and store what they return. Lengths are in the unit of the positions,
//! angles in radians, curvature in 1/length.

mod approach;
pub mod bounded_pairs;
pub mod bounds;

pub mod ccd;
pub mod circumsphere;
pub mod cone;
pub mod contact;
pub mod corner_rows;
pub mod curvature;
pub mod exact;
pub mod ids;
mod lanes;
pub mod leaf_triangles;
pub mod motion;
pub mod moved_triangles;
pub mod pair;
pub mod pair_fate;
pub mod pair_order;
pub mod pose;
mod prefetch;
mod recipe;
pub mod refine;
pub(crate) mod room;
pub mod settle;
pub mod share;
pub mod smooth_normal;
pub mod sphere_contacts;
pub mod sphere_pairs;
pub mod sphere_rows;
mod surroundings;
pub mod topology;
pub mod tree;
pub mod unique;
