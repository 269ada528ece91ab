#![doc = include_str!("walkthrough.md")]

mod bodies;
mod colors;
mod contacts;
#[cfg(feature = "gizmos")]
mod gizmos;
mod level_of_detail;
mod pairs;
mod patches;
#[cfg(feature = "rerun")]
mod rerun;
mod tick;
mod wires;

#[cfg(feature = "gizmos")]
pub use self::gizmos::{DeformableGizmos, DeformableGizmosPlugin};
pub use self::level_of_detail::LevelOfDetail;
#[cfg(feature = "rerun")]
pub use self::rerun::{DeformableRerunPlugin, RerunError, RerunSettings};
