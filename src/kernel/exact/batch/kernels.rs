//! The contacts of a batch, eight side by side.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{f64x8, mask64x8, prelude::*};

use super::{Batch, Limits, Results};
use crate::kernel::{
    exact::triangle_pair::AT_END,
    lanes::{DoubleVectorLanes, DoubleVectorRows, rounded},
};

#[inline(always)]
pub(super) fn vertices_on_edges<S: Simd>(simd: S, batch: &Batch, limits: Limits, results: &mut Results) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [vertex, start, end, ..] = &batch.points;
    let absolute = [
        DoubleVectorLanes::load(simd, vertex),
        DoubleVectorLanes::load(simd, start),
        DoubleVectorLanes::load(simd, end),
    ];
    let [vertex, start, end] = [absolute[0] - origin, absolute[1] - origin, absolute[2] - origin];
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let (edge, from_start) = (end - start, vertex - start);
    let squared = edge.dot(edge);
    let inverse = squared.simd_gt(zero).select(one / squared, zero);
    let along = (from_start.dot(edge) * inverse).max(zero).min(one);
    let between = from_start - edge.scaled(along);
    let distance = between.dot(between).sqrt();
    let along = along.simd_le(AT_END).select(zero, along);
    let weights = [one - along, along];
    for side in [&mut results.first, &mut results.second] {
        rounded(weights[0]).store_slice(&mut side[0]);
        rounded(weights[1]).store_slice(&mut side[1]);
    }
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    let point = absolute[1].scaled(weights[0]).plus(absolute[2].scaled(weights[1]));
    DoubleVectorLanes::select(swapped, absolute[0], point).rounded().store(&mut results.point_b);
    let separation = vertex - start.scaled(weights[0]).plus(end.scaled(weights[1]));
    let separation = DoubleVectorLanes::select(swapped, separation.negated(), separation);
    let direction = results.set_distance(simd, separation, distance, batch, limits);
    direction.rounded().store(&mut results.normal);
}

#[inline(always)]
pub(super) fn vertices_over_faces<S: Simd>(simd: S, batch: &Batch, limits: Limits, results: &mut Results) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [vertex, first, second, third, _] = &batch.points;
    let corners = [
        DoubleVectorLanes::load(simd, first),
        DoubleVectorLanes::load(simd, second),
        DoubleVectorLanes::load(simd, third),
    ];
    let absolute = DoubleVectorLanes::load(simd, vertex);
    let position = absolute - origin;
    let local = [(corners[0] - origin), (corners[1] - origin), (corners[2] - origin)];
    let edges = [(local[1] - local[0]), (local[2] - local[1]), (local[0] - local[2])];
    let normal = edges[0].cross(edges[1]);
    let inverse = f64x8::splat(simd, 1.0) / normal.dot(normal);
    let height = normal.dot(position - local[0]);
    let distance_squared = height * height * inverse;
    let first = normal.cross(edges[1]).dot(position - local[1]);
    let second = normal.cross(edges[2]).dot(position - local[2]);
    let third = normal.cross(edges[0]).dot(position - local[0]);
    let (weights, point) = normalized(simd, [first, second, third], corners);
    rounded(weights[0]).store_slice(&mut results.second[0]);
    rounded(weights[1]).store_slice(&mut results.second[1]);
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    DoubleVectorLanes::select(swapped, absolute, point).rounded().store(&mut results.point_b);
    let separation = normal.scaled(height * inverse);
    let separation = DoubleVectorLanes::select(swapped, separation.negated(), separation);
    let direction = results.set_distance(simd, separation, distance_squared.sqrt(), batch, limits);
    direction.rounded().store(&mut results.normal);
}

#[inline(always)]
pub(super) fn pairs_of_edges<S: Simd>(simd: S, batch: &Batch, limits: Limits, results: &mut Results) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [start_a, end_a, start_b, end_b, _] = &batch.points;
    let (start_a, end_a) =
        (DoubleVectorLanes::load(simd, start_a) - origin, DoubleVectorLanes::load(simd, end_a) - origin);
    let (absolute_start, absolute_end) = (DoubleVectorLanes::load(simd, start_b), DoubleVectorLanes::load(simd, end_b));
    let (start_b, end_b) = ((absolute_start - origin), (absolute_end - origin));
    let (u, v) = ((end_a - start_a), (end_b - start_b));
    let normal = u.cross(v);
    let between = start_b - start_a;
    let height = normal.dot(between);
    let one = f64x8::splat(simd, 1.0);
    let inverse = one / normal.dot(normal);
    let distance_squared = height * height * inverse;
    let along_a = between.cross(v).dot(normal) * inverse;
    let along_b = between.cross(u).dot(normal) * inverse;
    let (from_a, from_b) = (one - along_a, one - along_b);
    rounded(from_a).store_slice(&mut results.first[0]);
    rounded(along_a).store_slice(&mut results.first[1]);
    rounded(from_b).store_slice(&mut results.second[0]);
    rounded(along_b).store_slice(&mut results.second[1]);
    absolute_start.scaled(from_b).plus(absolute_end.scaled(along_b)).rounded().store(&mut results.point_b);
    let separation = normal.scaled(-height * inverse);
    let direction = results.set_distance(simd, separation, distance_squared.sqrt(), batch, limits);
    direction.rounded().store(&mut results.normal);
}

/// `across` is the way from the second triangle to the first.
#[inline(always)]
pub(super) fn edges_through_faces<S: Simd>(
    simd: S,
    batch: &Batch,
    across: &DoubleVectorRows,
    limits: Limits,
    results: &mut Results,
) {
    let origin = DoubleVectorLanes::load(simd, &batch.origin);
    let [start, end, first, second, third] = &batch.points;
    let corners = [
        DoubleVectorLanes::load(simd, first),
        DoubleVectorLanes::load(simd, second),
        DoubleVectorLanes::load(simd, third),
    ];
    let (absolute_start, absolute_end) = (DoubleVectorLanes::load(simd, start), DoubleVectorLanes::load(simd, end));
    let (start, end) = ((absolute_start - origin), (absolute_end - origin));
    let local = [(corners[0] - origin), (corners[1] - origin), (corners[2] - origin)];
    let edge = end - start;
    let normal = (local[1] - local[0]).cross(local[2] - local[1]);
    let (from, to) = (normal.dot(start - local[0]), normal.dot(end - local[0]));
    let (p, q, r) = ((local[0] - start), (local[1] - start), (local[2] - start));
    let volumes = [edge.dot(q.cross(r)), edge.dot(r.cross(p)), edge.dot(p.cross(q))];
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let along = (from / (from - to)).max(zero).min(one);
    rounded(one - along).store_slice(&mut results.first[0]);
    rounded(along).store_slice(&mut results.first[1]);
    let (weights, point_on_face) = normalized(simd, volumes, corners);
    rounded(weights[0]).store_slice(&mut results.second[0]);
    rounded(weights[1]).store_slice(&mut results.second[1]);
    let point_on_edge = absolute_start.scaled(one - along).plus(absolute_end.scaled(along));
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    DoubleVectorLanes::select(swapped, point_on_edge, point_on_face).rounded().store(&mut results.point_b);

    // The normal of the face, on the side where more of the first triangle lies.
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let normal = normal.scaled(one / normal.dot(normal).sqrt());
    let away = normal.dot(DoubleVectorLanes::load(simd, across)).simd_lt(zero);
    let direction = results.set_distance(simd, normal, zero, batch, limits);
    DoubleVectorLanes::select(away, direction.negated(), direction).rounded().store(&mut results.normal);
}

/// Weights that are proportional to three values of the same sign, and the point they stand for.
#[inline(always)]
fn normalized<S: Simd>(
    simd: S,
    areas: [f64x8<S>; 3],
    corners: [DoubleVectorLanes<S>; 3],
) -> ([f64x8<S>; 3], DoubleVectorLanes<S>) {
    let one = f64x8::splat(simd, 1.0);
    let inverse = one / (areas[0] + areas[1] + areas[2]);
    let (second, third) = (areas[1] * inverse, areas[2] * inverse);
    let first = one - second - third;
    let point = corners[0].scaled(first).plus(corners[1].scaled(second)).plus(corners[2].scaled(third));
    ([first, second, third], point)
}
