//! The compact record of a contact, and the key that identifies it from tick to tick.
//!
//! Written by the exact and the sphere stages, stored by the `contacts` module.

use std::hint::select_unpredictable;

use glam::Vec3;

use super::mesh::{
    feature::{Feature, FeaturePair},
    topology::SurfaceTopology,
};

/// Bits of a feature number in a key.
pub(in crate::kernel) const FEATURE_BITS: u32 = 28;

/// Identifies a contact within its pair of surfaces: the kinds of both features and their [numbers](feature_number).
/// The same two features have the same key in every tick, so a solver can keep its state per contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ContactKey(pub u64);

impl ContactKey {
    #[inline]
    pub(in crate::kernel) fn new(features: FeaturePair, number_a: u32, number_b: u32) -> Self {
        let kinds = rank(features.a) * 3 + rank(features.b);
        Self((kinds << (2 * FEATURE_BITS)) | (u64::from(number_a) << FEATURE_BITS) | u64::from(number_b))
    }

    /// The key of the same features, with the surfaces in the other order.
    pub(crate) const fn reversed(self) -> Self {
        const NUMBER: u64 = (1 << FEATURE_BITS) - 1;
        let (kinds, a, b) = (self.0 >> (2 * FEATURE_BITS), (self.0 >> FEATURE_BITS) & NUMBER, self.0 & NUMBER);
        let kinds = kinds % 3 * 3 + kinds / 3;
        Self((kinds << (2 * FEATURE_BITS)) | (b << FEATURE_BITS) | a)
    }

    /// Whether the features are a vertex and a face, or two edges. Such features pass each other from one side to the
    /// other, whereas around a corner or a rim a direction may turn without anything having passed.
    #[inline]
    pub(crate) const fn has_sides(self) -> bool {
        // Three times the rank of the first feature, plus the rank of the second.
        const VERTEX_FACE: u64 = 2;
        const EDGE_EDGE: u64 = 4;
        const FACE_VERTEX: u64 = 6;
        matches!(self.0 >> (2 * FEATURE_BITS), VERTEX_FACE | EDGE_EDGE | FACE_VERTEX)
    }
}

/// Vertices come before edges, and edges before faces.
#[inline]
const fn rank(feature: Feature) -> u64 {
    match feature {
        Feature::Vertex(_) => 0,
        Feature::Edge(_) => 1,
        Feature::Face => 2,
    }
}

/// The number of a triangle's feature: its welded vertex, its edge, or the triangle itself. Vertices that were welded
/// at equal positions may have moved apart since. Such a vertex has its own number, and an edge that ends at one has a
/// number after all edges.
#[must_use]
#[inline]
pub fn feature_number(topology: &SurfaceTopology, positions: &[Vec3], triangle: u32, feature: Feature) -> u32 {
    if topology.is_welded() {
        return welded_feature_number(topology, positions, triangle, feature);
    }
    match feature {
        Feature::Vertex(corner) => topology.triangles()[triangle as usize][corner as usize],
        Feature::Edge(edge) => topology.triangle_edges()[triangle as usize][edge as usize],
        Feature::Face => triangle,
    }
}

fn welded_feature_number(topology: &SurfaceTopology, positions: &[Vec3], triangle: u32, feature: Feature) -> u32 {
    let vertex = |corner: usize| {
        let own = topology.triangles()[triangle as usize][corner];
        let welded = topology.welded_triangles()[triangle as usize][corner];
        let together = own == welded || positions[own as usize] == positions[welded as usize];
        (together, if together { welded } else { own })
    };
    match feature {
        Feature::Vertex(corner) => vertex(corner as usize).1,
        Feature::Edge(edge) => {
            let edge = edge as usize;
            if vertex(edge).0 && vertex((edge + 1) % 3).0 {
                topology.triangle_edges()[triangle as usize][edge]
            } else {
                topology.edges().len() as u32 + 3 * triangle + edge as u32
            }
        }
        Feature::Face => triangle,
    }
}

/// One feature pair in contact. Positions and directions are in the pair's frame, distances in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CompactContact {
    /// Identifies the feature pair within its pair of surfaces.
    pub key: ContactKey,
    /// Triangle of the first surface, in the caller's numbering.
    pub triangle_a: u32,
    /// Triangle of the second surface. For a shape that is tested by formula, the number of its feature.
    pub triangle_b: u32,
    /// The features of the two triangles. A shape that is tested by formula counts as a face, or as an edge if an edge
    /// of the triangle is close to it, or if it pierces the triangle's face.
    pub features: FeaturePair,
    /// For a surface in contact with itself: whether the features are in the opposite order from the key.
    pub swapped: bool,
    /// Whether the same two features may be reported more than once, in this tick or another, usually by other pairs of
    /// triangles. False if only the first triangles around both features report them.
    pub is_shared: bool,
    /// Weights of the first two corners of triangle a. All three sum to 1.
    pub barycentric_a: [f32; 2],
    /// Weights of the first two corners of triangle b. Meaningless for a shape that is tested by formula.
    pub barycentric_b: [f32; 2],
    /// The contact point on the second side, in the pair's frame.
    pub point_b: Vec3,
    /// Unit vector from the first side to the second, in the pair's frame. Moving the second side along it separates
    /// the two.
    pub normal: Vec3,
    /// Signed distance of the two contact points in world units. Negative if the sides have passed each other.
    pub distance: f32,
}

/// A [shared](CompactContact::is_shared) contact of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SharedContact {
    /// Its key.
    pub key: ContactKey,
    /// Its index in the list.
    pub place: u32,
}

impl SharedContact {
    /// The same contact when `count` others precede the list.
    #[must_use]
    pub const fn later(self, count: u32) -> Self {
        Self { key: self.key, place: self.place + count }
    }

    /// The same contact when `count` others before it have been dropped from the list.
    pub(in crate::kernel) const fn earlier(self, count: u32) -> Self {
        Self { key: self.key, place: self.place - count }
    }
}

/// A touching pair of triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TouchingPair {
    /// Triangle of the first surface.
    pub triangle_a: u32,
    /// Triangle of the second surface. In a self-collision, the higher one.
    pub triangle_b: u32,
    /// Distance in world units, at least 0. 0 if they cross.
    pub distance: f64,
}

/// Where two faces meet: the fields with the same names of a [`CompactContact`].
#[derive(Clone, Copy)]
pub(in crate::kernel) struct FacePlace {
    pub(in crate::kernel) barycentrics: [[f32; 2]; 2],
    pub(in crate::kernel) point_b: Vec3,
    pub(in crate::kernel) normal: Vec3,
    pub(in crate::kernel) distance: f32,
}

impl CompactContact {
    /// An empty record, for a contact that turned out not to exist. No pair of features has its key.
    pub(crate) const NONE: Self = Self {
        key: ContactKey(u64::MAX),
        triangle_a: 0,
        triangle_b: 0,
        features: FeaturePair { a: Feature::Face, b: Feature::Face },
        swapped: false,
        is_shared: false,
        barycentric_a: [0.0; 2],
        barycentric_b: [0.0; 2],
        point_b: Vec3::ZERO,
        normal: Vec3::ZERO,
        distance: 0.0,
    };

    /// Empties the record.
    #[inline]
    pub(in crate::kernel) fn drop_name(&mut self) {
        self.key = Self::NONE.key;
    }

    /// Whether the record is empty.
    pub(crate) fn is_none(&self) -> bool {
        self.key == Self::NONE.key
    }

    /// A contact of two triangles, identified by the [numbers](feature_number) of its features. In a self-collision
    /// (`same_surface`) a feature pair is the same from either side, so its key does not depend on which triangle comes
    /// first. Barycentrics are the weights of the first two corners of each triangle.
    #[expect(clippy::too_many_arguments, reason = "one argument per field of the record")]
    #[inline]
    pub(in crate::kernel) fn between_features(
        triangles: [u32; 2],
        same_surface: bool,
        features: FeaturePair,
        numbers: [u32; 2],
        is_shared: bool,
        [barycentric_a, barycentric_b]: [[f32; 2]; 2],
        point_b: Vec3,
        normal: Vec3,
        distance: f32,
    ) -> Self {
        let named = Self::named(triangles, same_surface, features, numbers, is_shared);
        Self { barycentric_a, barycentric_b, point_b, normal, distance, ..named }
    }

    /// A contact of two triangles without its location.
    #[inline]
    pub(in crate::kernel) fn named(
        triangles: [u32; 2],
        same_surface: bool,
        features: FeaturePair,
        [number_a, number_b]: [u32; 2],
        is_shared: bool,
    ) -> Self {
        let order = |feature: Feature, number: u32| rank(feature) << u32::BITS | u64::from(number);
        let swapped = same_surface & (order(features.b, number_b) < order(features.a, number_a));
        // Computes both keys: a branch on which of them it is would be unpredictable.
        let keys =
            [ContactKey::new(features, number_a, number_b), ContactKey::new(features.swapped(), number_b, number_a)];
        Self {
            key: ContactKey(select_unpredictable(swapped, keys[1].0, keys[0].0)),
            swapped,
            is_shared,
            triangle_a: triangles[0],
            triangle_b: triangles[1],
            features,
            ..Self::NONE
        }
    }

    /// The contact of two whole triangles, identified by their own numbers.
    #[inline]
    pub(in crate::kernel) fn between_faces(triangles: [u32; 2], same_surface: bool, place: FacePlace) -> Self {
        let swapped = same_surface && triangles[1] < triangles[0];
        let [first, second] = if swapped { [triangles[1], triangles[0]] } else { triangles };
        let features = FeaturePair { a: Feature::Face, b: Feature::Face };
        Self {
            key: ContactKey::new(features, first, second),
            swapped,
            is_shared: false,
            triangle_a: triangles[0],
            triangle_b: triangles[1],
            features,
            barycentric_a: place.barycentrics[0],
            barycentric_b: place.barycentrics[1],
            point_b: place.point_b,
            normal: place.normal,
            distance: place.distance,
        }
    }

    /// Its triangles. Contacts of a pair of surfaces are sorted by these, then by their keys.
    #[must_use]
    pub const fn triangles(&self) -> (u32, u32) {
        (self.triangle_a, self.triangle_b)
    }

    /// The numbers of both features, see [`feature_number`]. For a shape that is tested by formula, the number of its
    /// feature.
    #[must_use]
    pub fn feature_numbers(&self) -> [u32; 2] {
        let mask = (1u64 << FEATURE_BITS) - 1;
        let numbers = [((self.key.0 >> FEATURE_BITS) & mask) as u32, (self.key.0 & mask) as u32];
        if self.swapped { [numbers[1], numbers[0]] } else { numbers }
    }
}
