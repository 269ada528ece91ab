//! Deformable surfaces meet avian's colliders, and push their bodies back.
//!
//! Copy this file into a game, and add the plugin beside avian's and bevy_circumsphere's, all in the same schedule:
//!
//! ```
//! # use avian3d::prelude::*;
//! # use bevy::prelude::*;
//! # use bevy_circumsphere::{prelude::*, response::XpbdResponsePlugin};
//! # use circumsphere_interop::avian::AvianSurfacesPlugin;
//! # let mut app = App::new();
//! # app.add_plugins((MinimalPlugins, TransformPlugin));
//! app.add_plugins((PhysicsPlugins::default(), AvianSurfacesPlugin::default()));
//! app.add_plugins((DeformableCollisionPlugins::default(), XpbdResponsePlugin::default()));
//! # app.update();
//! ```

use std::sync::Arc;

use avian3d::prelude::*;
use bevy::{
    ecs::{intern::Interned, schedule::ScheduleLabel},
    prelude::*,
};
use bevy_circumsphere::{prelude::*, response::SurfaceReaction};

/// Gives each of avian's colliders a [`RigidShape`], and hands what surfaces do to it to its body.
///
/// - A collider that is a sensor or disabled, or whose body is disabled, has no shape. To hide one from surfaces only,
///   insert [`SurfaceDisabled`].
/// - Surfaces see the collider's layers: `CollisionLayers` is copied to [`SurfaceLayers`].
/// - Friction is that of [`SurfaceFriction`](bevy_circumsphere::response::SurfaceFriction) on the collider.
/// - An entity that has a [`RigidShape`] of the game's own keeps it.
pub struct AvianSurfacesPlugin {
    schedule: Interned<dyn ScheduleLabel>,
}

impl AvianSurfacesPlugin {
    /// Couples them in `schedule`, which must be that of avian and of the deformable surfaces.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for AvianSurfacesPlugin {
    /// In [`FixedPostUpdate`], the default of both.
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

impl Plugin for AvianSurfacesPlugin {
    fn build(&self, app: &mut App) {
        // First avian moves its bodies, then surfaces are pushed out of their way, and what pushed them is slowed down
        // before it moves again. The other way round, surfaces would be a tick behind the bodies, and drawn inside them.
        app.configure_sets(
            self.schedule,
            (
                AvianSurfacesSystems::Follow.after(PhysicsSystems::Last).before(DeformableSystems::Prepare),
                AvianSurfacesSystems::Push.after(DeformableSystems::Respond).before(DeformableSystems::Writeback),
            ),
        );
        app.add_systems(
            self.schedule,
            (follow_colliders.in_set(AvianSurfacesSystems::Follow), push_bodies.in_set(AvianSurfacesSystems::Push)),
        );
    }
}

/// The sets of the plugin.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AvianSurfacesSystems {
    /// Shapes follow their colliders, after the engine has moved them, and before surfaces are gathered.
    Follow,
    /// Reactions are applied to bodies, after surfaces have been moved.
    Push,
}

/// Marks shapes that follow a collider.
#[derive(Component)]
struct FollowsCollider;

fn follow_colliders(
    mut commands: Commands,
    colliders: Query<(
        Entity,
        Ref<Collider>,
        Ref<CollisionLayers>,
        Option<&ColliderOf>,
        Option<&RigidShape>,
        Has<FollowsCollider>,
        Has<SurfaceReaction>,
        Has<Sensor>,
        Has<ColliderDisabled>,
    )>,
    bodies: Query<(&RigidBody, Has<RigidBodyDisabled>)>,
    orphans: Query<Entity, (With<FollowsCollider>, Without<Collider>)>,
) {
    for (entity, collider, layers, of, shape, follows, reacts, is_sensor, is_disabled) in &colliders {
        let body = of.and_then(|of| bodies.get(of.body).ok());
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
        let scaled = collider.shape_scaled();
        if shape.is_none_or(|shape| !Arc::ptr_eq(&shape.0.0, &scaled.0)) {
            let shape = RigidShape(scaled.clone());
            commands.entity(entity).insert((shape, SurfaceFrame::Unscaled, FollowsCollider));
        }
        if !follows || layers.is_changed() {
            let (memberships, filters) = (layers.memberships.0, layers.filters.0);
            commands.entity(entity).insert(SurfaceLayers { memberships, filters });
        }
        // Only where it is of use: surfaces that touch something with a reaction do not sleep.
        match body.is_some_and(|(body, _)| body.is_dynamic()) {
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
    colliders: Query<(&SurfaceReaction, &ColliderOf, &ColliderTransform), With<FollowsCollider>>,
    mut bodies: Query<Forces, Without<RigidBodyDisabled>>,
) {
    for (reaction, of, place) in &colliders {
        if *reaction == SurfaceReaction::default() {
            continue;
        }
        let Ok(mut body) = bodies.get_mut(of.body) else { continue };
        // Where the collider's entity is in the world. Its moment is about that.
        let origin = body.position() + body.rotation() * place.translation;
        body.apply_linear_impulse_at_point(reaction.impulse, origin);
        body.apply_angular_impulse(reaction.angular_impulse);
    }
}
