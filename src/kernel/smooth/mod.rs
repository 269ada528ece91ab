//! Smooth surfaces: the quadratic patches over their triangles, and where two of them are closest.

pub mod patch;
pub mod refine;
pub mod slide;
