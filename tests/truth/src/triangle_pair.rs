//! Distance and closest features of two triangles in f64.
//!
//! Each closest point is the minimum over explicit candidates: the boundary cases and, if there is an interior
//! solution, the solution of the least-squares problem by Gram–Schmidt orthogonalization with one reorthogonalization
//! (Björck, "Numerical Methods for Least Squares Problems", 1996, section 2.4). That solution is exact for an input
//! moved by a few units in the last place, and a distance changes by no more than its input moves. So every distance is
//! accurate to a few 1e-16 of the pair's extent, even for slivers and nearly parallel edges. Every reported distance is
//! between two explicit points of the features, so it is never too small by more than that.

use super::triangle_crossing::triangles_cross;
use glam::DVec3;

/// The point of a segment closest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSegment {
    /// Position along the segment: 0 at its first end, 1 at its second. 0 if the segment has no length.
    pub parameter: f64,
    /// The closest point.
    pub point: DVec3,
    /// Distance between the two points.
    pub distance: f64,
}

/// The closest points of two segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentSegment {
    /// Position along the first segment, in 0…1.
    pub parameter_a: f64,
    /// Position along the second segment, in 0…1.
    pub parameter_b: f64,
    /// The closest point of the first segment.
    pub point_a: DVec3,
    /// The closest point of the second segment.
    pub point_b: DVec3,
    /// Distance between the two points.
    pub distance: f64,
}

/// The point of a triangle closest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointTriangle {
    /// Weights of the triangle's vertices. None is negative, and the sum is 1 up to rounding.
    pub barycentric: [f64; 3],
    /// The closest point.
    pub point: DVec3,
    /// Distance between the two points.
    pub distance: f64,
}

/// One of the two triangles of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriangleSide {
    /// The first triangle.
    A,
    /// The second triangle.
    B,
}

/// Which features of two triangles are closest to each other.
///
/// Edge k of a triangle runs from its vertex k to its vertex (k + 1) mod 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClosestKind {
    /// A vertex of one triangle and the face of the other.
    VertexFace {
        /// The triangle that owns the vertex.
        vertex_of: TriangleSide,
        /// The vertex within its triangle, 0…2.
        vertex: usize,
    },
    /// An edge of each triangle.
    EdgeEdge {
        /// The edge of the first triangle, 0…2.
        edge_a: usize,
        /// The edge of the second triangle, 0…2.
        edge_b: usize,
    },
    /// The triangles share a point anywhere (decided exactly).
    Crossing,
}

/// The closest points of two triangles and the features they lie on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestFeatures {
    /// Distance of the triangles. Exactly 0 if they cross. Otherwise it is 0 only if it is lost in rounding (below
    /// 1e-15 of the pair's extent). `kind` distinguishes the two cases.
    pub distance: f64,
    /// The features. If several are equally close, such as two vertices, the first in this order: vertices of `a`,
    /// vertices of `b`, pairs of edges.
    pub kind: ClosestKind,
    /// Weights of the first triangle's vertices at `point_a`. None is negative, and the sum is 1 up to rounding.
    pub barycentric_a: [f64; 3],
    /// Weights of the second triangle's vertices at `point_b`.
    pub barycentric_b: [f64; 3],
    /// The closest point on the first triangle. If the triangles cross, a shared point, up to rounding.
    pub point_a: DVec3,
    /// The closest point on the second triangle. If the triangles cross, the same shared point, up to rounding.
    pub point_b: DVec3,
}

/// The point of the segment from `a` to `b` closest to `point`.
#[must_use]
pub fn point_segment(point: DVec3, a: DVec3, b: DVec3) -> PointSegment {
    let frame = LocalFrame::of(point, &[a, b]);
    let local = point_segment_local(DVec3::ZERO, frame.to_local(a), frame.to_local(b));
    PointSegment {
        parameter: local.parameter,
        point: frame.to_world(local.point),
        distance: frame.to_world_length(local.distance),
    }
}

/// The closest points of the segment from `a0` to `a1` and the segment from `b0` to `b1`.
///
/// If the segments are parallel and the closest points are not unique, one such pair.
#[must_use]
pub fn segment_segment(a0: DVec3, a1: DVec3, b0: DVec3, b1: DVec3) -> SegmentSegment {
    let frame = LocalFrame::of(a0, &[a1, b0, b1]);
    let [a0, a1, b0, b1] = [a0, a1, b0, b1].map(|point| frame.to_local(point));
    let local = segment_segment_local(a0, a1, b0, b1);
    SegmentSegment {
        parameter_a: local.parameter_a,
        parameter_b: local.parameter_b,
        point_a: frame.to_world(local.point_a),
        point_b: frame.to_world(local.point_b),
        distance: frame.to_world_length(local.distance),
    }
}

/// The point of a closed triangle closest to `point`. A triangle without area counts as a segment or a point.
#[must_use]
pub fn point_triangle(point: DVec3, triangle: &[DVec3; 3]) -> PointTriangle {
    let frame = LocalFrame::of(point, triangle);
    let local = point_triangle_local(DVec3::ZERO, &triangle.map(|corner| frame.to_local(corner)));
    PointTriangle {
        barycentric: local.barycentric,
        point: frame.to_world(local.point),
        distance: frame.to_world_length(local.distance),
    }
}

/// Distance of two closed triangles: exactly 0 if they share a point, otherwise the least of the 6 vertex–face and the
/// 9 edge–edge distances, accurate to a few 1e-16 of the pair's extent.
///
/// Coordinates must be finite and in the range of [`triangles_cross`].
#[must_use]
pub fn triangle_distance(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    closest_features(a, b).distance
}

/// The closest points of two triangles and their features. See [`triangle_distance`].
#[must_use]
pub fn closest_features(a: &[DVec3; 3], b: &[DVec3; 3]) -> ClosestFeatures {
    // Signs need the original coordinates, because moving to a local origin rounds.
    let crossing = triangles_cross(a, b);
    let frame = LocalFrame::of(a[0], &[a[1], a[2], b[0], b[1], b[2]]);
    let local_a = a.map(|corner| frame.to_local(corner));
    let local_b = b.map(|corner| frame.to_local(corner));

    let mut closest = closest_feature_pair(&local_a, &local_b);
    if crossing {
        for candidate in piercing_points(&local_a, &local_b) {
            closest = nearer(closest, candidate);
        }
        closest.kind = ClosestKind::Crossing;
        closest.distance = 0.0;
    }
    ClosestFeatures {
        distance: frame.to_world_length(closest.distance),
        point_a: frame.to_world(closest.point_a),
        point_b: frame.to_world(closest.point_b),
        ..closest
    }
}

/// The exponent bits of an f64. As a number, they are the largest power of two not above it.
const EXPONENT: u64 = 0x7ff0_0000_0000_0000;

/// The largest power of two not above a length, used as the unit of a frame because scaling by it does not round.
/// Lengths of 0 and lengths that overflowed give the world's unit, 1.
pub(super) fn power_of_two_within(length: f64) -> f64 {
    let power = f64::from_bits(length.max(f64::MIN_POSITIVE).to_bits() & EXPONENT);
    if length > 0.0 && power.is_finite() { power } else { 1.0 }
}

/// A frame in which a few points are small numbers around the origin. Otherwise, the offset of a pair far from the
/// world's origin and the scale of very small or large pairs would spoil squares and differences.
struct LocalFrame {
    origin: DVec3,
    /// World length of one local unit. It is a power of two, so scaling by it does not round.
    unit: f64,
}

impl LocalFrame {
    fn of(origin: DVec3, others: &[DVec3]) -> Self {
        let extent = others.iter().map(|point| (*point - origin).abs().max_element()).fold(0.0, f64::max);
        Self { origin, unit: power_of_two_within(extent) }
    }

    fn to_local(&self, point: DVec3) -> DVec3 {
        (point - self.origin) / self.unit
    }

    fn to_world(&self, point: DVec3) -> DVec3 {
        self.origin + point * self.unit
    }

    fn to_world_length(&self, length: f64) -> f64 {
        length * self.unit
    }
}

/// Splits `vector` into its component along the unit vector `direction` and the perpendicular rest. A second pass
/// removes the cancellation error of the first, so the rest is perpendicular up to its own rounding.
fn split_along(vector: DVec3, direction: DVec3) -> (f64, DVec3) {
    let along = vector.dot(direction);
    let rest = vector - direction * along;
    let remainder = rest.dot(direction);
    (along + remainder, rest - direction * remainder)
}

/// Unit vector and length. `None` for a vector without length.
fn unit_and_length(vector: DVec3) -> Option<(DVec3, f64)> {
    let length = vector.length();
    (length > 0.0).then(|| (vector / length, length))
}

fn point_segment_local(point: DVec3, a: DVec3, b: DVec3) -> PointSegment {
    let edge = b - a;
    let length_squared = edge.length_squared();
    let parameter = if length_squared > 0.0 { ((point - a).dot(edge) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    // The end itself, because a + (b - a) may round to something else.
    let closest = if parameter == 1.0 { b } else { a + edge * parameter };
    PointSegment { parameter, point: closest, distance: point.distance(closest) }
}

/// Parameters of the closest points of two lines, along `u` and along `v` from their bases. `offset` leads from the
/// base of `u` to the base of `v`. `None` if the lines are parallel or one has no direction.
fn closest_line_parameters(u: DVec3, v: DVec3, offset: DVec3) -> Option<(f64, f64)> {
    let (direction, length) = unit_and_length(u)?;
    let (v_along, v_rest) = split_along(v, direction);
    let (across, v_across) = unit_and_length(v_rest)?;
    let parameter_v = -offset.dot(across) / v_across;
    let parameter_u = (offset.dot(direction) + parameter_v * v_along) / length;
    Some((parameter_u, parameter_v))
}

fn segment_segment_local(a0: DVec3, a1: DVec3, b0: DVec3, b1: DVec3) -> SegmentSegment {
    let end_of_a = |parameter_a: f64, point_a: DVec3| {
        let on_b = point_segment_local(point_a, b0, b1);
        SegmentSegment {
            parameter_a,
            parameter_b: on_b.parameter,
            point_a,
            point_b: on_b.point,
            distance: on_b.distance,
        }
    };
    let end_of_b = |parameter_b: f64, point_b: DVec3| {
        let on_a = point_segment_local(point_b, a0, a1);
        SegmentSegment {
            parameter_a: on_a.parameter,
            parameter_b,
            point_a: on_a.point,
            point_b,
            distance: on_a.distance,
        }
    };
    let mut closest = end_of_a(0.0, a0);
    let others = [end_of_a(1.0, a1), end_of_b(0.0, b0), end_of_b(1.0, b1)];
    for candidate in others.into_iter().chain(closest_inside(a0, a1, b0, b1)) {
        if candidate.distance < closest.distance {
            closest = candidate;
        }
    }
    closest
}

/// The closest points of the two lines, if they are unique and lie within the segments.
fn closest_inside(a0: DVec3, a1: DVec3, b0: DVec3, b1: DVec3) -> Option<SegmentSegment> {
    let (u, v) = (a1 - a0, b1 - b0);
    let (parameter_a, parameter_b) = closest_line_parameters(u, v, b0 - a0)?;
    if !((0.0..=1.0).contains(&parameter_a) && (0.0..=1.0).contains(&parameter_b)) {
        return None;
    }
    let (point_a, point_b) = (a0 + u * parameter_a, b0 + v * parameter_b);
    Some(SegmentSegment { parameter_a, parameter_b, point_a, point_b, distance: point_a.distance(point_b) })
}

fn point_triangle_local(point: DVec3, triangle: &[DVec3; 3]) -> PointTriangle {
    let mut closest = closest_on_edges(point, triangle);
    if let Some(inside) = projection_inside(point, triangle)
        && inside.distance < closest.distance
    {
        closest = inside;
    }
    closest
}

fn closest_on_edges(point: DVec3, triangle: &[DVec3; 3]) -> PointTriangle {
    let on_edge = |k: usize| {
        let next = (k + 1) % 3;
        let closest = point_segment_local(point, triangle[k], triangle[next]);
        let mut barycentric = [0.0; 3];
        barycentric[k] = 1.0 - closest.parameter;
        barycentric[next] = closest.parameter;
        PointTriangle { barycentric, point: closest.point, distance: closest.distance }
    };
    let (first, second, third) = (on_edge(0), on_edge(1), on_edge(2));
    let best = if second.distance < first.distance { second } else { first };
    if third.distance < best.distance { third } else { best }
}

/// A triangle's plane in orthonormal directions, with the first corner as the origin.
struct PlaneBasis {
    /// Unit vector from corner 0 to corner 1, and the length of that edge.
    direction: DVec3,
    length: f64,
    /// Unit vector perpendicular to it in the plane.
    across: DVec3,
    /// Coordinates of corner 2 in both directions.
    apex_along: f64,
    apex_across: f64,
}

impl PlaneBasis {
    /// `None` if the corners are collinear.
    fn of(triangle: &[DVec3; 3]) -> Option<Self> {
        let (direction, length) = unit_and_length(triangle[1] - triangle[0])?;
        let (apex_along, rest) = split_along(triangle[2] - triangle[0], direction);
        let (across, apex_across) = unit_and_length(rest)?;
        Some(Self { direction, length, across, apex_along, apex_across })
    }

    fn normal(&self) -> DVec3 {
        self.direction.cross(self.across)
    }
}

/// The foot of the perpendicular on the triangle's plane, if it is within the triangle and the triangle has a plane.
fn projection_inside(point: DVec3, triangle: &[DVec3; 3]) -> Option<PointTriangle> {
    let basis = PlaneBasis::of(triangle)?;
    let [corner, second, third] = *triangle;
    let offset = point - corner;
    let weight_third = offset.dot(basis.across) / basis.apex_across;
    let weight_second = (offset.dot(basis.direction) - weight_third * basis.apex_along) / basis.length;
    let barycentric = [1.0 - weight_third - weight_second, weight_second, weight_third];
    if !barycentric.iter().all(|weight| *weight >= 0.0) {
        return None;
    }
    let foot = corner + (second - corner) * weight_second + (third - corner) * weight_third;
    Some(PointTriangle { barycentric, point: foot, distance: point.distance(foot) })
}

/// The nearer of two results, or the first if they are equally near.
fn nearer(first: ClosestFeatures, second: ClosestFeatures) -> ClosestFeatures {
    if second.distance < first.distance { second } else { first }
}

/// The closest of all vertex–face and edge–edge pairs.
fn closest_feature_pair(a: &[DVec3; 3], b: &[DVec3; 3]) -> ClosestFeatures {
    let mut closest = vertex_of_a_to_face(a, b, 0);
    for vertex in 1..3 {
        closest = nearer(closest, vertex_of_a_to_face(a, b, vertex));
    }
    for vertex in 0..3 {
        closest = nearer(closest, swapped(vertex_of_a_to_face(b, a, vertex)));
    }
    for edge_a in 0..3 {
        for edge_b in 0..3 {
            closest = nearer(closest, edge_to_edge(a, b, edge_a, edge_b));
        }
    }
    closest
}

fn vertex_of_a_to_face(a: &[DVec3; 3], b: &[DVec3; 3], vertex: usize) -> ClosestFeatures {
    let on_face = point_triangle_local(a[vertex], b);
    let mut barycentric_a = [0.0; 3];
    barycentric_a[vertex] = 1.0;
    ClosestFeatures {
        distance: on_face.distance,
        kind: ClosestKind::VertexFace { vertex_of: TriangleSide::A, vertex },
        barycentric_a,
        barycentric_b: on_face.barycentric,
        point_a: a[vertex],
        point_b: on_face.point,
    }
}

fn edge_to_edge(a: &[DVec3; 3], b: &[DVec3; 3], edge_a: usize, edge_b: usize) -> ClosestFeatures {
    let (end_a, end_b) = ((edge_a + 1) % 3, (edge_b + 1) % 3);
    let closest = segment_segment_local(a[edge_a], a[end_a], b[edge_b], b[end_b]);
    let mut barycentric_a = [0.0; 3];
    barycentric_a[edge_a] = 1.0 - closest.parameter_a;
    barycentric_a[end_a] = closest.parameter_a;
    let mut barycentric_b = [0.0; 3];
    barycentric_b[edge_b] = 1.0 - closest.parameter_b;
    barycentric_b[end_b] = closest.parameter_b;
    ClosestFeatures {
        distance: closest.distance,
        kind: ClosestKind::EdgeEdge { edge_a, edge_b },
        barycentric_a,
        barycentric_b,
        point_a: closest.point_a,
        point_b: closest.point_b,
    }
}

/// The same result with the roles of the triangles exchanged.
fn swapped(features: ClosestFeatures) -> ClosestFeatures {
    let kind = match features.kind {
        ClosestKind::VertexFace { vertex_of, vertex } => ClosestKind::VertexFace {
            vertex_of: match vertex_of {
                TriangleSide::A => TriangleSide::B,
                TriangleSide::B => TriangleSide::A,
            },
            vertex,
        },
        ClosestKind::EdgeEdge { edge_a, edge_b } => ClosestKind::EdgeEdge { edge_a: edge_b, edge_b: edge_a },
        ClosestKind::Crossing => ClosestKind::Crossing,
    };
    ClosestFeatures {
        distance: features.distance,
        kind,
        barycentric_a: features.barycentric_b,
        barycentric_b: features.barycentric_a,
        point_a: features.point_b,
        point_b: features.point_a,
    }
}

/// Points where edges of one triangle pass through the plane of the other, each with the closest point of that
/// triangle. `distance` is 0 up to rounding where the edge passes through the triangle itself.
fn piercing_points(a: &[DVec3; 3], b: &[DVec3; 3]) -> Vec<ClosestFeatures> {
    let mut candidates = Vec::with_capacity(6);
    for edge in 0..3 {
        candidates.extend(edge_of_a_through_face(a, b, edge));
        candidates.extend(edge_of_a_through_face(b, a, edge).map(swapped));
    }
    candidates
}

fn edge_of_a_through_face(a: &[DVec3; 3], b: &[DVec3; 3], edge: usize) -> Option<ClosestFeatures> {
    let next = (edge + 1) % 3;
    // Both heights use the same normal. Determinants rounded separately would have an error of a sliver's aspect ratio.
    let basis = PlaneBasis::of(b)?;
    let normal = basis.normal();
    let height = |p: DVec3| (p - b[0]).dot(normal);
    let (start, end) = (height(a[edge]), height(a[next]));
    if start * end > 0.0 || start == end {
        return None;
    }
    let parameter = start / (start - end);
    let point_a = a[edge] + (a[next] - a[edge]) * parameter;
    let on_face = point_triangle_local(point_a, b);
    let mut barycentric_a = [0.0; 3];
    barycentric_a[edge] = 1.0 - parameter;
    barycentric_a[next] = parameter;
    Some(ClosestFeatures {
        distance: on_face.distance,
        kind: ClosestKind::Crossing,
        barycentric_a,
        barycentric_b: on_face.barycentric,
        point_a,
        point_b: on_face.point,
    })
}
