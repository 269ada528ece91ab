//! Where the contacts of the last tick lie, in an order that depends on nothing but the scene.

use std::sync::Arc;

use bevy_ecs::prelude::*;

use super::sides::Before;
use crate::{
    detection::{SharedList, SphereLists},
    kernel::{
        contact::{CompactContact, SharedContact, TouchingPair},
        exact::rigid_shape::ShapeGeometry,
        mesh::topology::SurfaceTopology,
        pose::Pose,
        spheres::contacts::SphereContact,
    },
    surface::SideOrder,
};

/// One side of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ContactSide {
    /// A deformable surface.
    Surface(Entity),
    /// A [rigid shape](crate::RigidShape), whether a solid or made of triangles.
    Shape(Entity),
}

impl ContactSide {
    /// The entity, whatever it is.
    #[must_use]
    pub const fn entity(self) -> Entity {
        match self {
            Self::Surface(entity) | Self::Shape(entity) => entity,
        }
    }
}

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
    /// What a method by spheres has found.
    pub(super) spheres: Option<Arc<SphereLists>>,
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
    /// Of a method by spheres its contacts as a tick finds them, whatever others have done to the lists since: which triangles,
    /// and how far apart but for rounding in single precision. They are not sorted, and come in the same order for any number of
    /// threads. Points, normals and the order of [`contacts`](Self::contacts) and [`touching`](Self::touching) come of them
    /// when one of those is first read, on one thread, which takes up to twice as long as the tick on one thread has taken
    /// (`compare` states it); in the tick, by all threads, where those of the same surfaces have been read in the last few
    /// ticks, and where triangles are in few pairs or moved. None where the method is exact.
    pub fn sphere_contacts(&self) -> impl Iterator<Item = SphereContact> {
        self.spheres.iter().flat_map(|lists| lists.contacts())
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
#[derive(Resource, Clone, Debug, Default)]
pub struct ContactStore {
    /// How many times contacts have been detected.
    pub tick: u64,
    /// Pairs that are in contact or near it.
    pub pairs: Vec<StoredPair>,
    /// For each entity the places of its pairs, sorted by entity.
    pub(crate) by_entity: Vec<(Entity, u32)>,
}

impl ContactStore {
    /// The contacts of all pairs.
    pub fn contacts(&self) -> impl Iterator<Item = &CompactContact> {
        self.pairs.iter().flat_map(|pair| pair.contacts.iter())
    }

    /// How many those are.
    #[must_use]
    pub fn contact_count(&self) -> usize {
        self.pairs.iter().map(|pair| pair.contacts.len()).sum()
    }

    /// The touching triangles of all pairs.
    pub fn touching(&self) -> impl Iterator<Item = &TouchingPair> {
        self.pairs.iter().flat_map(|pair| pair.touching.iter())
    }

    /// How many those are.
    #[must_use]
    pub fn touching_count(&self) -> usize {
        self.pairs.iter().map(|pair| pair.touching.len()).sum()
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
