//! The game.

use std::{path::Path, time::Duration};

use bevy_animation::{
    AnimationClip, AnimationPlayer, AnimationPlugin, graph::AnimationGraph, graph::AnimationGraphHandle,
};
use bevy_app::{AnimationSystems, prelude::*};
use bevy_asset::{AssetPlugin, AssetServer, Assets, Handle, LoadState};
use bevy_circumsphere::{
    RayHit,
    prelude::*,
    response::{XpbdGarment, XpbdGarments, XpbdResponsePlugin},
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_gltf::{Gltf, GltfPlugin};
use bevy_image::ImagePlugin;
use bevy_mesh::MeshPlugin;
use bevy_time::{TimePlugin, TimeUpdateStrategy};
use bevy_transform::TransformPlugin;
use bevy_world_serialization::{WorldAssetRoot, WorldSerializationPlugin};
use glam::Vec3;

use crate::file;

/// Updates after which a file that has not been loaded never will be.
const PATIENCE: usize = 10_000;

/// Half the contact distance, in meters.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.004);

/// Distance of a shooter, in meters.
const DISTANCE: f32 = 10.0;

/// Who plays in the scene.
#[derive(Resource, Clone, Debug, PartialEq, Eq)]
pub struct Cast {
    /// The name of the mesh that wears the garment.
    pub skin: String,
    /// The name of the mesh that becomes its garment. Without it, all meshes move by their animation only.
    pub garment: Option<String>,
}

/// The character, once it is loaded.
#[derive(Resource)]
struct Loaded(Handle<Gltf>);

/// A game without a window: it animates, then detects and responds, at 60 ticks per second.
pub fn character_app(folder: &Path, cast: Cast) -> App {
    let mut app = App::new();
    app.add_plugins((
        TaskPoolPlugin::default(),
        TimePlugin,
        TransformPlugin,
        AssetPlugin { file_path: folder.display().to_string(), ..AssetPlugin::default() },
        WorldSerializationPlugin,
        MeshPlugin,
        ImagePlugin::default(),
        AnimationPlugin,
        GltfPlugin::default().add_custom_vertex_attribute(&file::PAINT[1..], XpbdGarment::ATTRIBUTE_FREEDOM),
    ))
    // After the animations, which Bevy plays in `PostUpdate`.
    .add_plugins((DeformableCollisionPlugins::new(PostUpdate), XpbdResponsePlugin::new(PostUpdate)))
    .configure_sets(PostUpdate, DeformableSystems::Prepare.after(AnimationSystems))
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO))
    .insert_resource(cast)
    .add_systems(Update, animate.run_if(resource_exists::<Loaded>));
    app.finish();
    app.cleanup();
    app
}

/// Loads a glTF file of the app's folder, and spawns its first scene. Time stands still until all of its meshes are
/// surfaces.
///
/// # Errors
/// If the file cannot be loaded or has no scene, says why.
pub fn load(app: &mut App, file: &str) -> Result<(), String> {
    let assets = app.world().resource::<AssetServer>().clone();
    let handle: Handle<Gltf> = assets.load(file.to_owned());
    let mut waited = 0;
    loop {
        app.update();
        match assets.get_load_state(&handle) {
            Some(LoadState::Failed(error)) => return Err(format!("{file}: {error}")),
            _ if assets.is_loaded_with_dependencies(&handle) => break,
            _ if waited == PATIENCE => return Err(format!("{file}: it takes too long to load")),
            _ => waited += 1,
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    let gltf = app.world().resource::<Assets<Gltf>>().get(&handle);
    let scene = gltf.and_then(|gltf| gltf.scenes.first().cloned()).ok_or_else(|| format!("{file}: it has no scene"))?;
    let surfaces = SurfaceFromMesh::default()
        .with_settings(SurfaceSettings { thickness: Some(THICKNESS), ..SurfaceSettings::default() });
    // The garment hangs from the waist of the skin.
    let Cast { skin, garment } = app.world().resource::<Cast>().clone();
    let mut garments = XpbdGarments::worn_by(skin);
    if let Some(garment) = garment {
        garments = garments.with_name(garment, XpbdGarment::default());
    }
    app.world_mut().spawn((WorldAssetRoot(scene), SurfaceFromMeshHierarchy::new(surfaces), garments));
    app.insert_resource(Loaded(handle));
    // One to spawn the scene, one to make surfaces and to dress.
    for _ in 0..2 {
        app.update();
    }
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_nanos(1_000_000_000 / 60)));
    Ok(())
}

/// What a bullet hits.
#[derive(Clone, Debug)]
pub struct Shot {
    pub hit: RayHit,
    /// The name of the joint that moves the place most.
    pub joint: Option<String>,
}

/// Shoots level, along −z, at the vertex of a mesh that is nearest to a height above its lowest vertex: 0 to 1, in parts
/// of the height of the mesh. `None` if there is no such mesh.
pub fn shoot(app: &mut App, target: &str, height: f32) -> Option<Shot> {
    let target = target.to_owned();
    let shoot = move |skins: Query<(&Name, &SurfacePositions)>,
                      names: Query<&Name>,
                      surfaces: SurfaceQuery,
                      joints: SurfaceJoints| {
        let (_, positions) = skins.iter().find(|(name, _)| name.as_str() == target)?;
        let heights = || positions.0.iter().map(|at| at.y);
        let (low, high) = (heights().fold(f32::INFINITY, f32::min), heights().fold(f32::NEG_INFINITY, f32::max));
        let off = |at: &Vec3| (at.y - (low + (high - low) * height)).abs();
        let aim = *positions.0.iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
        let origin = aim + DISTANCE * Vec3::Z;
        let hit = surfaces.cast_ray(origin, Vec3::NEG_Z, 2.0 * DISTANCE, &SurfaceQueryFilter::default())?;
        let joint = joints.dominant(hit.entity, hit.triangle, hit.barycentric);
        let joint = joint.and_then(|joint| names.get(joint).ok()).map(|name| name.as_str().to_owned());
        Some(Shot { hit, joint })
    };
    app.world_mut().run_system_once(shoot).ok().flatten()
}

/// Plays the first animation of the file.
fn animate(
    mut commands: Commands,
    mut players: Query<(Entity, &mut AnimationPlayer), Added<AnimationPlayer>>,
    loaded: Res<Loaded>,
    files: Res<Assets<Gltf>>,
    mut graphs: ResMut<Assets<AnimationGraph>>,
) {
    for (entity, mut player) in &mut players {
        let clip: Option<Handle<AnimationClip>> =
            files.get(&loaded.0).and_then(|gltf| gltf.animations.first().cloned());
        let Some(clip) = clip else { continue };
        let (graph, walk) = AnimationGraph::from_clip(clip);
        player.play(walk);
        commands.entity(entity).insert(AnimationGraphHandle(graphs.add(graph)));
    }
}
