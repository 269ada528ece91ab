//! When a ball that moves in a straight line first touches a triangle.
//!
//! The center of the ball meets the surface at the distance of its radius: two planes over the face, cylinders around the
//! edges, and balls around the corners.

use glam::DVec3;

use super::closest::closest_on_triangle;

/// When a ball with `center` and `radius`, which moves along `direction`, first comes within its radius of a triangle: in
/// lengths of the direction, from 0 to `range`. 0 if it touches at the start. `None` if it does not.
#[must_use]
pub fn cast_ball(corners: &[DVec3; 3], center: DVec3, radius: f64, direction: DVec3, range: f64) -> Option<f64> {
    let from_center = corners.map(|corner| corner - center);
    if closest_on_triangle(&from_center, DVec3::ZERO).point.length_squared() <= radius * radius {
        return Some(0.0);
    }
    let mut first = f64::INFINITY;
    let edge = |k: usize| from_center[(k + 1) % 3] - from_center[k];
    let normal = edge(0).cross(edge(1));
    if let Some(unit) = normal.try_normalize() {
        let (height, sinking) = (unit.dot(from_center[0]), unit.dot(direction));
        // On the side where the center is.
        let time = (height - radius.copysign(height)) / sinking;
        if time >= 0.0 {
            let foot = direction * time + unit.dot(from_center[0] - direction * time) * unit;
            let is_inside = (0..3).all(|k| normal.dot(edge(k).cross(foot - from_center[k])) >= 0.0);
            if is_inside {
                first = time;
            }
        }
    }
    for k in 0..3 {
        // Relative to the corner, where the coordinates are small.
        let (start, along) = (-from_center[k], edge(k));
        if let Some(time) = first_root(start, direction, radius) {
            first = first.min(time);
        }
        let squared = along.length_squared();
        if squared > 0.0 {
            let across = |vector: DVec3| vector - along * (vector.dot(along) / squared);
            if let Some(time) = first_root(across(start), across(direction), radius) {
                let place = (start + direction * time).dot(along);
                if (0.0..=squared).contains(&place) {
                    first = first.min(time);
                }
            }
        }
    }
    (first <= range).then_some(first)
}

/// When `start + t · direction` first has the length `radius`, from outside.
fn first_root(start: DVec3, direction: DVec3, radius: f64) -> Option<f64> {
    let (a, b) = (direction.length_squared(), start.dot(direction));
    if !(a > 0.0 && b < 0.0) {
        return None;
    }
    // The least distance, which is better conditioned than the discriminant.
    let passing = start - direction * (b / a);
    let half_chord = radius * radius - passing.length_squared();
    if half_chord < 0.0 {
        return None;
    }
    let time = -b / a - (half_chord / a).sqrt();
    (time >= 0.0).then_some(time)
}
