//! Names for the features of two triangles that are close to each other.

/// A feature of one triangle, by its index within the triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Feature {
    /// Corner 0–2.
    Vertex(u8),
    /// Edge 0–2. Edge `k` joins corners `k` and `k + 1`.
    Edge(u8),
    /// The interior of the triangle, or a whole rigid shape.
    Face,
}

impl Feature {
    /// The feature with a local index: 0 to 2 are the corners, 3 to 5 the edges, and 6 is the face.
    #[inline]
    pub(in crate::kernel) const fn of_part(part: usize) -> Self {
        match part {
            0..3 => Self::Vertex(part as u8),
            3..6 => Self::Edge(part as u8 - 3),
            _ => Self::Face,
        }
    }

    /// The local index of the feature.
    #[inline]
    pub(in crate::kernel) const fn part(self) -> usize {
        match self {
            Self::Vertex(corner) => corner as usize,
            Self::Edge(edge) => 3 + edge as usize,
            Self::Face => 6,
        }
    }
}

/// The kinds of the two features of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
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
    /// Two faces, by their spheres, or a face and a rigid shape.
    FaceFace,
}

impl FeatureKind {
    /// The lowercase name with hyphens that exported tables use.
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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FeaturePair {
    /// Feature of the first side.
    pub a: Feature,
    /// Feature of the second side.
    pub b: Feature,
}

impl FeaturePair {
    /// The kinds of both features.
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

    /// The same features, with the sides swapped.
    #[must_use]
    pub const fn swapped(self) -> Self {
        Self { a: self.b, b: self.a }
    }
}
