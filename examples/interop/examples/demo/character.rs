//! The person: loaded from a file, animated by Bevy, led along the path, and dressed in a cape.

use avian3d::prelude::*;
use bevy::{gltf::GltfAssetLabel, prelude::*, world_serialization::WorldAssetRoot};
use bevy_circumsphere::{
    prelude::*,
    response::{SurfaceWind, XpbdGarment, XpbdGarments, XpbdMaterial},
};
use circumsphere_support::scenes::PERSON_SPEED;

use crate::{flag::wind, game::Ready, level};

/// The file, in the folder of assets.
const FILE: &str = "person.glb";

/// Time from standing to walking, in seconds.
const START: f32 = 1.0;

/// How much slower the wind is near the ground than at the flag.
const SHELTER: f32 = 0.35;

/// The person, and how far it has come along the path.
#[derive(Component)]
struct Walker {
    angle: f32,
    /// From 0, standing, to 1, walking.
    pace: f32,
}

/// The animations of the file, in the graph that plays them.
#[derive(Resource)]
struct Animations {
    graph: Handle<AnimationGraph>,
    stand: AnimationNodeIndex,
    walk: AnimationNodeIndex,
}

pub fn plugin(app: &mut App) {
    app.add_systems(Startup, spawn)
        .add_systems(Update, (animate, walk.run_if(|ready: Res<Ready>| ready.0), blow).chain());
}

fn spawn(mut commands: Commands, assets: Res<AssetServer>, mut graphs: ResMut<Assets<AnimationGraph>>) {
    let angle = 0.8;
    commands.spawn((
        Walker { angle, pace: 0.0 },
        place(angle),
        WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset(FILE))),
        SurfaceFromMeshHierarchy::new(surface(0.005)).with_name("Cape", surface(0.003)),
        XpbdGarments::worn_by("Body").with_name("Cape", cape()),
        // Balls bounce off a capsule. Cloth meets the skin instead.
        RigidBody::Kinematic,
        children![(Collider::capsule(0.2, 1.2), SurfaceDisabled, Transform::from_xyz(0.0, 0.85, 0.0),)],
    ));
    let clips = [0, 1].map(|clip| assets.load(GltfAssetLabel::Animation(clip).from_asset(FILE)));
    let (graph, nodes) = AnimationGraph::from_clips(clips);
    commands.insert_resource(Animations { graph: graphs.add(graph), stand: nodes[0], walk: nodes[1] });
}

/// What a mesh of the file becomes, with half of the contact distance in meters. The edges of the cape are short at the
/// collar, so that it must be thin to lie flat beside itself.
fn surface(thickness: f32) -> SurfaceFromMesh {
    SurfaceFromMesh::default().with_settings(SurfaceSettings {
        thickness: Some(SurfaceThickness::World(thickness)),
        contact_events: true,
        ..default()
    })
}

/// The cape: held around the neck and on the shoulders, free below.
fn cape() -> XpbdGarment {
    XpbdGarment {
        longest: 0.9,
        pinned_height: 0.06,
        // The legs swing far behind the planes of the triangles that the hem hangs before.
        clearance: -1.0,
        material: XpbdMaterial { area_density: 0.35, drag: 0.3, ..XpbdMaterial::CLOTH },
        ..default()
    }
}

/// Where the person is at an angle of the path, looking along it.
fn place(angle: f32) -> Transform {
    let (place, forwards) = level::path(angle);
    Transform::from_translation(place).looking_to(-forwards, Vec3::Y)
}

/// Plays both animations, mixed by how fast the person walks.
fn animate(
    mut commands: Commands,
    mut players: Query<(Entity, &mut AnimationPlayer, Has<AnimationGraphHandle>)>,
    walkers: Query<&Walker>,
    animations: Res<Animations>,
) {
    let pace = walkers.iter().map(|walker| walker.pace).sum::<f32>();
    for (entity, mut player, is_playing) in &mut players {
        if !is_playing {
            commands.entity(entity).insert(AnimationGraphHandle(animations.graph.clone()));
        }
        player.play(animations.stand).repeat().set_weight(1.0 - pace);
        player.play(animations.walk).repeat().set_weight(pace);
    }
}

fn walk(mut walkers: Query<(&mut Walker, &mut Transform)>, time: Res<Time>) {
    for (mut walker, mut transform) in &mut walkers {
        walker.pace = (walker.pace + time.delta_secs() / START).min(1.0);
        let (_, forwards) = level::path(walker.angle);
        walker.angle += PERSON_SPEED as f32 * walker.pace * time.delta_secs() / forwards.length();
        *transform = place(walker.angle);
    }
}

/// Lets the cape feel the wind.
fn blow(mut commands: Commands, garments: Query<Entity, With<XpbdGarment>>, time: Res<Time>) {
    for garment in &garments {
        let velocity = SHELTER * wind(time.elapsed_secs());
        commands.entity(garment).insert(SurfaceWind { velocity, ..default() });
    }
}
