//! The place on the surface of a shape that is closest to a point.

use glam::{DQuat, DVec3};

use super::{ShapeGeometry, ShapeProximity};

/// The place on the surface of a shape that is closest to a point: the signed distance of the point, with its
/// derivatives.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct ShapeFoot {
    /// Signed distance of the point, negative inside.
    pub(in crate::kernel) distance: f64,
    /// Unit vector out of the shape: the gradient of the distance.
    pub(in crate::kernel) normal: DVec3,
    /// The feature of the shape.
    pub(in crate::kernel) shape_feature: u32,
    /// The second derivatives of the distance: the sum of the outer products of these vectors with themselves. Each is
    /// a principal direction at the point, times the square root of the curvature. A convex shape has none below 0.
    pub(in crate::kernel) bends: [DVec3; 2],
}

impl ShapeFoot {
    /// Where the surface of distance is flat.
    pub(super) const fn flat(distance: f64, normal: DVec3, shape_feature: u32) -> Self {
        Self { distance, normal, shape_feature, bends: [DVec3::ZERO; 2] }
    }

    /// At a distance from a corner.
    pub(super) fn around_point(distance: f64, normal: DVec3, shape_feature: u32) -> Self {
        let (first, second) = normal.any_orthonormal_pair();
        let bend = root_of_curvature(distance);
        Self { bends: [first * bend, second * bend], ..Self::flat(distance, normal, shape_feature) }
    }

    /// At a distance from a straight edge.
    pub(super) fn around_edge(distance: f64, normal: DVec3, edge: DVec3, shape_feature: u32) -> Self {
        let across = normal.cross(edge).normalize_or_zero();
        let bends = [across * root_of_curvature(distance), DVec3::ZERO];
        Self { bends, ..Self::flat(distance, normal, shape_feature) }
    }

    /// With a border around the shape.
    pub(super) const fn bordered(self, border: f64) -> Self {
        Self { distance: self.distance - border, ..self }
    }

    pub(super) fn turned(self, rotation: DQuat) -> Self {
        let [first, second] = self.bends;
        Self { normal: rotation * self.normal, bends: [rotation * first, rotation * second], ..self }
    }
}

/// The square root of the curvature of a circle. 0 if it has no radius.
pub(super) fn root_of_curvature(radius: f64) -> f64 {
    if radius > 0.0 { radius.sqrt().recip() } else { 0.0 }
}

impl ShapeGeometry {
    /// A contact inside the shape that leads out of the whole shape. `None` if there is no way. `point` is its place on the
    /// triangle or patch.
    pub(in crate::kernel) fn led_out(&self, point: DVec3, proximity: ShapeProximity) -> Option<ShapeProximity> {
        match self {
            Self::Compound(compound) => compound.out_of_all(point, proximity),
            _ => Some(proximity),
        }
    }

    /// The place on the surface that is closest to a point.
    pub(in crate::kernel) fn foot(&self, point: DVec3) -> ShapeFoot {
        match self {
            Self::Rounded { start, end, radius } => super::rounded::shape_foot(point, [*start, *end], *radius),
            Self::HalfSpace { normal } => ShapeFoot::flat(normal.dot(point), *normal, 0),
            Self::Polytope(polytope) => polytope.foot(point),
            Self::Convex(frustum) => frustum.shape_foot(point),
            Self::Compound(compound) => compound.foot(point),
        }
    }
}
