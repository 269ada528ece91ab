//! Exact proximity of two triangles, and of a triangle and a rigid shape, in f64.
//!
//! The last geometric stage: candidate pairs come in, distances and feature pairs go out. Input positions are f32 and
//! taken as exact. Every difference is formed in f64, relative to a corner of the pair.

mod batch;
mod cases;
pub mod pair_order;
pub mod penetration;
pub mod rest_pairs;
pub mod rigid_shape;
mod screen;
pub mod stage;
mod thick_pair;
mod tolerances;
pub mod triangle_pair;
pub mod unique;

pub(in crate::kernel) use batch::{FeatureBatches, LeftOver, Reports};
pub(in crate::kernel) use cases::{CaseLanes, Cases, FeatureSet};
pub(in crate::kernel) use screen::{PairScreen, ScreenLimits, Screened, rounded_down};
pub use triangle_pair::{PairProximity, Proximity, examine_pair};
pub(in crate::kernel) use triangle_pair::{examine_boundaries, examine_screened};
