//! Light, sky, and materials.

use std::f32::consts::PI;

use bevy::{
    asset::RenderAssetUsages,
    light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap, GlobalAmbientLight},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};

use crate::{flag, game::Look};

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
        .insert_resource(GlobalAmbientLight { color: Color::srgb(0.75, 0.85, 1.0), brightness: 260.0, ..default() })
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
    mut images: ResMut<Assets<Image>>,
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
            base_color_texture: Some(images.add(pattern())),
            diffuse_transmission: 0.25,
            ..rough(Color::WHITE, 0.8)
        },
        Look::Ball(number) => rough(BALLS[number % BALLS.len()], 0.35),
    };
    commands.entity(spawned.entity).insert(MeshMaterial3d(materials.add(material)));
}

/// The pattern of the flag: a triangle and its circumcircle, between two golden stripes.
fn pattern() -> Image {
    const PIXELS: f32 = 200.0;
    const RADIUS: f32 = 0.33;
    const LINE: f32 = 0.03;
    let [width, height] = flag::SIZE.map(|side| (side * PIXELS) as u32);
    let field = Vec3::new(14.0, 50.0, 120.0);
    let gold = Vec3::new(226.0, 150.0, 28.0);
    let white = Vec3::new(238.0, 234.0, 224.0);
    // The share of a pixel that is within a distance of a line.
    let within = |distance: f32| ((LINE - distance) * PIXELS).clamp(0.0, 1.0);
    let mut data = Vec::with_capacity((4 * width * height) as usize);
    for row in 0..height {
        for column in 0..width {
            let at = Vec2::new(column as f32 + 0.5, row as f32 + 0.5) / PIXELS - 0.5 * Vec2::from(flag::SIZE);
            // The distance to the nearest side: each is half a radius from the center.
            let sides = [0.5 * PI, 0.5 * PI + 2.0 / 3.0 * PI, 0.5 * PI + 4.0 / 3.0 * PI];
            let off =
                sides.map(|angle| Vec2::from_angle(angle).dot(at) - 0.5 * RADIUS).into_iter().fold(f32::MIN, f32::max);
            let ring = within((at.length() - RADIUS).abs());
            let triangle = within(off + LINE);
            let stripe = ((at.y.abs() - 0.36 * flag::SIZE[1]) * PIXELS).clamp(0.0, 1.0);
            let color = field.lerp(gold, stripe).lerp(gold, triangle).lerp(white, ring);
            data.extend([color.x as u8, color.y as u8, color.z as u8, u8::MAX]);
        }
    }
    let size = Extent3d { width, height, depth_or_array_layers: 1 };
    Image::new(size, TextureDimension::D2, data, TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::RENDER_WORLD)
}
