//! Headless worlds with mesh assets.

use bevy_app::prelude::*;
use bevy_asset::{AssetEvent, AssetPlugin, Assets, RenderAssetUsages};
use bevy_circumsphere::prelude::*;
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_mesh::{Indices, Mesh, Mesh3d, MeshPlugin, PrimitiveTopology};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{self, Diagonals, grid};
use glam::Vec3;

pub fn app() -> App {
    let mut app = App::new();
    // Bevy's mesh plugin needs the task pools.
    app.add_plugins((TaskPoolPlugin::default(), AssetPlugin::default(), MeshPlugin));
    app.add_plugins(DeformableCollisionPlugins::new(PostUpdate));
    app
}

/// A bumpy sheet above the plane y = 0, without two vertices at one place.
pub fn sheet() -> scenes::Mesh {
    let mut sheet = grid(4, 4, 2.0, 2.0, Diagonals::Uniform);
    for (number, position) in sheet.positions.iter_mut().enumerate() {
        position[1] = 0.01 * (number % 3) as f32;
    }
    sheet
}

pub fn points(mesh: &scenes::Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

pub fn empty(topology: PrimitiveTopology) -> Mesh {
    Mesh::new(topology, RenderAssetUsages::default())
}

/// An indexed triangle list with normals.
pub fn indexed(mesh: &scenes::Mesh) -> Mesh {
    empty(PrimitiveTopology::TriangleList)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, mesh.positions.clone())
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![[0.0, 1.0, 0.0]; mesh.positions.len()])
        .with_inserted_indices(Indices::U32(mesh.triangles.as_flattened().to_vec()))
}

pub fn add(app: &mut App, mesh: Mesh) -> Mesh3d {
    Mesh3d(app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh))
}

pub fn spawn(app: &mut App, mesh: Mesh, extra: impl Bundle) -> Entity {
    let mesh = add(app, mesh);
    app.world_mut().spawn((mesh, SurfaceFromMesh::default(), extra)).id()
}

/// A floor to touch: everything within 0.05 of the plane y = 0 is in contact with it.
pub fn floor(app: &mut App) -> Entity {
    app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), Transform::default())).id()
}

pub const THIN: SurfaceThickness = SurfaceThickness::World(0.05);

pub fn positions(app: &App, entity: Entity) -> Vec<Vec3> {
    app.world().get::<SurfacePositions>(entity).expect("it is a surface").0.clone()
}

pub fn status(app: &App, entity: Entity) -> SurfaceStatus {
    app.world().get::<SurfaceStatus>(entity).expect("it has a status").clone()
}

/// Why the mesh of the entity is no surface.
#[track_caller]
pub fn failure(app: &App, entity: Entity) -> SurfaceMeshError {
    match status(app, entity) {
        SurfaceStatus::Quarantined(QuarantineReason::Mesh(reason)) => reason,
        other => panic!("the status is {other:?}"),
    }
}

/// The corners of each touching triangle of an entity's contacts, in world space, with the distance: independent of how
/// vertices are numbered.
pub fn contacts_of(app: &mut App, entity: Entity) -> Vec<([[f32; 3]; 2], f32, [f32; 3])> {
    let read = move |contacts: SurfaceContacts| {
        let values = contacts.contacts_with(entity).map(|contact| {
            let points = contact.points();
            ([points.0.to_array(), points.1.to_array()], contact.distance(), contact.normal().to_array())
        });
        let mut values: Vec<_> = values.collect();
        values.sort_by(|a, b| a.partial_cmp(b).expect("no NaN"));
        values
    };
    app.world_mut().run_system_once(read).expect("contacts can be read")
}

/// The modifications of mesh assets that the app was told of.
#[derive(Resource, Default)]
pub struct Modifications(pub usize);

/// The changes of positions that another system saw.
#[derive(Resource, Default)]
pub struct Changes(pub usize);

/// Counts changes of positions and assets.
pub fn count_changes(app: &mut App) {
    app.init_resource::<Modifications>().init_resource::<Changes>();
    app.add_systems(Last, |mut count: ResMut<Modifications>, mut events: MessageReader<AssetEvent<Mesh>>| {
        count.0 += events.read().filter(|event| matches!(event, AssetEvent::Modified { .. })).count();
    });
    app.add_systems(Last, |mut count: ResMut<Changes>, changed: Query<(), Changed<SurfacePositions>>| {
        count.0 += changed.iter().count();
    });
}

/// The modifications and changes since the last call.
pub fn changes(app: &mut App) -> (usize, usize) {
    let modifications = std::mem::take(&mut app.world_mut().resource_mut::<Modifications>().0);
    (modifications, std::mem::take(&mut app.world_mut().resource_mut::<Changes>().0))
}
