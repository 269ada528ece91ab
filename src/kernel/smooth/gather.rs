//! Gathers the patches of eight triangles.

use fearless_simd::{f32x4, f32x8, f64x8, prelude::*};
use glam::Vec3;

use super::{closest_lanes::WeightLanes, patch_lanes::PatchLanes};
use crate::kernel::{
    mesh::curved_edges::MOST_OF_EDGE,
    pair::SurfaceSide,
    simd::lanes::{DoubleVectorLanes, VectorLanes, WIDTH, widened},
};

/// The patches of eight triangles in the frame of a pair.
pub(super) struct GatheredPatches<S: Simd> {
    pub(super) corners: [DoubleVectorLanes<S>; 3],
    pub(super) offsets: [VectorLanes<S>; 3],
}

impl<S: Simd> GatheredPatches<S> {
    /// Gathers patches. Each begins with its corner `turns`, and its other corners and edges follow in their order.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn new(simd: S, side: &SurfaceSide<'_>, triangles: &[u32; WIDTH], turns: [u8; WIDTH]) -> Self {
        Self { corners: corners(simd, side, triangles, turns), offsets: offsets(simd, side, triangles, turns) }
    }

    /// Relative to an origin, in f32.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn relative(&self, origin: DoubleVectorLanes<S>) -> PatchLanes<S> {
        PatchLanes { corners: relative(&self.corners, origin), offsets: self.offsets }
    }

    /// Points of the patches relative to an origin, in f64.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn point(
        &self,
        simd: S,
        origin: DoubleVectorLanes<S>,
        &WeightLanes([second, third]): &WeightLanes<S>,
    ) -> DoubleVectorLanes<S> {
        let [p, q, r] = self.corners;
        let (second, third) = (widened(second), widened(third));
        let first = f64x8::splat(simd, 1.0) - second - third;
        let [along, across, back] = [self.offsets[0].widened(), self.offsets[1].widened(), self.offsets[2].widened()];
        (p - origin)
            .plus((q - p).scaled(second))
            .plus((r - p).scaled(third))
            .plus(along.scaled(first * second))
            .plus(across.scaled(second * third))
            .plus(back.scaled(third * first))
    }

    /// How far the patches may be from their triangles.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn heights(&self) -> f32x8<S> {
        let [first, second, third] = self.offsets;
        first.dot(first).max(second.dot(second)).max(third.dot(third)).sqrt() * MOST_OF_EDGE
    }
}

/// Corners relative to an origin, in f32.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn relative<S: Simd>(
    &[p, q, r]: &[DoubleVectorLanes<S>; 3],
    origin: DoubleVectorLanes<S>,
) -> [VectorLanes<S>; 3] {
    [(p - origin).rounded(), (q - origin).rounded(), (r - origin).rounded()]
}

/// The corners of eight triangles in the frame of a pair.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn corners_of<S: Simd>(
    simd: S,
    side: &SurfaceSide<'_>,
    triangles: &[u32; WIDTH],
) -> [DoubleVectorLanes<S>; 3] {
    corners(simd, side, triangles, [0; WIDTH])
}

#[cfg_attr(not(unoptimized), inline(always))]
fn corners<S: Simd>(
    simd: S,
    side: &SurfaceSide<'_>,
    triangles: &[u32; WIDTH],
    turns: [u8; WIDTH],
) -> [DoubleVectorLanes<S>; 3] {
    let mut vertices = [[Vec3::ZERO; WIDTH]; 3];
    for lane in 0..WIDTH {
        let corners = side.own_corners(triangles[lane]);
        for place in 0..3 {
            vertices[place][lane] = corners[(place + turns[lane] as usize) % 3];
        }
    }
    let pose = side.moved.map(|moved| moved.pose);
    let [p, q, r] = vertices;
    [
        VectorLanes::of(simd, p).widened().moved(simd, pose),
        VectorLanes::of(simd, q).widened().moved(simd, pose),
        VectorLanes::of(simd, r).widened().moved(simd, pose),
    ]
}

#[cfg_attr(not(unoptimized), inline(always))]
fn offsets<S: Simd>(
    simd: S,
    side: &SurfaceSide<'_>,
    triangles: &[u32; WIDTH],
    turns: [u8; WIDTH],
) -> [VectorLanes<S>; 3] {
    let Some(curved) = side.curved else { return [VectorLanes::splat(simd, Vec3::ZERO); 3] };
    let mut rows = [[f32x4::splat(simd, 0.0); WIDTH]; 3];
    for lane in 0..WIDTH {
        let row = curved.row(triangles[lane]);
        for place in 0..3 {
            rows[place][lane] = f32x4::from_slice(simd, row.offset((place + turns[lane] as usize) % 3));
        }
    }
    let [first, second, third] = rows;
    let [first, second, third] =
        [VectorLanes::of_rows(first), VectorLanes::of_rows(second), VectorLanes::of_rows(third)];
    let Some(moved) = side.moved else { return [first, second, third] };
    let turn = moved.pose.to_affine().matrix3;
    [
        first.widened().turned(simd, &turn).rounded(),
        second.widened().turned(simd, &turn).rounded(),
        third.widened().turned(simd, &turn).rounded(),
    ]
}
