//! Features of contacts, in cases that are easy to get wrong.

use bevy_app::prelude::*;
use bevy_circumsphere::{Circumspheres, ContactStore, prelude::*};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::cuboid;
use glam::Vec3;

use crate::world::{app, at, spawn, write_positions};

const CONTACT: SurfaceThickness = SurfaceThickness::World(0.05);

fn spawn_triangles(app: &mut App, positions: &[Vec3], triangles: &[[u32; 3]]) -> Entity {
    let surface = DeformableSurface::from_mesh(positions, triangles).expect("the mesh is valid");
    app.world_mut().spawn((surface, CONTACT, SelfCollision)).id()
}

#[test]
fn an_edge_close_to_a_shape_is_no_crossing() {
    for shape in [SharedShape::ball(0.5), SharedShape::capsule_y(0.2, 0.5), SharedShape::cuboid(0.5, 0.5, 0.5)] {
        let mut app = app();
        // The edge from the first to the second corner passes the shape at a distance of 0.03.
        let front = Vec3::new(0.53, 0.0, 0.0);
        let corners = [front - Vec3::Y, front + Vec3::Y, front + Vec3::X];
        spawn_triangles(&mut app, &corners, &[[0, 1, 2]]);
        app.world_mut().spawn(RigidShape(shape));
        app.update();
        let mut state = bevy_ecs::system::SystemState::<SurfaceContacts>::new(app.world_mut());
        let contacts = state.get(app.world()).expect("the plugins keep a store");
        let mut edges = 0;
        for contact in contacts.iter() {
            assert!(contact.distance() > 0.0, "{contact:?}");
            assert!(!contact.is_crossing(), "{contact:?}");
            edges += usize::from(matches!(contact.features().0, Feature::Edge(_)));
        }
        assert!(edges > 0, "an edge is the closest feature");
    }
}

#[test]
fn vertices_that_have_come_apart_keep_contacts_of_their_own() {
    let mut app = app();
    // Two triangles above a long face. Their lowest corners are separate vertices at the same position.
    let face = [Vec3::new(-4.0, 0.0, -4.0), Vec3::new(4.0, 0.0, -4.0), Vec3::new(0.0, 0.0, 6.0)];
    let left = [Vec3::new(0.0, 0.02, 0.0), Vec3::new(-0.3, 1.0, 0.2), Vec3::new(-0.3, 1.0, -0.2)];
    let right = [Vec3::new(0.0, 0.02, 0.0), Vec3::new(0.3, 1.0, 0.2), Vec3::new(0.3, 1.0, -0.2)];
    let joined: Vec<Vec3> = [face, left, right].concat();
    let entity = spawn_triangles(&mut app, &joined, &[[0, 2, 1], [3, 4, 5], [6, 7, 8]]);
    app.update();
    assert_eq!(app.world().resource::<ContactStore>().contact_count(), 1, "vertices at one position count as one");

    let apart: Vec<Vec3> = [face, left.map(|corner| corner - Vec3::X), right.map(|corner| corner + Vec3::X)].concat();
    write_positions(&mut app, entity, &apart);
    app.update();
    let store = app.world().resource::<ContactStore>();
    assert_eq!(store.touching_count(), 2);
    let mut triangles: Vec<u32> = store.contacts().map(|contact| contact.triangle_b).collect();
    triangles.sort_unstable();
    assert_eq!(triangles, [1, 2], "each vertex has its own contact");
    let keys: Vec<ContactKey> = store.contacts().map(|contact| contact.key).collect();
    assert_ne!(keys[0], keys[1]);
}

#[test]
fn sphere_settings_take_effect_on_a_mesh_at_rest() {
    let mut app = app();
    let mesh = cuboid([0.5, 0.5, 0.5], 6);
    let first = spawn(&mut app, &mesh, (CONTACT, ContactMethod::Circumsphere));
    spawn(&mut app, &mesh, (CONTACT, ContactMethod::Circumsphere, at(1.02, 0.1, 0.0)));
    app.update();
    app.update();
    let highest = |app: &App| {
        let spheres = app.world().get::<Circumspheres>(first).expect("the surface has spheres");
        spheres.heights.iter().copied().fold(0.0, f32::max)
    };
    let before = highest(&app);
    app.world_mut().resource_mut::<CircumsphereSettings>().sphere_offset = 3.0;
    app.update();
    // Flat triangles in the middle of a side have the full height of φ radii.
    let expected = 3.0 / CircumsphereSettings::default().sphere_offset;
    assert!((highest(&app) / before - expected).abs() < 1.0e-4, "{before} became {}", highest(&app));
}
