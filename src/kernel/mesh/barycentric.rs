//! Barycentric weights, and the points that they stand for.

use glam::DVec3;

/// The weights of a corner: 1 there, 0 elsewhere.
#[inline]
pub(in crate::kernel) fn corner_weights(corner: usize) -> [f64; 3] {
    let mut weights = [0.0; 3];
    weights[corner] = 1.0;
    weights
}

/// The weights of a position along edge `edge`: 0 is corner `edge`, and 1 the next corner.
#[inline]
pub(in crate::kernel) fn edge_weights(edge: usize, along: f64) -> [f64; 3] {
    let mut weights = [0.0; 3];
    weights[edge] = 1.0 - along;
    weights[(edge + 1) % 3] = along;
    weights
}

/// Normalizes three values of the same sign, which are proportional to the areas opposite the corners, to weights.
#[inline]
pub(in crate::kernel) fn normalized(areas: [f64; 3]) -> [f64; 3] {
    let inverse = (areas[0] + areas[1] + areas[2]).recip();
    let (second, third) = (areas[1] * inverse, areas[2] * inverse);
    [1.0 - second - third, second, third]
}

/// The point with the given weights.
#[must_use]
#[inline]
pub fn point_at(corners: &[DVec3; 3], weights: &[f64; 3]) -> DVec3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// The weights of a point's projection on the triangle's plane, negative beside the triangle. Not finite if the triangle
/// has no area.
#[cfg(feature = "mesh")]
#[must_use]
pub fn barycentric_in_plane(triangle: &[DVec3; 3], point: DVec3) -> [f64; 3] {
    let normal = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]);
    let share = |k: usize| {
        let [from, to] = [triangle[(k + 1) % 3], triangle[(k + 2) % 3]];
        normal.dot((to - from).cross(point - from)) / normal.length_squared()
    };
    let [second, third] = [share(1), share(2)];
    [1.0 - second - third, second, third]
}

/// The weights of a point's projection on the triangle's plane, clamped to the triangle. A third each if the triangle
/// has no area or the point is infinite.
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
