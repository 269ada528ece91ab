#![doc = include_str!("walkthrough.md")]

mod rerun;

pub use rerun::{DeformableRerunPlugin, LevelOfDetail, RerunError, RerunSettings};
