//! Headless worlds for the tests of this folder.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_support::{random::Random, scenes::Mesh};
use glam::{DQuat, DVec3, Quat, Vec3};

pub const ALL: SurfaceQueryFilter<'_> = SurfaceQueryFilter {
    layers: SurfaceLayers { memberships: u32::MAX, filters: u32::MAX },
    excluded: &[],
    predicate: None,
    culls_back_faces: false,
};

pub fn app() -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    app
}

pub fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

pub fn spawn(app: &mut App, mesh: &Mesh, extra: impl Bundle) -> Entity {
    let surface = DeformableSurface::from_mesh(&points(mesh), &mesh.triangles).expect("the mesh is valid");
    app.world_mut().spawn((surface, extra)).id()
}

/// Runs a function with the query.
pub fn query<T: Send + 'static>(app: &mut App, read: impl Fn(&SurfaceQuery) -> T + Send + Sync + 'static) -> T {
    app.world_mut().run_system_once(move |query: SurfaceQuery| read(&query)).expect("surfaces can be queried")
}

/// A mesh with waves that depend on `time`, so that every tick has another form.
pub fn wavy(mesh: &Mesh, time: f64) -> Vec<Vec3> {
    let wave = |position: Vec3| {
        let place = position.as_dvec3();
        let by = |axis: DVec3, phase: f64| (axis.dot(place) * 5.0 + phase + time).sin() * 0.06;
        let moved = DVec3::new(by(DVec3::Y, 0.0), by(DVec3::Z, 1.0), by(DVec3::X, 2.0));
        (place + moved).as_vec3()
    };
    points(mesh).into_iter().map(wave).collect()
}

pub fn write_positions(app: &mut App, entity: Entity, positions: Vec<Vec3>) {
    app.world_mut().get_mut::<SurfacePositions>(entity).expect("the entity is a surface").0 = positions;
}

pub fn random_vector(random: &mut Random) -> Vec3 {
    Vec3::from_array([0; 3].map(|_| random.signed_unit()))
}

pub fn random_rotation(random: &mut Random) -> Quat {
    let turn = random_vector(random).as_dvec3() * 3.0;
    DQuat::from_scaled_axis(turn).as_quat().normalize()
}

/// A random pose: rotated, scaled by 0.5 to 2, and perhaps mirrored.
pub fn random_pose(random: &mut Random, translation: Vec3) -> Transform {
    let scale = 1.25 + 0.75 * random.signed_unit();
    let mirrored = if random.below(2) == 0 { Vec3::ONE } else { Vec3::new(-1.0, 1.0, 1.0) };
    Transform { translation, rotation: random_rotation(random), scale: mirrored * scale }
}

/// The corners of all triangles of a surface in the world, composed in f64.
pub fn world_triangles(app: &App, entity: Entity) -> Vec<[DVec3; 3]> {
    let world = app.world();
    let transform = world.get::<Transform>(entity).expect("the entity has a transform");
    let rotation = transform.rotation.as_dquat().normalize();
    let positions = &world.get::<SurfacePositions>(entity).expect("the entity is a surface").0;
    let in_world = |vertex: u32| {
        let position = positions[vertex as usize].as_dvec3();
        rotation * (position * transform.scale.as_dvec3()) + transform.translation.as_dvec3()
    };
    let surface = world.get::<DeformableSurface>(entity).expect("the entity is a surface");
    surface.topology().triangles().iter().map(|corners| corners.map(in_world)).collect()
}
