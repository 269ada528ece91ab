//! The closest points of eight pairs of flat triangles, with their weights.

use fearless_simd::{f32x8, mask32x8, prelude::*};

use crate::kernel::simd::lanes::VectorLanes;

/// Below this, relative to the squares that it is the difference of, a determinant is only rounding.
const PARALLEL: f32 = 1.0e-6;

/// Keeps divisions by lengths of zero finite. Triangles are scaled to a size of about 1.
const NOTHING: f32 = 1.0e-30;

/// The weights of the second and the third corner at a point of each of eight triangles.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct WeightLanes<S: Simd>(pub(in crate::kernel) [f32x8<S>; 2]);

impl<S: Simd> WeightLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn splat(simd: S, weight: f32) -> Self {
        Self([f32x8::splat(simd, weight); 2])
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn select(mask: mask32x8<S>, yes: Self, no: Self) -> Self {
        Self([mask.select(yes.0[0], no.0[0]), mask.select(yes.0[1], no.0[1])])
    }

    /// The point at a share of the way to another one.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn towards(self, other: Self, share: f32x8<S>) -> Self {
        Self([self.0[0] + (other.0[0] - self.0[0]) * share, self.0[1] + (other.0[1] - self.0[1]) * share])
    }

    /// At a share of the way along edge `edge`.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn on_edge(simd: S, edge: usize, along: f32x8<S>) -> Self {
        let (zero, rest) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0) - along);
        Self(match edge {
            0 => [along, zero],
            1 => [rest, along],
            _ => [zero, rest],
        })
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn at_corner(simd: S, corner: usize) -> Self {
        let [second, third] = [f32::from(corner == 1), f32::from(corner == 2)];
        Self([f32x8::splat(simd, second), f32x8::splat(simd, third)])
    }
}

/// The closest points of pairs of triangles.
pub(in crate::kernel) struct ClosestLanes<S: Simd> {
    pub(in crate::kernel) weights: [WeightLanes<S>; 2],
    squared: f32x8<S>,
}

impl<S: Simd> ClosestLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn offer(&mut self, is_allowed: mask32x8<S>, squared: f32x8<S>, weights: [WeightLanes<S>; 2]) {
        let is_closer = squared.simd_lt(self.squared) & is_allowed;
        self.squared = is_closer.select(squared, self.squared);
        for side in 0..2 {
            self.weights[side] = WeightLanes::select(is_closer, weights[side], self.weights[side]);
        }
    }

    /// Finds the closest points of two triangles each. Where they cross, a point that both share.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of(simd: S, a: &[VectorLanes<S>; 3], b: &[VectorLanes<S>; 3]) -> Self {
        let all = f32x8::splat(simd, 0.0).simd_eq(0.0);
        let mut closest =
            Self { weights: [WeightLanes::splat(simd, 0.0); 2], squared: f32x8::splat(simd, f32::INFINITY) };
        let (edges_a, edges_b) = (edges(simd, a), edges(simd, b));
        for own in 0..3 {
            for other in 0..3 {
                let (squared, along) = of_edges(simd, &edges_a[own], &edges_b[other]);
                let weights = [WeightLanes::on_edge(simd, own, along[0]), WeightLanes::on_edge(simd, other, along[1])];
                closest.offer(all, squared, weights);
            }
        }
        let feet = faces(simd, a, b);
        let other_feet = faces(simd, b, a);
        for corner in 0..3 {
            let own = WeightLanes::at_corner(simd, corner);
            let (foot, other) = (&feet[corner], &other_feet[corner]);
            closest.offer(foot.is_inside, foot.height * foot.height, [own, foot.weights]);
            closest.offer(other.is_inside, other.height * other.height, [other.weights, own]);
        }
        let zero = f32x8::splat(simd, 0.0);
        for edge in 0..3 {
            let (pierces, along, weights) = piercing(simd, &feet[edge], &feet[(edge + 1) % 3]);
            closest.offer(pierces, zero, [WeightLanes::on_edge(simd, edge, along), weights]);
            let (pierces, along, weights) = piercing(simd, &other_feet[edge], &other_feet[(edge + 1) % 3]);
            closest.offer(pierces, zero, [weights, WeightLanes::on_edge(simd, edge, along)]);
        }
        closest
    }
}

/// An edge of each of eight triangles.
struct EdgeLanes<S: Simd> {
    start: VectorLanes<S>,
    along: VectorLanes<S>,
    /// The squared length, and one over it.
    squared: f32x8<S>,
    inverse: f32x8<S>,
}

impl<S: Simd> EdgeLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new(simd: S, start: VectorLanes<S>, end: VectorLanes<S>) -> Self {
        let along = end - start;
        let squared = along.dot(along).max(NOTHING);
        Self { start, along, squared, inverse: f32x8::splat(simd, 1.0) / squared }
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn edges<S: Simd>(simd: S, &[p, q, r]: &[VectorLanes<S>; 3]) -> [EdgeLanes<S>; 3] {
    [EdgeLanes::new(simd, p, q), EdgeLanes::new(simd, q, r), EdgeLanes::new(simd, r, p)]
}

#[cfg_attr(not(unoptimized), inline(always))]
fn clamped<S: Simd>(share: f32x8<S>) -> f32x8<S> {
    share.max(0.0).min(1.0)
}

/// The squared distance of two segments, and where along each the closest points are (Ericson, "Real-Time Collision
/// Detection", 5.1.9).
#[cfg_attr(not(unoptimized), inline(always))]
fn of_edges<S: Simd>(simd: S, a: &EdgeLanes<S>, b: &EdgeLanes<S>) -> (f32x8<S>, [f32x8<S>; 2]) {
    let between = a.start - b.start;
    let (own, other, cosine) = (a.along.dot(between), b.along.dot(between), a.along.dot(b.along));
    let product = a.squared * b.squared;
    let determinant = product - cosine * cosine;
    let is_skew = determinant.simd_gt(product * PARALLEL);
    let crossing = clamped((cosine * other - own * b.squared) / determinant);
    let place = is_skew.select(crossing, f32x8::splat(simd, 0.0));
    let other_place = clamped((cosine * place + other) * b.inverse);
    let place = clamped((cosine * other_place - own) * a.inverse);
    let gap = between.plus(a.along.scaled(place)) - b.along.scaled(other_place);
    (gap.dot(gap), [place, other_place])
}

/// Where a corner is over a triangle.
pub(in crate::kernel) struct FootLanes<S: Simd> {
    /// Above the plane, in units of the length.
    height: f32x8<S>,
    pub(in crate::kernel) weights: WeightLanes<S>,
    pub(in crate::kernel) is_inside: mask32x8<S>,
}

/// What is needed of a triangle to tell where points are over it.
pub(in crate::kernel) struct FaceLanes<S: Simd> {
    origin: VectorLanes<S>,
    sides: [VectorLanes<S>; 2],
    /// The squared lengths of both sides, and between them their product.
    products: [f32x8<S>; 3],
    normal: VectorLanes<S>,
    /// One over the squared length of the normal, and its root.
    inverse: f32x8<S>,
    scale: f32x8<S>,
    has_area: mask32x8<S>,
}

impl<S: Simd> FaceLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(simd: S, &[origin, second, third]: &[VectorLanes<S>; 3]) -> Self {
        let sides = [second - origin, third - origin];
        let products = [sides[0].dot(sides[0]), sides[0].dot(sides[1]), sides[1].dot(sides[1])];
        let normal = sides[0].cross(sides[1]);
        let squared = normal.dot(normal);
        let has_area = squared.simd_gt(products[0] * products[2] * PARALLEL * PARALLEL) & squared.simd_gt(NOTHING);
        let inverse = f32x8::splat(simd, 1.0) / squared.max(NOTHING);
        Self { origin, sides, products, normal, inverse, scale: inverse.sqrt(), has_area }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn foot(&self, simd: S, point: VectorLanes<S>) -> FootLanes<S> {
        let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let between = point - self.origin;
        let [along_first, along_second] = [between.dot(self.sides[0]), between.dot(self.sides[1])];
        let [ff, fs, ss] = self.products;
        let u = (ss * along_first - fs * along_second) * self.inverse;
        let v = (ff * along_second - fs * along_first) * self.inverse;
        let is_inside = self.has_area & u.simd_ge(zero) & v.simd_ge(zero) & (u + v).simd_le(one);
        FootLanes { height: between.dot(self.normal) * self.scale, weights: WeightLanes([u, v]), is_inside }
    }
}

/// Where the corners of one triangle are over another.
#[cfg_attr(not(unoptimized), inline(always))]
fn faces<S: Simd>(simd: S, &[p, q, r]: &[VectorLanes<S>; 3], face: &[VectorLanes<S>; 3]) -> [FootLanes<S>; 3] {
    let face = FaceLanes::new(simd, face);
    [face.foot(simd, p), face.foot(simd, q), face.foot(simd, r)]
}

/// Whether an edge pierces a face between two of its ends' feet, how far along, and where.
#[cfg_attr(not(unoptimized), inline(always))]
fn piercing<S: Simd>(simd: S, start: &FootLanes<S>, end: &FootLanes<S>) -> (mask32x8<S>, f32x8<S>, WeightLanes<S>) {
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let crosses = (start.height * end.height).simd_lt(zero);
    let along = crosses.select(start.height / (start.height - end.height), zero);
    let weights = start.weights.towards(end.weights, along);
    let [u, v] = weights.0;
    (crosses & u.simd_ge(zero) & v.simd_ge(zero) & (u + v).simd_le(one), along, weights)
}
