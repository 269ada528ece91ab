//! What a triangle knows about its neighborhood: the vertices and edges whose first triangle it is, and its distances
//! along the surface from some landmarks.
//!
//! Found with the topology. From this alone, the exact stage decides which of several triangles reports a shared
//! feature.

use fearless_simd::{mask64x8, prelude::*, u8x64, u64x8};

use super::topology::Incidence;
use crate::kernel::simd::lanes::WIDTH;

/// Number of landmarks per component: vertices whose distances along the surface are known.
const LANDMARKS: usize = 3;

/// If the distances of two triangles from a landmark differ by more than this, the first triangles around their
/// features share no vertex. The vertices of a triangle are one edge away from its first corner, and those of a
/// triangle around one of them at most two.
const FARTHEST: u8 = 4;

/// What a triangle knows about its neighborhood, packed tightly.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct Surroundings {
    /// Distance of the first corner from each landmark, in edges, modulo 256.
    distances: [u8; LANDMARKS],
    /// The features for which this triangle is the first of the triangles around them, one bit each: 0 to 2 for the
    /// corners, 3 to 5 for the edges. Bit 6 is set if the triangle names a vertex twice.
    pub(in crate::kernel) first_of: u8,
}

/// The bit of a triangle that names a vertex twice, so that two of its features are the same.
const COLLAPSED: u8 = 1 << 6;

impl Surroundings {
    pub(in crate::kernel) const NONE: Self = Self { distances: [0; LANDMARKS], first_of: 0 };

    /// Computes the surroundings of all triangles, given their welded vertices, their edges, and the triangles around
    /// each vertex and edge.
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

    /// Whether two features of the triangle are the same.
    #[inline]
    pub(in crate::kernel) const fn is_collapsed(self) -> bool {
        self.first_of & COLLAPSED != 0
    }

    /// The features for which the triangle is the first, without the bit of collapsed triangles.
    #[inline]
    pub(in crate::kernel) const fn features(self) -> u8 {
        self.first_of & !COLLAPSED
    }

    /// Everything in one number.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn bits(self) -> u64 {
        let [first, second, third] = self.distances;
        u64::from(u32::from_le_bytes([first, second, third, self.first_of]))
    }
}

/// The surroundings of eight triangles.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct SurroundingLanes<S: Simd>(u64x8<S>);

impl<S: Simd> SurroundingLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(simd: S, all: [Surroundings; WIDTH]) -> Self {
        let mut bits = [0; WIDTH];
        for (bits, surroundings) in bits.iter_mut().zip(all) {
            *bits = surroundings.bits();
        }
        Self(u64x8::from_slice(simd, &bits))
    }

    /// The features for which each triangle is the first around them, see [`Surroundings`].
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn first_of(self) -> u64x8<S> {
        self.0 >> 24
    }

    /// Where two features of a triangle are the same.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn are_collapsed(self) -> mask64x8<S> {
        !(self.first_of() & u64::from(COLLAPSED)).simd_eq(0)
    }

    /// Whether the first triangles around the features of one triangle may share a vertex with those around the
    /// features of the other. If false, they certainly do not. If true, the landmarks do not rule it out.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn firsts_may_meet(self, other: Self) -> mask64x8<S> {
        let (own, other): (u8x64<S>, u8x64<S>) = (self.0.bitcast(), other.0.bitcast());
        let differences: u64x8<S> = (own - other + FARTHEST).bitcast();
        // In numbers up to eight, none of the upper four bits is set, and adding 7 to the lower four bits does not
        // carry.
        const { assert!(FARTHEST == 4) };
        let far = differences & 0xf0_f0f0 | ((differences & 0x0f_0f0f) + 0x07_0707) & 0x10_1010;
        far.simd_eq(0)
    }
}

/// The first triangle around each vertex and each edge of a triangle.
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

/// The distance of each vertex from each landmark in edges, modulo 256. Landmarks are chosen one after the other, each
/// as far from the earlier ones as possible. Every component has its own landmarks, and higher distances than the
/// component before it.
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
