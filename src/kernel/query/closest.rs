//! The point of a triangle or patch that is closest to another point.

use glam::DVec3;

use crate::kernel::{
    exact::rigid_shape::ShapeGeometry,
    mesh::{
        barycentric::{barycentric_of, corner_weights, edge_weights},
        feature::Feature,
        side::closest_feature,
    },
    smooth::{on_shape::PatchScratch, patch::Patch},
};

/// The point of a triangle that is closest to another point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestOnTriangle {
    /// The point.
    pub point: DVec3,
    /// Weights of the corners, 0 or more. They sum to 1.
    pub barycentric: [f64; 3],
    /// The smallest feature that contains it.
    pub feature: Feature,
}

/// The point of a triangle that is closest to `point`.
#[must_use]
pub fn closest_on_triangle(corners: &[DVec3; 3], point: DVec3) -> ClosestOnTriangle {
    let (feature, closest) = closest_feature(corners, point);
    let barycentric = match feature {
        Feature::Vertex(corner) => corner_weights(corner as usize),
        Feature::Edge(edge) => {
            let edge = edge as usize;
            let (start, along) = (corners[edge], corners[(edge + 1) % 3] - corners[edge]);
            edge_weights(edge, ((closest - start).dot(along) / along.length_squared()).clamp(0.0, 1.0))
        }
        Feature::Face => barycentric_of(corners, closest),
    };
    ClosestOnTriangle { point: closest, barycentric, feature }
}

/// The point of a patch that is closest to `point`. `None` if it is farther away than `range`.
pub fn closest_on_patch(
    patch: &Patch,
    point: DVec3,
    range: f64,
    scratch: &mut PatchScratch,
) -> Option<ClosestOnTriangle> {
    let on_triangle = closest_on_triangle(&patch.corners, point).point.distance(point);
    let height = patch.height();
    if on_triangle - height > range {
        return None;
    }
    let at = ShapeGeometry::Rounded { start: point, end: point, radius: 0.0 };
    // In range for certain, and finite.
    let closest = scratch.closest(patch, &at, on_triangle + height)?;
    (closest.distance <= range).then(|| ClosestOnTriangle {
        point: patch.point(&closest.barycentric),
        barycentric: closest.barycentric,
        feature: closest.feature,
    })
}
