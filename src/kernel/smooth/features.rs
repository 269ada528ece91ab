//! Where the features of two patches are closest, near given points of them: a corner stays where it is, an edge is a
//! curve, and a face is the patch.

use glam::{DMat2, DVec2, DVec3};

use super::patch::Patch;
use crate::kernel::mesh::feature::{Feature, FeaturePair};

/// Newton steps. Features are nearly straight, so the second one is already very small.
const STEPS: usize = 2;

/// Solves only what is not nearly singular.
const LEAST_DETERMINANT: f64 = 1.0e-4;

/// A point of a patch on one of its features, with the derivatives along the feature.
struct Point {
    at: DVec3,
    tangents: [DVec3; 2],
    /// Twice by the first parameter, by both, and twice by the second.
    seconds: [DVec3; 3],
}

impl Point {
    fn new(patch: &Patch, feature: Feature, weights: &[f64; 3]) -> Self {
        let local = patch.local(weights);
        match feature {
            Feature::Vertex(_) => Self { at: local.point, tangents: [DVec3::ZERO; 2], seconds: [DVec3::ZERO; 3] },
            Feature::Edge(edge) => {
                let edge = usize::from(edge) % 3;
                let (from, to) = (patch.corners[edge], patch.corners[(edge + 1) % 3]);
                let along = weights[(edge + 1) % 3];
                let tangent = to - from + patch.offsets[edge] * (1.0 - 2.0 * along);
                let second = patch.offsets[edge] * -2.0;
                Self { at: local.point, tangents: [tangent, DVec3::ZERO], seconds: [second, DVec3::ZERO, DVec3::ZERO] }
            }
            Feature::Face => Self { at: local.point, tangents: local.tangents, seconds: local.seconds },
        }
    }
}

/// The weights and points at which two features are closest.
pub(super) fn closest_of_features(
    patches: &[Patch; 2],
    features: FeaturePair,
    mut weights: [[f64; 3]; 2],
) -> ([[f64; 3]; 2], [DVec3; 2]) {
    let kinds = [features.a, features.b];
    for _ in 0..STEPS {
        let points = [0, 1].map(|side| Point::new(&patches[side], kinds[side], &weights[side]));
        let between = points[1].at - points[0].at;
        match kinds {
            [Feature::Edge(_), Feature::Edge(_)] => {
                let [first, second] = [points[0].tangents[0], points[1].tangents[0]];
                let matrix = DMat2::from_cols(
                    DVec2::new(first.length_squared() - between.dot(points[0].seconds[0]), -first.dot(second)),
                    DVec2::new(-first.dot(second), second.length_squared() + between.dot(points[1].seconds[0])),
                );
                let Some(step) = solve(&matrix, DVec2::new(between.dot(first), -between.dot(second))) else { break };
                for (side, step) in [step.x, step.y].into_iter().enumerate() {
                    move_on(&mut weights[side], kinds[side], DVec2::new(step, 0.0));
                }
            }
            [Feature::Vertex(_), Feature::Vertex(_)] => break,
            _ => {
                // The side that is not a corner moves.
                let side = usize::from(matches!(features.a, Feature::Vertex(_)));
                let away = if side == 0 { -between } else { between };
                let Point { tangents: [u, v], seconds: [uu, uv, vv], .. } = points[side];
                let is_curve = matches!(kinds[side], Feature::Edge(_));
                let last = if is_curve { 1.0 } else { v.length_squared() + away.dot(vv) };
                let mixed = u.dot(v) + away.dot(uv);
                let matrix =
                    DMat2::from_cols(DVec2::new(u.length_squared() + away.dot(uu), mixed), DVec2::new(mixed, last));
                let Some(step) = solve(&matrix, DVec2::new(-away.dot(u), -away.dot(v))) else { break };
                move_on(&mut weights[side], kinds[side], step);
            }
        }
    }
    let points = [patches[0].point(&weights[0]), patches[1].point(&weights[1])];
    (weights, points)
}

/// Solves a system whose matrix is positive. `None` if it is not, or nearly singular.
fn solve(matrix: &DMat2, wanted: DVec2) -> Option<DVec2> {
    let determinant = matrix.determinant();
    let (first, second) = (matrix.x_axis.x, matrix.y_axis.y);
    let is_positive = first > 0.0 && second > 0.0 && determinant > LEAST_DETERMINANT * first * second;
    is_positive.then(|| matrix.inverse() * wanted)
}

/// Moves the weights along a feature, and back into it.
fn move_on(weights: &mut [f64; 3], feature: Feature, step: DVec2) {
    match feature {
        Feature::Vertex(_) => {}
        Feature::Edge(edge) => {
            let edge = usize::from(edge) % 3;
            let along = (weights[(edge + 1) % 3] + step.x).clamp(0.0, 1.0);
            *weights = [0.0; 3];
            weights[edge] = 1.0 - along;
            weights[(edge + 1) % 3] = along;
        }
        Feature::Face => {
            let [second, third] = [weights[1] + step.x, weights[2] + step.y].map(|weight| weight.max(0.0));
            let sum = (second + third).max(1.0);
            *weights = [1.0 - (second + third) / sum, second / sum, third / sum];
        }
    }
}
