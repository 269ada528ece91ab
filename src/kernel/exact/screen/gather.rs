//! Transposes the corners of eight triangles from their rows into lanes.

use fearless_simd::{f32x8, f64x8, prelude::*};

use crate::kernel::{
    mesh::corner_rows::CornerRow,
    pose::Pose,
    simd::lanes::{DoubleVectorLanes, WIDTH, columns_from, widened},
};

/// The corners of eight triangles, transformed like [`Pose::transform_point`].
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn corners_in_lanes<S: Simd>(
    simd: S,
    rows: &[&CornerRow; WIDTH],
    pose: Option<&Pose>,
) -> [DoubleVectorLanes<S>; 3] {
    let numbers = numbers_in_lanes(simd, rows);
    let [ax, ay, az, bx, by, bz, cx, cy, cz] = numbers;
    let corners = [
        DoubleVectorLanes { x: ax, y: ay, z: az },
        DoubleVectorLanes { x: bx, y: by, z: bz },
        DoubleVectorLanes { x: cx, y: cy, z: cz },
    ];
    [corners[0].moved(simd, pose), corners[1].moved(simd, pose), corners[2].moved(simd, pose)]
}

/// The nine coordinates of eight triangles.
#[cfg_attr(not(unoptimized), inline(always))]
fn numbers_in_lanes<S: Simd>(simd: S, rows: &[&CornerRow; WIDTH]) -> [f64x8<S>; 9] {
    let mut all: [&[f32]; WIDTH] = [&[]; WIDTH];
    let mut last = [0.0; WIDTH];
    for (lane, row) in rows.iter().enumerate() {
        all[lane] = row.corners.as_flattened();
        last[lane] = row.corners[2][2];
    }
    let [a, b, c, d] = columns_from::<0, S>(simd, all);
    let [e, f, g, h] = columns_from::<4, S>(simd, all);
    let last = f32x8::from_slice(simd, &last);
    [widened(a), widened(b), widened(c), widened(d), widened(e), widened(f), widened(g), widened(h), widened(last)]
}
