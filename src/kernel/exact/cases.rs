//! Which features of a pair of triangles are meant, as a set of bits.

use super::feature::{Feature, FeaturePair};

/// Features of a pair of triangles, one bit each: a vertex over a face, two edges, an edge that pierces a face, or
/// anything on the boundaries of both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::kernel) struct Cases(pub(super) u32);

impl Cases {
    pub(in crate::kernel) const NONE: Self = Self(0);
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

    /// Those between some of the vertices and edges of either triangle: bits 0 to 2 its vertices, 3 to 5 its edges.
    pub(in crate::kernel) const fn between(parts_of_a: u8, parts_of_b: u8) -> Self {
        let (vertices, edges) = ([parts_of_a & 7, parts_of_b & 7], [parts_of_a >> 3 & 7, parts_of_b >> 3 & 7]);
        let [vertices_of_a, vertices_of_b] = [vertices[0] as u32, vertices[1] as u32];
        let [edges_of_a, edges_of_b] = [edges[0] as u32, edges[1] as u32];
        // Bit k spread to three places each, times three bits: every pair of edges.
        let spread = edges_of_a & 1 | (edges_of_a & 2) << 2 | (edges_of_a & 4) << 4;
        Self(vertices_of_a | vertices_of_b << 3 | (spread * edges_of_b) << 6 | edges_of_a << 15 | edges_of_b << 18)
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

    pub(in crate::kernel) const fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    pub(in crate::kernel) const fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(in crate::kernel) const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Without what is on the boundaries of both.
    pub(in crate::kernel) const fn without_boundary(self) -> Self {
        self.without(Self::BOUNDARY)
    }

    /// Each of them alone.
    pub(in crate::kernel) fn each(self) -> impl Iterator<Item = Self> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let next = left & left.wrapping_neg();
            left &= !next;
            (next != 0).then_some(Self(next))
        })
    }

    /// The features that a single case is about.
    pub(in crate::kernel) const fn features(self) -> FeaturePair {
        let [part_a, part_b] = self.parts();
        FeaturePair { a: Feature::of_part(part_a), b: Feature::of_part(part_b) }
    }

    /// The case that two features are.
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

    /// The part of the first and of the second triangle that a single case is about, numbered as in
    /// [`between`](Self::between); 6 is the face.
    pub(in crate::kernel) const fn parts(self) -> [usize; 2] {
        let number = self.0.trailing_zeros() as usize;
        match number {
            0..3 => [number, 6],
            3..6 => [6, number - 3],
            6..15 => [3 + (number - 6) / 3, 3 + (number - 6) % 3],
            15..18 => [3 + number - 15, 6],
            _ => [6, 3 + number - 18],
        }
    }
}

/// What of a pair of triangles is on the boundaries of both, one bit each: a vertex and the inside of an edge, bit `3 v + e`
/// for vertex `v` of the first triangle and edge `e` of the second, nine bits further for a vertex of the second and an edge of
/// the first; and two vertices, of which the second one is where edge `e` starts, 18 bits further.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct BoundaryCases(pub(super) u64);

impl BoundaryCases {
    /// The bit of two vertices, given that of the first and the edge that starts at the second.
    pub(super) const fn of_vertices(place: usize) -> u64 {
        1 << (18 + place)
    }

    /// Each of them: which side the vertex is of that is named first, which vertex it is, the edge, and whether it is the start of
    /// that which is meant.
    pub(super) fn each(self) -> impl Iterator<Item = (usize, usize, usize, bool)> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let place = left.trailing_zeros() as usize;
            left &= left.wrapping_sub(1);
            let (side, is_start) = (usize::from((9..18).contains(&place)), place >= 18);
            (place < 27).then_some((side, place % 9 / 3, place % 3, is_start))
        })
    }
}
