//! Eight pairs of triangles in memory, for a screen that loops over their corners and edges.
//!
//! A pair has more numbers than there are registers. In memory they are read where they are needed, and a loop over
//! corners and edges stays short.

use fearless_simd::{f64x8, prelude::*, u64x8};

use crate::kernel::{
    exact::tolerances::AT_END,
    simd::lanes::{DoubleVectorLanes, DoubleVectorRows, WIDTH},
};

/// One number per pair.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Numbers([f64; WIDTH]);

impl Numbers {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn load<S: Simd>(&self, simd: S) -> f64x8<S> {
        f64x8::from_slice(simd, &self.0)
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn store<S: Simd>(&mut self, numbers: f64x8<S>) {
        numbers.store_slice(&mut self.0);
    }
}

/// Eight pairs of triangles. The first index is the triangle, where a number belongs to one.
///
/// All vectors lead from a corner of the first triangle to a corner of the second, and the edges of the second are
/// reversed. Seen from the other end, a vector and an edge both change their sign, so every product is the one that
/// `triangle_pair` computes, or its exact negative where that makes no difference.
pub(super) struct Rows {
    /// From each corner of the first triangle to each of the second.
    pub(super) ways: [[DoubleVectorRows; 3]; 3],
    pub(super) edges: [[DoubleVectorRows; 3]; 2],
    pub(super) lengths_squared: [[Numbers; 3]; 2],
    /// Inverse squared lengths, or 0.
    pub(super) inverses: [[Numbers; 3]; 2],
    pub(super) normals: [DoubleVectorRows; 2],
    /// In the plane, perpendicular to each edge, toward the inside.
    pub(super) inward: [[DoubleVectorRows; 3]; 2],
    /// The squared distance of every vertex from every edge, in the order of `BoundaryCases`.
    pub(super) boundaries: [Numbers; 18],
    /// Where along the edge the vertex is closest.
    pub(super) alongs: [Numbers; 18],
    /// Six times the volume between two edges. The sign is correct for all, or wrong for all.
    pub(super) volumes: [[Numbers; 3]; 3],
    /// Height of each vertex over the other's face, multiplied by the length of the normal: all of them from above, or
    /// all from below.
    pub(super) heights: [[Numbers; 3]; 2],
}

impl Rows {
    pub(super) const ZERO: Self = {
        let (vector, number) = (DoubleVectorRows::ZERO, Numbers([0.0; WIDTH]));
        Self {
            ways: [[vector; 3]; 3],
            edges: [[vector; 3]; 2],
            lengths_squared: [[number; 3]; 2],
            inverses: [[number; 3]; 2],
            normals: [vector; 2],
            inward: [[vector; 3]; 2],
            boundaries: [number; 18],
            alongs: [number; 18],
            volumes: [[number; 3]; 3],
            heights: [[number; 3]; 2],
        }
    };

    /// Takes the second and third corner of one triangle, whose first corner is the origin, and the corners of the
    /// other.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn set<S: Simd>(
        &mut self,
        simd: S,
        [second, third]: [DoubleVectorLanes<S>; 2],
        b: &[DoubleVectorLanes<S>; 3],
    ) {
        for corner in 0..3 {
            b[corner].store(&mut self.ways[0][corner]);
            (b[corner] - second).store(&mut self.ways[1][corner]);
            (b[corner] - third).store(&mut self.ways[2][corner]);
        }
        self.set_side(simd, 0, [second, third - second, third.negated()]);
        self.set_side(simd, 1, [b[0] - b[1], b[1] - b[2], b[2] - b[0]]);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn set_side<S: Simd>(&mut self, simd: S, side: usize, edges: [DoubleVectorLanes<S>; 3]) {
        let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
        let normal = edges[0].cross(edges[1]);
        normal.store(&mut self.normals[side]);
        for (place, edge) in edges.into_iter().enumerate() {
            let length_squared = edge.dot(edge);
            edge.store(&mut self.edges[side][place]);
            self.lengths_squared[side][place].store(length_squared);
            self.inverses[side][place].store(length_squared.simd_gt(zero).select(one / length_squared, zero));
            normal.cross(edge).store(&mut self.inward[side][place]);
        }
    }

    /// The vertices and edges whose squared distance is at most `most`, one bit each.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn boundaries_within<S: Simd>(&self, simd: S, most: f64x8<S>) -> u64x8<S> {
        let mut within = u64x8::splat(simd, 0);
        for (place, distance_squared) in self.boundaries.iter().enumerate() {
            within = distance_squared.load(simd).simd_le(most).select(within | (1u64 << place), within);
        }
        within
    }

    /// Where the vertex is closest to the start of the edge, and where it is closest to its end.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn at_ends<S: Simd>(&self, simd: S) -> [u64x8<S>; 2] {
        let (mut at_start, mut at_end) = (u64x8::splat(simd, 0), u64x8::splat(simd, 0));
        for (place, along) in self.alongs.iter().enumerate() {
            let (along, case) = (along.load(simd), 1u64 << place);
            at_start = along.simd_le(AT_END).select(at_start | case, at_start);
            at_end = along.simd_ge(1.0 - AT_END).select(at_end | case, at_end);
        }
        [at_start, at_end]
    }
}
