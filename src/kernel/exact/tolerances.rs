//! Tolerances that the exact test of triangle pairs and its screen share.

/// Boundary pairs are equally close if their squared distances differ by no more than this share: twice what the
/// rounding of f32 positions leaves of two edges that are meant to be parallel.
pub(super) const TIE: f64 = 2.0e-6;

/// A position along an edge, 0 to 1, this close to an end is at the end.
pub(super) const AT_END: f64 = 1.0e-9;

/// Two edges are parallel if the sine of their angle is smaller. Their closest points are then at an end of one of
/// them. In f64, products of differences of f32 numbers resolve sines far below this.
pub(super) const PARALLEL_SINE: f64 = 1.0e-12;

/// Triangles this close, relative to their extent, touch within the precision of f64. For triangles that share a point
/// exactly, coplanar ones above all, products round to 1e-14 of the extent.
pub(super) const ROUND_OFF: f64 = 1.0e-13;

/// The square of a range is enlarged by this share, ten times the rounding of squares, roots, and scales. Examined
/// features need not be within the range, but none is missed whose rounded distance is.
pub(super) const SQUARE_SLACK: f64 = 1.0e-14;
