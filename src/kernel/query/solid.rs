//! Where a line passes through a solid, or a ball that moves along it touches one.
//!
//! The signed distance of a point from a convex solid is a convex function along a line. Newton's method therefore comes
//! closer to the first root from the left, and to the second from the right, without passing them. A compound is the union
//! of what its parts contain.

use glam::DVec3;

use crate::kernel::exact::rigid_shape::ShapeGeometry;

/// The most steps. Each doubles the number of right digits, but where a line only grazes a solid it adds one bit.
const STEPS: usize = 64;

/// Distances below this, relative to the coordinates of the point, are 0.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A line in the frame of a solid.
#[derive(Clone, Copy, Debug)]
pub struct SolidLine {
    /// Its point at 0.
    pub origin: DVec3,
    /// From there to its point at 1.
    pub direction: DVec3,
    /// The radius of a ball that moves along it. 0 for a ray.
    pub radius: f64,
}

/// The part of a line within a solid, by its two ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Where the line enters.
    pub enter: f64,
    /// Where it leaves. Infinite in a half-space.
    pub leave: f64,
}

impl SolidLine {
    fn at(&self, place: f64) -> DVec3 {
        self.origin + self.direction * place
    }

    /// The parts of the line within a solid, in order and apart from each other.
    #[must_use]
    pub fn spans(&self, shape: &ShapeGeometry) -> Vec<Span> {
        let mut spans: Vec<Span> = Vec::new();
        shape.for_each_part(&mut |part, into_part| {
            let line = Self {
                origin: into_part.transform_point3(self.origin),
                direction: into_part.transform_vector3(self.direction),
                radius: self.radius,
            };
            spans.extend(line.span(part));
        });
        spans.sort_unstable_by(|one, other| one.enter.total_cmp(&other.enter));
        spans.dedup_by(|later, earlier| {
            let overlap = later.enter <= earlier.leave;
            if overlap {
                earlier.leave = earlier.leave.max(later.leave);
            }
            overlap
        });
        spans
    }

    /// The part of the line within a convex solid.
    fn span(&self, part: &ShapeGeometry) -> Option<Span> {
        if let ShapeGeometry::HalfSpace { normal } = part {
            let (height, rise) = (normal.dot(self.origin) - self.radius, normal.dot(self.direction));
            let crossing = -height / rise;
            return if rise < 0.0 {
                Some(Span { enter: crossing, leave: f64::INFINITY })
            } else if rise > 0.0 {
                Some(Span { enter: f64::NEG_INFINITY, leave: crossing })
            } else {
                (height <= 0.0).then_some(Span { enter: f64::NEG_INFINITY, leave: f64::INFINITY })
            };
        }
        let bounds = part.bounds()?;
        let center = (bounds.min.as_dvec3() + bounds.max.as_dvec3()) * 0.5;
        // The solid is within this distance of the middle of its box.
        let reach = (bounds.max.as_dvec3() - center).length() + self.radius;
        let squared = self.direction.length_squared();
        let middle = (center - self.origin).dot(self.direction) / squared;
        if self.at(middle).distance_squared(center) > reach * reach {
            return None;
        }
        // Positions along the line are measured from here, so that a far origin costs no precision.
        let near = Self { origin: self.at(middle), ..*self };
        let end = reach * (1.0 + 1.0e-6) / squared.sqrt();
        let enter = near.root(part, -end, 1.0)?;
        let leave = near.root(part, end, -1.0)?;
        (enter <= leave).then_some(Span { enter: middle + enter, leave: middle + leave })
    }

    /// The first root of the distance from `start` on, forward or backward. `start` is outside.
    fn root(&self, part: &ShapeGeometry, start: f64, forward: f64) -> Option<f64> {
        let mut place = start;
        for _ in 0..STEPS {
            let point = self.at(place);
            let foot = part.foot(point);
            let height = foot.distance - self.radius;
            if height <= ROUNDING * (point.abs().max_element() + self.radius) {
                return Some(place);
            }
            let sinking = -foot.normal.dot(self.direction) * forward;
            // From here on the line only rises.
            if sinking <= 0.0 {
                return None;
            }
            let next = place + forward * height / sinking;
            if next == place {
                return Some(place);
            }
            if (next - start).abs() > 2.0 * start.abs() {
                return None;
            }
            place = next;
        }
        // It grazes the solid, or misses it by next to nothing.
        None
    }

    /// The unit normal out of a solid at a place of the line on its surface.
    #[must_use]
    pub fn outward(&self, shape: &ShapeGeometry, place: f64) -> DVec3 {
        shape.foot(self.at(place)).normal
    }
}

/// The signed distance of a point from a solid, negative inside, and the closest point of its surface.
#[must_use]
pub fn closest_on_solid(shape: &ShapeGeometry, point: DVec3) -> (f64, DVec3) {
    let foot = shape.foot(point);
    (foot.distance, point - foot.normal * foot.distance)
}
