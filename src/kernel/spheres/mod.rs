//! Spheres through triangles: curvature, circumspheres and their recipes, safety cones, overlapping pairs, and their
//! contacts.

pub(in crate::kernel) mod cap_lanes;
pub mod circumsphere;
pub mod cone;
pub mod contacts;
pub mod curvature;
mod osculating;
pub mod osculating_contacts;
pub mod pairs;
pub(in crate::kernel) mod recipe;
pub mod rows;
