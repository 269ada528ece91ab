//! Rigid shapes as the other side of a contact.

use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use parry3d::shape::SharedShape;

use super::components::{Registration, SurfaceLayers, SurfaceStatus};

/// A rigid shape that surfaces touch, placed by the entity's transform (rotation, translation, uniform scale).
///
/// Ball, capsule, cuboid, convex polyhedron and half-space are tested exactly, and are solid: a vertex inside has
/// negative distance. Any other shape is asked through parry, which gives one contact a triangle. Shapes never touch each other: that is a rigid-body engine's work.
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # let mut world = bevy_ecs::world::World::new();
/// world.spawn(RigidShape(SharedShape::ball(0.5)));
/// ```
#[derive(Component, Clone)]
#[component(immutable)]
#[require(SurfaceLayers, SurfaceStatus, Registration, Transform)]
pub struct RigidShape(pub SharedShape);
