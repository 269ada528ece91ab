//! What the examples, tests, benches and fuzz targets of `bevy_circumsphere` share: recorded meshes and procedural ones,
//! random numbers, and the bars of the tests.
//!
//! Nothing here is published and nothing here knows the library: meshes are plain arrays, so that a test can
//! compare the library with data the library had no hand in.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod bars;
pub mod programs;
pub mod random;
pub mod recording;
pub mod scenes;
#[cfg(feature = "strategies")]
pub mod strategies;
