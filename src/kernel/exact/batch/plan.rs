//! Tables that say how to compute each feature pair, instead of branches.

use crate::kernel::{
    exact::cases::FeatureSet,
    mesh::feature::{Feature, FeaturePair},
    simd::lanes::WIDTH,
};

/// What is computed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    EdgeEdge,
    VertexFace,
    Piercing,
    VertexEdge,
}

impl Kind {
    pub(super) const COUNT: usize = 4;
}

/// The largest number of points that a kind needs.
pub(super) const POINTS: usize = 6;

/// Rows of weights.
pub(super) const ZERO: u8 = 0;
pub(super) const ONE: u8 = 1;
/// The start of the first edge. Its end is in the next row.
pub(super) const FIRST: u8 = 2;
/// The start of the second edge, or the first corner of a face. The end or the second corner is in the next row.
pub(super) const SECOND: u8 = 4;

/// How to compute the contact of one feature pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    pub(super) features: FeaturePair,
    /// Their local indices, see [`Feature::of_part`].
    pub(super) parts: [u8; 2],
    pub(super) kind: Kind,
    /// Which triangle has the feature that is named first.
    pub(super) first_side: u8,
    /// The index of that feature if it is an edge, otherwise 0.
    pub(super) turns: u8,
    /// Triangle and corner of each point that is needed; unused entries are arbitrary. First the points of the feature
    /// named first, then those of the other feature, then the remaining corner of the triangle whose edge pierces a
    /// face.
    pub(super) points: [[u8; 2]; POINTS],
    /// Rows with the weights of the first two corners of each triangle.
    pub(super) weights: [[u8; 2]; 2],
}

/// The plans for the bits of a [`FeatureSet`]. The last ones have no meaning.
pub(super) static PLANS: [Plan; 8 * WIDTH] = {
    let mut plans = [Plan::of(0); 8 * WIDTH];
    let mut case = 0;
    while case < FeatureSet::BOUNDARY + 27 {
        plans[case] = Plan::of(case);
        case += 1;
    }
    plans
};

impl Plan {
    const fn of(case: usize) -> Self {
        const VERTICES: usize = FeatureSet::VERTICES_OVER_FACES;
        if case < VERTICES {
            let [edge_a, edge_b] = [case / 3, case % 3];
            let points = [[0, edge_a], [0, edge_a + 1], [1, edge_b], [1, edge_b + 1], [0, 0], [0, 0]];
            Self::new(Kind::EdgeEdge, 0, [3 + edge_a, 3 + edge_b], points)
        } else if case < FeatureSet::PIERCING {
            let (side, vertex) = ((case - VERTICES) / 3, (case - VERTICES) % 3);
            let points = [[side, vertex], [1 - side, 0], [1 - side, 1], [1 - side, 2], [0, 0], [0, 0]];
            Self::new(Kind::VertexFace, side, [vertex, 6], points)
        } else if case < FeatureSet::BOUNDARY {
            let (side, edge) = ((case - FeatureSet::PIERCING) / 3, (case - FeatureSet::PIERCING) % 3);
            let points =
                [[side, edge], [side, edge + 1], [1 - side, 0], [1 - side, 1], [1 - side, 2], [side, edge + 2]];
            Self::new(Kind::Piercing, side, [3 + edge, 6], points)
        } else {
            // A vertex and an edge, or the vertex at which the edge starts.
            let place = case - FeatureSet::BOUNDARY;
            let (side, is_start) = (if place / 9 == 1 { 1 } else { 0 }, place >= 18);
            let (vertex, edge) = (place % 9 / 3, place % 3);
            let points = [[side, vertex], [1 - side, edge], [1 - side, edge + 1], [0, 0], [0, 0], [0, 0]];
            Self::new(Kind::VertexEdge, side, [vertex, if is_start { edge } else { 3 + edge }], points)
        }
    }

    /// Takes the local index of the feature named first, and of the other one. Corners wrap around.
    const fn new(kind: Kind, first_side: usize, [first, second]: [usize; 2], around: [[usize; 2]; POINTS]) -> Self {
        let parts = if first_side == 0 { [first, second] } else { [second, first] };
        let features = FeaturePair { a: Feature::of_part(parts[0]), b: Feature::of_part(parts[1]) };
        let mut points = [[0; 2]; POINTS];
        let mut point = 0;
        while point < POINTS {
            let [side, corner] = around[point];
            points[point] = [side as u8, (corner % 3) as u8];
            point += 1;
        }
        // An edge that pierces a face is named first, whichever side it belongs to.
        let edge_of_b = if matches!(features.a, Feature::Face) { FIRST } else { SECOND };
        Self {
            features,
            parts: [parts[0] as u8, parts[1] as u8],
            kind,
            first_side: first_side as u8,
            turns: if first >= 3 { first as u8 - 3 } else { 0 },
            points,
            weights: [weights(features.a, FIRST), weights(features.b, edge_of_b)],
        }
    }
}

/// Rows with the weights of the first two corners of a triangle, given its feature in contact. The weights of an edge
/// are in row `edge` and the next one.
const fn weights(feature: Feature, edge: u8) -> [u8; 2] {
    match feature {
        Feature::Vertex(0) => [ONE, ZERO],
        Feature::Vertex(1) => [ZERO, ONE],
        Feature::Vertex(_) => [ZERO, ZERO],
        Feature::Edge(0) => [edge, edge + 1],
        Feature::Edge(1) => [ZERO, edge],
        Feature::Edge(_) => [edge + 1, ZERO],
        Feature::Face => [SECOND, SECOND + 1],
    }
}
