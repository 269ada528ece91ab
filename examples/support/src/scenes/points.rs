//! Vector arithmetic in `f64`, for scenes that are computed in double precision and stored in `f32` at the end.
//!
//! Rotations are unit quaternions in the order x, y, z, w.

/// A point or a vector.
pub(super) type Point = [f64; 3];

/// `a + factor * b`.
pub(super) fn advance(a: Point, factor: f64, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] + factor * b[axis])
}

/// `a - b`.
pub(super) fn subtract(a: Point, b: Point) -> Point {
    advance(a, -1.0, b)
}

/// Interpolates from `a` to `b`.
pub(super) fn between(a: Point, b: Point, share: f64) -> Point {
    advance(a, share, subtract(b, a))
}

/// The dot product.
pub(super) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The cross product.
pub(super) fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Normalizes a vector that is not zero.
pub(super) fn unit(a: Point) -> Point {
    let length = dot(a, a).sqrt();
    a.map(|coordinate| coordinate / length)
}

/// The shortest rotation from the y axis to the unit vector `direction`, which must not be −y.
pub(super) fn rotation_from_y(direction: Point) -> [f64; 4] {
    let [x, y, z] = direction;
    // The axis is y × direction. The half angle comes from the sum of both vectors.
    let quaternion = [z, 0.0, -x, 1.0 + y];
    let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
    quaternion.map(|part| part / length)
}

/// Rotates `point` by a unit quaternion.
pub(super) fn rotate([x, y, z, w]: [f64; 4], point: Point) -> Point {
    let axis = [x, y, z];
    let twice = cross(axis, point).map(|coordinate| 2.0 * coordinate);
    let turned = cross(axis, twice);
    std::array::from_fn(|axis| point[axis] + w * twice[axis] + turned[axis])
}

/// The rotation by the unit quaternion `second`, followed by `first`.
pub(super) fn product(first: [f64; 4], second: [f64; 4]) -> [f64; 4] {
    let [a, b] = [first, second].map(|[x, y, z, _]| [x, y, z]);
    let turned = advance(advance(cross(a, b), first[3], b), second[3], a);
    let scalar = first[3] * second[3] - (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
    [turned[0], turned[1], turned[2], scalar]
}

/// From 0 at `from` to 1 at `to`, constant outside, with two continuous derivatives.
pub(super) fn ease(from: f64, to: f64, moment: f64) -> f64 {
    let share = ((moment - from) / (to - from)).clamp(0.0, 1.0);
    share * share * share * (10.0 + share * (6.0 * share - 15.0))
}
