//! Eight triangles or pairs side by side: vectors in lanes, slabs between triangles, what is fetched ahead, and the hook by which
//! callers split work among threads.

pub(in crate::kernel) mod approach;
pub(in crate::kernel) mod lanes;
pub(in crate::kernel) mod prefetch;
pub mod share;
pub(in crate::kernel) mod slab;
