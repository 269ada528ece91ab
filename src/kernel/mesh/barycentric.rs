//! Weights of a triangle's corners, and the points they stand for.

use glam::DVec3;

/// The weights of a corner.
#[inline]
pub(in crate::kernel) fn corner_weights(corner: usize) -> [f64; 3] {
    let mut weights = [0.0; 3];
    weights[corner] = 1.0;
    weights
}

/// The weights of a position along edge `edge`, 0 at corner `edge` and 1 at the next.
#[inline]
pub(in crate::kernel) fn edge_weights(edge: usize, along: f64) -> [f64; 3] {
    let mut weights = [0.0; 3];
    weights[edge] = 1.0 - along;
    weights[(edge + 1) % 3] = along;
    weights
}

/// Weights from three values of the same sign that are proportional to the areas opposite the corners.
#[inline]
pub(in crate::kernel) fn normalized(areas: [f64; 3]) -> [f64; 3] {
    let inverse = (areas[0] + areas[1] + areas[2]).recip();
    let (second, third) = (areas[1] * inverse, areas[2] * inverse);
    [1.0 - second - third, second, third]
}

/// The point that weights stand for.
#[must_use]
#[inline]
pub fn point_at(corners: &[DVec3; 3], weights: &[f64; 3]) -> DVec3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// Weights of the corners at the projection of a point on the triangle's plane, clamped into the triangle; a third each
/// where the triangle has no area or the point is infinite.
#[must_use]
pub fn barycentric_of(triangle: &[DVec3; 3], point: DVec3) -> [f64; 3] {
    let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
    let area = |k: usize| {
        normal.dot((triangle[(k + 2) % 3] - triangle[(k + 1) % 3]).cross(point - triangle[(k + 1) % 3])).max(0.0)
    };
    let areas = [area(0), area(1), area(2)];
    let sum = areas[0] + areas[1] + areas[2];
    if sum > 0.0 && sum.is_finite() { areas.map(|area| area / sum) } else { [1.0 / 3.0; 3] }
}
