//! Contacts of a triangle with a half-space, by the height of each vertex, and a triangle that represents its boundary.

use std::sync::{Arc, LazyLock};

use glam::{DVec3, Vec3};

use super::ShapeProximity;
use crate::kernel::mesh::{barycentric::corner_weights, feature::Feature, topology::SurfaceTopology};

/// A triangle in the boundary of the half-space below `normal`. It contains a circle of the given radius, centered
/// below `point`.
pub(crate) fn boundary_triangle(normal: DVec3, point: DVec3, radius: f64) -> [DVec3; 3] {
    let center = point - normal * normal.dot(point);
    let (u, v) = normal.any_orthonormal_pair();
    let root = 0.75_f64.sqrt();
    let thirds = [(1.0, 0.0), (-0.5, root), (-0.5, -root)];
    // The corners are twice as far from the center as the sides.
    thirds.map(|(cosine, sine)| center + (u * cosine + v * sine) * (2.0 * radius))
}

/// The topology of [`boundary_triangle`].
pub(crate) fn boundary_topology() -> &'static Arc<SurfaceTopology> {
    static ONE_TRIANGLE: LazyLock<Arc<SurfaceTopology>> = LazyLock::new(|| {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        Arc::new(SurfaceTopology::new(&corners, &[[0, 1, 2]]).expect("three finite corners make a triangle"))
    });
    &ONE_TRIANGLE
}

pub(super) fn examine(triangle: &[DVec3; 3], normal: DVec3, range: f64, found: &mut Vec<ShapeProximity>) {
    for (vertex, &position) in triangle.iter().enumerate() {
        let distance = normal.dot(position);
        if distance <= range {
            found.push(ShapeProximity {
                feature: Feature::Vertex(vertex as u8),
                shape_feature: 0,
                crossing: false,
                barycentric: corner_weights(vertex),
                shape_point: position - normal * distance,
                normal,
                distance,
            });
        }
    }
}
