//! Tolerances that the tests apply to every exact method.

/// Relative band around the contact distance in which either answer is right, because f32 inputs are rounded.
pub const BAND: f64 = 1.0e-4;

/// Largest error of a separation, relative to the larger of contact distance and triangle size.
pub const SEPARATION_TOLERANCE: f64 = 1.0e-5;
