//! Finds what separates two sets of moving points for a whole step, from both ends of the step alone.
//!
//! Tested for triangles, then for features, before the search for a time of impact: most candidates of the boxes pass
//! each other at a distance. Points that move in straight lines, and their convex hulls, stay on one side of a plane at
//! rest if they are there at both ends. Likewise, along an axis, their differences stay on one side of the origin.

use glam::DVec3;

use super::advance::{HEIGHT_ERROR, LENGTH_SLACK};

/// Whether the hulls of two sets of points certainly stay more than `separation` apart from the start of a step, `[0]`,
/// to its end: along a coordinate axis, or on both sides of a plane between their means where these come closest.
pub(super) fn stay_apart<const A: usize, const B: usize>(
    a: [&[DVec3; A]; 2],
    b: [&[DVec3; B]; 2],
    separation: f64,
) -> bool {
    let [start, end] = [0, 1].map(|time| Differences::new(a[time], b[time]));
    let (low, high) = (start.low.min(end.low), start.high.max(end.high));
    // The coordinates of differences, and of each set relative to one of its points, are at most twice the largest.
    let within = separation * LENGTH_SLACK + 2.0 * HEIGHT_ERROR * low.abs().max(high.abs()).max_element();
    if low.max(-high).max_element() > within {
        return true;
    }
    let way = end.middle - start.middle;
    let squared = way.length_squared();
    let time = if squared > 0.0 { (-start.middle.dot(way) / squared).clamp(0.0, 1.0) } else { 0.0 };
    let normal = start.middle + way * time;
    let gap = |time: usize| {
        let origin = b[time][0];
        let height = |point: &DVec3| normal.dot(*point - origin);
        let lowest = a[time].iter().map(height).fold(f64::INFINITY, f64::min);
        lowest - b[time][1..].iter().map(height).fold(0.0, f64::max)
    };
    gap(0).min(gap(1)) > within * normal.length()
}

/// Like [`stay_apart`], for two triangles with one common vertex. `a` and `b` are their other corners relative to it,
/// at both ends. No pair of features without the common vertex comes closer than `separation` if these corners are on
/// different sides of a plane through it, and the features of one side are away from it.
pub(super) fn stay_apart_about_vertex(a: [[DVec3; 2]; 2], b: [[DVec3; 2]; 2], separation: f64) -> bool {
    let corners = || a.as_flattened().iter().chain(b.as_flattened());
    let sum = |corners: [[DVec3; 2]; 2]| corners.as_flattened().iter().sum::<DVec3>();
    let normal = sum(a) - sum(b);
    let largest = corners().fold(DVec3::ZERO, |largest, corner| largest.max(corner.abs())).max_element();
    let within = (separation * LENGTH_SLACK + HEIGHT_ERROR * largest) * normal.length();
    a.as_flattened().iter().all(|corner| normal.dot(*corner) > within)
        && b.as_flattened().iter().all(|corner| normal.dot(*corner) < -within)
}

/// The extent of the differences between the points of two sets at one time.
struct Differences {
    low: DVec3,
    high: DVec3,
    middle: DVec3,
}

impl Differences {
    fn new<const A: usize, const B: usize>(a: &[DVec3; A], b: &[DVec3; B]) -> Self {
        let ((low_a, high_a, middle_a), (low_b, high_b, middle_b)) = (span(a), span(b));
        Self { low: low_a - high_b, high: high_a - low_b, middle: middle_a - middle_b }
    }
}

/// The box of some points, and their mean.
fn span<const COUNT: usize>(points: &[DVec3; COUNT]) -> (DVec3, DVec3, DVec3) {
    let (mut low, mut high, mut sum) = (points[0], points[0], points[0]);
    for &point in &points[1..] {
        (low, high, sum) = (low.min(point), high.max(point), sum + point);
    }
    (low, high, sum * (1.0 / COUNT as f64))
}
