//! Whether a box overlaps a triangle, by thirteen separating axes (Akenine-Möller 2001).

use glam::DVec3;

/// Whether a closed box around the origin, with these half sides, shares a point with a triangle.
#[must_use]
pub fn box_overlaps_triangle(half_extents: DVec3, corners: &[DVec3; 3]) -> bool {
    let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
    let is_apart = |axis: DVec3| {
        let [a, b, c] = corners.map(|corner| axis.dot(corner));
        let reach = axis.abs().dot(half_extents);
        a.min(b).min(c) > reach || a.max(b).max(c) < -reach
    };
    let sides = DVec3::AXES;
    let is_separated = sides.into_iter().any(is_apart)
        || is_apart(edges[0].cross(edges[1]))
        || edges.iter().any(|edge| sides.iter().any(|side| is_apart(side.cross(*edge))));
    !is_separated
}
