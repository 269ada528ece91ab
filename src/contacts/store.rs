//! Where the contacts of the last tick lie, in an order that depends on nothing but the scene.

use std::sync::Arc;

use bevy_ecs::prelude::*;

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

/// A surface and what it is in contact with, or near to.
#[derive(Clone, Debug)]
pub struct StoredPair {
    /// The first side, always a deformable surface.
    pub a: ContactSide,
    /// The second side: the same as the first in a self-collision.
    pub b: ContactSide,
    /// Triangles of the two touch within this distance, in world units.
    pub contact_distance: f32,
    /// Distance of the nearest triangles in world units, at least 0; infinite where none was near.
    pub nearest: f64,
    /// Its contacts, by their triangles, and those of the same two triangles by
    /// [key](crate::kernel::contact::ContactKey). Of features that several pairs of triangles have, the contact is that of the
    /// first.
    pub contacts: SharedList<CompactContact>,
    /// Its touching triangles, in their order.
    pub touching: SharedList<TouchingPair>,
    /// What a sphere method has found.
    pub(super) spheres: Option<FoundBySpheres>,
    /// Which of its contacts are [shared](CompactContact::is_shared) and have sides: in another tick other triangles may report
    /// them.
    pub(super) shared: SharedList<SharedContact>,
    /// World pose of the frame that its contacts are in.
    pub frame_pose: Pose,
    pub(crate) topology_a: Arc<SurfaceTopology>,
    pub(crate) topology_b: Option<Arc<SurfaceTopology>>,
    /// The second side, where it is a rigid shape that is tested by formula.
    pub(crate) shape: Option<Arc<ShapeGeometry>>,
    /// Where both sides stand in the world.
    pub(crate) poses: [Pose; 2],
    /// Whether the surfaces have an inside, as far as this pair goes.
    pub(crate) one_sided: [bool; 2],
    pub(crate) events: [bool; 2],
    /// Sorts pairs as the store does: those with a solid that is tested by formula last, then by the order of both sides.
    pub(crate) order: PairOrder,
}

impl StoredPair {
    /// The contacts that a sphere method has found: which triangles, and how far apart but for rounding in single precision. In the
    /// order of the candidates, the same for any number of threads. None where the method is exact.
    pub fn sphere_contacts(&self) -> impl Iterator<Item = SphereContact> {
        self.spheres.iter().flat_map(FoundBySpheres::contacts)
    }

    /// How many contacts there are, whether or not they are [written](crate::settings::SphereContactDetail).
    #[must_use]
    pub fn contact_count(&self) -> usize {
        self.spheres.as_ref().map_or(self.contacts.len(), |found| found.reported)
    }

    /// How many pairs of triangles touch, whether or not they are [written](crate::settings::SphereContactDetail).
    #[must_use]
    pub fn touching_count(&self) -> usize {
        self.spheres.as_ref().map_or(self.touching.len(), |found| found.touching)
    }

    /// What the next tick is told of it.
    pub(super) fn before(&self) -> Before<'_> {
        Before { contacts: &self.contacts, shared: &self.shared }
    }
}

pub(crate) type PairOrder = (bool, SideOrder, SideOrder);

/// The contacts of the last detection: pairs of surfaces by [order](crate::SurfaceOrder), rigid shapes made of triangles among them,
/// then surfaces with solids that are tested by formula. The lists of a pair are those of the stage that found them, not copies.
///
/// Every touching pair of triangles has its closest features among the contacts, with one exception: where one-sided
/// surfaces have penetrated each other, contacts that do not lead out of the solid are left out.
///
/// Most systems read it through [`SurfaceContacts`](super::SurfaceContacts).
#[derive(Resource, Debug, Default)]
pub struct ContactStore {
    pub(super) tick: u64,
    pub(crate) pairs: Vec<StoredPair>,
    /// For each entity the places of its pairs, sorted by entity.
    pub(crate) by_entity: Vec<(Entity, u32)>,
}

impl ContactStore {
    /// How many times contacts have been detected.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// Pairs that are in contact or near it.
    #[must_use]
    pub fn pairs(&self) -> &[StoredPair] {
        &self.pairs
    }

    /// The contacts of all pairs.
    pub fn contacts(&self) -> impl Iterator<Item = &CompactContact> {
        self.pairs.iter().flat_map(|pair| pair.contacts.iter())
    }

    /// How many those are.
    #[must_use]
    pub fn contact_count(&self) -> usize {
        self.pairs.iter().map(StoredPair::contact_count).sum()
    }

    /// The touching triangles of all pairs.
    pub fn touching(&self) -> impl Iterator<Item = &TouchingPair> {
        self.pairs.iter().flat_map(|pair| pair.touching.iter())
    }

    /// How many those are.
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

    /// The pairs of two sides, whichever comes first: one at most.
    pub(crate) fn pairs_between(&self, a: Entity, b: Entity) -> impl Iterator<Item = &StoredPair> {
        self.pairs_of(a).filter(move |pair| {
            let sides = [pair.a.entity(), pair.b.entity()];
            sides == [a, b] || sides == [b, a]
        })
    }
}
