//! Pure geometry: slices in, the caller's buffers out, no ECS type.
//!
//! Lengths are in the unit of the positions, angles in radians, curvature in 1/length. Each room imports only from those above it
//! in this list; `tests/architecture.rs` holds them to that.

pub mod bvh;
pub(crate) mod capacity;
pub mod ccd;
pub mod contact;
pub mod exact;
pub mod mesh;
pub mod pair;
pub mod pair_fate;
pub mod pose;
pub mod simd;
pub mod spheres;
