//! The store of the last detection's contacts, in an order that depends on nothing but the scene.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::sides::Before;
use crate::{
    detection::{FoundBySpheres, SharedList},
    kernel::{
        contact::{CompactContact, SharedContact, TouchingPair},
        exact::rigid_shape::ShapeGeometry,
        mesh::topology::SurfaceTopology,
        pose::Pose,
        spheres::contacts::SphereContact,
    },
    surface::{ContactSide, SideOrder, ThicknessList},
};

/// A surface and something that it is in contact with, or close to.
#[derive(Clone, Debug)]
pub struct StoredPair {
    /// The first side. Always a deformable surface.
    pub a: ContactSide,
    /// The second side. In a self-collision, the same as the first.
    pub b: ContactSide,
    /// Triangles of the two sides touch within this distance, in world units. The largest, if a thickness
    /// [varies](crate::VertexThickness).
    pub contact_distance: f32,
    /// The thickness at each vertex of either side, where it varies.
    pub(crate) vertex_thickness: [Option<Arc<ThicknessList>>; 2],
    /// Distance of the nearest triangles in world units, at least 0. Infinite if none is within range. If a thickness varies,
    /// this is the least distance of two points, each farther away by how much the thickness there is less than the
    /// largest. So the sides touch if it is at most `contact_distance`.
    pub nearest: f64,
    /// The contacts, sorted by their triangles, then by [key](crate::kernel::contact::ContactKey). If several pairs of
    /// triangles have the same features, this is the contact of the first pair.
    pub contacts: SharedList<CompactContact>,
    /// The touching pairs of triangles, sorted.
    pub touching: SharedList<TouchingPair>,
    /// The results of a sphere method.
    pub(super) spheres: Option<FoundBySpheres>,
    /// The contacts that are [shared](CompactContact::is_shared) and have sides. Other triangles may report them in
    /// another tick.
    pub(super) shared: SharedList<SharedContact>,
    /// World pose of the frame of the contacts.
    pub frame_pose: Pose,
    /// Whether one of the surfaces is smooth, so that the contacts are not those of flat triangles.
    pub(crate) is_smooth: bool,
    pub(crate) topology_a: Arc<SurfaceTopology>,
    pub(crate) topology_b: Option<Arc<SurfaceTopology>>,
    /// The second side, if it is a rigid shape that is tested by formula.
    pub(crate) shape: Option<Arc<ShapeGeometry>>,
    /// The poses of both sides in the world.
    pub(crate) poses: [Pose; 2],
    /// Whether the sides have an inside in this pair.
    pub(crate) one_sided: [bool; 2],
    pub(crate) events: [bool; 2],
    /// How many ticks in a row the contact may be absent without ending.
    pub(crate) event_hold: u32,
    /// The sort key of pairs in the store: those with a shape that is tested by formula come last, then the order of
    /// both sides decides.
    pub(crate) order: PairOrder,
}

impl StoredPair {
    /// The contacts that a sphere method found: which triangles, and their distance except for f32 rounding. In the
    /// order of the candidates, the same for any number of threads. Empty if the method is exact.
    pub fn sphere_contacts(&self) -> impl Iterator<Item = SphereContact> {
        self.spheres.iter().flat_map(FoundBySpheres::contacts)
    }

    /// Whether the sides are at most this share of the contact distance farther apart than where they touch.
    pub(crate) fn touches_within(&self, share: f64) -> bool {
        self.nearest <= f64::from(self.contact_distance) * (1.0 + share)
    }

    /// The number of contacts, whether or not they are [written](crate::settings::SphereContactDetail).
    #[must_use]
    pub fn contact_count(&self) -> usize {
        self.spheres.as_ref().map_or(self.contacts.len(), |found| found.reported)
    }

    /// The number of touching pairs of triangles, whether or not they are
    /// [written](crate::settings::SphereContactDetail).
    #[must_use]
    pub fn touching_count(&self) -> usize {
        self.spheres.as_ref().map_or(self.touching.len(), |found| found.touching)
    }

    /// The distance within which the sides touch at a contact, in world units: the sum of the thicknesses at its points.
    #[must_use]
    pub fn contact_distance_at(&self, contact: &CompactContact) -> f32 {
        let lack = |side: usize, topology: Option<&Arc<SurfaceTopology>>, triangle: u32, weights: [f32; 2]| {
            let (Some(list), Some(topology)) = (&self.vertex_thickness[side], topology) else { return 0.0 };
            list.varying(self.poses[side].scale()).lack_at(topology.triangles()[triangle as usize], weights)
        };
        let lack = lack(0, Some(&self.topology_a), contact.triangle_a, contact.barycentric_a)
            + lack(1, self.topology_b.as_ref(), contact.triangle_b, contact.barycentric_b);
        (f64::from(self.contact_distance) - lack) as f32
    }

    /// A distance in world units that the sides are not closer than, up to the contact distance. If no thickness varies, the
    /// distance of the nearest triangles.
    pub(crate) fn clearance(&self) -> f64 {
        let contact_distance = f64::from(self.contact_distance);
        if self.vertex_thickness.iter().all(Option::is_none) {
            return self.nearest;
        }
        let lack = |side: usize| {
            let list = self.vertex_thickness[side].as_ref();
            list.map_or(0.0, |list| f64::from(list.largest - list.least) * self.poses[side].scale())
        };
        let apart = contact_distance - lack(0) - lack(1);
        self.touching.iter().map(|pair| pair.distance).fold(apart.max(0.0), f64::min)
    }

    /// What the next tick needs to keep contacts on their sides.
    pub(super) fn before(&self) -> Before<'_> {
        Before { contacts: &self.contacts, shared: &self.shared }
    }
}

pub(crate) type PairOrder = (bool, SideOrder, SideOrder);

/// The contacts of the last detection. Pairs of surfaces come first, sorted by [order](crate::SurfaceOrder), including
/// those with rigid shapes made of triangles. Pairs with shapes that are tested by formula follow. Each pair shares the
/// lists of the stage that found them.
///
/// With the exact methods, the closest features of every touching pair of triangles are among the contacts, with one
/// exception: if one-sided surfaces have penetrated each other, contacts that do not lead out of the solid are left
/// out.
///
/// Most systems read it through [`SurfaceContacts`](super::SurfaceContacts).
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct ContactStore {
    pub(super) tick: u64,
    pub(crate) pairs: Vec<StoredPair>,
    /// For each entity, the indices of its pairs. Sorted by entity.
    pub(crate) by_entity: Vec<(Entity, u32)>,
}

impl ContactStore {
    /// The number of detections so far.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Pairs that are in contact or close to it.
    #[must_use]
    pub fn pairs(&self) -> &[StoredPair] {
        &self.pairs
    }

    /// The contacts of all pairs.
    pub fn contacts(&self) -> impl Iterator<Item = &CompactContact> {
        self.pairs.iter().flat_map(|pair| pair.contacts.iter())
    }

    /// The number of contacts of all pairs.
    #[must_use]
    pub fn contact_count(&self) -> usize {
        self.pairs.iter().map(StoredPair::contact_count).sum()
    }

    /// The touching pairs of triangles of all pairs.
    pub fn touching(&self) -> impl Iterator<Item = &TouchingPair> {
        self.pairs.iter().flat_map(|pair| pair.touching.iter())
    }

    /// The number of touching pairs of triangles.
    #[must_use]
    pub fn touching_count(&self) -> usize {
        self.pairs.iter().map(StoredPair::touching_count).sum()
    }

    pub(crate) fn pairs_of(&self, entity: Entity) -> impl Iterator<Item = &StoredPair> {
        let start = self.by_entity.partition_point(|&(other, _)| other < entity);
        self.by_entity[start..]
            .iter()
            .take_while(move |&&(other, _)| other == entity)
            .map(|&(_, place)| &self.pairs[place as usize])
    }

    /// The pair of two sides, in either order. At most one.
    pub(crate) fn pairs_between(&self, a: Entity, b: Entity) -> impl Iterator<Item = &StoredPair> {
        self.pairs_of(a).filter(move |pair| {
            let sides = [pair.a.entity(), pair.b.entity()];
            sides == [a, b] || sides == [b, a]
        })
    }
}
