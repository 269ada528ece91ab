//! Fine meshes that follow coarse surfaces.

use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_circumsphere::{geometry::SurfaceTopology, kernel::mesh::driven::DrivenMap, prelude::*};
use bevy_ecs::prelude::*;
use bevy_mesh::{Mesh, Mesh3d, VertexAttributeValues};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, grid, icosphere, torus};
use glam::{Quat, Vec3};

use crate::world::{THIN, add, app, changes, count_changes, indexed, points, spawn};

/// The largest distance of two lists of points.
#[track_caller]
fn farthest(found: &[Vec3], expected: &[Vec3]) -> f32 {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(found, expected)| found.distance(*expected)).fold(0.0, f32::max)
}

#[test]
fn at_rest_every_vertex_is_where_it_was() {
    // Coarse bodies, and finer ones that bulge over them, hang over their borders, or lie on them.
    let pairs = [
        (icosphere(1, 1.0), icosphere(4, 1.05)),
        (icosphere(0, 1.0), icosphere(3, 0.9)),
        (torus(1.0, 0.3, 12, 8), torus(1.0, 0.33, 40, 20)),
        (grid(4, 4, 2.0, 2.0, Diagonals::Uniform), grid(30, 30, 2.2, 2.2, Diagonals::Uniform)),
    ];
    for (coarse, fine) in pairs {
        let (positions, rest) = (points(&coarse), points(&fine));
        let topology = SurfaceTopology::new(&positions, &coarse.triangles).expect("it is valid");
        let mut map = DrivenMap::new(&topology, &positions, &rest);
        let mut found = Vec::new();
        map.follow(&topology, &positions, &mut found);
        // Weights and height are rounded to f32, and may be up to 2.
        let error = farthest(&found, &rest);
        assert!(error <= 16.0 * f32::EPSILON, "{} vertices: {error}", rest.len());
        // A rigid motion carries them along.
        let rotation = Quat::from_axis_angle(Vec3::new(1.0, 2.0, -0.5).normalize(), 2.0);
        let moved = |point: &Vec3| rotation * *point + Vec3::new(0.5, -1.0, 0.25);
        map.follow(&topology, &positions.iter().map(moved).collect::<Vec<_>>(), &mut found);
        let error = farthest(&found, &rest.iter().map(moved).collect::<Vec<_>>());
        assert!(error <= 64.0 * f32::EPSILON, "{} vertices: {error}", rest.len());
    }
}

#[test]
fn a_fine_ball_stays_round_when_its_coarse_one_grows() {
    let (coarse, fine) = (icosphere(2, 1.0), icosphere(4, 1.1));
    let positions = points(&coarse);
    let topology = SurfaceTopology::new(&positions, &coarse.triangles).expect("it is valid");
    let mut map = DrivenMap::new(&topology, &positions, &points(&fine));
    let grown: Vec<Vec3> = positions.iter().map(|point| 2.0 * *point).collect();
    let mut found = Vec::new();
    map.follow(&topology, &grown, &mut found);
    // Heights stay: over the coarse faces, which are up to 0.025 below the ball at radius 1, they are 0.1 to 0.125.
    for point in &found {
        assert!((point.length() - 2.1).abs() < 0.03, "{}", point.length());
    }
}

fn mesh_positions(app: &App, entity: Entity) -> Vec<Vec3> {
    let mesh = &app.world().get::<Mesh3d>(entity).expect("it has one").0;
    let mesh = app.world().resource::<Assets<Mesh>>().get(mesh).expect("it is there");
    let Some(VertexAttributeValues::Float32x3(values)) = mesh.attribute(Mesh::ATTRIBUTE_POSITION) else {
        panic!("it has positions")
    };
    values.iter().copied().map(Vec3::from_array).collect()
}

#[test]
fn a_mesh_follows_the_surface_from_any_place_and_only_when_it_moves() {
    let mut app = app();
    count_changes(&mut app);
    let (coarse, fine) = (icosphere(1, 1.0), icosphere(3, 1.02));
    let place = Transform::from_xyz(3.0, 1.0, 0.0).with_rotation(Quat::from_rotation_y(0.5));
    let surface = spawn(&mut app, indexed(&coarse), (THIN, place));
    // The drawn mesh has an origin and a scale of its own, at the same place in the world.
    let own = Transform::from_xyz(-1.0, 0.0, 2.0).with_scale(Vec3::splat(0.5));
    let to_own = own.compute_affine().inverse() * place.compute_affine();
    let rest: Vec<Vec3> = points(&fine).iter().map(|point| to_own.transform_point3(*point)).collect();
    let mut local = fine.clone();
    local.positions = rest.iter().map(Vec3::to_array).collect();
    let mesh = add(&mut app, indexed(&local));
    let drawn = app.world_mut().spawn((mesh, own, DrivenMesh::by(surface))).id();
    app.update();
    assert!(farthest(&mesh_positions(&app, drawn), &rest) < 1.0e-5);
    app.update();
    changes(&mut app);
    app.update();
    assert_eq!(changes(&mut app).0, 0, "it rests");

    // The surface is deformed, and moved as a whole.
    for position in &mut app.world_mut().get_mut::<SurfacePositions>(surface).expect("it is a surface").0 {
        position.y *= 0.5;
    }
    app.world_mut().get_mut::<Transform>(surface).expect("it has one").translation.x += 2.0;
    app.update();
    let moved = Transform { translation: place.translation + 2.0 * Vec3::X, ..place };
    let found: Vec<Vec3> = mesh_positions(&app, drawn)
        .iter()
        .map(|point| moved.compute_affine().inverse().transform_point3(own.compute_affine().transform_point3(*point)))
        .collect();
    let flattened: Vec<Vec3> = points(&fine).iter().map(|point| Vec3::new(point.x, 0.5 * point.y, point.z)).collect();
    let error = farthest(&found, &flattened);
    assert!(error < 0.1, "flattened along with its surface, up to the heights that are kept: {error}");
    app.update();
    assert_eq!(changes(&mut app).0, 1, "once");

    // It cannot be written while another entity draws it too.
    let other = app.world().get::<Mesh3d>(drawn).expect("it has one").clone();
    let other = app.world_mut().spawn(other).id();
    app.init_resource::<Refused>().add_observer(|on: On<SurfaceMeshNotWritten>, mut refused: ResMut<Refused>| {
        refused.0.push((on.entity, on.reason.clone()));
    });
    app.world_mut().get_mut::<Transform>(surface).expect("it has one").translation.x += 1.0;
    app.update();
    app.update();
    assert_eq!(app.world().resource::<Refused>().0, [(drawn, SurfaceMeshError::Shared(other))]);
    assert_eq!(changes(&mut app).0, 0);
    app.world_mut().despawn(other);
    app.update();
    app.update();
    assert_eq!(changes(&mut app).0, 1);
    // Without its surface, it stays.
    app.world_mut().despawn(surface);
    app.update();
    app.update();
    assert_eq!(changes(&mut app).0, 0);
}

#[derive(Resource, Default)]
struct Refused(Vec<(Entity, SurfaceMeshError)>);
