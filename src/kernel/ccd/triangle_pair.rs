//! First impact of two triangles whose vertices move in straight lines.
//!
//! Separate triangles first meet where a vertex of one meets the face of the other, or where two edges meet: 6 + 9
//! pairs of features. Before these are tested, planes along the faces show how long the whole triangles stay apart.
//! Triangles that cross at the start need not have features near each other, so that is tested as well.

use glam::DVec3;
use robust::Coord3D;

use super::{
    advance::{ImpactCause, MovingHull, Plane},
    feature::{FeatureImpact, edge_edge_impact_within, vertex_face_impact_within},
    parting::{stay_apart, stay_apart_about_vertex},
};
use crate::kernel::mesh::{
    barycentric::{corner_weights, edge_weights},
    feature::{Feature, FeaturePair},
};

/// The corners of a triangle at the start and at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingTriangle {
    /// At the start.
    pub start: [DVec3; 3],
    /// At the end.
    pub end: [DVec3; 3],
}

impl MovingTriangle {
    /// The part of the step that ends at a time, 0 to 1.
    pub(super) fn until(self, time: f64) -> Self {
        let end = if time < 1.0 {
            std::array::from_fn(|corner| self.start[corner].lerp(self.end[corner], time))
        } else {
            self.end
        };
        Self { end, ..self }
    }

    /// The motions of its corners.
    pub(super) fn motions(&self) -> [DVec3; 3] {
        std::array::from_fn(|corner| self.end[corner] - self.start[corner])
    }
}

/// Which corners of two triangles are one vertex. Features that share a vertex are never tested.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CommonVertices([[bool; 3]; 3]);

impl CommonVertices {
    /// No corner is, as for triangles of different surfaces.
    pub const NONE: Self = Self([[false; 3]; 3]);

    /// Those with the same (welded) number.
    #[must_use]
    pub fn of(a: [u32; 3], b: [u32; 3]) -> Self {
        Self(a.map(|vertex_a| b.map(|vertex_b| vertex_a == vertex_b)))
    }

    fn any(&self) -> bool {
        self.0.as_flattened().contains(&true)
    }

    /// The common corner of each triangle, if there is exactly one.
    fn only(&self) -> Option<[usize; 2]> {
        let mut common = (0..9).filter(|&pair| self.0[pair / 3][pair % 3]);
        let first = common.next()?;
        common.next().is_none().then_some([first / 3, first % 3])
    }

    /// Whether two features share a vertex.
    fn between(&self, features: FeaturePair) -> bool {
        let corners = |feature: Feature| match feature.part() {
            part @ 0..3 => [part; 3],
            part @ 3..6 => [part - 3, part - 3, (part - 2) % 3],
            _ => [0, 1, 2],
        };
        let of_b = corners(features.b);
        corners(features.a).into_iter().any(|corner| of_b.into_iter().any(|other| self.0[corner][other]))
    }
}

/// When and how two triangles first come within a separation of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleImpact {
    /// 0 at the start of the step, 1 at its end. Never later than the first time at which the distance of the triangles
    /// is at most the separation, except for features that share a vertex.
    pub time: f64,
    /// Whether the triangles start within the separation, cross at the start, reach the separation, or may reach it.
    pub cause: ImpactCause,
    /// A vertex and a face, or two edges. An edge and a face if they cross. If several features meet at once, such as
    /// those around a vertex that meets an edge, one of them.
    pub features: FeaturePair,
    /// Weights of the first triangle's corners at that time. They sum to 1.
    pub barycentric_a: [f64; 3],
    /// Weights of the second triangle's corners at that time. They sum to 1.
    pub barycentric_b: [f64; 3],
    /// Unit vector from the first triangle to the second, as in [`FeatureImpact::normal`]. Zero if they cross.
    pub normal: DVec3,
}

/// First impact of two triangles: the first time at which their distance is at most `separation`, 0 or more. `None` if
/// it stays greater for the whole step, both ends included, or if a coordinate is not finite.
///
/// The time does not depend on which triangle comes first.
#[must_use]
pub fn triangle_pair_impact(
    a: &MovingTriangle,
    b: &MovingTriangle,
    common: &CommonVertices,
    separation: f64,
) -> Option<TriangleImpact> {
    triangle_pair_impact_by(a, b, common, separation, &mut DVec3::default())
}

/// [`triangle_pair_impact`], with the normal of a plane that has separated a pair of triangles near these. Writes that of a
/// plane that separates these, if it finds one.
pub(super) fn triangle_pair_impact_by(
    a: &MovingTriangle,
    b: &MovingTriangle,
    common: &CommonVertices,
    separation: f64,
    normal: &mut DVec3,
) -> Option<TriangleImpact> {
    let clear = clear_from_start(a, b, common, separation, normal)?;
    if clear > 1.0 {
        return None;
    }
    if clear <= 0.0
        && let Some(crossing) = crossing_at_start(a, b, common)
    {
        return Some(crossing);
    }
    let mut first: Option<TriangleImpact> = None;
    for features in feature_pairs(common, ALL_FEATURES) {
        let until = first.map_or(1.0, |impact| impact.time);
        if let Some(found) = features_impact(a, b, features, separation, clear, until)
            && first.is_none_or(|first| found.time < first.time)
        {
            first = Some(found);
        }
    }
    first
}

/// The features of two triangles, as bits: 1 << 0 to 2 for the corners, 3 to 5 for the edges.
pub(super) type FeatureBits = [u8; 2];

/// Whether a pair of features is tested of those whose bits are set: a corner with the other face, or two edges.
pub(super) fn has_features([a, b]: FeatureBits) -> bool {
    const CORNERS: u8 = 0b111;
    (a | b) & CORNERS != 0 || a > CORNERS && b > CORNERS
}

/// All features of two triangles.
const ALL_FEATURES: FeatureBits = [0b11_1111; 2];

/// The bits of two features alone.
fn bits_of(features: FeaturePair) -> FeatureBits {
    [features.a, features.b].map(|feature| if feature == Feature::Face { 0 } else { 1 << feature.part() })
}

/// Calls `found` with the impact of each pair of features that meets, of those whose bits are set: a corner with the other
/// face, or two edges. If the triangles cross at the start, also returns the crossing.
pub(super) fn feature_impacts_by(
    a: &MovingTriangle,
    b: &MovingTriangle,
    common: &CommonVertices,
    tested: FeatureBits,
    separation: f64,
    normal: &mut DVec3,
    found: impl FnMut(TriangleImpact),
) -> Option<TriangleImpact> {
    let clear = clear_from_start(a, b, common, separation, normal)?;
    if clear > 1.0 {
        return None;
    }
    let impact = |features: FeaturePair| features_impact(a, b, features, separation, clear, 1.0);
    feature_pairs(common, tested).filter_map(impact).for_each(found);
    if clear <= 0.0 { crossing_at_start(a, b, common) } else { None }
}

/// The pairs of features of two triangles in which one may meet the other: a corner and a face, or two edges, of those
/// whose bits are set. Without those that share a vertex.
fn feature_pairs(common: &CommonVertices, tested: FeatureBits) -> impl Iterator<Item = FeaturePair> {
    let corners = (0..3).flat_map(|corner| {
        let corner = Feature::Vertex(corner);
        [FeaturePair { a: corner, b: Feature::Face }, FeaturePair { a: Feature::Face, b: corner }]
    });
    let edges = (0..9).map(|pair| FeaturePair { a: Feature::Edge(pair / 3), b: Feature::Edge(pair % 3) });
    corners.chain(edges).filter(move |&features| {
        let bits = bits_of(features);
        tested[0] & bits[0] == bits[0] && tested[1] & bits[1] == bits[1] && !common.between(features)
    })
}

/// First impact of two features, which must be clear until the time `clear`, not after `until`.
fn features_impact(
    a: &MovingTriangle,
    b: &MovingTriangle,
    features: FeaturePair,
    separation: f64,
    clear: f64,
    until: f64,
) -> Option<TriangleImpact> {
    match (features.a, features.b) {
        (Feature::Vertex(vertex), _) => {
            let vertex = usize::from(vertex);
            let points = |own: &[DVec3; 3], other: &[DVec3; 3]| [own[vertex], other[0], other[1], other[2]];
            let (start, end) = (points(&a.start, &b.start), points(&a.end, &b.end));
            let impact = vertex_face_impact_within(&start, &end, separation, clear, until)?;
            let [_, weights @ ..] = impact.weights;
            Some(triangle_impact(&impact, features, corner_weights(vertex), weights))
        }
        (_, Feature::Vertex(_)) => {
            features_impact(b, a, features.swapped(), separation, clear, until).map(TriangleImpact::swapped)
        }
        _ => {
            let [edge_a, edge_b] = [features.a, features.b].map(|edge| edge.part() - 3);
            let (ends_a, ends_b) = (ends_of(edge_a), ends_of(edge_b));
            let points = |a: &[DVec3; 3], b: &[DVec3; 3]| [a[ends_a[0]], a[ends_a[1]], b[ends_b[0]], b[ends_b[1]]];
            let (start, end) = (points(&a.start, &b.start), points(&a.end, &b.end));
            let impact = edge_edge_impact_within(&start, &end, separation, clear, until)?;
            let [_, along_a, _, along_b] = impact.weights;
            Some(triangle_impact(&impact, features, edge_weights(edge_a, along_a), edge_weights(edge_b, along_b)))
        }
    }
}

/// The corners that an edge joins.
const fn ends_of(edge: usize) -> [usize; 2] {
    [edge, (edge + 1) % 3]
}

fn triangle_impact(
    impact: &FeatureImpact,
    features: FeaturePair,
    barycentric_a: [f64; 3],
    barycentric_b: [f64; 3],
) -> TriangleImpact {
    TriangleImpact {
        time: impact.time,
        cause: impact.cause,
        features,
        barycentric_a,
        barycentric_b,
        normal: impact.normal,
    }
}

impl TriangleImpact {
    /// The same impact, with the triangles swapped.
    fn swapped(self) -> Self {
        Self {
            features: self.features.swapped(),
            barycentric_a: self.barycentric_b,
            barycentric_b: self.barycentric_a,
            normal: -self.normal,
            ..self
        }
    }
}

/// How long planes along the faces certainly keep the triangles farther than `separation` apart: 0 if they touch or
/// share a vertex, infinite if for the whole step. `None` if a quick test shows that they stay apart, or if a
/// coordinate is not finite.
fn clear_from_start(
    a: &MovingTriangle,
    b: &MovingTriangle,
    common: &CommonVertices,
    separation: f64,
    normal: &mut DVec3,
) -> Option<f64> {
    let all = [&a.start, &a.end, &b.start, &b.end];
    if common.any() {
        let is_finite = all.into_iter().flatten().all(|corner| corner.is_finite());
        return (is_finite && !common.only().is_some_and(|corners| stay_apart_about(a, b, corners, separation)))
            .then_some(0.0);
    }
    if stay_apart([&a.start, &a.end], [&b.start, &b.end], separation, normal) {
        return None;
    }
    let differences = |a: &[DVec3; 3], b: &[DVec3; 3]| -> [DVec3; 9] { std::array::from_fn(|k| a[k / 3] - b[k % 3]) };
    let hull = MovingHull::new(differences(&a.start, &b.start), differences(&a.end, &b.end))?;
    let mut clear = 0.0_f64;
    for triangle in [a, b] {
        let edges = |corners: &[DVec3; 3]| [corners[1] - corners[0], corners[2] - corners[0]];
        let (start, end) = (edges(&triangle.start), edges(&triangle.end));
        let change = [end[0] - start[0], end[1] - start[1]];
        let turning = change[0].cross(start[1]) + start[0].cross(change[1]);
        clear = clear.max(hull.clear_from_start(Plane::new(start[0].cross(start[1]), turning), separation));
    }
    Some(clear)
}

/// Whether two triangles certainly stay farther than `separation` apart, except for a common corner.
fn stay_apart_about(a: &MovingTriangle, b: &MovingTriangle, [common_a, common_b]: [usize; 2], separation: f64) -> bool {
    // Vertices that were welded where the mesh was at rest may have moved apart.
    let is_one = a.start[common_a] == b.start[common_b] && a.end[common_a] == b.end[common_b];
    let others = |corners: &[DVec3; 3], common: usize| {
        [corners[(common + 1) % 3] - corners[common], corners[(common + 2) % 3] - corners[common]]
    };
    let both =
        |triangle: &MovingTriangle, common: usize| [others(&triangle.start, common), others(&triangle.end, common)];
    is_one && stay_apart_about_vertex(both(a, common_a), both(b, common_b), separation)
}

/// An edge of one triangle that pierces the face of the other at the start of the step, by exact signs. Touching does
/// not count: features that touch are found as such.
pub(super) fn crossing_at_start(
    a: &MovingTriangle,
    b: &MovingTriangle,
    common: &CommonVertices,
) -> Option<TriangleImpact> {
    for edge_is_of_a in [true, false] {
        let (own, other) = if edge_is_of_a { (a, b) } else { (b, a) };
        for edge in 0..3 {
            let features = FeaturePair { a: Feature::Edge(edge as u8), b: Feature::Face };
            if common.between(if edge_is_of_a { features } else { features.swapped() }) {
                continue;
            }
            let Some((along, weights)) = piercing(ends_of(edge).map(|end| own.start[end]), &other.start) else {
                continue;
            };
            let found = TriangleImpact {
                time: 0.0,
                cause: ImpactCause::Crossing,
                features,
                barycentric_a: edge_weights(edge, along),
                barycentric_b: weights,
                normal: DVec3::ZERO,
            };
            return Some(if edge_is_of_a { found } else { found.swapped() });
        }
    }
    None
}

/// Where along an edge, and with which weights of the face's corners, the edge pierces the inside of a face.
fn piercing(edge: [DVec3; 2], face: &[DVec3; 3]) -> Option<(f64, [f64; 3])> {
    let coordinates = |point: DVec3| Coord3D { x: point.x, y: point.y, z: point.z };
    let volume = |p: DVec3, q: DVec3, r: DVec3, s: DVec3| {
        robust::orient3d(coordinates(p), coordinates(q), coordinates(r), coordinates(s))
    };
    let [start, end] = edge.map(|point| volume(face[0], face[1], face[2], point));
    if !(start < 0.0 && end > 0.0 || start > 0.0 && end < 0.0) {
        return None;
    }
    let opposite = [1, 2, 0].map(|k: usize| volume(edge[0], edge[1], face[k], face[(k + 1) % 3]));
    if !(opposite.iter().all(|&volume| volume > 0.0) || opposite.iter().all(|&volume| volume < 0.0)) {
        return None;
    }
    let sum = opposite[0] + opposite[1] + opposite[2];
    let [second, third] = [opposite[1] / sum, opposite[2] / sum];
    Some((start / (start - end), [1.0 - second - third, second, third]))
}
