//! Closest points of the two features of a contact, and the direction that separates them, given the side on which they
//! were, for eight contacts.

use fearless_simd::{f32x8, mask32x8, prelude::*};

use crate::kernel::simd::lanes::VectorLanes;

/// Features closer than this share of their size have no direction of their own.
const TOGETHER: f32 = 1.0e-6;

/// Edges count as parallel if the sine of the angle between them is smaller.
const PARALLEL_SINE: f32 = 3.0e-4;

/// The cosine of the angle by which a direction turns around a rim in a substep at most. What turns farther has passed through
/// what is on both sides of the rim.
const PASSED: f32 = -0.95;

/// Which features of two triangles meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeatureKind {
    /// A vertex, the first particle, and a face.
    VertexFace,
    /// Two edges of two particles each.
    EdgeEdge,
}

impl FeatureKind {
    /// The particle that the positions of the others are measured from.
    pub(super) const fn base(self) -> usize {
        match self {
            Self::VertexFace => 1,
            Self::EdgeEdge => 2,
        }
    }

    /// The other particles, in order.
    pub(super) const fn others(self) -> [usize; 3] {
        match self {
            Self::VertexFace => [0, 2, 3],
            Self::EdgeEdge => [0, 1, 3],
        }
    }
}

/// The closest points of eight pairs of features.
pub(super) struct Meeting<S: Simd> {
    /// Signed weights of the four particles: they sum to 1 for the first feature and to −1 for the second.
    pub(super) weights: [f32x8<S>; 4],
    /// Unit vector along which the first feature moves away from the second, or back to its own side.
    pub(super) normal: VectorLanes<S>,
}

/// A vertex and a face, with the positions of the vertex and of the second and third corner relative to the first.
/// `before` is the direction from the face to the vertex at the last evaluation. A vertex that projects into the
/// interior of the face from the other side has passed through it.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn vertex_face<S: Simd>(
    simd: S,
    [vertex, second, third]: [VectorLanes<S>; 3],
    before: VectorLanes<S>,
) -> Meeting<S> {
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let across = third - second;
    let normal = second.cross(third);
    let normal_squared = normal.dot(normal);
    // Twice the areas opposite the corners, times the length of the normal.
    let areas =
        [normal.dot(across.cross(vertex - second)), normal.dot(vertex.cross(third)), normal.dot(second.cross(vertex))];
    let is_inside = areas[0].min(areas[1]).min(areas[2]).simd_gt(zero) & normal_squared.simd_gt(zero);
    let sum = areas[0] + areas[1] + areas[2];
    let inverse = is_inside.select(one / sum, zero);
    let (face_second, face_third) = (areas[1] * inverse, areas[2] * inverse);

    // On the boundary, the nearest of three edges; of equally near ones the first.
    let [along_first, along_across, along_last] = [
        along(simd, vertex, second),
        along(simd, vertex - second, across),
        along(simd, vertex - third, third.negated()),
    ];
    let candidates = [
        vertex - second.scaled(along_first),
        vertex - second - across.scaled(along_across),
        vertex - third.scaled(one - along_last),
    ];
    let squares =
        [candidates[0].dot(candidates[0]), candidates[1].dot(candidates[1]), candidates[2].dot(candidates[2])];
    let (mut rim_second, mut rim_third) = (along_first, zero);
    let (mut between, mut nearest) = (candidates[0], squares[0]);
    let nearer = squares[1].simd_lt(nearest);
    rim_second = nearer.select(one - along_across, rim_second);
    rim_third = nearer.select(along_across, rim_third);
    between = VectorLanes::select(nearer, candidates[1], between);
    nearest = nearer.select(squares[1], nearest);
    let nearer = squares[2].simd_lt(nearest);
    rim_second = nearer.select(zero, rim_second);
    rim_third = nearer.select(one - along_last, rim_third);
    between = VectorLanes::select(nearer, candidates[2], between);

    let size_squared = second.dot(second).max(third.dot(third));
    let rim = directed(simd, between, size_squared, before, mask32x8::splat(simd, false));
    let unit = normal.scaled(one / normal_squared.sqrt());
    let is_behind = unit.dot(before).simd_lt(zero);
    let unit = VectorLanes::select(is_behind, unit.negated(), unit);
    let weight_second = is_inside.select(face_second, rim_second);
    let weight_third = is_inside.select(face_third, rim_third);
    Meeting {
        weights: [one, weight_second + weight_third - one, -weight_second, -weight_third],
        normal: VectorLanes::select(is_inside, unit, rim),
    }
}

/// Two edges, with the positions of both ends of the first and of the end of the second relative to the start of the
/// second. `before` is the direction from the second to the first at the last evaluation. Edges whose closest points
/// lie strictly between their ends, with the direction reversed, have passed each other.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn edge_edge<S: Simd>(
    simd: S,
    [start, end, other]: [VectorLanes<S>; 3],
    before: VectorLanes<S>,
) -> Meeting<S> {
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let edge = end - start;
    let (own_squared, other_squared) = (edge.dot(edge), other.dot(other));
    let normal = edge.cross(other);
    let normal_squared = normal.dot(normal);
    let crosses = normal_squared.simd_gt(own_squared * other_squared * (PARALLEL_SINE * PARALLEL_SINE));
    let on_own = crosses.select(other.cross(start).dot(normal) / normal_squared, f32x8::splat(simd, 0.5));
    let on_own = on_own.max(zero).min(one);
    let on_other = along(simd, start.plus(edge.scaled(on_own)), other);
    let on_own = along(simd, other.scaled(on_other) - start, edge);
    let between = start.plus(edge.scaled(on_own)) - other.scaled(on_other);
    let is_inside =
        crosses & on_own.simd_gt(zero) & on_own.simd_lt(one) & on_other.simd_gt(zero) & on_other.simd_lt(one);
    let size_squared = own_squared.max(other_squared);
    Meeting {
        weights: [one - on_own, on_own, on_other - one, -on_other],
        normal: directed(simd, between, size_squared, before, is_inside),
    }
}

/// Where along an edge a point is closest, 0 to 1, given the vector from the edge's start to the point.
#[cfg_attr(not(unoptimized), inline(always))]
fn along<S: Simd>(simd: S, from_start: VectorLanes<S>, edge: VectorLanes<S>) -> f32x8<S> {
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let squared = edge.dot(edge);
    let along = (from_start.dot(edge) / squared).max(zero).min(one);
    squared.simd_gt(zero).select(along, zero)
}

/// `between` points from the second closest point to the first.
#[cfg_attr(not(unoptimized), inline(always))]
fn directed<S: Simd>(
    simd: S,
    between: VectorLanes<S>,
    size_squared: f32x8<S>,
    before: VectorLanes<S>,
    can_pass: mask32x8<S>,
) -> VectorLanes<S> {
    let zero = f32x8::splat(simd, 0.0);
    let squared = between.dot(between);
    let is_apart = squared.simd_gt(size_squared * (TOGETHER * TOGETHER));
    let unit = between.scaled(f32x8::splat(simd, 1.0) / squared.sqrt());
    let turned = unit.dot(before);
    let has_passed = can_pass & turned.simd_lt(zero) | turned.simd_lt(PASSED);
    let unit = VectorLanes::select(has_passed, unit.negated(), unit);
    VectorLanes::select(is_apart, unit, before)
}

#[cfg(test)]
mod tests {
    use circumsphere_support::random::Random;
    use glam::{DVec3, Vec3};
    use parry3d_f64::{
        math::Pose3,
        query::{ClosestPoints, PointQuery, details::closest_points_segment_segment},
        shape::{Segment, Triangle},
    };

    use super::*;
    use crate::kernel::simd::lanes::WIDTH;

    /// Weights and normal in the first lane, of features whose particles are at `points`.
    fn meeting_of(kind: FeatureKind, points: &[DVec3; 4], before: DVec3) -> ([f64; 4], DVec3) {
        dispatch!(simd => {
            let lanes = kind.others().map(|other| VectorLanes::splat(simd, (points[other] - points[kind.base()]).as_vec3()));
            let before = VectorLanes::splat(simd, before.as_vec3());
            let Meeting { weights, normal } = match kind {
                FeatureKind::VertexFace => vertex_face(simd, lanes, before),
                FeatureKind::EdgeEdge => edge_edge(simd, lanes, before),
            };
            (weights.map(|weight| f64::from(<[f32; WIDTH]>::from(weight)[0])), normal.stored().get(0).as_dvec3())
        })
    }

    /// The distance of two features, by parry in f64.
    fn distance_of(kind: FeatureKind, &[a, b, c, d]: &[DVec3; 4]) -> f64 {
        match kind {
            FeatureKind::VertexFace => Triangle::new(b, c, d).project_local_point(a, false).point.distance(a),
            FeatureKind::EdgeEdge => {
                let (own, other) = (Segment::new(a, b), Segment::new(c, d));
                match closest_points_segment_segment(&Pose3::IDENTITY, &own, &other, f64::MAX) {
                    ClosestPoints::WithinMargin(own, other) => own.distance(other),
                    found => panic!("{found:?}"),
                }
            }
        }
    }

    fn sum(weights: &[f64; 4], points: &[DVec3; 4]) -> DVec3 {
        (0..4).map(|place| points[place] * weights[place]).sum()
    }

    #[test]
    fn weights_and_normals_give_the_distance() {
        let mut random = Random::new(11);
        let mut on_rims = 0;
        for kind in [FeatureKind::VertexFace, FeatureKind::EdgeEdge] {
            for _ in 0..2000 {
                let mut point = || DVec3::from_array(std::array::from_fn(|_| f64::from(random.signed_unit())));
                let points = [point(), point(), point(), point()].map(|point| point.as_vec3().as_dvec3());
                let expected = distance_of(kind, &points);
                let rough = sum(&meeting_of(kind, &points, DVec3::X).0, &points);
                let (weights, normal) = meeting_of(kind, &points, rough.normalize());
                let between = sum(&weights, &points);
                on_rims += usize::from(weights.contains(&0.0));
                let sides: [f64; 2] = match kind {
                    FeatureKind::VertexFace => [weights[0], weights[1] + weights[2] + weights[3]],
                    FeatureKind::EdgeEdge => [weights[0] + weights[1], weights[2] + weights[3]],
                };
                assert!((sides[0] - 1.0).abs() < 1e-6 && (sides[1] + 1.0).abs() < 1e-6, "{kind:?} {weights:?}");
                assert!((between.length() - expected).abs() < 1e-5, "{kind:?} {points:?}: {between} for {expected}");
                assert!((normal.dot(between) - expected).abs() < 1e-5, "{kind:?} {points:?}: {normal}");
                assert!((normal.length() - 1.0).abs() < 1e-5, "{kind:?} {points:?}: {normal}");
            }
        }
        assert!(on_rims > 1000, "{on_rims}");
    }

    #[test]
    fn what_has_passed_through_is_on_the_side_where_it_was() {
        let face = [DVec3::ZERO, DVec3::X, DVec3::Z];
        let inside = DVec3::new(0.2, -0.1, 0.3);
        let (_, normal) = meeting_of(FeatureKind::VertexFace, &[inside, face[0], face[1], face[2]], DVec3::Y);
        assert_eq!(normal, DVec3::Y);
        // Beyond the rim, it has gone around.
        let outside = DVec3::new(-0.2, -0.1, 0.3);
        let (_, normal) = meeting_of(FeatureKind::VertexFace, &[outside, face[0], face[1], face[2]], DVec3::Y);
        assert!(normal.distance(DVec3::new(-0.2, -0.1, 0.0).normalize()) < 1e-6, "{normal}");
        // Nearly behind the rim, it has passed through what is on both sides of that, as between two sheets with equal grids.
        let behind = DVec3::new(-0.02, -0.1, 0.3);
        let (_, normal) = meeting_of(FeatureKind::VertexFace, &[behind, face[0], face[1], face[2]], DVec3::Y);
        assert!(normal.distance(DVec3::new(0.02, 0.1, 0.0).normalize()) < 1e-6, "{normal}");
        let [below, along] = [DVec3::NEG_Y * 0.1, DVec3::X];
        let parallel = [below - along, below + along, -along, along];
        assert_eq!(meeting_of(FeatureKind::EdgeEdge, &parallel, DVec3::Y).1, DVec3::Y);
        let edges = [DVec3::new(-1.0, -0.1, 0.0), DVec3::new(1.0, -0.1, 0.0), DVec3::NEG_Z, DVec3::Z];
        let (_, normal) = meeting_of(FeatureKind::EdgeEdge, &edges, DVec3::Y);
        assert_eq!(normal, DVec3::Y);
        assert_eq!(meeting_of(FeatureKind::EdgeEdge, &edges, DVec3::NEG_Y).1, DVec3::NEG_Y);
    }

    #[test]
    fn degenerate_features_keep_their_direction_or_have_a_finite_one() {
        let before = Vec3::new(0.6, 0.8, 0.0).as_dvec3();
        let point = DVec3::splat(0.25);
        for kind in [FeatureKind::VertexFace, FeatureKind::EdgeEdge] {
            assert_eq!(meeting_of(kind, &[point; 4], before).1.as_vec3(), before.as_vec3());
            // Everything on one line.
            let line = [0.0, 1.0, 2.0, 3.0].map(|along| DVec3::X * along);
            let (weights, normal) = meeting_of(kind, &line, before);
            assert!(normal.is_finite() && (sum(&weights, &line).length() - 1.0).abs() < 1e-6, "{kind:?} {weights:?}");
        }
    }
}
