//! The program of the guide, in docs/guide.md: a character from a file, in a cape.
//!
//! `BEVY_ASSET_ROOT=. cargo run --release --manifest-path examples/interop/Cargo.toml --example cape --features window`

use bevy::{app::AnimationSystems, prelude::*};
use bevy_circumsphere::{prelude::*, response::*};

/// In the folder `assets`. It has the meshes "Body" and "Cape", and its second animation is a walk.
const FILE: &str = "person.glb";
const WALK: usize = 1;

fn spawn_character(mut commands: Commands, assets: Res<AssetServer>) {
    let surface = |thickness: f32| {
        let thickness = Some(SurfaceThickness::World(thickness));
        SurfaceFromMesh::default().with_settings(SurfaceSettings { thickness, ..default() })
    };
    commands.spawn((
        WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset(FILE))),
        SurfaceFromMeshHierarchy::new(surface(0.005)).with_name("Cape", surface(0.003)),
        XpbdGarments::worn_by("Body").with_name("Cape", XpbdGarment { longest: 0.9, clearance: -1.0, ..default() }),
    ));
}

/// Walks in a circle. Characters in glTF files look along +z.
fn walk(mut characters: Query<&mut Transform, With<XpbdGarments>>, time: Res<Time>) {
    for mut character in &mut characters {
        let Vec2 { x, y } = Vec2::from_angle(time.elapsed_secs());
        *character = Transform::from_xyz(x, 0.0, y).looking_to(Vec3::new(y, 0.0, -x), Vec3::Y);
    }
}

fn play_animation(
    mut commands: Commands,
    mut players: Query<(Entity, &mut AnimationPlayer), Added<AnimationPlayer>>,
    assets: Res<AssetServer>,
    mut graphs: ResMut<Assets<AnimationGraph>>,
) {
    for (entity, mut player) in &mut players {
        let clip = assets.load(GltfAssetLabel::Animation(WALK).from_asset(FILE));
        let (graph, node) = AnimationGraph::from_clip(clip);
        player.play(node).repeat();
        commands.entity(entity).insert(AnimationGraphHandle(graphs.add(graph)));
    }
}

fn spawn_camera_and_light(mut commands: Commands) {
    commands.spawn((Camera3d::default(), Transform::from_xyz(0.0, 2.0, 4.5).looking_at(Vec3::Y * 0.9, Vec3::Y)));
    commands.spawn((DirectionalLight::default(), Transform::from_xyz(2.0, 4.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y)));
}

fn main() {
    App::new()
        .add_plugins(DefaultPlugins)
        // Bevy plays animations in `PostUpdate`, and cloth follows them.
        .add_plugins((DeformableCollisionPlugins::new(PostUpdate), XpbdResponsePlugin::new(PostUpdate)))
        .configure_sets(PostUpdate, DeformableSystems::Prepare.after(AnimationSystems))
        .add_systems(Startup, (spawn_character, spawn_camera_and_light))
        .add_systems(Update, (walk, play_animation))
        .run();
}
