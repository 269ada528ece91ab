//! The contacts of a batch, eight at a time.

use fearless_simd::{f64x8, mask64x8, prelude::*};

use super::{Batch, FIRST, Limits, Results, SECOND};
use crate::kernel::{
    exact::tolerances::AT_END,
    simd::lanes::{DoubleVectorLanes, VectorLanes, VectorRows, rounded},
};

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn vertices_on_edges<S: Simd>(simd: S, batch: &Batch, limits: &Limits<'_>, results: &mut Results) {
    let origin = origins(simd, batch, limits);
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    let [vertex, start, end, ..] = &batch.points;
    let absolute = [
        placed(simd, vertex, swapped, limits),
        placed(simd, start, !swapped, limits),
        placed(simd, end, !swapped, limits),
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
    results.set_weights(FIRST, weights[0], weights[1]);
    results.set_weights(SECOND, weights[0], weights[1]);
    let point = absolute[1].scaled(weights[0]).plus(absolute[2].scaled(weights[1]));
    DoubleVectorLanes::select(swapped, absolute[0], point).rounded().store(&mut results.point_b);
    let separation = vertex - start.scaled(weights[0]).plus(end.scaled(weights[1]));
    let separation = DoubleVectorLanes::select(swapped, separation.negated(), separation);
    let normal = results.set_distance(simd, separation, distance, batch, limits);
    normal.rounded().store(&mut results.normal);
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn vertices_over_faces<S: Simd>(simd: S, batch: &Batch, limits: &Limits<'_>, results: &mut Results) {
    let origin = origins(simd, batch, limits);
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    let [vertex, first, second, third, ..] = &batch.points;
    let corners = [
        placed(simd, first, !swapped, limits),
        placed(simd, second, !swapped, limits),
        placed(simd, third, !swapped, limits),
    ];
    let absolute = placed(simd, vertex, swapped, limits);
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
    results.set_weights(SECOND, weights[0], weights[1]);
    DoubleVectorLanes::select(swapped, absolute, point).rounded().store(&mut results.point_b);
    let separation = normal.scaled(height * inverse);
    let separation = DoubleVectorLanes::select(swapped, separation.negated(), separation);
    let normal = results.set_distance(simd, separation, distance_squared.sqrt(), batch, limits);
    normal.rounded().store(&mut results.normal);
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn pairs_of_edges<S: Simd>(simd: S, batch: &Batch, limits: &Limits<'_>, results: &mut Results) {
    let origin = origins(simd, batch, limits);
    let of_b = mask64x8::splat(simd, true);
    let [start_a, end_a, start_b, end_b, ..] = &batch.points;
    let (start_a, end_a) = (placed(simd, start_a, !of_b, limits) - origin, placed(simd, end_a, !of_b, limits) - origin);
    let (absolute_start, absolute_end) = (placed(simd, start_b, of_b, limits), placed(simd, end_b, of_b, limits));
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
    results.set_weights(FIRST, from_a, along_a);
    results.set_weights(SECOND, from_b, along_b);
    absolute_start.scaled(from_b).plus(absolute_end.scaled(along_b)).rounded().store(&mut results.point_b);
    let separation = normal.scaled(-height * inverse);
    let normal = results.set_distance(simd, separation, distance_squared.sqrt(), batch, limits);
    normal.rounded().store(&mut results.normal);
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn edges_through_faces<S: Simd>(simd: S, batch: &Batch, limits: &Limits<'_>, results: &mut Results) {
    let origin = origins(simd, batch, limits);
    let swapped = mask64x8::from_bitmask(simd, batch.swapped);
    let [start, end, first, second, third, apex] = &batch.points;
    let corners = [
        placed(simd, first, !swapped, limits),
        placed(simd, second, !swapped, limits),
        placed(simd, third, !swapped, limits),
    ];
    let (absolute_start, absolute_end) = (placed(simd, start, swapped, limits), placed(simd, end, swapped, limits));
    let apex = placed(simd, apex, swapped, limits);
    let (start, end) = ((absolute_start - origin), (absolute_end - origin));
    let local = [(corners[0] - origin), (corners[1] - origin), (corners[2] - origin)];
    let edge = end - start;
    let normal = (local[1] - local[0]).cross(local[2] - local[1]);
    let (from, to) = (normal.dot(start - local[0]), normal.dot(end - local[0]));
    let (p, q, r) = ((local[0] - start), (local[1] - start), (local[2] - start));
    let volumes = [edge.dot(q.cross(r)), edge.dot(r.cross(p)), edge.dot(p.cross(q))];
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let along = (from / (from - to)).max(zero).min(one);
    results.set_weights(FIRST, one - along, along);
    let (weights, point_on_face) = normalized(simd, volumes, corners);
    results.set_weights(SECOND, weights[0], weights[1]);
    let point_on_edge = absolute_start.scaled(one - along).plus(absolute_end.scaled(along));
    DoubleVectorLanes::select(swapped, point_on_edge, point_on_face).rounded().store(&mut results.point_b);

    // The vector from the centroid of the second triangle to that of the first. The corners of the edge's triangle are
    // added in their original order.
    let (second_edge, third_edge) =
        (mask64x8::from_bitmask(simd, batch.turned[0]), mask64x8::from_bitmask(simd, batch.turned[1]));
    let own = [
        select_of_three(second_edge, third_edge, [absolute_start, apex, absolute_end]),
        select_of_three(second_edge, third_edge, [absolute_end, absolute_start, apex]),
        select_of_three(second_edge, third_edge, [apex, absolute_end, absolute_start]),
    ];
    let (own, other) = (own[0].plus(own[1]).plus(own[2]), corners[0].plus(corners[1]).plus(corners[2]));
    let three = f64x8::splat(simd, 3.0);
    let between = DoubleVectorLanes::select(swapped, other, own) - DoubleVectorLanes::select(swapped, own, other);
    let across = DoubleVectorLanes { x: between.x / three, y: between.y / three, z: between.z / three };

    // The normal of the face, away from the side where more of the first triangle lies.
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let normal = normal.scaled(one / normal.dot(normal).sqrt());
    let away = normal.dot(across).simd_lt(zero);
    let opposite = results.set_distance(simd, normal, zero, batch, limits);
    DoubleVectorLanes::select(away, opposite.negated(), opposite).rounded().store(&mut results.normal);
}

/// The second or the third value where its mask is set, otherwise the first.
#[cfg_attr(not(unoptimized), inline(always))]
fn select_of_three<S: Simd>(
    second: mask64x8<S>,
    third: mask64x8<S>,
    values: [DoubleVectorLanes<S>; 3],
) -> DoubleVectorLanes<S> {
    let value = DoubleVectorLanes::select(second, values[1], values[0]);
    DoubleVectorLanes::select(third, values[2], value)
}

/// The first corners of the first triangles, in the pair's frame.
#[cfg_attr(not(unoptimized), inline(always))]
fn origins<S: Simd>(simd: S, batch: &Batch, limits: &Limits<'_>) -> DoubleVectorLanes<S> {
    placed(simd, &batch.origin, mask64x8::splat(simd, false), limits)
}

/// Points in the pair's frame. The mask selects those of the second surface.
#[cfg_attr(not(unoptimized), inline(always))]
fn placed<S: Simd>(simd: S, points: &VectorRows, of_second: mask64x8<S>, limits: &Limits<'_>) -> DoubleVectorLanes<S> {
    let points = VectorLanes::load(simd, points).widened();
    let [a, b] = limits.poses;
    if a.is_none() && b.is_none() {
        return points;
    }
    DoubleVectorLanes::select(of_second, points.moved(simd, b), points.moved(simd, a))
}

impl Results {
    /// Stores the weights of the start and the end of an edge, or of the first two corners of a face.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn set_weights<S: Simd>(&mut self, row: u8, start: f64x8<S>, end: f64x8<S>) {
        rounded(start).store_slice(&mut self.weights[row as usize]);
        rounded(end).store_slice(&mut self.weights[row as usize + 1]);
    }
}

/// Normalizes three values of the same sign to weights, and returns these with the point that they stand for.
#[cfg_attr(not(unoptimized), inline(always))]
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
