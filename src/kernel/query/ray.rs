//! Where a ray meets a triangle, without gaps between triangles that share an edge or a vertex.
//!
//! Woop, Benthin, and Wald 2013, Watertight Ray/Triangle Intersection: corners are sheared so that the ray becomes an axis,
//! and the signs of three edge functions in the plane across it decide. Each corner is rounded by itself, so triangles
//! that share it agree where it is. The difference of two rounded products has the right sign or is 0, and in that case
//! an exact predicate decides. So whether the ray meets a mesh is decided exactly, for corners that are off by the
//! rounding error of f64.

use glam::DVec3;
use robust::Coord;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayTriangleHit {
    /// In lengths of the direction. 0 or more.
    pub distance: f64,
    /// Weights of the corners, 0 or more. They sum to 1.
    pub barycentric: [f64; 3],
    /// Whether the corners are clockwise as seen along the ray.
    pub is_back_face: bool,
}

/// A ray, prepared for many triangles.
#[derive(Clone, Copy, Debug)]
pub struct WatertightRay {
    origin: DVec3,
    /// The axis of the largest component of the direction comes last.
    axes: [usize; 3],
    /// The other two components relative to the last, and the inverse of the last.
    shear: [f64; 3],
}

impl WatertightRay {
    /// `None` if the direction is 0 or a number is not finite.
    #[must_use]
    pub fn new(origin: DVec3, direction: DVec3) -> Option<Self> {
        let size = direction.abs();
        if !(origin.is_finite() && direction.is_finite() && size.max_element() > 0.0) {
            return None;
        }
        let last = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
        let (mut first, mut second) = ((last + 1) % 3, (last + 2) % 3);
        if direction[last] < 0.0 {
            // Keeps the winding.
            (first, second) = (second, first);
        }
        let along = direction[last];
        let shear = [direction[first] / along, direction[second] / along, along.recip()];
        shear[2].is_finite().then_some(Self { origin, axes: [first, second, last], shear })
    }

    /// A corner in the plane across the ray, and its distance along the ray.
    fn sheared(&self, corner: DVec3) -> (Coord<f64>, f64) {
        let [first, second, last] = self.axes;
        let from_origin = corner - self.origin;
        let along = from_origin[last];
        let x = from_origin[first] - self.shear[0] * along;
        let y = from_origin[second] - self.shear[1] * along;
        (Coord { x, y }, self.shear[2] * along)
    }

    /// Where the ray meets a triangle. Also on its border, so a ray through a shared edge or vertex meets all triangles
    /// there that are not parallel to it. `None` for triangles that are.
    #[must_use]
    pub fn hit(&self, corners: &[DVec3; 3]) -> Option<RayTriangleHit> {
        let [(a, along_a), (b, along_b), (c, along_c)] = corners.map(|corner| self.sheared(corner));
        let (u, v, w) = (turn(c, b), turn(a, c), turn(b, a));
        let is_back_face = u < 0.0 || v < 0.0 || w < 0.0;
        if is_back_face && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let area = u + v + w;
        if area == 0.0 {
            return None;
        }
        let barycentric = [u / area, v / area, w / area];
        let distance = barycentric[0] * along_a + barycentric[1] * along_b + barycentric[2] * along_c;
        (distance >= 0.0).then_some(RayTriangleHit { distance, barycentric, is_back_face })
    }
}

/// Twice the area of the triangle from the ray to two points, with the right sign. Changes only its sign if the points are
/// swapped.
fn turn(from: Coord<f64>, to: Coord<f64>) -> f64 {
    let rounded = from.x * to.y - from.y * to.x;
    if rounded == 0.0 { robust::orient2d(from, to, Coord { x: 0.0, y: 0.0 }) } else { rounded }
}
