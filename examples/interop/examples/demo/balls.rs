//! Balls of avian that fly into the flag, and roll away.

use std::collections::VecDeque;

use avian3d::prelude::*;
use bevy::prelude::*;
use bevy_circumsphere::response::SurfaceFriction;

use crate::{flag, game::Look};

/// Radius in meters, and mass in kilograms: less than a third of the flag's.
pub const RADIUS: f32 = 0.11;
const MASS: f32 = 0.16;

/// Where balls come from, and how long they fly to the flag, in seconds.
const ORIGIN: Vec3 = Vec3::new(1.6, 0.9, 4.6);
const FLIGHT: f32 = 0.62;

/// Seconds from one ball to the next, and how many there are at once.
const PAUSE: f32 = 1.4;
const MOST: usize = 7;

/// Where the balls hit, from the center of the flag, one after the other, in meters.
const AIMS: [Vec3; 5] = [
    Vec3::new(0.1, 0.0, 0.0),
    Vec3::new(-0.35, 0.2, 0.0),
    Vec3::new(0.35, -0.15, 0.0),
    Vec3::new(-0.2, -0.25, 0.0),
    Vec3::new(0.25, 0.25, 0.0),
];

/// A ball.
#[derive(Component)]
pub struct Ball;

/// A wish for another ball.
#[derive(Message)]
pub struct Throw;

/// All balls, oldest first, and how many there have been.
#[derive(Resource, Default)]
struct Thrown {
    balls: VecDeque<Entity>,
    count: usize,
    next: f32,
    mesh: Handle<Mesh>,
}

pub fn plugin(app: &mut App) {
    app.init_resource::<Thrown>()
        .add_message::<Throw>()
        .add_systems(Startup, |mut thrown: ResMut<Thrown>, mut meshes: ResMut<Assets<Mesh>>| {
            thrown.mesh = meshes.add(Sphere::new(RADIUS).mesh().uv(32, 18));
            thrown.next = PAUSE;
        })
        .add_systems(Update, throw);
}

fn throw(
    mut commands: Commands,
    mut thrown: ResMut<Thrown>,
    mut wishes: MessageReader<Throw>,
    time: Res<Time>,
    gravity: Res<Gravity>,
) {
    let is_due = time.elapsed_secs() >= thrown.next;
    if is_due {
        thrown.next += PAUSE;
    }
    for _ in 0..wishes.read().count() + usize::from(is_due) {
        if thrown.balls.len() == MOST
            && let Some(oldest) = thrown.balls.pop_front()
        {
            commands.entity(oldest).despawn();
        }
        let way = flag::CENTER + AIMS[thrown.count % AIMS.len()] - ORIGIN;
        let ball = commands.spawn((
            Ball,
            Look::Ball(thrown.count),
            Mesh3d(thrown.mesh.clone()),
            Transform::from_translation(ORIGIN),
            RigidBody::Dynamic,
            Collider::sphere(RADIUS),
            Mass(MASS),
            LinearVelocity(way / FLIGHT - 0.5 * FLIGHT * gravity.0),
            AngularVelocity(Vec3::new(2.0, 1.0, 0.5)),
            AngularDamping(1.5),
            Friction::new(0.6),
            Restitution::new(0.35),
            SurfaceFriction::default(),
        ));
        thrown.balls.push_back(ball.id());
        thrown.count += 1;
    }
}
