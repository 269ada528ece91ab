//! The features that the corners of a moving pair belong to, and how close its two sides are at one time.

use glam::DVec3;

use crate::{
    triangle_crossing::triangles_cross,
    triangle_pair::{ClosestKind, TriangleSide, closest_features, point_triangle, segment_segment},
};

/// The most corners of a pair: those of two triangles.
pub(super) const CORNERS: usize = 6;

pub(super) type Corners = [DVec3; CORNERS];

/// The features that the corners of a pair belong to.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Shape {
    VertexFace,
    EdgeEdge,
    Triangles,
}

impl Shape {
    /// The number of corners of the first side. Those of the second side follow.
    pub(super) const fn first_side(self) -> usize {
        match self {
            Self::VertexFace => 1,
            Self::EdgeEdge => 2,
            Self::Triangles => 3,
        }
    }

    pub(super) const fn corners(self) -> usize {
        match self {
            Self::VertexFace | Self::EdgeEdge => 4,
            Self::Triangles => 6,
        }
    }

    /// The vertex–face pairs among the corners: a vertex, then the corners of the face.
    pub(super) const fn vertex_faces(self) -> &'static [[usize; 4]] {
        match self {
            Self::VertexFace => &[[0, 1, 2, 3]],
            Self::EdgeEdge => &[],
            Self::Triangles => &[[0, 3, 4, 5], [1, 3, 4, 5], [2, 3, 4, 5], [3, 0, 1, 2], [4, 0, 1, 2], [5, 0, 1, 2]],
        }
    }

    /// The pairs of edges among the corners.
    pub(super) const fn edge_edges(self) -> &'static [[usize; 4]] {
        match self {
            Self::VertexFace => &[],
            Self::EdgeEdge => &[[0, 1, 2, 3]],
            Self::Triangles => &[
                [0, 1, 3, 4],
                [0, 1, 4, 5],
                [0, 1, 5, 3],
                [1, 2, 3, 4],
                [1, 2, 4, 5],
                [1, 2, 5, 3],
                [2, 0, 3, 4],
                [2, 0, 4, 5],
                [2, 0, 5, 3],
            ],
        }
    }

    /// The edges of one side, each with the face of the other that it may pierce.
    pub(super) const fn edge_faces(self) -> &'static [([usize; 2], [usize; 3])] {
        match self {
            Self::VertexFace | Self::EdgeEdge => &[],
            Self::Triangles => &[
                ([0, 1], [3, 4, 5]),
                ([1, 2], [3, 4, 5]),
                ([2, 0], [3, 4, 5]),
                ([3, 4], [0, 1, 2]),
                ([4, 5], [0, 1, 2]),
                ([5, 3], [0, 1, 2]),
            ],
        }
    }

    /// Whether the two sides have a point in common. Exact if the corners are.
    pub(super) fn touches(self, corners: &Corners) -> bool {
        let [p, q, r, s, t, u] = *corners;
        match self {
            Self::VertexFace => triangles_cross(&[p; 3], &[q, r, s]),
            Self::EdgeEdge => triangles_cross(&[p, q, q], &[r, s, s]),
            Self::Triangles => triangles_cross(&[p, q, r], &[s, t, u]),
        }
    }

    pub(super) fn closest(self, corners: &Corners) -> Closest {
        let [p, q, r, s, t, u] = *corners;
        match self {
            Self::VertexFace => {
                let found = point_triangle(p, &[q, r, s]);
                Closest { distance: found.distance, between: found.point - p, normal: (r - q).cross(s - q) }
            }
            Self::EdgeEdge => {
                let found = segment_segment(p, q, r, s);
                let between = found.point_b - found.point_a;
                Closest { distance: found.distance, between, normal: (q - p).cross(s - r) }
            }
            Self::Triangles => {
                let (a, b) = ([p, q, r], [s, t, u]);
                let found = closest_features(&a, &b);
                let face = |[p, q, r]: [DVec3; 3]| (q - p).cross(r - p);
                let edge = |triangle: [DVec3; 3], edge: usize| triangle[(edge + 1) % 3] - triangle[edge];
                let normal = match found.kind {
                    ClosestKind::VertexFace { vertex_of: TriangleSide::A, .. } => face(b),
                    ClosestKind::VertexFace { vertex_of: TriangleSide::B, .. } => face(a),
                    ClosestKind::EdgeEdge { edge_a, edge_b } => edge(a, edge_a).cross(edge(b, edge_b)),
                    ClosestKind::Crossing => DVec3::ZERO,
                };
                Closest { distance: found.distance, between: found.point_b - found.point_a, normal }
            }
        }
    }
}

/// The closest points of a pair at one time.
#[derive(Clone)]
pub(super) struct Closest {
    pub(super) distance: f64,
    /// From the first side to the second: the best separating direction, unless they are too close to tell.
    pub(super) between: DVec3,
    /// Perpendicular to the features of the closest points, if those are a face or two edges.
    pub(super) normal: DVec3,
}

impl Closest {
    /// Unit vectors from the first side to the second: between the closest points, and across the features. Zero where
    /// undefined.
    pub(super) fn directions(&self) -> [DVec3; 2] {
        let across = if self.normal.dot(self.between) < 0.0 { -self.normal } else { self.normal };
        [self.between.normalize_or_zero(), across.normalize_or_zero()]
    }
}
