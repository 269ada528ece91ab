//! Looking at what detection did. Behind features, so that a game ships without it.

mod rerun;

pub use rerun::{DeformableRerunPlugin, LevelOfDetail, RerunError, RerunSettings};
