//! Cloth and soft bodies beside the rigid bodies of avian and rapier, in one app.
//!
//! A game copies one of the files `avian.rs` and `rapier.rs`: each is a plugin that needs nothing else of this package.

pub mod avian;
pub mod rapier;
pub mod scenes;
