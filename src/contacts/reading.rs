//! How systems read contacts.

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

/// The square of a unit vector's length is rounded by less than this: records are in f32. A scale that differs between the axes,
/// by as little as a pose takes for none, changes it by more.
const UNIT_ROUNDING: f64 = 1.0e-6;

/// Reads the contacts of the last detection. Does not borrow positions, so a solver can write them meanwhile.
#[derive(SystemParam)]
pub struct SurfaceContacts<'w> {
    store: Res<'w, ContactStore>,
}

impl SurfaceContacts<'_> {
    /// How many times contacts have been detected.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.store.tick
    }

    /// Every contact once, in the order of the [`ContactStore`].
    pub fn iter(&self) -> impl Iterator<Item = Contact<'_>> {
        self.store.pairs.iter().flat_map(|pair| Self::contacts(pair, false))
    }

    /// Every pair of sides that is in contact or near it, in the order of the [`ContactStore`], and its contacts.
    #[cfg(feature = "rerun")]
    pub(crate) fn by_pair(&self) -> impl Iterator<Item = (&StoredPair, impl Iterator<Item = Contact<'_>>)> {
        self.store.pairs.iter().map(|pair| (pair, Self::contacts(pair, false)))
    }

    /// The contacts of one surface or shape, itself as the first side of each. A contact between two surfaces is among
    /// those of both; [`iter`](Self::iter) has it once.
    pub fn of(&self, entity: Entity) -> impl Iterator<Item = Contact<'_>> {
        self.store.pairs_of(entity).flat_map(move |pair| Self::contacts(pair, pair.a.entity() != entity))
    }

    /// The contacts between two surfaces or a surface and a shape, `a` as the first side of each. Twice the same entity:
    /// those of a surface with itself.
    pub fn between(&self, a: Entity, b: Entity) -> impl Iterator<Item = Contact<'_>> {
        self.store.pairs_between(a, b).flat_map(move |pair| Self::contacts(pair, pair.a.entity() != a))
    }

    fn contacts(pair: &StoredPair, swapped: bool) -> impl Iterator<Item = Contact<'_>> {
        pair.contacts.iter().map(move |record| Contact { pair, record, swapped })
    }
}

/// Gives contacts smooth normals: those of the curved surfaces that meshes stand for, without the bumps that inner edges
/// give. Nothing is computed but what is asked for, and nothing is stored.
///
/// A body that slides over a mesh meets its inner edges and vertices too, and the exact [normals](Contact::normal) there
/// lean against it. The smooth normal turns steadily from face to face, is exactly the plane's on flat ground, and leaves
/// creases as they are: see [`CircumsphereSettings::crease_angle`]. The separation stays that of the exact normal.
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// fn push_out(contacts: SurfaceContacts, smooth_normals: SmoothNormals) {
///     for contact in contacts.iter() {
///         let push = smooth_normals.of(&contact) * -contact.separation();
///         // ...move the first side by it
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
    /// The world unit normal from the second side of a contact to the first, see [`Contact::smooth_normal`].
    #[must_use]
    pub fn of(&self, contact: &Contact<'_>) -> Vec3 {
        let positions = |entity| self.surfaces.get(entity).ok().map(|positions| positions.0.as_slice());
        contact.smooth_normal(positions, self.settings.crease())
    }
}

/// The weights of all three corners from the first two. A corner that is no part of the feature has none, not even
/// what rounding leaves of 1.
fn complete(feature: Feature, [first, second]: [f32; 2]) -> [f32; 3] {
    match feature {
        Feature::Edge(0) => [first, 1.0 - first, 0.0],
        _ => [first, second, 1.0 - first - second],
    }
}

/// One vertex that a contact acts on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StencilEntry {
    /// The surface it belongs to; in an [impact](crate::Impact::stencil) it may be a rigid shape made of triangles.
    pub entity: Entity,
    /// Which of its vertices, as the game numbered them.
    pub vertex: VertexId,
    /// Its share of the contact point: positive on the first side, negative on the second. A side's weights sum to
    /// plus or minus 1; vertices with no share are left out.
    pub weight: f32,
    /// World normal from the second side to the first, so that `weight * normal` is how the separation grows when
    /// this vertex moves.
    pub normal: Vec3,
}

/// The entries of one side: the corners of its triangle that have a share.
pub(super) fn stencil_side(
    entity: Entity,
    corners: [u32; 3],
    weights: [f32; 3],
    (sign, normal): (f32, Vec3),
) -> impl Iterator<Item = StencilEntry> {
    let shares = corners.into_iter().zip(weights).filter(|&(_, weight)| weight != 0.0);
    shares.map(move |(vertex, weight)| StencilEntry { entity, vertex: VertexId(vertex), weight: sign * weight, normal })
}

/// A contact, read from one of its sides, in world units.
#[derive(Clone, Copy)]
pub struct Contact<'a> {
    pair: &'a StoredPair,
    record: &'a CompactContact,
    swapped: bool,
}

/// Without the surfaces, which it only refers to.
impl Debug for Contact<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let mut contact = formatter.debug_struct("Contact");
        contact.field("a", &self.a()).field("b", &self.b()).field("features", &self.features());
        contact.field("triangles", &self.triangles()).field("points", &self.points()).field("normal", &self.normal());
        contact.field("separation", &self.separation()).finish_non_exhaustive()
    }
}

impl Contact<'_> {
    /// Picks by side: what stands first in the record, or second.
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

    /// Names the contact within its pair of surfaces, the same in every tick.
    #[must_use]
    pub fn key(&self) -> ContactKey {
        self.record.key
    }

    /// What kinds of features meet.
    #[must_use]
    pub fn kind(&self) -> FeatureKind {
        self.record.features.kind()
    }

    /// Whether the two sides cross here, an edge piercing a face: the distance is 0, and how deep is not known.
    #[must_use]
    pub fn is_crossing(&self) -> bool {
        self.kind() == FeatureKind::EdgeFace
    }

    /// How far the two sides are from touching: the distance less the contact distance, in world units. Negative
    /// where they touch, positive only within the margin.
    #[must_use]
    pub fn separation(&self) -> f32 {
        self.record.distance - self.pair.contact_distance
    }

    /// Signed distance between the two contact points in world units, negative where the sides have passed each other.
    #[must_use]
    pub fn distance(&self) -> f32 {
        self.record.distance
    }

    /// The distance at which the two touch, in world units: the sum of both thicknesses, where a shape has none.
    #[must_use]
    pub fn contact_distance(&self) -> f32 {
        self.pair.contact_distance
    }

    /// World unit normal from the second side to the first: moving the first side along it parts the two.
    #[must_use]
    pub fn normal(&self) -> Vec3 {
        let normal = self.world_normal().as_vec3();
        if self.swapped { -normal } else { normal }
    }

    /// The same in the order of the record, in f64.
    fn world_normal(&self) -> DVec3 {
        let normal = self.pair.frame_pose.transform_direction(self.record.normal.as_dvec3());
        let is_unit = (normal.length_squared() - 1.0).abs() <= UNIT_ROUNDING;
        if is_unit { normal } else { normal.normalize_or(normal) }
    }

    /// World unit normal from the second side to the first, of the curved surfaces that the two meshes stand for. What
    /// [`SmoothNormals`] gives, for systems that have the surfaces' positions already: `positions` finds those of a
    /// surface, in its own frame. An edge bent by `crease` or more stays sharp.
    ///
    /// The exact [normal](Self::normal) where there is no telling: where an edge of the contact has more than two
    /// triangles, a triangle no area, a surface no positions any more, and where the smooth normals of the two sides do
    /// not fit together. Never more than a right angle from the exact one.
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
            [Some((_, point_a)), Some((_, point_b))] => *point_a - *point_b,
            _ => exact * f64::from(record.distance),
        };
        let [cone_a, cone_b] = sides.map(|side| side.map_or_else(NormalCone::anything, |(cone, _)| cone));
        let cone_b = match &pair.shape {
            Some(shape) => {
                // A direction that the surface's facets rule out would only bring the bump back.
                let outward = -cone_a.nearest_unsmoothed(-exact);
                let outward = pair.poses[1].inverse().transform_direction(outward).normalize_or_zero();
                shape.normal_cone(record.triangle_b, outward).moved(&pair.poses[1])
            }
            None => cone_b,
        };
        let smooth = smooth_normal(exact, apart, &cone_a, &cone_b);
        let smooth = smooth.as_vec3();
        if self.swapped { -smooth } else { smooth }
    }

    /// The contact points on the first and the second side, in the world.
    #[must_use]
    pub fn points(&self) -> (Vec3, Vec3) {
        let pose = &self.pair.frame_pose;
        let along = self.record.normal.as_dvec3() * (f64::from(self.record.distance) / pose.scale());
        let point_b = self.record.point_b.as_dvec3();
        let world = |point| pose.transform_point(point).as_vec3();
        self.pick(world(point_b + along), world(point_b))
    }

    /// Triangles of the first and the second side, as the game numbered them; `None` for a rigid shape that is not made of
    /// triangles.
    #[must_use]
    pub fn triangles(&self) -> (Option<TriangleId>, Option<TriangleId>) {
        let of_b = self.pair.topology_b.as_ref().map(|_| TriangleId(self.record.triangle_b));
        self.pick(Some(TriangleId(self.record.triangle_a)), of_b)
    }

    /// The features of the first and the second side, as places within their triangles.
    #[must_use]
    pub fn features(&self) -> (Feature, Feature) {
        self.pick(self.record.features.a, self.record.features.b)
    }

    /// Weights of the corners of the first and the second triangle at the contact points; of a rigid shape that is not made
    /// of triangles without meaning. Each sums to 1.
    #[must_use]
    pub fn barycentrics(&self) -> ([f32; 3], [f32; 3]) {
        let record = self.record;
        self.pick(complete(record.features.a, record.barycentric_a), complete(record.features.b, record.barycentric_b))
    }

    /// The vertices of a side's feature: one, two or three; none for a rigid shape that is not made of triangles.
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

    /// The numbers of both features, see [`feature_number`](crate::kernel::contact::feature_number); of a solid
    /// that is tested by formula that of its part.
    #[must_use]
    pub fn feature_numbers(&self) -> (u32, u32) {
        let [of_a, of_b] = self.record.feature_numbers();
        self.pick(of_a, of_b)
    }

    /// The vertices that the contact acts on, with their signed shares: at most three a side, none of a rigid shape
    /// of any kind.
    #[must_use]
    pub fn stencil(&self) -> ArrayVec<StencilEntry, 6> {
        let normal = self.normal();
        let mut stencil = ArrayVec::new();
        let mut side = |entity: Entity, topology: &SurfaceTopology, triangle: u32, weights: [f32; 3], sign: f32| {
            stencil.extend(stencil_side(entity, topology.triangles()[triangle as usize], weights, (sign, normal)));
        };
        let (sign_a, sign_b) = self.pick(1.0, -1.0);
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
