//! Fewer contacts for those who need a few: the deepest, the deepest of each vertex, and a manifold.

use std::collections::BTreeMap;

use bevy_ecs::prelude::*;
use glam::Vec3;

use super::reading::{Contact, SurfaceContacts};
use crate::{kernel::mesh::ids::VertexId, surface::ContactSide};

impl SurfaceContacts<'_> {
    /// The contact between two sides with the lowest [separation](Contact::separation), with `a` as its first side. Of
    /// several, the first in the order of the store. `None` if there is no contact. Pass the same entity twice for a
    /// surface with itself.
    #[must_use]
    pub fn deepest(&self, a: Entity, b: Entity) -> Option<Contact<'_>> {
        self.between(a, b).min_by(|one, other| one.separation().total_cmp(&other.separation()))
    }

    /// For each vertex of a surface that contacts act on, the contact with the lowest
    /// [separation](Contact::separation), with the surface as its first side. Sorted by vertex. In a self-collision, the
    /// vertex may be on either side.
    #[must_use]
    pub fn deepest_per_vertex(&self, entity: Entity) -> Vec<(VertexId, Contact<'_>)> {
        let mut deepest: BTreeMap<VertexId, Contact<'_>> = BTreeMap::new();
        for contact in self.contacts_with(entity) {
            for entry in contact.stencil().into_iter().filter(|entry| entry.entity == entity) {
                let kept = deepest.entry(entry.vertex).or_insert(contact);
                if contact.separation() < kept.separation() {
                    *kept = contact;
                }
            }
        }
        deepest.into_iter().collect()
    }

    /// At most `most` contacts between two sides that stand for all of them, with `a` as their first side: the deepest, then
    /// always the one whose point on `a` is farthest from the points of those that were chosen. Ends early where all other
    /// contacts are at the points of chosen ones.
    #[must_use]
    pub fn manifold(&self, a: Entity, b: Entity, most: usize) -> Vec<Contact<'_>> {
        let all: Vec<(Contact<'_>, Vec3)> = self.between(a, b).map(|contact| (contact, contact.points().0)).collect();
        let mut chosen = Vec::new();
        let Some(deepest) = self.deepest(a, b).filter(|_| most > 0) else { return chosen };
        chosen.push(deepest);
        let mut last = deepest.points().0;
        let mut distances = vec![f32::INFINITY; all.len()];
        while chosen.len() < most {
            for (distance, (_, point)) in distances.iter_mut().zip(&all) {
                *distance = distance.min(point.distance_squared(last));
            }
            // Of several, the first.
            let farthest = distances.iter().zip(&all).rev().max_by(|(one, _), (other, _)| one.total_cmp(other));
            let Some((_, (contact, point))) = farthest.filter(|(distance, _)| **distance > 0.0) else { break };
            chosen.push(*contact);
            last = *point;
        }
        chosen
    }
}

impl Contact<'_> {
    /// The velocity of the second side's contact point relative to the first one's, in the unit of the velocities that are
    /// passed. Positive along the [normal](Self::normal) if the sides separate. `of_vertex` returns the velocity of a vertex of
    /// a surface in the world, and `of_shape` that of a rigid shape at a point in the world.
    #[must_use]
    pub fn relative_velocity(
        &self,
        of_vertex: impl Fn(Entity, VertexId) -> Vec3,
        of_shape: impl Fn(Entity, Vec3) -> Vec3,
    ) -> Vec3 {
        let of_surfaces =
            self.stencil().into_iter().map(|entry| of_vertex(entry.entity, entry.vertex) * entry.weight).sum::<Vec3>();
        let (point_a, point_b) = self.points();
        let of_side = |side: ContactSide, point: Vec3| match side {
            ContactSide::Surface(_) => Vec3::ZERO,
            ContactSide::Shape(entity) => of_shape(entity, point),
        };
        of_surfaces + of_side(self.b(), point_b) - of_side(self.a(), point_a)
    }
}
