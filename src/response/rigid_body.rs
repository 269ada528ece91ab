//! Rigid bodies that surfaces push while the solver steps.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::{Mat3, Quat, Vec3};

/// The mass of a rigid body, so that surfaces push it while the solver steps. Insert it on the entity of a
/// [`RigidShape`](crate::RigidShape), or on an entity that the shapes name with [`RigidPart`], and apply the
/// [`RigidPush`] of every tick. Without a mass, a shape moves as the game says, whatever is in its way.
///
/// A physics engine moves its bodies first. Then write their masses, before
/// [`DeformableSystems::Prepare`](crate::DeformableSystems::Prepare). A mass that is negative or not finite counts as none.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[require(RigidPush)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, PartialEq))]
pub struct RigidMass {
    /// One over the mass, in 1/kg, along each axis of the world. 0 along those that are locked.
    pub inverse_mass: Vec3,
    /// Inverse of the inertia tensor about the center of mass, in 1/(kg m²), in the axes of the world. The rows and columns
    /// of axes that are locked are 0.
    pub inverse_inertia: Mat3,
    /// The center of mass in the world, where the body is now.
    pub center_of_mass: Vec3,
}

impl RigidMass {
    /// Whether the solver can move something with it.
    pub(super) fn is_usable(&self) -> bool {
        let Self { inverse_mass, inverse_inertia, center_of_mass } = self;
        inverse_mass.is_finite()
            && inverse_mass.min_element() >= 0.0
            && inverse_inertia.is_finite()
            && center_of_mass.is_finite()
    }
}

/// A [`RigidShape`](crate::RigidShape) that is part of the rigid body of another entity, which has a [`RigidMass`].
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, PartialEq))]
pub struct RigidPart(#[entities] pub Entity);

/// What surfaces did to a rigid body with a [`RigidMass`] in the last tick, in the world. Written in every tick. Move the body
/// by it once, in the schedule of the response and before the body moves on: surfaces lie where the body is then.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
pub struct RigidPush {
    /// To add to the velocity of the center of mass, in meters per second.
    pub velocity: Vec3,
    /// To add to the angular velocity, in radians per second.
    pub angular_velocity: Vec3,
    /// By how much to move the center of mass, in meters.
    pub translation: Vec3,
    /// By how much to rotate the body about its center of mass, after all its own rotations.
    pub rotation: Quat,
}
