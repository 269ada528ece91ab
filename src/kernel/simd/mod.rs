//! SIMD building blocks for eight triangles or pairs at a time: dispatch to instruction sets, vectors in lanes, separating
//! slabs, prefetching, and the hook through which callers distribute work among threads.

#[macro_use]
pub(in crate::kernel) mod multiversion;

pub(in crate::kernel) mod approach;
pub(in crate::kernel) mod lanes;
pub mod parallel;
pub(in crate::kernel) mod prefetch;
pub(in crate::kernel) mod slab;
