//! Conservative rejection of triangle pairs by the slabs along their normals.
//!
//! Both triangles are projected on a normal: where the intervals are farther apart than the range, so are the
//! triangles. A triangle's own corners are projected too, because rounding tilts a sliver's normal.

use glam::DVec3;

/// Intervals must be farther apart than the range by this factor before a pair is rejected: far above the rounding of
/// f64, far below any tolerance of a contact distance.
const RANGE_SLACK: f64 = 1.0 + 1.0e-9;

/// Whether the plane slabs of either triangle show that the two are farther apart than `range`. A triangle without
/// area shows nothing.
#[must_use]
pub fn planes_separate(a: &[DVec3; 3], b: &[DVec3; 3], range: f64) -> bool {
    slab_separates(a, b, range) || slab_separates(b, a, range)
}

fn slab_separates(own: &[DVec3; 3], other: &[DVec3; 3], range: f64) -> bool {
    let origin = own[0];
    let (u, v) = (own[1] - origin, own[2] - origin);
    let normal = u.cross(v);
    let own_heights = [0.0, normal.dot(u), normal.dot(v)];
    let other_heights = other.map(|corner| normal.dot(corner - origin));
    let low = |heights: [f64; 3]| heights[0].min(heights[1]).min(heights[2]);
    let high = |heights: [f64; 3]| heights[0].max(heights[1]).max(heights[2]);
    let gap = (low(other_heights) - high(own_heights)).max(low(own_heights) - high(other_heights));
    gap > 0.0 && gap * gap > (range * RANGE_SLACK) * (range * RANGE_SLACK) * normal.length_squared()
}
