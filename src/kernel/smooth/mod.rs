//! Smooth surfaces: the quadratic patches over their triangles, how far apart they are, and their contacts.

mod closest_lanes;
mod feature_lanes;
mod gather;
mod newton;
pub mod patch;
mod patch_lanes;
pub mod refine;
