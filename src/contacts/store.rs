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
    surface::{ContactSide, SideOrder},
};

/// A surface and something that it is in contact with, or close to.
#[derive(Clone, Debug)]
pub struct StoredPair {
    /// The first side. Always a deformable surface.
    pub a: ContactSide,
    /// The second side. In a self-collision, the same as the first.
    pub b: ContactSide,
    /// Triangles of the two sides touch within this distance, in world units.
    pub contact_distance: f32,
    /// Distance of the nearest triangles in world units, at least 0. Infinite if none is within range.
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
