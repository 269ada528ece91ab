//! The plugin in headless worlds.

use std::collections::BTreeSet;

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::tetrahedra::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box};
use glam::{Quat, Vec3};

fn app() -> App {
    let mut app = App::new();
    // In any order.
    app.add_plugins(TetrahedralContainmentPlugin);
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    app.insert_resource(CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() });
    app.finish();
    app.cleanup();
    app
}

fn spawn(app: &mut App, mesh: &TetrahedralMesh, extra: impl Bundle) -> Entity {
    let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let body = TetrahedralBody::from_mesh(&positions, &mesh.tetrahedra).expect("the body is valid");
    app.world_mut().spawn((body, extra)).id()
}

fn moved(mesh: &TetrahedralMesh, by: [f32; 3]) -> TetrahedralMesh {
    let positions = mesh.positions.iter().map(|p| [p[0] + by[0], p[1] + by[1], p[2] + by[2]]).collect();
    TetrahedralMesh { positions, tetrahedra: mesh.tetrahedra.clone() }
}

fn found(app: &mut App) -> Vec<VertexContainment> {
    app.update();
    app.world().resource::<Containments>().iter().copied().collect()
}

#[test]
fn vertices_of_both_bodies_are_found_in_order() {
    let mut app = app();
    let ball = tetrahedral_ball(6, 1.0);
    let first = spawn(&mut app, &ball, ());
    let second = spawn(&mut app, &moved(&ball, [0.9, 0.1, 0.05]), ());
    let found = found(&mut app);
    let order: Vec<_> = found.iter().map(|found| (found.body != first, found.vertex)).collect();
    assert!(order.is_sorted() && order.iter().collect::<BTreeSet<_>>().len() == order.len());
    for (body, container) in [(first, second), (second, first)] {
        let containments = app.world().resource::<Containments>();
        let count = containments.between(body, container).count();
        assert!(count > 50, "{count}");
        assert_eq!(containments.between(body, body).count(), 0);
        // The way out ends on the sphere, within what its polyhedron leaves.
        let center = if container == first { Vec3::ZERO } else { Vec3::new(0.9, 0.1, 0.05) }.as_dvec3();
        let positions = &app.world().get::<SurfacePositions>(body).expect("it has some").0;
        for found in containments.between(body, container) {
            assert!((found.barycentric.iter().sum::<f64>() - 1.0).abs() < 1.0e-12);
            let end = positions[found.vertex.index()].as_dvec3() + found.direction * found.depth;
            let radius = end.distance(center);
            assert!((0.94..1.0 + 1.0e-6).contains(&radius), "{radius}");
        }
    }
}

#[test]
fn poses_do_not_change_what_is_inside() {
    let mesh = tetrahedral_ball(4, 1.0);
    let other = moved(&tetrahedral_box([5, 4, 3], [0.7, 0.6, 0.5]), [0.63, 0.21, -0.17]);
    let plain = {
        let mut app = app();
        spawn(&mut app, &mesh, ());
        spawn(&mut app, &other, ());
        found(&mut app)
    };
    assert!(plain.len() > 30);
    let rotation = Quat::from_rotation_y(0.7) * Quat::from_rotation_x(-0.4);
    // The second body is stored in another frame, which its pose undoes.
    let inverse = Transform::from_rotation(rotation.inverse()).with_scale(Vec3::splat(0.5));
    let undone = Transform::from_rotation(rotation).with_scale(Vec3::splat(2.0));
    let stored = TetrahedralMesh {
        positions: other
            .positions
            .iter()
            .map(|&position| (inverse.rotation * Vec3::from_array(position) * 0.5).to_array())
            .collect(),
        tetrahedra: other.tetrahedra.clone(),
    };
    let mut app = app();
    spawn(&mut app, &mesh, ());
    spawn(&mut app, &stored, undone);
    let posed = found(&mut app);
    assert_eq!(posed.len(), plain.len());
    for (posed, plain) in posed.iter().zip(&plain) {
        assert_eq!(posed.vertex, plain.vertex);
        // The stored positions are rounded to f32.
        assert!((posed.depth - plain.depth).abs() < 1.0e-6, "{posed:?} {plain:?}");
        if plain.depth > 1.0e-3 {
            assert!(posed.direction.dot(plain.direction) > 0.0);
        }
    }
}

#[test]
fn a_mirrored_body_has_the_same_inside() {
    let mesh = tetrahedral_box([3; 3], [1.0; 3]);
    let probe = moved(&tetrahedral_box([1; 3], [0.25; 3]), [0.74, 0.1, 0.2]);
    let mut results = Vec::new();
    for scale in [Vec3::ONE, Vec3::new(-1.0, 1.0, 1.0)] {
        let mut app = app();
        let body = spawn(&mut app, &mesh, Transform::from_scale(scale));
        spawn(&mut app, &probe, ());
        let all = found(&mut app);
        let depths: Vec<_> =
            all.iter().filter(|found| found.container == body).map(|found| (found.vertex, found.depth)).collect();
        assert_eq!(depths.len(), 8);
        assert!(all.iter().filter(|found| found.container == body).all(|found| found.direction.x > 0.9));
        results.push(depths);
    }
    assert_eq!(results[0], results[1], "the box is symmetric");
}

#[test]
fn layers_disabling_and_despawning_are_respected() {
    let mut app = app();
    let ball = tetrahedral_ball(4, 1.0);
    spawn(&mut app, &ball, ());
    let second = spawn(&mut app, &moved(&ball, [0.5, 0.0, 0.0]), ());
    assert!(!found(&mut app).is_empty());
    app.world_mut().entity_mut(second).insert(SurfaceLayers { memberships: 2, filters: 2 });
    assert!(found(&mut app).is_empty(), "they do not meet");
    app.world_mut().entity_mut(second).remove::<SurfaceLayers>().insert(SurfaceLayers::default());
    assert!(!found(&mut app).is_empty());
    app.world_mut().entity_mut(second).insert(SurfaceDisabled);
    assert!(found(&mut app).is_empty(), "one is disabled");
    app.world_mut().entity_mut(second).remove::<SurfaceDisabled>();
    assert!(!found(&mut app).is_empty());
    app.world_mut().despawn(second);
    assert!(found(&mut app).is_empty());
    assert!(app.world().resource::<Containments>().is_empty());
}

#[test]
fn a_body_that_folds_onto_itself_is_found_only_with_self_collision() {
    // A bar whose ends meet.
    let bar = tetrahedral_box([30, 3, 3], [3.0, 0.3, 0.3]);
    let curvature = 1.08 * std::f64::consts::TAU / 6.0;
    let curl = |&[x, y, z]: &[f32; 3]| {
        let (sine, cosine) = (curvature * f64::from(x)).sin_cos();
        let radius = curvature.recip() - f64::from(y);
        [(radius * sine) as f32, (curvature.recip() - radius * cosine) as f32, z]
    };
    let curled = bar.positions.iter().map(curl).collect();
    let ring = TetrahedralMesh { positions: curled, tetrahedra: bar.tetrahedra.clone() };
    let mut app = app();
    let body = spawn(&mut app, &ring, ());
    assert!(found(&mut app).is_empty());
    app.world_mut().entity_mut(body).insert(SelfCollision);
    let folded = found(&mut app);
    assert!(folded.len() > 16, "{}", folded.len());
    for found in &folded {
        assert_eq!((found.body, found.container), (body, body));
        let corners = bar.tetrahedra[found.tetrahedron.index()];
        assert!(!corners.contains(&found.vertex.0));
        // The ends overlap by less than 0.5, and the bar is 0.6 thick.
        assert!(found.depth <= 0.5 && (found.direction.length() - 1.0).abs() < 1.0e-12, "{found:?}");
    }
    // Straight again, nothing is left.
    let straight: Vec<Vec3> = bar.positions.iter().copied().map(Vec3::from_array).collect();
    app.world_mut().get_mut::<SurfacePositions>(body).expect("it has some").0 = straight;
    assert!(found(&mut app).is_empty());
}

#[test]
fn contacts_are_the_same_with_and_without_the_plugin() {
    let contacts = |has_plugin: bool| {
        let mut app = App::new();
        app.add_plugins(DeformableCollisionPlugins::new(Update));
        if has_plugin {
            app.add_plugins(TetrahedralContainmentPlugin);
        }
        app.finish();
        app.cleanup();
        let ball = tetrahedral_ball(4, 1.0);
        spawn(&mut app, &ball, ());
        spawn(&mut app, &moved(&ball, [0.5, 0.3, 0.0]), ());
        app.update();
        app.world().resource::<bevy_circumsphere::ContactStore>().contact_count()
    };
    assert_eq!(contacts(true), contacts(false));
    assert!(contacts(true) > 0);
}
