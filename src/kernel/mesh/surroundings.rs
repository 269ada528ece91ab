//! What a triangle is to its neighbors along the surface: of which vertices and edges it is the first triangle, and how far
//! it is from some landmarks.
//!
//! Found with the topology. The exact stage tells by it, without looking anything else up, which of several triangles reports
//! a shared feature.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{mask64x8, prelude::*, u8x64, u64x8};

use super::topology::Incidence;
use crate::kernel::simd::lanes::WIDTH;

/// From so many vertices of each component the distances along the surface are known.
const LANDMARKS: usize = 3;

/// Two triangles whose distances from a landmark differ by more have no first triangles that share a vertex: a triangle's
/// vertices are an edge away from its first corner, and those of a triangle around one of them at most two.
const FARTHEST: u8 = 4;

/// What a triangle is to its neighbors, in as little room as it takes.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct Surroundings {
    /// How far its first corner is from each landmark, in edges, without what 256 goes into.
    distances: [u8; LANDMARKS],
    /// Of which of its parts it is the first of the triangles around them, one bit each: 0 to 2 its corners, 3 to 5 its
    /// edges. 6: whether it names a vertex twice.
    pub(in crate::kernel) first_of: u8,
}

/// The bit of a triangle that names a vertex twice, so that two of its parts are the same.
const COLLAPSED: u8 = 1 << 6;

impl Surroundings {
    pub(in crate::kernel) const NONE: Self = Self { distances: [0; LANDMARKS], first_of: 0 };

    /// Those of all triangles, given as welded vertices and as edges, with the triangles around either.
    pub(in crate::kernel) fn of_all(
        triangles: &[[u32; 3]],
        triangle_edges: &[[u32; 3]],
        vertex_triangles: &Incidence,
        edge_triangles: &Incidence,
    ) -> Vec<Self> {
        let distances = landmark_distances(triangles, vertex_triangles);
        let of_one = |(triangle, (corners, edges)): (usize, (&[u32; 3], &[u32; 3]))| {
            let firsts = first_triangles(corners, edges, vertex_triangles, edge_triangles);
            let is_first = |(part, first): (usize, u32)| u8::from(first as usize == triangle) << part;
            let [a, b, c] = *corners;
            let collapsed = if a == b || b == c || c == a { COLLAPSED } else { 0 };
            Self {
                distances: distances[corners[0] as usize],
                first_of: firsts.into_iter().enumerate().map(is_first).sum::<u8>() | collapsed,
            }
        };
        triangles.iter().zip(triangle_edges).enumerate().map(of_one).collect()
    }

    /// Whether two parts of the triangle are the same.
    #[inline]
    pub(in crate::kernel) const fn is_collapsed(self) -> bool {
        self.first_of & COLLAPSED != 0
    }

    /// All of it in one number.
    #[inline(always)]
    fn bits(self) -> u64 {
        let [first, second, third] = self.distances;
        u64::from(u32::from_le_bytes([first, second, third, self.first_of]))
    }
}

/// Those of eight triangles.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct SurroundingLanes<S: Simd>(u64x8<S>);

impl<S: Simd> SurroundingLanes<S> {
    #[inline(always)]
    pub(in crate::kernel) fn new(simd: S, all: [Surroundings; WIDTH]) -> Self {
        let mut bits = [0; WIDTH];
        for (bits, surroundings) in bits.iter_mut().zip(all) {
            *bits = surroundings.bits();
        }
        Self(u64x8::from_slice(simd, &bits))
    }

    /// Of which of its parts a triangle is the first of the triangles around them, see [`Surroundings`].
    #[inline(always)]
    pub(in crate::kernel) fn first_of(self) -> u64x8<S> {
        self.0 >> 24
    }

    /// Where two parts of the triangle are the same.
    #[inline(always)]
    pub(in crate::kernel) fn are_collapsed(self) -> mask64x8<S> {
        !(self.first_of() & u64::from(COLLAPSED)).simd_eq(0)
    }

    /// Whether the first triangles around the vertices and edges of the one may share a vertex with those around those of
    /// the other. Where it is false they do not; where it is true, that is all that the landmarks tell.
    #[inline(always)]
    pub(in crate::kernel) fn firsts_may_meet(self, other: Self) -> mask64x8<S> {
        let (own, other): (u8x64<S>, u8x64<S>) = (self.0.bitcast(), other.0.bitcast());
        let differences: u64x8<S> = (own - other + FARTHEST).bitcast();
        // Those of eight and less have neither one of the upper four digits nor a carry from the lower ones.
        const { assert!(FARTHEST == 4) };
        let far = differences & 0xf0_f0f0 | ((differences & 0x0f_0f0f) + 0x07_0707) & 0x10_1010;
        far.simd_eq(0)
    }
}

/// The first triangles around the vertices and the edges of a triangle.
fn first_triangles(
    corners: &[u32; 3],
    edges: &[u32; 3],
    vertex_triangles: &Incidence,
    edge_triangles: &Incidence,
) -> [u32; 6] {
    let [a, b, c] = corners.map(|vertex| vertex_triangles.around(vertex)[0]);
    let [d, e, f] = edges.map(|edge| edge_triangles.around(edge)[0]);
    [a, b, c, d, e, f]
}

/// For each vertex how many edges away it is from each of some landmarks, which are chosen one after the other, each as
/// far from those before as there is. Every component has landmarks of its own, and higher numbers than the one before. Of
/// each number the last byte.
fn landmark_distances(triangles: &[[u32; 3]], around: &Incidence) -> Vec<[u8; LANDMARKS]> {
    const UNSEEN: u32 = u32::MAX;
    let count = around.len();
    let mut distances = vec![[0; LANDMARKS]; count];
    let mut seeds: Vec<u32> = triangles.iter().map(|corners| corners[0]).collect();
    let mut nearest = vec![UNSEEN; count];
    let (mut levels, mut open) = (Vec::new(), Vec::with_capacity(count));
    for landmark in 0..LANDMARKS {
        levels.clear();
        levels.resize(count, UNSEEN);
        let (mut base, mut next_seeds) = (0, Vec::new());
        for &seed in &seeds {
            if levels[seed as usize] != UNSEEN {
                continue;
            }
            open.clear();
            open.push(seed);
            levels[seed as usize] = base;
            let (mut next, mut farthest) = (0, seed);
            while next < open.len() {
                let vertex = open[next];
                let level = levels[vertex as usize];
                distances[vertex as usize][landmark] = level as u8;
                nearest[vertex as usize] = nearest[vertex as usize].min(level - base);
                if nearest[vertex as usize] >= nearest[farthest as usize] {
                    farthest = vertex;
                }
                for &triangle in around.around(vertex) {
                    for neighbor in triangles[triangle as usize] {
                        if levels[neighbor as usize] == UNSEEN {
                            levels[neighbor as usize] = level + 1;
                            open.push(neighbor);
                        }
                    }
                }
                next += 1;
            }
            base = levels[open[open.len() - 1] as usize] + 1;
            next_seeds.push(farthest);
        }
        seeds = next_seeds;
    }
    distances
}
