//! Shared code of the examples, tests, benches, and fuzz targets of `bevy_circumsphere`: recorded and procedural
//! meshes, random numbers, and the tolerances of the tests.
//!
//! Nothing here is published, and nothing here depends on the library. Meshes are plain arrays, so that tests can
//! compare the library with independent data.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod bars;
pub mod programs;
pub mod random;
pub mod recording;
pub mod scenes;
pub mod tetrahedra;
pub mod warnings;
