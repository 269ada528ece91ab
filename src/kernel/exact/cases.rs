//! Sets of features of a pair of triangles, as bits.

use fearless_simd::{mask64x8, prelude::*, u64x8};

use crate::kernel::mesh::feature::{Feature, FeaturePair};

/// Features of a pair of triangles, one bit each: a vertex over a face, two edges, an edge that pierces a face, or any
/// *boundary features*, which are two vertices, or a vertex and an edge, on the boundaries of both triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::kernel) struct Cases(pub(super) u32);

impl Cases {
    pub(in crate::kernel) const ALL: Self = Self(u32::MAX);
    pub(super) const BOUNDARY: Self = Self(1 << 21);
    pub(super) const VERTICES_OVER_FACES: Self = Self(0b11_1111);
    pub(super) const EDGES: Self = Self(0b1_1111_1111 << 6);
    pub(super) const PIERCING: Self = Self(0b11_1111 << 15);

    pub(super) const fn vertex_face(vertex_of_a: bool, vertex: usize) -> Self {
        Self(1 << (if vertex_of_a { vertex } else { 3 + vertex }))
    }

    pub(super) const fn edges(edge_a: usize, edge_b: usize) -> Self {
        Self(1 << (6 + 3 * edge_a + edge_b))
    }

    pub(super) const fn piercing(edge_of_a: bool, edge: usize) -> Self {
        Self(1 << (if edge_of_a { 15 + edge } else { 18 + edge }))
    }

    pub(in crate::kernel) const fn contain(self, case: Self) -> bool {
        self.0 & case.0 != 0
    }

    pub(in crate::kernel) const fn are_none(self) -> bool {
        self.0 == 0
    }

    /// Whether an edge may pierce a face.
    pub(in crate::kernel) const fn may_cross(self) -> bool {
        self.contain(Self::PIERCING)
    }

    pub(in crate::kernel) const fn from_bits(bits: u64) -> Self {
        Self(bits as u32)
    }

    pub(in crate::kernel) const fn bits(self) -> u64 {
        self.0 as u64
    }

    pub(in crate::kernel) const fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    pub(in crate::kernel) const fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(in crate::kernel) const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// This set if `holds`, otherwise the empty set, without a branch.
    #[inline]
    pub(in crate::kernel) const fn only_if(self, holds: bool) -> Self {
        Self(self.0 & 0u32.wrapping_sub(holds as u32))
    }

    /// This set without boundary features.
    pub(in crate::kernel) const fn without_boundary(self) -> Self {
        self.without(Self::BOUNDARY)
    }

    /// Each case by itself.
    pub(in crate::kernel) fn each(self) -> impl Iterator<Item = Self> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let next = left & left.wrapping_neg();
            left &= !next;
            (next != 0).then_some(Self(next))
        })
    }

    /// The features of a single case.
    pub(in crate::kernel) fn features(self) -> FeaturePair {
        let [part_a, part_b] = self.parts();
        FeaturePair { a: Feature::of_part(part_a), b: Feature::of_part(part_b) }
    }

    /// The case of two features.
    pub(in crate::kernel) const fn of(features: FeaturePair) -> Self {
        match (features.a, features.b) {
            (Feature::Vertex(vertex), Feature::Face) => Self::vertex_face(true, vertex as usize),
            (Feature::Face, Feature::Vertex(vertex)) => Self::vertex_face(false, vertex as usize),
            (Feature::Edge(edge_a), Feature::Edge(edge_b)) => Self::edges(edge_a as usize, edge_b as usize),
            (Feature::Edge(edge), Feature::Face) => Self::piercing(true, edge as usize),
            (Feature::Face, Feature::Edge(edge)) => Self::piercing(false, edge as usize),
            _ => Self::BOUNDARY,
        }
    }

    /// The local indices of a single case's features on the first and the second triangle, as in [`Feature::of_part`].
    #[inline]
    pub(in crate::kernel) fn parts(self) -> [usize; 2] {
        PARTS[self.0.trailing_zeros() as usize % PARTS.len()].map(usize::from)
    }

    const fn parts_of_bit(bit: u8) -> [u8; 2] {
        match bit {
            0..3 => [bit, 6],
            3..6 => [6, bit - 3],
            6..15 => [3 + (bit - 6) / 3, 3 + (bit - 6) % 3],
            15..18 => [3 + bit - 15, 6],
            _ => [6, 3 + (bit - 18) % 3],
        }
    }
}

/// The local feature indices of each case, as a table: a branch on the case would be unpredictable.
static PARTS: [[u8; 2]; 32] = {
    let mut parts = [[0; 2]; 32];
    let mut bit = 0;
    while bit < 32 {
        parts[bit as usize] = Cases::parts_of_bit(bit);
        bit += 1;
    }
    parts
};

/// The boundary features of a pair of triangles, one bit each. A vertex and the inside of an edge have bit `3 v + e`
/// for vertex `v` of the first triangle and edge `e` of the second, plus nine for a vertex of the second and an edge of
/// the first. Two vertices, the second of which is the start of edge `e`, have that bit plus 18.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct BoundaryCases(pub(super) u64);

impl BoundaryCases {
    pub(in crate::kernel) const fn bits(self) -> u64 {
        self.0
    }

    /// The bit of two vertices, given the bit index of the first one and the edge that starts at the second.
    pub(super) const fn of_vertices(place: usize) -> u64 {
        1 << (18 + place)
    }
}

/// The cases of eight pairs of triangles.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct CaseLanes<S: Simd>(pub(in crate::kernel) u64x8<S>);

impl<S: Simd> CaseLanes<S> {
    /// All cases between some of the vertices and edges of both triangles. Bits 0 to 2 are the vertices, 3 to 5 the
    /// edges.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn between(parts_of_a: u64x8<S>, parts_of_b: u64x8<S>) -> Self {
        let [vertices_of_a, vertices_of_b] = [parts_of_a & 7, parts_of_b & 7];
        let [edges_of_a, edges_of_b] = [parts_of_a >> 3 & 7, parts_of_b >> 3 & 7];
        // Every pair of edges: each bit of the first triangle at three places, combined with three copies of the
        // second's.
        let spread = edges_of_a & 1 | (edges_of_a & 2) << 2 | (edges_of_a & 4) << 4;
        let edges = (spread | spread << 1 | spread << 2) & (edges_of_b | edges_of_b << 3 | edges_of_b << 6);
        Self(vertices_of_a | vertices_of_b << 3 | edges << 6 | edges_of_a << 15 | edges_of_b << 18)
    }

    /// Where an edge may pierce a face.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn may_cross(self) -> mask64x8<S> {
        !(self.0 & Cases::PIERCING.bits()).simd_eq(0)
    }

    /// The cases inside faces and edges, in the order of [`FeatureSet`].
    #[cfg_attr(not(unoptimized), inline(always))]
    fn in_order(self) -> u64x8<S> {
        let edges = (self.0 & Cases::EDGES.bits()) >> 6;
        let vertices = (self.0 & Cases::VERTICES_OVER_FACES.bits()) << FeatureSet::VERTICES_OVER_FACES as u32;
        edges | vertices | self.0 & Cases::PIERCING.bits()
    }
}

/// The features that a pair of triangles reports, one bit each, in the order in which the contacts are written: nine
/// pairs of edges, six vertices over faces, six edges that pierce a face, and 27 bits for boundary features, in the
/// order of [`BoundaryCases`].
pub(in crate::kernel) struct FeatureSet;

impl FeatureSet {
    pub(super) const VERTICES_OVER_FACES: usize = 9;
    pub(super) const PIERCING: usize = 15;
    pub(super) const BOUNDARY: usize = 21;

    /// Combines the cases and the [`BoundaryCases`] of eight pairs of triangles.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn in_lanes<S: Simd>(cases: CaseLanes<S>, boundary: u64x8<S>) -> u64x8<S> {
        cases.in_order() | boundary << Self::BOUNDARY as u32
    }
}
