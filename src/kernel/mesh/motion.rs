//! How far a mesh has moved from one tick to the next, as a whole and within itself.
//!
//! Distances between triangles do not change where everything moves alike. What they can change by follows from one
//! vector a mesh, and how far the motion of any vertex is from it.

use glam::{Vec3, Vec3A};

/// Motion of all vertices: each within `radius` of `center`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    center: Vec3,
    /// Infinite where nothing is known.
    radius: f32,
}

impl Default for Motion {
    /// Unknown.
    fn default() -> Self {
        Self::UNKNOWN
    }
}

/// Half a unit in the last place is what a difference, its distance from the center or a root may be rounded by; some ten
/// roundings are on the way to a radius.
const ROUNDING: f32 = 8.0 * f32::EPSILON;

impl Motion {
    /// Nothing has moved.
    pub const REST: Self = Self { center: Vec3::ZERO, radius: 0.0 };
    /// Anything may have moved anywhere.
    pub const UNKNOWN: Self = Self { center: Vec3::ZERO, radius: f32::INFINITY };

    /// From one list of positions to the next, of as many vertices. Rounded up.
    #[must_use]
    pub fn between(before: &[Vec3], after: &[Vec3]) -> Self {
        if before.len() != after.len() {
            return Self::UNKNOWN;
        }
        // Three of four lanes: each takes as long as one number by itself.
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
        // Squares that are too small or too large for f32 say nothing.
        let is_reliable = low == high || (f32::MIN_POSITIVE..f32::MAX).contains(&farthest);
        if is_reliable && radius.is_finite() { Self { center: center.into(), radius } } else { Self::UNKNOWN }
    }

    /// By how much the distance of a point of one mesh from a point of the other can have changed, at most; of one mesh
    /// with itself both are the same. Infinite where a motion is not known.
    #[must_use]
    pub fn relative(&self, other: &Self) -> f64 {
        let between = (self.center.as_dvec3() - other.center.as_dvec3()).length();
        between + f64::from(self.radius) + f64::from(other.radius)
    }
}
