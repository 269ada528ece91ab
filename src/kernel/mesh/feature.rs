//! Names for the parts of two triangles that are close to each other.

/// A part of one triangle, by its place within the triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Feature {
    /// Corner 0–2.
    Vertex(u8),
    /// Edge 0–2; edge `k` joins the corners `k` and `k + 1`.
    Edge(u8),
    /// The triangle's interior, or a whole rigid shape.
    Face,
}

impl Feature {
    /// The part of a triangle with a number: 0 to 2 its corners, 3 to 5 its edges, 6 the face.
    #[inline]
    pub(in crate::kernel) const fn of_part(part: usize) -> Self {
        match part {
            0..3 => Self::Vertex(part as u8),
            3..6 => Self::Edge(part as u8 - 3),
            _ => Self::Face,
        }
    }

    /// That number.
    #[inline]
    pub(in crate::kernel) const fn part(self) -> usize {
        match self {
            Self::Vertex(corner) => corner as usize,
            Self::Edge(edge) => 3 + edge as usize,
            Self::Face => 6,
        }
    }
}

/// What kinds of features meet in a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FeatureKind {
    /// Two vertices.
    VertexVertex,
    /// A vertex and the inside of an edge.
    VertexEdge,
    /// A vertex and the inside of a face.
    VertexFace,
    /// The insides of two edges.
    EdgeEdge,
    /// An edge that pierces a face: the two surfaces cross.
    EdgeFace,
    /// Two faces, by their spheres; or a face and a rigid shape.
    FaceFace,
}

impl FeatureKind {
    /// The kind's name in lower case with hyphens, as it stands in exported tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::VertexVertex => "vertex-vertex",
            Self::VertexEdge => "vertex-edge",
            Self::VertexFace => "vertex-face",
            Self::EdgeEdge => "edge-edge",
            Self::EdgeFace => "edge-face",
            Self::FaceFace => "face-face",
        }
    }
}

/// The features of the first and the second side of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FeaturePair {
    /// Feature of the first side.
    pub a: Feature,
    /// Feature of the second side.
    pub b: Feature,
}

impl FeaturePair {
    /// Which kinds meet.
    #[must_use]
    pub const fn kind(self) -> FeatureKind {
        match (self.a, self.b) {
            (Feature::Vertex(_), Feature::Vertex(_)) => FeatureKind::VertexVertex,
            (Feature::Vertex(_), Feature::Edge(_)) | (Feature::Edge(_), Feature::Vertex(_)) => FeatureKind::VertexEdge,
            (Feature::Vertex(_), Feature::Face) | (Feature::Face, Feature::Vertex(_)) => FeatureKind::VertexFace,
            (Feature::Edge(_), Feature::Edge(_)) => FeatureKind::EdgeEdge,
            (Feature::Edge(_), Feature::Face) | (Feature::Face, Feature::Edge(_)) => FeatureKind::EdgeFace,
            (Feature::Face, Feature::Face) => FeatureKind::FaceFace,
        }
    }

    /// The same features seen from the other side.
    #[must_use]
    pub const fn swapped(self) -> Self {
        Self { a: self.b, b: self.a }
    }
}
