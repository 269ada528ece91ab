//! How far a mesh has moved from one tick to the next, as a whole and within itself.
//!
//! Distances between triangles do not change while everything moves alike. How much they can change follows from one
//! vector per mesh, and from how far the motion of any vertex differs from it.

use glam::{Vec3, Vec3A};

/// The motion of all vertices: each lies within `radius` of `center`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    center: Vec3,
    /// Infinite if the motion is unknown.
    radius: f32,
}

impl Default for Motion {
    /// Unknown.
    fn default() -> Self {
        Self::UNKNOWN
    }
}

/// Relative rounding error. A difference, its distance from the center, and a root each round by half a unit in the
/// last place, and a radius is the result of about ten roundings.
const ROUNDING: f32 = 8.0 * f32::EPSILON;

impl Motion {
    /// Nothing has moved.
    pub const REST: Self = Self { center: Vec3::ZERO, radius: 0.0 };
    /// Anything may have moved anywhere.
    pub const UNKNOWN: Self = Self { center: Vec3::ZERO, radius: f32::INFINITY };

    /// The motion from one list of positions to the next, rounded up. Unknown if the lists differ in length.
    #[must_use]
    pub fn between(before: &[Vec3], after: &[Vec3]) -> Self {
        if before.len() != after.len() {
            return Self::UNKNOWN;
        }
        // Uses three of four SIMD lanes, which takes as long as one number by itself.
        let differences = || before.iter().zip(after).map(|(&before, &after)| Vec3A::from(after) - Vec3A::from(before));
        let (low, high) = differences()
            .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), moved| (low.min(moved), high.max(moved)));
        if before.is_empty() {
            return Self::REST;
        }
        let center = (low + high) * 0.5;
        let farthest = differences().fold(0.0, |farthest: f32, moved| farthest.max((moved - center).length_squared()));
        let largest = low.abs().max(high.abs()).max_element();
        let radius = farthest.sqrt() * (1.0 + ROUNDING) + largest * ROUNDING;
        // Squares that are too small or too large for f32 are not reliable.
        let is_reliable = low == high || (f32::MIN_POSITIVE..f32::MAX).contains(&farthest);
        if is_reliable && radius.is_finite() { Self { center: center.into(), radius } } else { Self::UNKNOWN }
    }

    /// The largest possible change of the distance between a point of one mesh and a point of the other. For one mesh
    /// against itself, pass the same motion twice. Infinite if a motion is unknown.
    #[must_use]
    pub fn relative(&self, other: &Self) -> f64 {
        let between = (self.center.as_dvec3() - other.center.as_dvec3()).length();
        between + f64::from(self.radius) + f64::from(other.radius)
    }
}
