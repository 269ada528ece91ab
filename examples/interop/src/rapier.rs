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
use bevy_circumsphere::{
    prelude::*,
    response::{RigidMass, RigidPart, RigidPush},
};
use bevy_rapier3d::prelude::*;

/// Gives each of rapier's colliders a [`RigidShape`], and lets surfaces push dynamic bodies.
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
        // First rapier moves its bodies, then surfaces and bodies push each other. The other way round, surfaces would be a
        // tick behind the bodies, and drawn inside them.
        app.configure_sets(
            self.schedule,
            (
                RapierSurfacesSystems::Follow.after(PhysicsSet::Writeback).before(DeformableSystems::Prepare),
                RapierSurfacesSystems::Push.after(DeformableSystems::Respond).before(DeformableSystems::Writeback),
            ),
        );
        app.add_systems(
            self.schedule,
            (
                (follow_colliders, weigh_bodies).in_set(RapierSurfacesSystems::Follow),
                push_bodies.in_set(RapierSurfacesSystems::Push),
            ),
        );
    }
}

/// The sets of the plugin.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RapierSurfacesSystems {
    /// Shapes follow their colliders, after the engine has moved them, and before surfaces are gathered.
    Follow,
    /// Bodies are moved by what surfaces did to them, after the surfaces have been moved.
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
        Option<&RigidPart>,
        Has<Sensor>,
        Has<ColliderDisabled>,
    )>,
    parents: Query<&ChildOf>,
    bodies: Query<Has<RigidBodyDisabled>, With<RigidBody>>,
    orphans: Query<Entity, (With<FollowsCollider>, Without<Collider>)>,
) {
    for (entity, collider, groups, shape, follows, part, is_sensor, is_disabled) in &colliders {
        let body = body_of(entity, &parents, |entity| bodies.contains(entity));
        if is_sensor || is_disabled || body.is_some_and(|body| bodies.get(body).is_ok_and(|is_disabled| is_disabled)) {
            if follows {
                commands.entity(entity).remove::<(FollowsCollider, RigidShape, RigidPart)>();
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
        if let Some(body) = body
            && part != Some(&RigidPart(body))
        {
            commands.entity(entity).insert(RigidPart(body));
        }
    }
    for entity in &orphans {
        commands.entity(entity).remove::<(FollowsCollider, RigidShape, RigidPart)>();
    }
}

/// Only dynamic bodies have masses: surfaces that touch one do not sleep.
fn weigh_bodies(
    mut commands: Commands,
    mut bodies: Query<(Entity, &RapierRigidBodyHandle, &RapierContextEntityLink, Option<&mut RigidMass>)>,
    contexts: Query<&RapierRigidBodySet>,
) {
    for (entity, handle, context, known) in &mut bodies {
        let body = contexts.get(context.0).ok().and_then(|set| set.bodies.get(handle.0));
        let Some(body) = body.filter(|body| body.is_dynamic()) else {
            if known.is_some() {
                commands.entity(entity).remove::<(RigidMass, RigidPush)>();
            }
            continue;
        };
        let properties = body.mass_properties();
        let inertia = properties.effective_world_inv_inertia;
        let mass = RigidMass {
            inverse_mass: properties.effective_inv_mass,
            inverse_inertia: Mat3::from_cols(
                Vec3::new(inertia.m11, inertia.m12, inertia.m13),
                Vec3::new(inertia.m12, inertia.m22, inertia.m23),
                Vec3::new(inertia.m13, inertia.m23, inertia.m33),
            ),
            center_of_mass: properties.world_com,
        };
        if let Some(mut known) = known {
            known.set_if_neq(mass);
        } else {
            commands.entity(entity).insert(mass);
        }
    }
}

fn push_bodies(
    mut bodies: Query<(
        &RigidPush,
        &RapierRigidBodyHandle,
        &RapierContextEntityLink,
        &mut Transform,
        Option<&mut Velocity>,
        Option<&ChildOf>,
    )>,
    mut contexts: Query<&mut RapierRigidBodySet>,
    parents: Query<&GlobalTransform>,
) {
    for (push, handle, context, mut transform, velocity, child) in &mut bodies {
        if *push == RigidPush::default() {
            continue;
        }
        let Ok(mut set) = contexts.get_mut(context.0) else { continue };
        let Some(body) = set.bodies.get_mut(handle.0) else { continue };
        let center = body.center_of_mass();
        let mut pose = *body.position();
        pose.translation = center + push.translation + push.rotation * (pose.translation - center);
        pose.rotation = (push.rotation * pose.rotation).normalize();
        body.set_position(pose, true);
        body.set_linvel(body.linvel() + push.velocity, true);
        body.set_angvel(body.angvel() + push.angular_velocity, true);
        // Before the next step, rapier reads the components again.
        if let Some(mut velocity) = velocity {
            (velocity.linear, velocity.angular) = (body.linvel(), body.angvel());
        }
        let shown = Transform { translation: pose.translation, rotation: pose.rotation, scale: transform.scale };
        let parent = child.and_then(|child| parents.get(child.parent()).ok());
        let shown = parent.map_or(shown, |parent| GlobalTransform::from(shown).reparented_to(parent));
        (transform.translation, transform.rotation) = (shown.translation, shown.rotation);
    }
}
