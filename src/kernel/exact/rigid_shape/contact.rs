//! The record of a contact with a shape that is tested by formula.

use super::ShapeProximity;
use crate::kernel::{
    contact::{CompactContact, ContactKey, feature_number},
    mesh::feature::{Feature, FeaturePair},
    pair::SurfaceSide,
};

impl CompactContact {
    /// Creates a contact with a shape that is tested by formula. `scale` is the world length of one unit of the shape's
    /// frame.
    #[doc(hidden)]
    #[must_use]
    pub fn with_shape(side: &SurfaceSide<'_>, triangle: u32, proximity: &ShapeProximity, scale: f64) -> Self {
        let features = FeaturePair {
            a: proximity.feature,
            // The kinds of both features mark a crossing: an edge of the triangle or of the shape pierces a face. An
            // edge that is only close to the shape counts as close to an edge of it.
            b: match (proximity.crossing, proximity.feature) {
                (true, Feature::Face) | (false, Feature::Edge(_)) => Feature::Edge(0),
                _ => Feature::Face,
            },
        };
        let number = feature_number(side.topology, side.own_positions(), triangle, proximity.feature);
        Self {
            key: ContactKey::new(features, number, proximity.shape_feature),
            swapped: false,
            is_shared: !matches!(proximity.feature, Feature::Face),
            triangle_a: triangle,
            triangle_b: proximity.shape_feature,
            features,
            barycentric_a: [proximity.barycentric[0] as f32, proximity.barycentric[1] as f32],
            barycentric_b: [0.0; 2],
            point_b: proximity.shape_point.as_vec3(),
            normal: -proximity.normal.as_vec3(),
            distance: (proximity.distance * scale) as f32,
        }
    }
}
