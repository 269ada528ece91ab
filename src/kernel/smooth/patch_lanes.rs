//! Eight pairs of patches and their closest points.
//!
//! Each step finds the closest points of the triangles that touch both patches at the points so far, and goes there, or
//! as far towards it as the distance shrinks (Gauss–Newton with a line search; the triangles are the patches to first
//! order, and their closest points, which are exact, honor the borders). So the result is the distance of two points of
//! the patches in any case, and never too small.

use fearless_simd::{f32x8, mask32x8, prelude::*};

use super::closest_lanes::{ClosestLanes, WeightLanes};
use crate::kernel::simd::lanes::VectorLanes;

/// Steps from the closest points of the flat triangles.
const STEPS: usize = 3;

/// The shares of a step that are tried.
const SHARES: [f32; 3] = [1.0, 0.5, 0.25];

/// Steps that reduce the squared distance by less than this share end the search.
const LEAST_GAIN: f32 = 1.0e-3;

/// Points closer than this, relative to the size of the pair, count as the same.
const SAME: f32 = 2.0e-6;

/// A patch of each of eight pairs.
#[derive(Clone, Copy)]
pub(super) struct PatchLanes<S: Simd> {
    pub(super) corners: [VectorLanes<S>; 3],
    /// The offsets of the edges, see [`Patch`](super::patch::Patch).
    pub(super) offsets: [VectorLanes<S>; 3],
}

impl<S: Simd> PatchLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn scaled(&self, scale: f32x8<S>) -> Self {
        let ([p, q, r], [first, second, third]) = (self.corners, self.offsets);
        Self {
            corners: [p.scaled(scale), q.scaled(scale), r.scaled(scale)],
            offsets: [first.scaled(scale), second.scaled(scale), third.scaled(scale)],
        }
    }

    /// The largest coordinate.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn largest(&self) -> f32x8<S> {
        let [p, q, r] = [self.corners[0].abs(), self.corners[1].abs(), self.corners[2].abs()];
        let largest = p.max(q).max(r);
        largest.x.max(largest.y).max(largest.z)
    }

    /// The weight of the first corner.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn first_weight(simd: S, &WeightLanes([b, c]): &WeightLanes<S>) -> f32x8<S> {
        f32x8::splat(simd, 1.0) - b - c
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn point(&self, simd: S, weights: &WeightLanes<S>) -> VectorLanes<S> {
        let (a, [b, c]) = (Self::first_weight(simd, weights), weights.0);
        let ([p, q, r], [first, second, third]) = (self.corners, self.offsets);
        let flat = p.plus((q - p).scaled(b)).plus((r - p).scaled(c));
        flat.plus(first.scaled(a * b)).plus(second.scaled(b * c)).plus(third.scaled(c * a))
    }

    /// The derivatives by the weights of the second and the third corner.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn tangents(&self, simd: S, weights: &WeightLanes<S>) -> [VectorLanes<S>; 2] {
        let (a, [b, c]) = (Self::first_weight(simd, weights), weights.0);
        let ([p, q, r], [first, second, third]) = (self.corners, self.offsets);
        [
            (q - p).plus(first.scaled(a - b)).plus((second - third).scaled(c)),
            (r - p).plus(third.scaled(a - c)).plus((second - first).scaled(b)),
        ]
    }

    /// The second derivatives: twice by the weight of the second corner, by both, and twice by that of the third.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn second_derivatives(&self, simd: S) -> [VectorLanes<S>; 3] {
        let ([first, second, third], twice) = (self.offsets, f32x8::splat(simd, -2.0));
        [first.scaled(twice), second - first - third, third.scaled(twice)]
    }

    /// Whether a vector is nearly normal to the patch at a point.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn is_normal_to(&self, simd: S, weights: &WeightLanes<S>, vector: VectorLanes<S>) -> mask32x8<S> {
        let [u, v] = self.tangents(simd, weights);
        let normal = u.cross(v);
        let (along, length) = (normal.dot(vector), normal.dot(normal));
        (along * along).simd_ge(length * vector.dot(vector) * (1.0 - NORMAL)) & length.simd_gt(0.0)
    }

    /// Whether a point lies on the border, and the closest point to another one lies beyond it, given the vector there.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn is_held(&self, simd: S, weights: &WeightLanes<S>, vector: VectorLanes<S>) -> mask32x8<S> {
        let [u, v] = self.tangents(simd, weights);
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let (along_u, along_v) = (u.dot(vector), v.dot(vector));
        let determinant = uu * vv - uv * uv;
        let second = (vv * along_u - uv * along_v) / determinant;
        let third = (uu * along_v - uv * along_u) / determinant;
        let [b, c] = weights.0;
        let a = Self::first_weight(simd, weights);
        (a.simd_lt(AT_BORDER) & (second + third).simd_gt(BEYOND))
            | (b.simd_lt(AT_BORDER) & second.simd_lt(-BEYOND))
            | (c.simd_lt(AT_BORDER) & third.simd_lt(-BEYOND))
    }

    /// The triangle that touches the patch at a point, with the same weights there.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn touching_triangle(&self, simd: S, weights: &WeightLanes<S>) -> [VectorLanes<S>; 3] {
        let [u, v] = self.tangents(simd, weights);
        let first = self.point(simd, weights) - u.scaled(weights.0[0]) - v.scaled(weights.0[1]);
        [first, first.plus(u), first.plus(v)]
    }
}

/// The closest points of pairs of patches.
pub(super) struct MeetingLanes<S: Simd> {
    /// The distance, 0 where they cross.
    pub(super) distance: f32x8<S>,
    pub(super) weights: [WeightLanes<S>; 2],
    /// From the point on the first patch to that on the second.
    pub(super) between: VectorLanes<S>,
    /// Whether the patches may be closest inside both: the vector between the points is nearly normal to both patches,
    /// not zero, and no border holds a point.
    pub(super) may_be_inside: mask32x8<S>,
    /// Whether the patches are closest between an edge of the first and the inside of the second, or the other way
    /// round. Flat triangles never are, but patches join without a common tangent plane.
    pub(super) edge_inside: [mask32x8<S>; 2],
}

/// The largest squared sine of the angle between a normal and the vector between points that may become the closest ones
/// inside both patches. The steps get there slowly where the patches nearly touch.
const NORMAL: f32 = 0.3;

/// A point with a weight below the first number lies on the border of its patch. It is held there if the closest point
/// to the other patch's point lies beyond the border by the second number. Both patches are then closest inside of them
/// only in 1 of 100 cases in crumpled cloth, and a third as many pairs are left to look at.
const AT_BORDER: f32 = 1.0e-3;
const BEYOND: f32 = 1.0e-2;

/// Finds the closest points of two patches each. The patches must be near the origin.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn closest<S: Simd>(simd: S, a: &PatchLanes<S>, b: &PatchLanes<S>) -> MeetingLanes<S> {
    let one = f32x8::splat(simd, 1.0);
    let size = a.largest().max(b.largest()).max(f32::MIN_POSITIVE);
    // Powers of lengths up to the sixth must be normal numbers.
    let scale = one / size;
    let (a, b) = (a.scaled(scale), b.scaled(scale));
    let mut weights = ClosestLanes::of(simd, &a.corners, &b.corners).weights;
    let mut gap = b.point(simd, &weights[1]) - a.point(simd, &weights[0]);
    let mut squared = gap.dot(gap);
    for _ in 0..STEPS {
        let triangles = [a.touching_triangle(simd, &weights[0]), b.touching_triangle(simd, &weights[1])];
        let target = ClosestLanes::of(simd, &triangles[0], &triangles[1]).weights;
        let enough = squared * (1.0 - LEAST_GAIN);
        let before = weights;
        let mut is_better = one.simd_lt(0.0);
        for share in SHARES {
            let share = f32x8::splat(simd, share);
            let next = [before[0].towards(target[0], share), before[1].towards(target[1], share)];
            let next_gap = b.point(simd, &next[1]) - a.point(simd, &next[0]);
            let next_squared = next_gap.dot(next_gap);
            let takes = next_squared.simd_lt(enough) & !is_better;
            is_better |= takes;
            squared = takes.select(next_squared, squared);
            gap = VectorLanes::select(takes, next_gap, gap);
            for side in 0..2 {
                weights[side] = WeightLanes::select(takes, next[side], weights[side]);
            }
        }
        if !is_better.any_true() {
            break;
        }
    }
    let is_held = a.is_held(simd, &weights[0], gap) | b.is_held(simd, &weights[1], gap.negated());
    let is_apart = squared.simd_gt(SAME * SAME);
    let [a_at_border, b_at_border] = [at_border(simd, &weights[0]), at_border(simd, &weights[1])];
    let [normal_to_a, normal_to_b] = [a.is_normal_to(simd, &weights[0], gap), b.is_normal_to(simd, &weights[1], gap)];
    let edge_inside = [
        a_at_border.simd_eq(1.0) & b_at_border.simd_eq(0.0) & normal_to_b & is_apart,
        a_at_border.simd_eq(0.0) & b_at_border.simd_eq(1.0) & normal_to_a & is_apart,
    ];
    let may_be_inside = normal_to_a & normal_to_b & is_apart & !is_held;
    let distance = is_apart.select(squared.sqrt() * size, f32x8::splat(simd, 0.0));
    MeetingLanes { distance, weights, between: gap.scaled(size), may_be_inside, edge_inside }
}

/// How many borders of its patch a point lies on: 1 on an edge, 2 at a corner.
#[cfg_attr(not(unoptimized), inline(always))]
fn at_border<S: Simd>(simd: S, weights: &WeightLanes<S>) -> f32x8<S> {
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let [second, third] = weights.0;
    let first = one - second - third;
    first.simd_lt(AT_BORDER).select(one, zero)
        + second.simd_lt(AT_BORDER).select(one, zero)
        + third.simd_lt(AT_BORDER).select(one, zero)
}
