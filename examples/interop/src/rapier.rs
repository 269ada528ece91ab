//! Deformable surfaces meet rapier's colliders, and push their bodies back.
//!
//! Copy this file into a game, and add the plugin beside rapier's and bevy_circumsphere's, all in the same schedule:
//!
//! ```
//! # use bevy::prelude::*;
//! # use bevy_circumsphere::{prelude::*, response::XpbdResponsePlugin};
//! # use bevy_rapier3d::prelude::*;
//! # use circumsphere_interop::rapier::RapierSurfacesPlugin;
//! # let mut app = App::new();
//! # app.add_plugins((MinimalPlugins, TransformPlugin));
//! // Rapier reads no clock in a fixed schedule: `dt` is the duration of the app's fixed step.
//! app.insert_resource(TimestepMode::Fixed { dt: 1.0 / 64.0, substeps: 1 });
//! app.add_plugins(RapierPhysicsPlugin::<NoUserData>::default().in_schedule(FixedPostUpdate));
//! app.add_plugins(RapierSurfacesPlugin::default());
//! app.add_plugins((DeformableCollisionPlugins::default(), XpbdResponsePlugin::default()));
//! # app.update();
//! ```

use std::sync::Arc;

use bevy::{
    ecs::{intern::Interned, schedule::ScheduleLabel},
    prelude::*,
};
use bevy_circumsphere::{prelude::*, response::SurfaceReaction};
use bevy_rapier3d::prelude::*;

/// Gives each of rapier's colliders a [`RigidShape`], and hands what surfaces do to it to its body.
///
/// - A collider that is a sensor or disabled, or whose body is disabled, has no shape. To hide one from surfaces only,
///   insert [`SurfaceDisabled`].
/// - Surfaces see the collider's groups: `CollisionGroups` is copied to [`SurfaceLayers`].
/// - Friction is that of [`SurfaceFriction`](bevy_circumsphere::response::SurfaceFriction) on the collider.
/// - An entity that has a [`RigidShape`] of the game's own keeps it.
pub struct RapierSurfacesPlugin {
    schedule: Interned<dyn ScheduleLabel>,
}

impl RapierSurfacesPlugin {
    /// Couples them in `schedule`, which must be that of rapier and of the deformable surfaces.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for RapierSurfacesPlugin {
    /// In [`FixedPostUpdate`], the default of deformable surfaces. Rapier's own default is [`PostUpdate`].
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

impl Plugin for RapierSurfacesPlugin {
    fn build(&self, app: &mut App) {
        // First rapier moves its bodies, then surfaces are pushed out of their way, and what pushed them is slowed down
        // before it moves again. The other way round, surfaces would be a tick behind the bodies, and drawn inside them.
        app.configure_sets(
            self.schedule,
            (
                RapierSurfacesSystems::Follow.after(PhysicsSet::Writeback).before(DeformableSystems::Prepare),
                RapierSurfacesSystems::Push.after(DeformableSystems::Respond).before(DeformableSystems::Writeback),
            ),
        );
        app.add_systems(
            self.schedule,
            (follow_colliders.in_set(RapierSurfacesSystems::Follow), push_bodies.in_set(RapierSurfacesSystems::Push)),
        );
    }
}

/// The sets of the plugin.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RapierSurfacesSystems {
    /// Shapes follow their colliders, after the engine has moved them, and before surfaces are gathered.
    Follow,
    /// Reactions are applied to bodies, after surfaces have been moved.
    Push,
}

/// Marks shapes that follow a collider.
#[derive(Component)]
struct FollowsCollider;

/// Finds the body that a collider belongs to: itself, or the nearest ancestor that is one.
fn body_of(collider: Entity, parents: &Query<&ChildOf>, is_body: impl Fn(Entity) -> bool) -> Option<Entity> {
    std::iter::once(collider).chain(parents.iter_ancestors(collider)).find(|&entity| is_body(entity))
}

fn follow_colliders(
    mut commands: Commands,
    colliders: Query<(
        Entity,
        &Collider,
        Option<Ref<CollisionGroups>>,
        Option<&RigidShape>,
        Has<FollowsCollider>,
        Has<SurfaceReaction>,
        Has<Sensor>,
        Has<ColliderDisabled>,
    )>,
    parents: Query<&ChildOf>,
    bodies: Query<(&RigidBody, Has<RigidBodyDisabled>)>,
    orphans: Query<Entity, (With<FollowsCollider>, Without<Collider>)>,
) {
    for (entity, collider, groups, shape, follows, reacts, is_sensor, is_disabled) in &colliders {
        let body = body_of(entity, &parents, |entity| bodies.contains(entity));
        let body = body.and_then(|body| bodies.get(body).ok());
        if is_sensor || is_disabled || body.is_some_and(|(_, is_disabled)| is_disabled) {
            if follows {
                commands.entity(entity).remove::<(FollowsCollider, RigidShape, SurfaceReaction)>();
            }
            continue;
        }
        if shape.is_some() && !follows {
            continue;
        }
        // The scaled shape: the scale may be another for each axis.
        if shape.is_none_or(|shape| !Arc::ptr_eq(&shape.0.0, &collider.raw.0)) {
            let shape = RigidShape(collider.raw.clone());
            commands.entity(entity).insert((shape, SurfaceFrame::Unscaled, FollowsCollider));
        }
        if let Some(groups) = groups.filter(|groups| !follows || groups.is_changed()) {
            let (memberships, filters) = (groups.memberships.bits(), groups.filters.bits());
            commands.entity(entity).insert(SurfaceLayers { memberships, filters });
        }
        // Only where it is of use: surfaces that touch something with a reaction do not sleep.
        match body.is_some_and(|(body, _)| *body == RigidBody::Dynamic) {
            true if !reacts => commands.entity(entity).insert(SurfaceReaction::default()),
            false if reacts => commands.entity(entity).remove::<SurfaceReaction>(),
            _ => continue,
        };
    }
    for entity in &orphans {
        commands.entity(entity).remove::<(FollowsCollider, RigidShape, SurfaceReaction)>();
    }
}

fn push_bodies(
    colliders: Query<(Entity, &SurfaceReaction), With<FollowsCollider>>,
    mut bodies: Query<(&RapierRigidBodyHandle, &RapierContextEntityLink, Option<&mut Velocity>)>,
    mut contexts: Query<&mut RapierRigidBodySet>,
    parents: Query<&ChildOf>,
    transforms: TransformHelper,
) {
    for (entity, reaction) in &colliders {
        if *reaction == SurfaceReaction::default() {
            continue;
        }
        let Some(body) = body_of(entity, &parents, |entity| bodies.contains(entity)) else { continue };
        let Ok((handle, context, velocity)) = bodies.get_mut(body) else { continue };
        let Ok(mut set) = contexts.get_mut(context.0) else { continue };
        let Some(body) = set.bodies.get_mut(handle.0) else { continue };
        // Where the collider's entity is in the world. Its moment is about that.
        let Ok(origin) = transforms.compute_global_transform(entity) else { continue };
        body.apply_impulse_at_point(reaction.impulse, origin.translation(), true);
        body.apply_torque_impulse(reaction.angular_impulse, true);
        // Before the next step, rapier reads the component again.
        if let Some(mut velocity) = velocity {
            (velocity.linear, velocity.angular) = (body.linvel(), body.angvel());
        }
    }
}
