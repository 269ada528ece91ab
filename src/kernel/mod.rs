//! Pure geometry, and the arithmetic of the solver: functions take slices and write into buffers that the caller owns. No ECS type.
//!
//! Lengths are in the unit of the positions, angles in radians, curvature in 1/length. The rooms in their order, each of which
//! imports only from those before it: capacity, pose, simd, mesh, contact, pair, bvh, spatial hash, exact, smooth, query, spheres, ccd,
//! tetrahedra, xpbd, pair fate, thin wall. `tests/architecture.rs` checks it.

// First, for its macros.
#[macro_use]
pub mod simd;

pub mod bvh;
pub(crate) mod capacity;
pub mod ccd;
pub mod contact;
pub mod exact;
pub mod mesh;
pub mod pair;
pub mod pair_fate;
pub mod pose;
pub mod query;
pub mod smooth;
pub mod spatial_hash;
pub mod spheres;
pub mod tetrahedra;
#[cfg(feature = "thin-wall")]
pub mod thin_wall;
pub mod xpbd;
