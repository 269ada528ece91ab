//! The volume that a surface encloses.

use glam::DVec3;

/// The volume that triangles enclose, in the unit of the points, cubed. Negative if they are wound clockwise as seen from
/// outside. Depends on where the points are if the triangles do not close.
#[must_use]
pub fn enclosed_volume(points: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let origin = points.first().copied().unwrap_or_default();
    let corner = |vertex: u32| points[vertex as usize] - origin;
    let six_times: f64 = triangles.iter().map(|&[a, b, c]| corner(a).dot(corner(b).cross(corner(c)))).sum();
    six_times / 6.0
}
