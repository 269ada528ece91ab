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
use bevy_circumsphere::{
    prelude::*,
    response::{RigidMass, RigidPart, RigidPush},
};

/// Gives each of avian's colliders a [`RigidShape`], and lets surfaces push dynamic bodies.
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
        // First avian moves its bodies, then surfaces and bodies push each other. The other way round, surfaces would be a
        // tick behind the bodies, and drawn inside them.
        app.configure_sets(
            self.schedule,
            (
                AvianSurfacesSystems::Follow.after(PhysicsSystems::Last).before(DeformableSystems::Prepare),
                AvianSurfacesSystems::Push.after(DeformableSystems::Respond).before(DeformableSystems::Writeback),
            ),
        );
        app.add_systems(
            self.schedule,
            (
                (follow_colliders, weigh_bodies).in_set(AvianSurfacesSystems::Follow),
                push_bodies.in_set(AvianSurfacesSystems::Push),
            ),
        );
    }
}

/// The sets of the plugin.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AvianSurfacesSystems {
    /// Shapes follow their colliders, after the engine has moved them, and before surfaces are gathered.
    Follow,
    /// Bodies are moved by what surfaces did to them, after the surfaces have been moved.
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
        Option<&RigidPart>,
        Has<Sensor>,
        Has<ColliderDisabled>,
    )>,
    bodies: Query<(&RigidBody, Has<RigidBodyDisabled>)>,
    orphans: Query<Entity, (With<FollowsCollider>, Without<Collider>)>,
) {
    for (entity, collider, layers, of, shape, follows, part, is_sensor, is_disabled) in &colliders {
        let body = of.and_then(|of| bodies.get(of.body).ok());
        if is_sensor || is_disabled || body.is_some_and(|(_, is_disabled)| is_disabled) {
            if follows {
                commands.entity(entity).remove::<(FollowsCollider, RigidShape, RigidPart)>();
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
        if let Some(of) = of
            && part != Some(&RigidPart(of.body))
        {
            commands.entity(entity).insert(RigidPart(of.body));
        }
    }
    for entity in &orphans {
        commands.entity(entity).remove::<(FollowsCollider, RigidShape, RigidPart)>();
    }
}

/// Only dynamic bodies have masses: surfaces that touch one do not sleep.
fn weigh_bodies(
    mut commands: Commands,
    mut bodies: Query<(
        Entity,
        &RigidBody,
        &Position,
        &Rotation,
        &ComputedMass,
        &ComputedAngularInertia,
        &ComputedCenterOfMass,
        Option<&LockedAxes>,
        Option<&mut RigidMass>,
    )>,
) {
    for (entity, body, position, rotation, mass, inertia, center, locked, known) in &mut bodies {
        if !body.is_dynamic() {
            if known.is_some() {
                commands.entity(entity).remove::<(RigidMass, RigidPush)>();
            }
            continue;
        }
        let locked = locked.copied().unwrap_or_default();
        let free = |is_locked: bool| if is_locked { 0.0 } else { 1.0 };
        let moves =
            [locked.is_translation_x_locked(), locked.is_translation_y_locked(), locked.is_translation_z_locked()];
        let turns = [locked.is_rotation_x_locked(), locked.is_rotation_y_locked(), locked.is_rotation_z_locked()];
        let [moves, turns] = [moves, turns].map(|axes| Vec3::from(axes.map(free)));
        let turns = Mat3::from_diagonal(turns);
        let mass = RigidMass {
            inverse_mass: moves * mass.inverse(),
            inverse_inertia: turns * Mat3::from(inertia.rotated(rotation.0).inverse()) * turns,
            center_of_mass: position.0 + rotation.0 * center.0,
        };
        if let Some(mut known) = known {
            known.set_if_neq(mass);
        } else {
            commands.entity(entity).insert(mass);
        }
    }
}

fn push_bodies(
    mut commands: Commands,
    mut bodies: Query<(
        Entity,
        &RigidPush,
        &ComputedCenterOfMass,
        &mut Position,
        &mut Rotation,
        &mut LinearVelocity,
        &mut AngularVelocity,
        &mut Transform,
        Option<&ChildOf>,
        Has<Sleeping>,
    )>,
    parents: Query<&GlobalTransform>,
) {
    for (entity, push, center, mut position, mut rotation, mut linear, mut angular, mut transform, child, is_asleep) in
        &mut bodies
    {
        if *push == RigidPush::default() {
            continue;
        }
        let place = position.0 + rotation.0 * center.0 + push.translation;
        rotation.0 = (push.rotation * rotation.0).normalize();
        position.0 = place - rotation.0 * center.0;
        linear.0 += push.velocity;
        angular.0 += push.angular_velocity;
        let shown = Transform { translation: position.0, rotation: rotation.0, scale: transform.scale };
        let parent = child.and_then(|child| parents.get(child.parent()).ok());
        let shown = parent.map_or(shown, |parent| GlobalTransform::from(shown).reparented_to(parent));
        (transform.translation, transform.rotation) = (shown.translation, shown.rotation);
        if is_asleep {
            commands.queue(WakeBody(entity));
        }
    }
}
