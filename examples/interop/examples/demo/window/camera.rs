//! A camera that flies: W, A, S, D, E, and Q move it, and the right mouse button turns it.

use bevy::{
    camera_controller::free_camera::{FreeCamera, FreeCameraPlugin},
    core_pipeline::tonemapping::Tonemapping,
    prelude::*,
};

use super::look;

/// Where it begins, and what it looks at.
const PLACE: Vec3 = Vec3::new(0.7, 1.75, 6.9);
const TARGET: Vec3 = Vec3::new(0.25, 1.42, 0.0);

pub fn plugin(app: &mut App) {
    app.add_plugins(FreeCameraPlugin).add_systems(Startup, spawn);
}

fn spawn(mut commands: Commands) {
    commands.spawn((
        Camera3d::default(),
        Projection::Perspective(PerspectiveProjection { fov: 0.66, ..default() }),
        Transform::from_translation(PLACE).looking_at(TARGET, Vec3::Y),
        FreeCamera { walk_speed: 2.5, run_speed: 8.0, ..default() },
        Msaa::Sample4,
        Tonemapping::TonyMcMapface,
        look::haze(),
    ));
}
