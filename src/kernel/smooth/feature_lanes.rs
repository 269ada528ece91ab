//! Where the features of eight pairs of patches are closest, near given points of them: a corner stays where it is, an
//! edge is a curve, and a face is the patch.
//!
//! Of the two features, at most two parameters vary: those of both edges, of the edge, or of the face. Newton steps
//! minimize the squared distance over these.

use fearless_simd::{f32x8, mask32x8, prelude::*};
use glam::Vec3;

use super::{closest_lanes::WeightLanes, patch_lanes::PatchLanes};
use crate::kernel::simd::lanes::VectorLanes;

/// Newton steps. Features are nearly straight, so the second one is already very small.
const STEPS: usize = 2;

/// Solves only what is not nearly singular.
const LEAST_DETERMINANT: f32 = 1.0e-4;

/// The feature of each of eight patches. Corners are first corners of their patches, and edges first edges.
#[derive(Clone, Copy)]
pub(super) struct FeatureLanes<S: Simd> {
    pub(super) is_edge: mask32x8<S>,
    pub(super) is_face: mask32x8<S>,
}

/// Derivatives of the vector between two points by one or two parameters.
struct Way<S: Simd> {
    first: VectorLanes<S>,
    second: VectorLanes<S>,
    /// Twice by the first parameter, by both, and twice by the second.
    seconds: [VectorLanes<S>; 3],
}

impl<S: Simd> Way<S> {
    /// By the parameters of the patch at a point, or none.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn of(simd: S, patch: &PatchLanes<S>, features: &FeatureLanes<S>, weights: &WeightLanes<S>) -> Self {
        let none = VectorLanes::splat(simd, Vec3::ZERO);
        let [u, v] = patch.tangents(simd, weights);
        let [uu, uv, vv] = patch.second_derivatives(simd);
        let moves = features.is_edge | features.is_face;
        Self {
            first: VectorLanes::select(moves, u, none),
            second: VectorLanes::select(features.is_face, v, none),
            seconds: [
                VectorLanes::select(moves, uu, none),
                VectorLanes::select(features.is_face, uv, none),
                VectorLanes::select(features.is_face, vv, none),
            ],
        }
    }
}

/// The weights at which two features each are closest, from given weights. Patches must be near the origin, and of a
/// size of about 1.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn closest_of_features<S: Simd>(
    simd: S,
    [a, b]: [&PatchLanes<S>; 2],
    features: &[FeatureLanes<S>; 2],
    mut weights: [WeightLanes<S>; 2],
) -> [WeightLanes<S>; 2] {
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let are_edges = features[0].is_edge & features[1].is_edge;
    let has_second = are_edges | features[0].is_face | features[1].is_face;
    for _ in 0..STEPS {
        let between = b.point(simd, &weights[1]) - a.point(simd, &weights[0]);
        let own = Way::of(simd, a, &features[0], &weights[0]);
        let other = Way::of(simd, b, &features[1], &weights[1]);
        // Either only one side moves, or each by its first parameter.
        let none = VectorLanes::splat(simd, Vec3::ZERO);
        let of_other = VectorLanes::select(are_edges, none, other.first);
        let (first, second) =
            (of_other - own.first, VectorLanes::select(are_edges, other.first, other.second - own.second));
        let of_other = VectorLanes::select(are_edges, none, other.seconds[0]);
        let [uu, uv, vv] = [
            of_other - own.seconds[0],
            other.seconds[1] - own.seconds[1],
            VectorLanes::select(are_edges, other.seconds[0], other.seconds[2] - own.seconds[2]),
        ];
        let matrix = [
            first.dot(first) + between.dot(uu),
            first.dot(second) + between.dot(uv),
            has_second.select(second.dot(second) + between.dot(vv), one),
        ];
        let [xx, xy, yy] = matrix;
        let (along_first, along_second) = (between.dot(first), between.dot(second));
        let determinant = xx * yy - xy * xy;
        let is_positive = xx.simd_gt(0.0) & yy.simd_gt(0.0) & determinant.simd_gt(xx * yy * LEAST_DETERMINANT);
        let step = is_positive.select((xy * along_second - yy * along_first) / determinant, zero);
        let other_step = is_positive.select((xy * along_first - xx * along_second) / determinant, zero);
        weights = [
            moved(simd, &weights[0], &features[0], step, other_step),
            moved(simd, &weights[1], &features[1], are_edges.select(other_step, step), other_step),
        ];
    }
    weights
}

/// Weights moved along a feature, and back into it.
#[cfg_attr(not(unoptimized), inline(always))]
fn moved<S: Simd>(
    simd: S,
    weights: &WeightLanes<S>,
    features: &FeatureLanes<S>,
    first: f32x8<S>,
    second: f32x8<S>,
) -> WeightLanes<S> {
    let zero = f32x8::splat(simd, 0.0);
    let moves = features.is_edge | features.is_face;
    let second = (weights.0[1] + features.is_face.select(second, zero)).max(zero);
    let first = (weights.0[0] + moves.select(first, zero)).max(zero);
    let sum = (first + second).max(1.0);
    WeightLanes([first / sum, second / sum])
}
