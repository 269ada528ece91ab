//! The flag: a cloth that hangs from a pole in the wind.

use avian3d::prelude::*;
use bevy::{
    asset::RenderAssetUsages,
    math::ops::{cos, sin},
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
};
use bevy_circumsphere::{
    prelude::*,
    response::{SurfaceWind, XpbdBody, XpbdMaterial},
};
use circumsphere_support::scenes::{Diagonals, grid};

use crate::game::Look;

/// Width and height of the flag, in meters, and its cells along both.
pub const SIZE: [f32; 2] = [1.95, 1.25];
const CELLS: [usize; 2] = [39, 25];

/// Where the pole stands, its height, and its radius, in meters.
const POLE: Vec3 = Vec3::new(-1.3, 0.0, -0.5);
const POLE_HEIGHT: f32 = 3.45;
const POLE_RADIUS: f32 = 0.035;

/// Distance of the flag from the axis of the pole, in meters.
const GAP: f32 = 0.06;

/// The center of the flag while the wind blows along x, in meters.
pub const CENTER: Vec3 = Vec3::new(POLE.x + GAP + 0.5 * SIZE[0], POLE_HEIGHT - 0.08 - 0.5 * SIZE[1], POLE.z);

/// Marks the flag.
#[derive(Component)]
pub struct Flag;

/// The wind, in meters per second, with gusts, and never from one direction for long.
pub fn wind(time: f32) -> Vec3 {
    let gust = 1.0 + 0.25 * sin(1.3 * time) + 0.15 * sin(3.1 * time + 1.0);
    let turn = 0.35 * sin(0.7 * time) + 0.12 * sin(2.3 * time);
    Vec3::new(cos(turn), 0.04, sin(turn)) * (4.2 * gust)
}

pub fn plugin(app: &mut App) {
    app.add_systems(Startup, spawn).add_systems(Update, blow);
    // As soon as the mesh is a surface.
    app.add_observer(hang);
}

fn spawn(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>) {
    let cloth = grid(CELLS[0], CELLS[1], SIZE[0], SIZE[1], Diagonals::Alternating);
    // It lies in the plane y = 0, with its second side along z: lifted upright, with that side down.
    let positions: Vec<Vec3> = cloth.positions.iter().map(|&[x, _, z]| CENTER + Vec3::new(x, -z, 0.0)).collect();
    let places = cloth.positions.iter().map(|&[x, _, z]| [x / SIZE[0] + 0.5, z / SIZE[1] + 0.5]);
    let mesh = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![Vec3::Z; positions.len()])
        .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, places.collect::<Vec<_>>())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_indices(Indices::U32(cloth.triangles.as_flattened().to_vec()));
    commands.spawn((
        Flag,
        Look::Flag,
        Mesh3d(meshes.add(mesh)),
        Transform::default(),
        WriteSurfaceToMesh::default(),
        SurfaceThickness::World(0.008),
        SelfCollision,
        SweptCollision,
        ContactEventsEnabled,
        SurfaceWind::default(),
    ));
    commands.spawn((
        Look::Pole,
        Mesh3d(meshes.add(Cylinder::new(POLE_RADIUS, POLE_HEIGHT))),
        Transform::from_translation(POLE + Vec3::Y * (0.5 * POLE_HEIGHT)),
        RigidBody::Static,
        Collider::capsule(POLE_RADIUS, POLE_HEIGHT),
    ));
}

/// Makes the flag a body, and pins its side at the pole.
fn hang(
    made: On<Add<DeformableSurface>>,
    mut commands: Commands,
    flags: Query<(&DeformableSurface, &SurfacePositions), With<Flag>>,
) -> Result {
    let Ok((surface, positions)) = flags.get(made.entity) else { return Ok(()) };
    // Without drag relative to the ground: the wind carries it along.
    let material = XpbdMaterial { area_density: 0.25, drag: 0.0, ..XpbdMaterial::CLOTH };
    let pinned = (0..=CELLS[1]).map(|row| VertexId((row * (CELLS[0] + 1)) as u32));
    commands.entity(made.entity).insert(XpbdBody::new(surface, positions, material)?.pinned(pinned));
    Ok(())
}

fn blow(mut flags: Query<&mut SurfaceWind, With<Flag>>, time: Res<Time>) {
    for mut flag in &mut flags {
        flag.velocity = wind(time.elapsed_secs());
    }
}
