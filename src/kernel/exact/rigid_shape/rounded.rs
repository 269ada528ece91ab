//! Contacts of a triangle with a ball or a capsule: the pair test with a triangle that is a point or a segment.

use glam::DVec3;

use super::{SUPPORT_SLACK, ShapeFoot, ShapeProximity};
use crate::kernel::{
    exact::triangle_pair::{PairProximity, examine_pair},
    mesh::{barycentric::point_at, feature::Feature, side::face_normal},
};

/// Both ends, and the segment between them.
pub(super) const FEATURES: usize = 3;

pub(super) fn examine(
    triangle: &[DVec3; 3],
    [start, end]: [DVec3; 2],
    radius: f64,
    range: f64,
    scratch: &mut PairProximity,
    found: &mut Vec<ShapeProximity>,
) {
    examine_pair(triangle, &[start, end, end], range + radius, scratch);
    let before = found.len();
    for proximity in &scratch.proximities {
        // The segment is a triangle whose third corner repeats the second, and a ball one with three equal corners.
        // Repeated features have the same number, and are taken once.
        let shape_feature = match proximity.features.b {
            _ if start == end => 0,
            Feature::Vertex(corner) => u32::from(corner.min(1)),
            _ => 2,
        };
        let feature = proximity.features.a;
        if found[before..].iter().any(|known| (known.feature, known.shape_feature) == (feature, shape_feature)) {
            continue;
        }
        let crossing = proximity.distance <= 0.0;
        // A separation that is too short to have a direction counts as none.
        let apart = if crossing { None } else { proximity.separation.try_normalize() };
        let normal = apart.unwrap_or_else(|| way_out(triangle, end - start));
        let axis_point = point_at(&[start, end, end], &proximity.barycentric_b);
        let slack = SUPPORT_SLACK * start.distance(end);
        if !crossing && [start, end].iter().any(|point| normal.dot(*point - axis_point) > slack) {
            continue;
        }
        found.push(ShapeProximity {
            feature,
            shape_feature,
            crossing: false,
            barycentric: proximity.barycentric_a,
            shape_point: axis_point + normal * radius,
            normal,
            distance: proximity.distance - radius,
        });
    }
}

/// The normal where a triangle cuts the axis: the triangle's normal; perpendicular to the axis if the triangle has no
/// area; upward for a ball.
fn way_out(triangle: &[DVec3; 3], axis: DVec3) -> DVec3 {
    let square = || axis.try_normalize().map(|axis| axis.any_orthonormal_vector());
    face_normal(triangle).try_normalize().or_else(square).unwrap_or(DVec3::Y)
}

/// The point of the axis that is closest to a point.
pub(super) fn foot(point: DVec3, [start, end]: [DVec3; 2]) -> DVec3 {
    let way = end - start;
    let squared = way.length_squared();
    if squared > 0.0 { start + way * ((point - start).dot(way) / squared).clamp(0.0, 1.0) } else { start }
}

/// The place on the surface that is closest to a point.
pub(super) fn shape_foot(point: DVec3, [start, end]: [DVec3; 2], radius: f64) -> ShapeFoot {
    let core = foot(point, [start, end]);
    let (away, axis) = (point - core, end - start);
    let distance = core.distance(point);
    let square = || axis.try_normalize().map_or(DVec3::Y, |axis| axis.any_orthonormal_vector());
    let normal = away.try_normalize().unwrap_or_else(square);
    let at_end = if start == end || core == start {
        Some(0)
    } else if core == end {
        Some(1)
    } else {
        None
    };
    let around = match at_end {
        Some(end) => ShapeFoot::around_point(distance, normal, end),
        None => ShapeFoot::around_edge(distance, normal, axis, 2),
    };
    around.bordered(radius)
}
