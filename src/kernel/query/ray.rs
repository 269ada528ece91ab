//! Where a ray meets a triangle or a patch, without gaps between those that share an edge or a vertex.
//!
//! Woop, Benthin, and Wald 2013, Watertight Ray/Triangle Intersection: corners are sheared so that the ray becomes an axis,
//! and the signs of three edge functions in the plane across it decide. Each corner is rounded by itself, so triangles
//! that share it agree where it is. The difference of two rounded products has the right sign or is 0, and in that case
//! an exact predicate decides. So whether the ray meets a mesh is decided exactly, for corners that are off by the
//! rounding error of f64.
//!
//! Patches are halved where the ray may meet them, until they are as good as flat. All are halved equally often, and what
//! lies on an edge depends on nothing but that edge, so there are no gaps either.

use arrayvec::ArrayVec;
use glam::DVec3;
use robust::Coord;

use crate::kernel::{
    mesh::curved_edges::MOST_OF_EDGE,
    smooth::patch::{Patch, PatchPart},
};

/// How often each edge of a patch is halved. What is left is farther from its patch than its flat triangle by at most a
/// millionth of the height of the patch.
const HALVINGS: u32 = 10;

/// Boxes around parts of a patch are grown by this share of their coordinates, which is more than rounding moves a corner.
const PADDING: f64 = 64.0 * f64::EPSILON;

/// Hits of a patch from the same side are one if their weights differ by less than this: the ray passes between two parts.
const SAME: f64 = 4.0 / (1 << HALVINGS) as f64;

/// A line meets a quadratic patch at most four times.
const MOST_HITS: usize = 4;

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

    /// A vector, by its two components in the plane across the ray and its length along the ray.
    fn sheared(&self, vector: DVec3) -> DVec3 {
        let [first, second, last] = self.axes;
        let along = vector[last];
        DVec3::new(vector[first] - self.shear[0] * along, vector[second] - self.shear[1] * along, self.shear[2] * along)
    }

    /// Where the ray meets a triangle. Also on its border, so a ray through a shared edge or vertex meets all triangles
    /// there that are not parallel to it. `None` for triangles that are.
    #[must_use]
    pub fn hit(&self, corners: &[DVec3; 3]) -> Option<RayTriangleHit> {
        hit_of_axis(&corners.map(|corner| self.sheared(corner - self.origin)))
    }

    /// Where the ray meets a patch, in no order.
    #[must_use]
    pub fn patch_hits(&self, patch: &Patch) -> ArrayVec<RayTriangleHit, MOST_HITS> {
        let mut hits = ArrayVec::new();
        let sheared = Patch {
            corners: patch.corners.map(|corner| self.sheared(corner - self.origin)),
            offsets: patch.offsets.map(|offset| self.sheared(offset)),
        };
        add_hits_of_axis(&PatchPart::whole(sheared), 0, &mut hits);
        hits
    }
}

/// Adds where an axis, from the origin along z, meets a part of a patch.
fn add_hits_of_axis(part: &PatchPart, halvings: u32, hits: &mut ArrayVec<RayTriangleHit, MOST_HITS>) {
    if !may_meet_axis(&part.patch) {
        return;
    }
    if halvings < HALVINGS {
        for part in part.halved() {
            add_hits_of_axis(&part, halvings + 1, hits);
        }
        return;
    }
    let Some(hit) = hit_of_axis(&part.patch.corners) else { return };
    let barycentric = part.in_whole(&hit.barycentric);
    let is_known = |known: &RayTriangleHit| {
        let differ = (0..3).map(|corner| (known.barycentric[corner] - barycentric[corner]).abs());
        known.is_back_face == hit.is_back_face && differ.fold(0.0, f64::max) < SAME
    };
    if !hits.iter().any(is_known) {
        // More than four are rounding errors of a ray that lies in the patch.
        let _ = hits.try_push(RayTriangleHit { barycentric, ..hit });
    }
}

/// Whether the box around a patch contains a point of the axis.
fn may_meet_axis(Patch { corners: [a, b, c], offsets: [first, second, third] }: &Patch) -> bool {
    let most = f64::from(MOST_OF_EDGE);
    let low = a.min(*b).min(*c) + first.min(*second).min(*third).min(DVec3::ZERO) * most;
    let high = a.max(*b).max(*c) + first.max(*second).max(*third).max(DVec3::ZERO) * most;
    let padding = low.abs().max(high.abs()) * PADDING;
    let (low, high) = (low - padding, high + padding);
    low.x <= 0.0 && low.y <= 0.0 && high.x >= 0.0 && high.y >= 0.0 && high.z >= 0.0
}

/// Where an axis, from the origin along z, meets a triangle.
fn hit_of_axis(corners: &[DVec3; 3]) -> Option<RayTriangleHit> {
    let [a, b, c] = corners.map(|corner| Coord { x: corner.x, y: corner.y });
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
    let distance = barycentric[0] * corners[0].z + barycentric[1] * corners[1].z + barycentric[2] * corners[2].z;
    (distance >= 0.0).then_some(RayTriangleHit { distance, barycentric, is_back_face })
}

/// Twice the area of the triangle from the ray to two points, with the right sign. Changes only its sign if the points are
/// swapped.
fn turn(from: Coord<f64>, to: Coord<f64>) -> f64 {
    let rounded = from.x * to.y - from.y * to.x;
    if rounded == 0.0 { robust::orient2d(from, to, Coord { x: 0.0, y: 0.0 }) } else { rounded }
}
