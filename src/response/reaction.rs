//! Reactions: what the contacts of a tick did to what the solver does not move.

use bevy_ecs::{entity::EntityHashMap, prelude::*};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::{DVec3, Vec3};

use crate::{
    kernel::{pose::Pose, xpbd::coloring::NONE},
    surface::ActiveSurfaces,
};

/// The impulse that the contacts of the last tick gave to a rigid shape, or to a surface that the solver does not move.
/// Insert it on such an entity to have it written in every tick. To let surfaces push a rigid body, use
/// [`RigidMass`](super::RigidMass) instead: an impulse that comes when the tick is over adds energy to what springs back.
///
/// It holds what contacts, their friction, and the guard of [`SweptCollision`](crate::SweptCollision) pushed. What the guard
/// can only stop, because other objects leave it no way, leaves no impulse.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
pub struct SurfaceReaction {
    /// The sum of impulses, in newton seconds in the world. Divide by the duration of the tick to get the mean force.
    pub impulse: Vec3,
    /// The sum of their moments about the origin of the entity's frame, in newton meter seconds in the world.
    pub angular_impulse: Vec3,
}

/// A contact that pushes something that the solver does not move.
#[derive(Clone, Copy, Debug)]
struct Pushed {
    entity: Entity,
    /// The contact point in the world.
    point: DVec3,
    /// −1 if the solver pushes the other side away, along the normal.
    sign: f64,
}

/// Stands for no reaction.
pub(super) const NO_REACTION: u32 = NONE;

/// The reactions of a tick.
#[derive(Debug, Default)]
pub(super) struct Reactions {
    /// The contacts of this part of the tick.
    contacts: Vec<Pushed>,
    /// Impulse and moment, about the origin of the world, of each entity in all parts.
    sums: EntityHashMap<[DVec3; 2]>,
}

impl Reactions {
    pub(super) fn begin_tick(&mut self) {
        self.sums.clear();
    }

    pub(super) fn begin_part(&mut self) {
        self.contacts.clear();
    }

    /// Numbers a contact at a point. `is_first` says whether the entity is its first side.
    pub(super) fn number(&mut self, entity: Entity, point: DVec3, is_first: bool) -> u32 {
        self.contacts.push(Pushed { entity, point, sign: if is_first { 1.0 } else { -1.0 } });
        self.contacts.len() as u32 - 1
    }

    /// Adds the impulse that a contact gave to its first side.
    pub(super) fn add(&mut self, number: u32, impulse: DVec3) {
        let Pushed { entity, point, sign } = self.contacts[number as usize];
        self.add_at(entity, point, impulse * sign);
    }

    /// Adds an impulse on an entity at a point.
    pub(super) fn add_at(&mut self, entity: Entity, point: DVec3, impulse: DVec3) {
        let [sum, moment] = self.sums.entry(entity).or_default();
        *sum += impulse;
        *moment += point.cross(impulse);
    }

    /// Writes the reactions of a tick. What nothing has pushed gets none.
    pub(super) fn write(&self, active: &ActiveSurfaces, reactions: &mut Query<&mut SurfaceReaction>) {
        let surfaces = active.surfaces.iter().map(|surface| (surface.entity, surface.pose));
        let shapes = active.shapes.iter().map(|shape| (shape.entity, shape.pose));
        let origin = |pose: Pose| pose.transform_point(DVec3::ZERO);
        for (entity, pose) in surfaces.chain(shapes) {
            let Ok(mut reaction) = reactions.get_mut(entity) else { continue };
            let [impulse, moment] = self.sums.get(&entity).copied().unwrap_or_default();
            let moment = moment - origin(pose).cross(impulse);
            reaction.set_if_neq(SurfaceReaction { impulse: impulse.as_vec3(), angular_impulse: moment.as_vec3() });
        }
    }
}
