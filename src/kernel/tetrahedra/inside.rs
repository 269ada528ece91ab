//! Whether a tetrahedron contains a point, decided by exact signs, and the point's barycentric weights.

use glam::DVec3;
use robust::{Coord3D, orient3d};

/// Six times the signed volume of a tetrahedron: positive if `b`, `c`, and `d` are counter-clockwise as seen from
/// outside, opposite `a`. The sign is exact for coordinates that come from f32, and the value is rounded.
#[must_use]
pub fn signed_volume([a, b, c, d]: &[DVec3; 4]) -> f64 {
    let coordinates = |point: &DVec3| Coord3D { x: point.x, y: point.y, z: point.z };
    -orient3d(coordinates(a), coordinates(b), coordinates(c), coordinates(d))
}

/// The barycentric weights of a point in a tetrahedron, or `None` if it is outside. A point on a face is inside.
///
/// The winding of the tetrahedron does not matter. One without volume contains nothing. All weights are 0 or more and
/// sum to 1 within rounding. A weight is exactly 0 if and only if the point is in the plane of the opposite face.
#[must_use]
pub fn barycentric_inside(corners: &[DVec3; 4], point: DVec3) -> Option<[f64; 4]> {
    let mut volumes = [0.0; 4];
    let (mut positive, mut negative) = (false, false);
    for (corner, volume) in volumes.iter_mut().enumerate() {
        let mut part = *corners;
        part[corner] = point;
        *volume = signed_volume(&part);
        positive |= *volume > 0.0;
        negative |= *volume < 0.0;
        if positive && negative {
            return None;
        }
    }
    // The parts add up to the whole. If all are 0, so is the tetrahedron.
    if !positive && !negative {
        return None;
    }
    // The largest is divided out first, so that the sum neither overflows nor becomes 0.
    let largest = volumes.iter().fold(0.0, |largest: f64, volume| largest.max(volume.abs()));
    let shares = volumes.map(|volume| volume.abs() / largest);
    let sum: f64 = shares.iter().sum();
    Some(shares.map(|share| share / sum))
}
