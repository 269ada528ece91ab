//! What the tests hold every exact method to.

/// Distances of f32 inputs are only as good as their rounding at edge scale: within this share of the contact distance
/// either answer is right.
pub const BAND: f64 = 1.0e-4;

/// The most that a separation may be wrong by, relative to the larger of contact distance and triangle size.
pub const SEPARATION_TOLERANCE: f64 = 1.0e-5;
