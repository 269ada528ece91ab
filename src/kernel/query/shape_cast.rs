//! When a solid that moves in a straight line first touches a triangle.
//!
//! The distance of two convex bodies is a convex function of the way that one of them has moved, so Newton's method comes
//! closer to the first contact without passing it. Everything is in the frame of the solid, to which the triangle moves.

use glam::DVec3;

use crate::kernel::{
    exact::{
        PairProximity,
        rigid_shape::{ShapeGeometry, ShapeProximity},
    },
    smooth::{on_shape::PatchScratch, patch::Patch},
};

/// The most steps. Between flat faces one is enough.
const STEPS: usize = 64;

/// The most steps towards a patch.
const PATCH_STEPS: usize = 256;

/// A patch may be this much closer at another place than at the one that was found, relative to the coordinates.
const PATCH_SLACK: f64 = 4.0e-3;

/// Distances of patches below this, relative to the coordinates, are 0.
const PATCH_ROUNDING: f64 = 1.0e-7;

/// Distances below this, relative to the coordinates, are 0.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Where a moving solid meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidTriangleHit {
    /// How far the triangle has moved, in lengths of its direction.
    pub distance: f64,
    /// Where they meet, in the frame of the solid.
    pub point: DVec3,
    /// Unit vector out of the solid there.
    pub normal: DVec3,
}

/// Memory for tests of triangles and solids.
#[derive(Default)]
pub struct SolidScratch {
    pair: PairProximity,
    found: Vec<ShapeProximity>,
    of_patch: PatchScratch,
}

impl SolidScratch {
    /// Where a solid is closest to a triangle, or deepest in it. `None` if they are farther apart than `range`.
    fn closest(&mut self, solid: &ShapeGeometry, corners: &[DVec3; 3], range: f64) -> Option<ShapeProximity> {
        self.found.clear();
        solid.examine(corners, range, &mut self.pair, &mut self.found);
        self.found.iter().min_by(|one, other| one.distance.total_cmp(&other.distance)).copied()
    }

    /// Whether a solid comes within `radius` of a triangle.
    pub fn overlaps(&mut self, solid: &ShapeGeometry, corners: &[DVec3; 3], radius: f64) -> bool {
        self.found.clear();
        solid.examine(corners, radius, &mut self.pair, &mut self.found) <= radius
    }

    /// Whether a solid shares a point with a patch.
    pub fn overlaps_patch(&mut self, solid: &ShapeGeometry, patch: &Patch) -> bool {
        if patch.is_flat() { self.overlaps(solid, &patch.corners, 0.0) } else { self.of_patch.overlaps(patch, solid) }
    }

    /// When a patch that moves along `direction` first meets a solid, up to `range` lengths of the direction.
    ///
    /// It begins where the triangle comes within the height of the patch, and moves on by as much as both are apart, which
    /// never passes a contact.
    pub fn cast_patch(
        &mut self,
        solid: &ShapeGeometry,
        patch: &Patch,
        direction: DVec3,
        range: f64,
    ) -> Option<SolidTriangleHit> {
        let height = patch.height();
        let start = self.cast(solid, &patch.corners, height, direction, range)?;
        if patch.is_flat() {
            return Some(start);
        }
        if start.distance == 0.0 && self.of_patch.overlaps(patch, solid) {
            return Some(start);
        }
        let mut moved = start.distance;
        let (bounds, speed) = (solid.bounds()?, direction.length());
        let reach = bounds.min.abs().max(bounds.max.abs()).as_dvec3().length();
        let size = patch.corners.iter().fold(reach, |size, corner| size.max((*corner - patch.corners[0]).length()));
        // Both have parted for good once they have passed each other.
        let farthest = 2.0 * (2.0 * size + reach + height);
        let last = range.min(moved + farthest / speed);
        // Where they touch, the direction between them is no longer known, but the last one before is.
        let mut last_normal = start.normal;
        let mut clear = moved;
        for _ in 0..PATCH_STEPS {
            let way = direction * moved;
            let at = Patch { corners: patch.corners.map(|corner| corner + way), offsets: patch.offsets };
            let closest = self.of_patch.closest_of_all(&at, solid, farthest, PATCH_SLACK * size)?;
            let rounding = PATCH_ROUNDING * size;
            if closest.distance > rounding {
                if closest.normal.dot(direction) < 0.0 {
                    last_normal = closest.normal;
                }
                clear = moved;
                moved += closest.distance / speed;
            } else if closest.distance < -rounding && moved > clear {
                // Another place was closer.
                moved = 0.5 * (clear + moved);
            } else {
                return Some(SolidTriangleHit { distance: moved, point: closest.shape_point, normal: last_normal });
            }
            if clear > last {
                return None;
            }
        }
        // It grazes the patch, or misses it by next to nothing.
        None
    }

    /// When a triangle that moves along `direction` first comes within `radius` of a solid, up to `range` lengths of the
    /// direction.
    pub fn cast(
        &mut self,
        solid: &ShapeGeometry,
        corners: &[DVec3; 3],
        radius: f64,
        direction: DVec3,
        range: f64,
    ) -> Option<SolidTriangleHit> {
        let mut first: Option<SolidTriangleHit> = None;
        solid.for_each_part(&mut |part, into_part| {
            let corners = corners.map(|corner| into_part.transform_point3(corner));
            let range = first.map_or(range, |first| first.distance);
            let hit = self.cast_at_part(part, &corners, radius, into_part.transform_vector3(direction), range);
            if let Some(hit) = hit.filter(|hit| first.is_none_or(|first| hit.distance < first.distance)) {
                let back = into_part.inverse();
                let (point, normal) = (back.transform_point3(hit.point), back.transform_vector3(hit.normal));
                first = Some(SolidTriangleHit { point, normal, ..hit });
            }
        });
        first
    }

    fn cast_at_part(
        &mut self,
        part: &ShapeGeometry,
        corners: &[DVec3; 3],
        radius: f64,
        direction: DVec3,
        range: f64,
    ) -> Option<SolidTriangleHit> {
        let bounds = part.bounds()?;
        let reach = bounds.min.abs().max(bounds.max.abs()).as_dvec3().length();
        // Where they touch, the direction between them is no longer known, but the last one before is.
        let mut last_normal = None;
        let mut moved = 0.0;
        for _ in 0..STEPS {
            let at = corners.map(|corner| corner + direction * moved);
            let farthest = at.iter().fold(0.0_f64, |farthest, corner| farthest.max(corner.length()));
            let closest = self.closest(part, &at, 2.0 * (farthest + reach))?;
            let gap = closest.distance - radius;
            let normal = last_normal.unwrap_or(closest.normal);
            let hit = SolidTriangleHit { distance: moved, point: closest.shape_point, normal };
            if gap <= ROUNDING * (farthest + reach + radius) {
                return Some(hit);
            }
            let approach = -closest.normal.dot(direction);
            // From here on they only part.
            if approach <= 0.0 {
                return None;
            }
            let next = moved + gap / approach;
            if next > range {
                return None;
            }
            if next == moved {
                return Some(hit);
            }
            (moved, last_normal) = (next, Some(closest.normal));
        }
        // It grazes the triangle, or misses it by next to nothing.
        None
    }
}
