//! Keeps tetrahedra from being inverted, eight at a time.

use fearless_simd::{f32x8, prelude::*};

use super::{TetrahedronBlock, deformation::Columns};
use crate::kernel::{
    simd::lanes::VectorLanes,
    xpbd::rows::{Gathered, MovingRows, gather, scatter_free},
};

/// The least `J` that contacts leave.
const UPRIGHT: f32 = 0.05;

/// Share of that by which it may be missed, so that no visit is made for the last bit.
const SLACK: f32 = 0.02;

impl TetrahedronBlock {
    /// Moves the corners of those that are inverted or nearly flat apart. Returns whether any is far from upright.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn keep_upright<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>) -> bool {
        let zero = f32x8::splat(simd, 0.0);
        let (corners, [a, b, c]) = self.corners(simd, rows);
        let density = f32x8::from_slice(simd, &self.density);
        let first = b.cross(c);
        let missing = f32x8::splat(simd, UPRIGHT) - a.dot(first) * density;
        // An unused lane has no volume and no density.
        let is_flat = missing.simd_gt(zero) & density.abs().simd_gt(zero);
        if !is_flat.any_true() {
            return false;
        }
        is_flat.select(f32x8::splat(simd, 1.0), f32x8::from_slice(simd, &self.raised)).store_slice(&mut self.raised);
        let gradients = gradients_of_volume([a, b, c], density);
        let change = is_flat.select(missing, zero) * one_per_weight(&gradients, &corners);
        let mut pushes = gradients;
        for corner in 0..4 {
            pushes[corner] = gradients[corner].scaled(change);
        }
        self.push(simd, rows, corners, pushes);
        // What is nearly where it should be does not ask for another visit.
        missing.simd_gt(f32x8::splat(simd, UPRIGHT * SLACK)).any_true()
    }

    /// Removes the velocity at which those that were kept upright gain volume.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn stop_unfolding<S: Simd>(&self, simd: S, rows: MovingRows<'_>) {
        let zero = f32x8::splat(simd, 0.0);
        let is_raised = f32x8::from_slice(simd, &self.raised).simd_gt(zero);
        if !is_raised.any_true() {
            return;
        }
        let (_, edges) = self.corners(simd, rows);
        let gradients = gradients_of_volume(edges, f32x8::from_slice(simd, &self.density));
        let speeds = [
            gather(simd, &rows.velocity, &self.corners[0]),
            gather(simd, &rows.velocity, &self.corners[1]),
            gather(simd, &rows.velocity, &self.corners[2]),
            gather(simd, &rows.velocity, &self.corners[3]),
        ];
        let mut rate = zero;
        for corner in 0..4 {
            rate += gradients[corner].dot(speeds[corner].vector);
        }
        let change = is_raised.select(-rate.max(zero), zero) * one_per_weight(&gradients, &speeds);
        for corner in 0..4 {
            let slowed = speeds[corner].pushed(gradients[corner].scaled(change));
            scatter_free(slowed, rows.velocity, &self.corners[corner]);
        }
    }
}

/// The gradients of `J` by the positions of the corners, given the edges from the first one, and the determinant of the
/// inverse of those at rest.
#[cfg_attr(not(unoptimized), inline(always))]
fn gradients_of_volume<S: Simd>([a, b, c]: Columns<S>, density: f32x8<S>) -> [VectorLanes<S>; 4] {
    let (first, second, third) = (b.cross(c).scaled(density), c.cross(a).scaled(density), a.cross(b).scaled(density));
    [first.plus(second).plus(third).negated(), first, second, third]
}

/// `1 / Σ w g²`, or 0 where nothing can move.
#[cfg_attr(not(unoptimized), inline(always))]
fn one_per_weight<S: Simd>(gradients: &[VectorLanes<S>; 4], corners: &[Gathered<S>; 4]) -> f32x8<S> {
    let mut weight = gradients[0].dot(gradients[0]) * corners[0].inverse_mass;
    for corner in 1..4 {
        weight += gradients[corner].dot(gradients[corner]) * corners[corner].inverse_mass;
    }
    let zero = weight * 0.0;
    weight.simd_gt(zero).select(1.0 / weight, zero)
}
