//! Light, sky, and materials.

use std::f32::consts::PI;

use bevy::{
    light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap, GlobalAmbientLight},
    prelude::*,
};

use crate::game::Look;

/// The sky near the horizon.
const SKY: Color = Color::srgb(0.66, 0.76, 0.86);

/// The colors of the balls, one after the other.
const BALLS: [Color; 4] = [
    Color::srgb(0.93, 0.55, 0.12),
    Color::srgb(0.9, 0.86, 0.78),
    Color::srgb(0.15, 0.55, 0.5),
    Color::srgb(0.7, 0.16, 0.2),
];

pub fn plugin(app: &mut App) {
    app.insert_resource(ClearColor(SKY))
        .insert_resource(GlobalAmbientLight { color: Color::srgb(0.75, 0.85, 1.0), brightness: 420.0, ..default() })
        .insert_resource(DirectionalLightShadowMap { size: 2048 })
        .add_systems(Startup, light)
        .add_observer(paint);
}

/// Hides where the meadow ends.
pub fn haze() -> DistanceFog {
    DistanceFog { color: SKY, falloff: FogFalloff::Linear { start: 12.0, end: 30.0 }, ..default() }
}

fn light(mut commands: Commands) {
    commands.spawn((
        DirectionalLight {
            color: Color::srgb(1.0, 0.95, 0.86),
            illuminance: 9_500.0,
            shadow_maps_enabled: true,
            ..default()
        },
        CascadeShadowConfigBuilder {
            num_cascades: 2,
            first_cascade_far_bound: 10.0,
            maximum_distance: 28.0,
            ..default()
        }
        .build(),
        Transform::from_rotation(Quat::from_euler(EulerRot::YXZ, 0.16 * PI, -0.27 * PI, 0.0)),
    ));
}

/// Gives what the game spawns a material.
fn paint(
    spawned: On<Add<Look>>,
    mut commands: Commands,
    looks: Query<&Look>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let Ok(look) = looks.get(spawned.entity) else { return };
    let rough = |base_color: Color, perceptual_roughness: f32| StandardMaterial {
        base_color,
        perceptual_roughness,
        reflectance: 0.3,
        ..default()
    };
    let material = match *look {
        Look::Ground => rough(Color::WHITE, 1.0),
        Look::Stone => rough(Color::WHITE, 0.9),
        Look::Pole => rough(Color::srgb(0.75, 0.72, 0.66), 0.4),
        // Light shines through.
        Look::Flag => StandardMaterial {
            double_sided: true,
            cull_mode: None,
            diffuse_transmission: 0.25,
            ..rough(Color::WHITE, 0.8)
        },
        Look::Ball(number) => rough(BALLS[number % BALLS.len()], 0.35),
    };
    commands.entity(spawned.entity).insert(MeshMaterial3d(materials.add(material)));
}
