//! The system parameters that read contacts from the [`ContactStore`].
//!
//! Points, normals, and stencils are computed when they are read, in world units.

use std::fmt::{self, Debug, Formatter};

use arrayvec::ArrayVec;
use bevy_ecs::{prelude::*, system::SystemParam};
use glam::{DVec3, Vec3};

use super::store::{ContactStore, StoredPair};
use crate::{
    kernel::{
        contact::{CompactContact, ContactKey},
        mesh::{
            feature::{Feature, FeatureKind},
            ids::{TriangleId, VertexId},
            smooth_normal::{CreaseAngle, NormalCone, SurfacePlace, smooth_normal},
            topology::SurfaceTopology,
        },
    },
    settings::CircumsphereSettings,
    surface::{ContactSide, SurfacePositions},
};

/// Upper bound of the rounding error of a unit vector's squared length, since records are in f32. A scale that is
/// uniform only within the tolerance of a pose changes it by more.
const UNIT_ROUNDING: f64 = 1.0e-6;

/// Reads the contacts of the last detection. Does not borrow positions, so a solver can write them at the same time.
#[derive(SystemParam)]
pub struct SurfaceContacts<'w> {
    store: Res<'w, ContactStore>,
}

impl SurfaceContacts<'_> {
    /// The number of detections so far.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.store.tick
    }

    /// All contacts, each once, in the order of the [`ContactStore`].
    pub fn iter(&self) -> impl Iterator<Item = Contact<'_>> {
        self.store.pairs.iter().flat_map(|pair| Self::contacts(pair, false))
    }

    /// All pairs of sides that are in contact or close to it, with their contacts, in the order of the
    /// [`ContactStore`].
    #[cfg(any(feature = "gizmos", feature = "rerun"))]
    pub(crate) fn by_pair(&self) -> impl Iterator<Item = (&StoredPair, impl Iterator<Item = Contact<'_>>)> {
        self.store.pairs.iter().map(|pair| (pair, Self::contacts(pair, false)))
    }

    /// The contacts of one surface or shape, with `entity` as the first side of each. A contact between two surfaces
    /// belongs to both of them. [`iter`](Self::iter) returns it once.
    pub fn contacts_with(&self, entity: Entity) -> impl Iterator<Item = Contact<'_>> {
        self.store.pairs_of(entity).flat_map(move |pair| Self::contacts(pair, pair.a.entity() != entity))
    }

    /// The contacts between two surfaces, or between a surface and a shape, with `a` as the first side of each. Pass
    /// the same entity twice for the contacts of a surface with itself.
    pub fn between(&self, a: Entity, b: Entity) -> impl Iterator<Item = Contact<'_>> {
        self.store.pairs_between(a, b).flat_map(move |pair| Self::contacts(pair, pair.a.entity() != a))
    }

    /// Whether two surfaces, or a surface and a shape, touch: some of their triangles are within the contact distance.
    /// Pass the same entity twice for a surface with itself.
    #[must_use]
    pub fn is_touching(&self, a: Entity, b: Entity) -> bool {
        self.store.pairs_between(a, b).any(|pair| pair.touching_count() > 0)
    }

    fn contacts(pair: &StoredPair, swapped: bool) -> impl Iterator<Item = Contact<'_>> {
        pair.contacts.iter().map(move |record| Contact { pair, record, swapped })
    }
}

/// Computes smooth contact normals: the normals of the curved surfaces that meshes stand for, without the bumps of
/// inner edges. Computes only what is requested, and stores nothing.
///
/// A body that slides over a mesh also meets its inner edges and vertices, where the exact [normals](Contact::normal)
/// tilt against the motion. The smooth normal changes continuously from face to face, is exactly the plane's normal on
/// flat ground, and preserves creases: see [`CircumsphereSettings::crease_angle`]. The separation remains that of the
/// exact normal.
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// fn push_out(contacts: SurfaceContacts, smooth_normals: SmoothNormals) {
///     for contact in contacts.iter() {
///         let push = smooth_normals.of(&contact) * -contact.separation();
///         // ...move the second side by it
///         # let _ = push;
///     }
/// }
/// # bevy_ecs::system::IntoSystem::into_system(push_out);
/// ```
#[derive(SystemParam)]
pub struct SmoothNormals<'w, 's> {
    settings: Res<'w, CircumsphereSettings>,
    surfaces: Query<'w, 's, &'static SurfacePositions>,
}

impl SmoothNormals<'_, '_> {
    /// World unit normal from the first side of a contact to the second. See [`Contact::smooth_normal`].
    #[must_use]
    pub fn of(&self, contact: &Contact<'_>) -> Vec3 {
        let positions = |entity| self.surfaces.get(entity).ok().map(|positions| positions.0.as_slice());
        contact.smooth_normal(positions, self.settings.crease())
    }
}

/// The weights of all three corners, from the first two. A corner outside the feature gets exactly 0, without the
/// rounding error of the sum.
fn complete(feature: Feature, [first, second]: [f32; 2]) -> [f32; 3] {
    match feature {
        Feature::Edge(0) => [first, 1.0 - first, 0.0],
        _ => [first, second, 1.0 - first - second],
    }
}

/// A vertex that a contact acts on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StencilEntry {
    /// The surface that the vertex belongs to. In an [impact](crate::Impact::stencil) it may be a rigid shape made of
    /// triangles.
    pub entity: Entity,
    /// The vertex, in the game's numbering.
    pub vertex: VertexId,
    /// Its weight in the contact point, negative on the first side and positive on the second. The weights of a side
    /// sum to -1 or 1. Vertices without weight are left out.
    pub weight: f32,
    /// World normal from the first side to the second. `weight * normal` is the gradient of the separation with respect
    /// to this vertex.
    pub normal: Vec3,
}

/// The entries of one side: the corners of its triangle that have weight.
pub(super) fn stencil_side(
    entity: Entity,
    corners: [u32; 3],
    weights: [f32; 3],
    (sign, normal): (f32, Vec3),
) -> impl Iterator<Item = StencilEntry> {
    let shares = corners.into_iter().zip(weights).filter(|&(_, weight)| weight != 0.0);
    shares.map(move |(vertex, weight)| StencilEntry { entity, vertex: VertexId(vertex), weight: sign * weight, normal })
}

/// A contact, seen from one of its sides, in world units.
#[derive(Clone, Copy)]
pub struct Contact<'a> {
    pair: &'a StoredPair,
    record: &'a CompactContact,
    swapped: bool,
}

/// Omits the surfaces, which the contact only refers to.
impl Debug for Contact<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let mut contact = formatter.debug_struct("Contact");
        contact.field("a", &self.a()).field("b", &self.b()).field("features", &self.features());
        contact.field("triangles", &self.triangles()).field("points", &self.points()).field("normal", &self.normal());
        contact.field("separation", &self.separation()).finish_non_exhaustive()
    }
}

impl Contact<'_> {
    /// Puts two values of the record, of its first and second side, into the order in which the contact is seen.
    fn pick<T>(&self, first: T, second: T) -> (T, T) {
        if self.swapped { (second, first) } else { (first, second) }
    }

    /// The first side.
    #[must_use]
    pub fn a(&self) -> ContactSide {
        self.pick(self.pair.a, self.pair.b).0
    }

    /// The second side.
    #[must_use]
    pub fn b(&self) -> ContactSide {
        self.pick(self.pair.a, self.pair.b).1
    }

    /// Identifies the contact within its pair of surfaces. The same in every tick.
    #[must_use]
    pub fn key(&self) -> ContactKey {
        self.record.key
    }

    /// The kinds of features that meet.
    #[must_use]
    pub fn kind(&self) -> FeatureKind {
        self.record.features.kind()
    }

    /// Whether the two sides cross here: an edge pierces a face. The distance is then 0, and the depth is unknown.
    #[must_use]
    pub fn is_crossing(&self) -> bool {
        self.kind() == FeatureKind::EdgeFace
    }

    /// The distance less the contact distance, in world units. Negative if the sides touch, positive only within the
    /// margin.
    #[must_use]
    pub fn separation(&self) -> f32 {
        self.record.distance - self.contact_distance()
    }

    /// Signed distance of the two contact points in world units. Negative if the sides have passed each other.
    #[must_use]
    pub fn distance(&self) -> f32 {
        self.record.distance
    }

    /// The distance within which the two sides touch here, in world units: the sum of both thicknesses. A shape has none.
    #[must_use]
    pub fn contact_distance(&self) -> f32 {
        self.pair.contact_distance_at(self.record)
    }

    /// World unit normal from the first side to the second. Moving the second side along it separates the two.
    #[must_use]
    pub fn normal(&self) -> Vec3 {
        let normal = self.world_normal().as_vec3();
        // Adding 0 turns -0 into 0.
        if self.swapped { Vec3::ZERO - normal } else { normal + Vec3::ZERO }
    }

    /// The normal in the order of the record, in f64.
    fn world_normal(&self) -> DVec3 {
        let normal = self.pair.frame_pose.transform_direction(self.record.normal.as_dvec3());
        let is_unit = (normal.length_squared() - 1.0).abs() <= UNIT_ROUNDING;
        if is_unit { normal } else { normal.normalize_or(normal) }
    }

    /// World unit normal from the first side to the second, of the curved surfaces that the two meshes stand for.
    /// [`SmoothNormals`] returns the same. This function is for systems that already access positions: `positions`
    /// returns those of a surface, in its own frame. An edge bent by `crease` or more stays sharp.
    ///
    /// Returns the exact [normal](Self::normal) if the smooth one is undefined: an edge of the contact has more than
    /// two triangles, a triangle has no area, a surface has no positions anymore, or the smooth normals of the two
    /// sides do not match. Never more than a right angle from the exact normal.
    #[must_use]
    pub fn smooth_normal<'p>(&self, positions: impl Fn(Entity) -> Option<&'p [Vec3]>, crease: CreaseAngle) -> Vec3 {
        let (pair, record) = (self.pair, self.record);
        let exact = self.world_normal();
        let cone = |side: usize, topology: &SurfaceTopology| {
            let (entity, triangle, feature, weights) = match side {
                0 => (pair.a.entity(), record.triangle_a, record.features.a, record.barycentric_a),
                _ => (pair.b.entity(), record.triangle_b, record.features.b, record.barycentric_b),
            };
            let positions = positions(entity).filter(|positions| positions.len() == topology.vertex_count())?;
            let barycentric = complete(feature, weights).map(f64::from);
            let one_sided = pair.one_sided[side];
            let place = SurfacePlace { topology, positions, triangle, feature, one_sided, barycentric };
            let pose = &pair.poses[side];
            Some((NormalCone::of(&place, crease).moved(pose), pose.transform_point(place.point())))
        };
        let sides = [cone(0, &pair.topology_a), pair.topology_b.as_ref().and_then(|topology| cone(1, topology))];
        let apart = match &sides {
            [Some((_, point_a)), Some((_, point_b))] => *point_b - *point_a,
            _ => exact * f64::from(record.distance),
        };
        let [cone_a, cone_b] = sides.map(|side| side.map_or_else(NormalCone::anything, |(cone, _)| cone));
        let cone_b = match &pair.shape {
            Some(shape) => {
                // A direction outside the cone of the surface's facets would only reintroduce the bump.
                let outward = -cone_a.nearest_unsmoothed(exact);
                let outward = pair.poses[1].inverse().transform_direction(outward).normalize_or_zero();
                shape.normal_cone(record.triangle_b, outward).moved(&pair.poses[1])
            }
            None => cone_b,
        };
        let smooth = smooth_normal(exact, apart, &cone_a, &cone_b);
        let smooth = smooth.as_vec3();
        if self.swapped { -smooth } else { smooth }
    }

    /// The contact points on the first and second side, in the world.
    #[must_use]
    pub fn points(&self) -> (Vec3, Vec3) {
        let pose = &self.pair.frame_pose;
        let along = self.record.normal.as_dvec3() * (f64::from(self.record.distance) / pose.scale());
        let point_b = self.record.point_b.as_dvec3();
        let world = |point| pose.transform_point(point).as_vec3();
        self.pick(world(point_b - along), world(point_b))
    }

    /// The triangles of the first and second side, in the game's numbering. `None` for a rigid shape that is tested by
    /// formula.
    #[must_use]
    pub fn triangles(&self) -> (Option<TriangleId>, Option<TriangleId>) {
        let of_b = self.pair.topology_b.as_ref().map(|_| TriangleId(self.record.triangle_b));
        self.pick(Some(TriangleId(self.record.triangle_a)), of_b)
    }

    /// The features of the first and second side, by their indices within the triangles.
    #[must_use]
    pub fn features(&self) -> (Feature, Feature) {
        self.pick(self.record.features.a, self.record.features.b)
    }

    /// The weights of the corners of the first and second triangle at the contact points. Each triple sums to 1.
    /// Meaningless for a rigid shape that is tested by formula.
    #[must_use]
    pub fn barycentrics(&self) -> ([f32; 3], [f32; 3]) {
        let record = self.record;
        self.pick(complete(record.features.a, record.barycentric_a), complete(record.features.b, record.barycentric_b))
    }

    /// The vertices of each side's feature: one, two, or three. None for a rigid shape that is tested by formula.
    #[must_use]
    pub fn feature_vertices(&self) -> (ArrayVec<VertexId, 3>, ArrayVec<VertexId, 3>) {
        let corners = |topology: &SurfaceTopology, triangle: u32, feature: Feature| {
            let corners = topology.triangles()[triangle as usize].map(VertexId);
            match feature {
                Feature::Vertex(corner) => ArrayVec::from_iter([corners[corner as usize]]),
                Feature::Edge(edge) => ArrayVec::from_iter([corners[edge as usize], corners[(edge as usize + 1) % 3]]),
                Feature::Face => ArrayVec::from_iter(corners),
            }
        };
        let record = self.record;
        let of_a = corners(&self.pair.topology_a, record.triangle_a, record.features.a);
        let of_b = self
            .pair
            .topology_b
            .as_ref()
            .map_or_else(ArrayVec::new, |topology| corners(topology, record.triangle_b, record.features.b));
        self.pick(of_a, of_b)
    }

    /// The numbers of both features, see [`feature_number`](crate::kernel::contact::feature_number). For a rigid shape
    /// that is tested by formula, the number of its feature.
    #[must_use]
    pub fn feature_numbers(&self) -> (u32, u32) {
        let [of_a, of_b] = self.record.feature_numbers();
        self.pick(of_a, of_b)
    }

    /// The vertices that the contact acts on, with signed weights: at most three per side, none of a rigid shape of any
    /// kind.
    #[must_use]
    pub fn stencil(&self) -> ArrayVec<StencilEntry, 6> {
        let normal = self.normal();
        let mut stencil = ArrayVec::new();
        let mut side = |entity: Entity, topology: &SurfaceTopology, triangle: u32, weights: [f32; 3], sign: f32| {
            stencil.extend(stencil_side(entity, topology.triangles()[triangle as usize], weights, (sign, normal)));
        };
        let (sign_a, sign_b) = self.pick(-1.0, 1.0);
        let record = self.record;
        let weights = complete(record.features.a, record.barycentric_a);
        side(self.pair.a.entity(), &self.pair.topology_a, record.triangle_a, weights, sign_a);
        if let (Some(topology), ContactSide::Surface(_)) = (&self.pair.topology_b, self.pair.b) {
            let weights = complete(record.features.b, record.barycentric_b);
            side(self.pair.b.entity(), topology, record.triangle_b, weights, sign_b);
        }
        stencil
    }
}
