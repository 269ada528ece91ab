//! Scenes of rigid bodies and deformable surfaces, the same for both engines.

use std::time::Duration;

use bevy::{ecs::schedule::ScheduleLabel, prelude::*, time::TimeUpdateStrategy};
use bevy_circumsphere::{
    prelude::*,
    response::{RigidPush, XpbdBody, XpbdDiagnostics, XpbdMaterial, XpbdResponsePlugin, XpbdSettings},
};
use circumsphere_support::scenes::{Mesh, cloth, rounded_cuboid};

use crate::{avian::AvianSurfacesPlugin, rapier::RapierSurfacesPlugin};

/// Ticks per second.
pub const RATE: u32 = 64;

/// Half the contact distance of all surfaces, in meters.
pub const THICKNESS: f32 = 0.01;

/// Vertices per side of a cloth, and the length of its edges in meters.
const SIDE: usize = 25;
const EDGE: f32 = 0.05;

/// What the scenes need of an engine.
pub trait Engine: Send + Sync + 'static {
    /// Its name.
    const NAME: &'static str;

    /// Adds the engine to a schedule.
    fn add(app: &mut App, schedule: impl ScheduleLabel + Clone, gravity: Vec3);

    /// Adds the plugin that couples it.
    fn couple(app: &mut App, schedule: impl ScheduleLabel);

    /// A dynamic body of a mass in kilograms, with a velocity in meters per second.
    fn body(shape: SharedShape, mass: f32, velocity: Vec3) -> impl Bundle;

    /// A dynamic body whose colliders are its children.
    fn body_of_parts(velocity: Vec3) -> impl Bundle;

    /// A body that does not move.
    fn fixed(shape: SharedShape) -> impl Bundle;

    /// A body that the game moves.
    fn kinematic(shape: SharedShape) -> impl Bundle;

    /// A collider without a body of its own, of a density of 1 kilogram per cubic meter.
    fn part(shape: SharedShape) -> impl Bundle;

    /// What takes a collider out.
    fn disabled() -> impl Bundle;

    /// What makes a collider a sensor.
    fn sensor() -> impl Bundle;

    /// Removes the collider, but not the entity.
    fn remove_collider(app: &mut App, collider: Entity);

    /// Layers of a collider: what it belongs to, and what it meets.
    fn layers(memberships: u32, filters: u32) -> impl Bundle;

    /// Whether a body sleeps.
    fn is_asleep(world: &mut World, body: Entity) -> bool;

    /// Linear and angular velocity of a body.
    fn velocity(world: &World, body: Entity) -> [Vec3; 2];
}

/// The engine avian.
pub struct Avian;

impl Engine for Avian {
    const NAME: &'static str = "avian";

    fn add(app: &mut App, schedule: impl ScheduleLabel + Clone, gravity: Vec3) {
        app.add_plugins(avian3d::PhysicsPlugins::new(schedule));
        app.insert_resource(avian3d::prelude::Gravity(gravity));
    }

    fn couple(app: &mut App, schedule: impl ScheduleLabel) {
        app.add_plugins(AvianSurfacesPlugin::new(schedule));
    }

    fn body(shape: SharedShape, mass: f32, velocity: Vec3) -> impl Bundle {
        use avian3d::prelude::{Collider, LinearVelocity, Mass, RigidBody};
        (RigidBody::Dynamic, Collider::from(shape), Mass(mass), LinearVelocity(velocity))
    }

    fn body_of_parts(velocity: Vec3) -> impl Bundle {
        (avian3d::prelude::RigidBody::Dynamic, avian3d::prelude::LinearVelocity(velocity))
    }

    fn fixed(shape: SharedShape) -> impl Bundle {
        (avian3d::prelude::RigidBody::Static, avian3d::prelude::Collider::from(shape))
    }

    fn kinematic(shape: SharedShape) -> impl Bundle {
        (avian3d::prelude::RigidBody::Kinematic, avian3d::prelude::Collider::from(shape))
    }

    fn disabled() -> impl Bundle {
        avian3d::prelude::ColliderDisabled
    }

    fn sensor() -> impl Bundle {
        avian3d::prelude::Sensor
    }

    fn remove_collider(app: &mut App, collider: Entity) {
        app.world_mut().entity_mut(collider).remove::<avian3d::prelude::Collider>();
    }

    fn layers(memberships: u32, filters: u32) -> impl Bundle {
        avian3d::prelude::CollisionLayers::from_bits(memberships, filters)
    }

    fn is_asleep(world: &mut World, body: Entity) -> bool {
        world.entity(body).contains::<avian3d::prelude::Sleeping>()
    }

    fn part(shape: SharedShape) -> impl Bundle {
        avian3d::prelude::Collider::from(shape)
    }

    fn velocity(world: &World, body: Entity) -> [Vec3; 2] {
        use avian3d::prelude::{AngularVelocity, LinearVelocity};
        let linear = world.get::<LinearVelocity>(body).map_or(Vec3::ZERO, |velocity| velocity.0);
        [linear, world.get::<AngularVelocity>(body).map_or(Vec3::ZERO, |velocity| velocity.0)]
    }
}

/// The engine rapier.
pub struct Rapier;

impl Engine for Rapier {
    const NAME: &'static str = "rapier";

    fn add(app: &mut App, schedule: impl ScheduleLabel + Clone, gravity: Vec3) {
        use bevy_rapier3d::prelude::*;
        let RapierContextInitialization::InitializeDefaultRapierContext {
            integration_parameters,
            rapier_configuration,
            broad_phase_optimization_strategy,
        } = RapierContextInitialization::default()
        else {
            unreachable!("the default has a context")
        };
        let settings = RapierContextInitialization::InitializeDefaultRapierContext {
            integration_parameters,
            rapier_configuration: RapierConfiguration { gravity, ..rapier_configuration },
            broad_phase_optimization_strategy,
        };
        app.insert_resource(TimestepMode::Fixed { dt: 1.0 / RATE as f32, substeps: 1 });
        app.add_plugins(
            RapierPhysicsPlugin::<NoUserData>::default().with_custom_initialization(settings).in_schedule(schedule),
        );
    }

    fn couple(app: &mut App, schedule: impl ScheduleLabel) {
        app.add_plugins(RapierSurfacesPlugin::new(schedule));
    }

    fn body(shape: SharedShape, mass: f32, velocity: Vec3) -> impl Bundle {
        use bevy_rapier3d::prelude::{Collider, ColliderMassProperties, RigidBody, Velocity};
        let mass = ColliderMassProperties::Mass(mass);
        (RigidBody::Dynamic, Collider::from(shape), mass, Velocity::linear(velocity))
    }

    fn body_of_parts(velocity: Vec3) -> impl Bundle {
        (bevy_rapier3d::prelude::RigidBody::Dynamic, bevy_rapier3d::prelude::Velocity::linear(velocity))
    }

    fn fixed(shape: SharedShape) -> impl Bundle {
        (bevy_rapier3d::prelude::RigidBody::Fixed, bevy_rapier3d::prelude::Collider::from(shape))
    }

    fn kinematic(shape: SharedShape) -> impl Bundle {
        (bevy_rapier3d::prelude::RigidBody::KinematicPositionBased, bevy_rapier3d::prelude::Collider::from(shape))
    }

    fn disabled() -> impl Bundle {
        bevy_rapier3d::prelude::ColliderDisabled
    }

    fn sensor() -> impl Bundle {
        bevy_rapier3d::prelude::Sensor
    }

    fn remove_collider(app: &mut App, collider: Entity) {
        app.world_mut().entity_mut(collider).remove::<bevy_rapier3d::prelude::Collider>();
    }

    fn layers(memberships: u32, filters: u32) -> impl Bundle {
        use bevy_rapier3d::prelude::{CollisionGroups, Group};
        CollisionGroups::new(Group::from_bits_retain(memberships), Group::from_bits_retain(filters))
    }

    fn is_asleep(world: &mut World, body: Entity) -> bool {
        use bevy_rapier3d::{
            prelude::{RapierRigidBodyHandle, RapierRigidBodySet},
            rapier::dynamics::RigidBody,
        };
        let Some(handle) = world.get::<RapierRigidBodyHandle>(body).map(|handle| handle.0) else { return false };
        let mut sets = world.query::<&RapierRigidBodySet>();
        sets.iter(world).filter_map(|set| set.bodies.get(handle)).any(RigidBody::is_sleeping)
    }

    fn part(shape: SharedShape) -> impl Bundle {
        bevy_rapier3d::prelude::Collider::from(shape)
    }

    fn velocity(world: &World, body: Entity) -> [Vec3; 2] {
        let velocity = world.get::<bevy_rapier3d::prelude::Velocity>(body);
        velocity.map_or([Vec3::ZERO; 2], |velocity| [velocity.linear, velocity.angular])
    }
}

/// An app with an engine and deformable surfaces in one schedule, which takes one step per update.
pub fn app_in<E: Engine>(schedule: impl ScheduleLabel + Clone, gravity: Vec3) -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin));
    E::add(&mut app, schedule.clone(), gravity);
    E::couple(&mut app, schedule.clone());
    app.add_plugins((DeformableCollisionPlugins::new(schedule.clone()), XpbdResponsePlugin::new(schedule)));
    app.world_mut().resource_mut::<XpbdSettings>().gravity = gravity;
    start(&mut app);
    app
}

/// Lets the clock of an app that has all of its plugins take one fixed step per update.
pub fn start(app: &mut App) {
    app.insert_resource(Time::<Fixed>::from_hz(f64::from(RATE)));
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs(1) / RATE));
    app.finish();
    app.cleanup();
}

/// A scene of one surface and one body.
pub struct Scene {
    /// The app.
    pub app: App,
    /// The surface.
    pub surface: Entity,
    /// The body.
    pub body: Entity,
}

const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);

/// Radius of the ball in [`ball_on_cloth`] and [`ball_in_space`], in meters.
pub const BALL: f32 = 0.2;

fn spawn_surface(app: &mut App, mesh: &Mesh, material: XpbdMaterial, pins: impl IntoIterator<Item = usize>) -> Entity {
    let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
    let (surface, positions) = DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("the mesh is valid");
    let body = XpbdBody::new(&surface, &positions, material).expect("the body is valid");
    let body = body.pinned(pins.into_iter().map(|vertex| VertexId(vertex as u32)));
    let thickness = SurfaceThickness::World(THICKNESS);
    app.world_mut().spawn((surface, positions, body, thickness, SelfCollision, SweptCollision)).id()
}

/// The vertices of the border of a cloth.
pub fn border() -> impl Iterator<Item = usize> {
    let is_outer = |place: usize| place == 0 || place == SIDE - 1;
    (0..SIDE * SIDE).filter(move |vertex| is_outer(vertex % SIDE) || is_outer(vertex / SIDE))
}

/// A ball of a mass in kilograms falls into a canvas that is held at its border.
#[must_use]
pub fn ball_on_cloth<E: Engine>(mass: f32) -> Scene {
    let mut app = app_in::<E>(FixedPostUpdate, GRAVITY);
    let canvas = XpbdMaterial { area_density: 1.0, drag: 10.0, ..XpbdMaterial::CLOTH };
    let surface = spawn_surface(&mut app, &cloth(SIDE, EDGE), canvas, border());
    let ball = E::body(SharedShape::ball(BALL), mass, Vec3::ZERO);
    let body = app.world_mut().spawn((ball, Transform::from_xyz(0.03, 0.6, 0.02))).id();
    Scene { app, surface, body }
}

/// A ball hits a free cloth where there is no gravity and no air.
#[must_use]
pub fn ball_in_space<E: Engine>(mass: f32) -> Scene {
    let mut app = app_in::<E>(FixedPostUpdate, Vec3::ZERO);
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
    let surface = spawn_surface(&mut app, &cloth(SIDE, EDGE), material, []);
    let ball = E::body(SharedShape::ball(BALL), mass, Vec3::new(0.0, -3.0, 0.5));
    let body = app.world_mut().spawn((ball, Transform::from_xyz(0.1, 0.6, 0.02))).id();
    Scene { app, surface, body }
}

/// Half the width of the crate in [`crate_on_mattress`], in meters.
pub const CRATE: f32 = 0.2;

/// A crate of a mass in kilograms drops onto a mattress that lies on the ground.
#[must_use]
pub fn crate_on_mattress<E: Engine>(mass: f32) -> Scene {
    let mut app = app_in::<E>(FixedPostUpdate, GRAVITY);
    app.world_mut().spawn(E::fixed(SharedShape::halfspace(Vec3::Y)));
    let mattress = rounded_cuboid([0.6, 0.15, 0.6], 0.1, 12).translate([0.0, 0.17, 0.0]);
    let surface = spawn_surface(&mut app, &mattress, XpbdMaterial::SOFT, []);
    let shape = SharedShape::cuboid(CRATE, CRATE, CRATE);
    let body = app.world_mut().spawn((E::body(shape, mass, Vec3::ZERO), Transform::from_xyz(0.0, 0.7, 0.0))).id();
    Scene { app, surface, body }
}

/// Plays the three scenes, and prints where the bodies are.
pub fn play<E: Engine>() {
    let scenes = [
        ("a ball of 0.5 kg falls into a canvas", ball_on_cloth::<E>(0.5)),
        ("a crate of 5 kg drops onto a mattress", crate_on_mattress::<E>(5.0)),
        ("a ball of 0.3 kg hits a free cloth in space", ball_in_space::<E>(0.3)),
    ];
    for (title, mut scene) in scenes {
        println!("{}: {title}", E::NAME);
        println!(
            "{:>8} {:>10} {:>12} {:>20} {:>12}",
            "seconds", "height m", "speed m/s", "push of a tick m/s", "contacts"
        );
        for tick in 1..=10 * RATE {
            scene.app.update();
            if tick % RATE != 0 {
                continue;
            }
            let world = scene.app.world();
            let height = world.get::<Transform>(scene.body).map_or(f32::NAN, |transform| transform.translation.y);
            let push = world.get::<RigidPush>(scene.body).map_or(Vec3::ZERO, |push| push.velocity);
            println!(
                "{:>8} {height:>10.3} {:>12.3} {:>20.4} {:>12}",
                tick / RATE,
                E::velocity(world, scene.body)[0].length(),
                push.length(),
                world.resource::<XpbdDiagnostics>().contacts
            );
        }
    }
}
