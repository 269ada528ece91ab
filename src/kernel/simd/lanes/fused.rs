//! Vectors of eight lanes as three numbers each, with fused multiply-add where the processor has it. Only for bounds,
//! which hold however they are rounded, not for numbers that must be the same everywhere.

use fearless_simd::{f32x8, prelude::*};

/// One vector per lane.
pub(in crate::kernel) type Vectors<S> = [f32x8<S>; 3];

#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn plus<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Vectors<S> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn minus<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Vectors<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn dot<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> f32x8<S> {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// Without fused operations.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn cross<S: Simd>(a: Vectors<S>, b: Vectors<S>) -> Vectors<S> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The interval of a triangle's projections on a direction of any length.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn project<S: Simd>(corners: &[Vectors<S>; 3], direction: Vectors<S>) -> (f32x8<S>, f32x8<S>) {
    let (first, second, third) = (dot(direction, corners[0]), dot(direction, corners[1]), dot(direction, corners[2]));
    (first.min(second).min(third), first.max(second).max(third))
}
