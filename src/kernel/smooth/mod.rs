//! Smooth surfaces: the quadratic patches over their triangles, how far apart they are, and their contacts.

pub(in crate::kernel) mod closest_lanes;
mod edge_inside;
mod feature_lanes;
pub(in crate::kernel) mod gather;
mod newton;
pub mod on_shape;
pub mod patch;
mod patch_lanes;
pub mod refine;
