//! The corners of eight triangles, from their rows to the lanes.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{f32x4, f32x8, f64x8, prelude::*};
use glam::DVec3;

use crate::kernel::{
    corner_rows::CornerRow,
    lanes::{DoubleVectorLanes, WIDTH, widened},
    pose::Pose,
};

/// The corners of eight triangles, one number to the lanes, moved as [`Pose::transform_point`] does it.
#[inline(always)]
pub(super) fn corners_in_lanes<S: Simd>(
    simd: S,
    rows: &[&CornerRow; WIDTH],
    pose: Option<&Pose>,
) -> [DoubleVectorLanes<S>; 3] {
    let numbers = numbers_in_lanes(simd, rows);
    let corner = |place: usize| DoubleVectorLanes {
        x: numbers[3 * place],
        y: numbers[3 * place + 1],
        z: numbers[3 * place + 2],
    };
    let corners = [corner(0), corner(1), corner(2)];
    match pose {
        Some(pose) => [moved(simd, pose, corners[0]), moved(simd, pose, corners[1]), moved(simd, pose, corners[2])],
        None => corners,
    }
}

/// The nine numbers of eight triangles: squares of four rows and four columns are turned round.
#[inline(always)]
fn numbers_in_lanes<S: Simd>(simd: S, rows: &[&CornerRow; WIDTH]) -> [f64x8<S>; 9] {
    let row = |lane: usize| rows[lane].corners.as_flattened();
    let square = |first_row: usize, first: usize| {
        let load = |place: usize| f32x4::from_slice(simd, &row(first_row + place)[first..first + 4]);
        let ((a, b), (c, d)) = (load(0).interleave(load(2)), load(1).interleave(load(3)));
        let ((first, second), (third, fourth)) = (a.interleave(c), b.interleave(d));
        [first, second, third, fourth]
    };
    let [low, high] = [[square(0, 0), square(4, 0)], [square(0, 4), square(4, 4)]];
    let last = [row(0)[8], row(1)[8], row(2)[8], row(3)[8], row(4)[8], row(5)[8], row(6)[8], row(7)[8]];
    let column = |halves: &[[f32x4<S>; 4]; 2], place: usize| widened(halves[0][place].combine(halves[1][place]));
    [
        column(&low, 0),
        column(&low, 1),
        column(&low, 2),
        column(&low, 3),
        column(&high, 0),
        column(&high, 1),
        column(&high, 2),
        column(&high, 3),
        widened(f32x8::from_slice(simd, &last)),
    ]
}

#[inline(always)]
fn moved<S: Simd>(simd: S, pose: &Pose, point: DoubleVectorLanes<S>) -> DoubleVectorLanes<S> {
    let affine = pose.to_affine();
    let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
    let along = |axis: DVec3, factor: f64x8<S>| DoubleVectorLanes::splat(simd, axis).scaled(factor);
    let turned = along(x, point.x).plus(along(y, point.y)).plus(along(z, point.z));
    turned.plus(DoubleVectorLanes::splat(simd, affine.translation))
}
