//! Tetrahedral bodies: their surface, the vertices that lie in their tetrahedra, and how deep.
//!
//! Which tetrahedron contains a vertex is decided by exact signs (Shewchuk's adaptive predicates, crate `robust`).
//! Candidates come from hashed cells (Teschner et al. 2003, "Optimized Spatial Hashing for Collision Detection of
//! Deformable Objects"). Independent of the contacts of triangles: positions and tetrahedra come in, containments go
//! out.

mod cells;
pub mod containment;
pub mod inside;
pub mod penetration;
pub mod topology;
