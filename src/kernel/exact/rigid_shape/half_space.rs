//! Contacts of a triangle with a half-space: each vertex by its height.

use glam::DVec3;

use super::{
    super::{barycentric::corner_weights, feature::Feature},
    ShapeProximity,
};

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
