//! A rigid shape made of triangles gives the same contacts as a surface that does not deform, reported as those of a
//! shape.

use bevy_app::prelude::*;
use bevy_circumsphere::{StoredPair, detection::DetectionDiagnostics, prelude::*};
use bevy_math::ops;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, grid},
};
use glam::{Quat, Vec3};

use crate::{
    shape_kinds::trimesh,
    world::{
        Announcement::{Ended, Started},
        Seen, THIN, all, app, assert_near, assert_near_vector, assert_swapped, at, ball, between, deepest, insert,
        keep_journal, messages, observe, of, points, rounding, sheet, spawn, status, store, surface, write_positions,
    },
};

/// An uneven floor of `cells` by `cells` cells with two triangles each.
fn floor(cells: usize) -> Mesh {
    let mut mesh = grid(cells, cells, 4.0, 4.0, Diagonals::Alternating);
    let mut random = Random::new(7);
    let bump = if cells > 1 { 0.4 / cells as f32 } else { 0.0 };
    mesh.positions.iter_mut().for_each(|position| position[1] = bump * random.signed_unit());
    mesh
}

/// All values of a pair except the kind of its sides, for a bitwise comparison.
fn told(pair: &StoredPair) -> Vec<String> {
    let contacts = pair.contacts.iter().map(|contact| format!("{contact:?}"));
    let touching = pair.touching.iter().map(|touching| format!("{touching:?}"));
    let whole = format!("{} {} {:?}", pair.contact_distance, pair.nearest, pair.frame_pose);
    contacts.chain(touching).chain([whole]).collect()
}

fn lowered(mesh: &Mesh, by: f32, random: &mut Random) -> Vec<Vec3> {
    let mut jitter = || 0.004 * random.signed_unit();
    points(mesh).iter().map(|&point| point + Vec3::new(jitter(), by + jitter(), jitter())).collect()
}

#[test]
fn a_floor_gives_the_same_contacts_as_a_shape_and_as_a_surface() {
    for cells in [1, 10, 100] {
        let mesh = floor(cells);
        assert_eq!(mesh.triangles.len(), 2 * cells * cells);
        for (turn, margin) in [(0.0, 0.0), (0.4, 0.1)] {
            let pose = at(0.02, 0.0, 0.01).with_rotation(Quat::from_rotation_y(turn));
            let cloth = grid(9, 9, 1.5, 1.5, Diagonals::Uniform).translate([0.1, 0.06, 0.2]);
            let [mut as_shape, mut as_surface] = [true, false].map(|rigid| {
                let mut app = app();
                app.insert_resource(CircumsphereSettings { margin, ..Default::default() });
                let cloth = spawn(&mut app, &cloth, (THIN, SelfCollision));
                let body = spawn(&mut app, &ball(), (THIN, at(-1.0, 0.52, -0.9)));
                let floor = if rigid {
                    app.world_mut().spawn((RigidShape(trimesh(&mesh)), pose)).id()
                } else {
                    let extra = (SurfaceThickness::World(0.0), pose);
                    app.world_mut().spawn((surface(&mesh), extra)).id()
                };
                (app, [cloth, body, floor], Random::new(11))
            });
            let (mut contacts, mut passed) = (0, 0);
            for tick in 0..if cells < 100 { 100 } else { 30_u8 } {
                // Down through the floor and up again.
                let height = 0.05 * ops::cos(f32::from(tick) * 0.2) - 0.05;
                for (app, [moving, body, _], random) in [&mut as_shape, &mut as_surface] {
                    write_positions(app, *moving, &lowered(&cloth, height, random));
                    let body_height = 0.5 + 0.03 * ops::sin(f32::from(tick) * 0.3);
                    insert(app, *body, at(-1.0, body_height, -0.9));
                    app.update();
                }
                let lists = [&as_shape, &as_surface].map(|(app, ..)| {
                    let pairs = &store(app).pairs();
                    pairs.iter().map(told).collect::<Vec<_>>()
                });
                assert!(lists[0] == lists[1], "{cells} {turn} {margin}: tick {tick}");
                let (app, [_, _, floor], _) = &as_shape;
                let pairs = store(app).pairs().iter().filter(|pair| pair.b == ContactSide::Shape(*floor));
                for contact in pairs.flat_map(|pair| pair.contacts.iter()) {
                    contacts += 1;
                    passed += usize::from(contact.distance < 0.0);
                }
            }
            assert!(contacts > 1_000 && passed > 200, "{cells}: {contacts} contacts, {passed} of them passed");
        }
    }
}

#[test]
fn the_side_of_a_floor_is_remembered_while_a_body_trembles_across_it() {
    for cells in [1, 10, 100] {
        let mut mesh = floor(cells);
        mesh.positions.iter_mut().for_each(|position| position[1] = 0.0);
        for from in [1.0, -1.0] {
            let mut app = app();
            let mut random = Random::new(3);
            // A dart whose lowest vertex is at its origin.
            let dart = [Vec3::ZERO, Vec3::new(0.3, 1.0, 0.0), Vec3::new(-0.3, 1.0, 0.2)].map(|corner| corner * from);
            let dart = DeformableSurface::from_mesh(&dart, &[[0, 1, 2]]).expect("one triangle is a valid mesh");
            let shape = app.world_mut().spawn(RigidShape(trimesh(&mesh))).id();
            let dart = app.world_mut().spawn((dart, THIN)).id();
            let mut passed = 0;
            for tick in 0..100 {
                let height = if tick == 0 { 0.03 * from } else { 0.045 * random.signed_unit() };
                // Within one triangle of the finest floor.
                insert(&mut app, dart, at(0.011, height, 0.029));
                app.update();
                let contacts = between(&mut app, dart, shape);
                let lowest = contacts.iter().find(|contact| {
                    contact.kind == bevy_circumsphere::geometry::FeatureKind::VertexFace
                        && contact.feature_vertices.0.len() == 1
                });
                let lowest = lowest.unwrap_or_else(|| panic!("{cells} {from} {tick}: {contacts:?}"));
                assert_near(lowest.distance, height * from, rounding(1.0), (cells, from, tick));
                assert_near_vector(lowest.normal, Vec3::NEG_Y * from, rounding(1.0), (cells, from, tick));
                passed += usize::from(lowest.distance < 0.0);
            }
            assert!(passed > 20, "{passed}");
        }
    }
}

fn solid_and_mesh() -> [(&'static str, SharedShape); 2] {
    let half = circumsphere_support::scenes::cuboid([0.4; 3], 2);
    [("cuboid", SharedShape::cuboid(0.4, 0.4, 0.4)), ("mesh", trimesh(&half))]
}

fn layers(memberships: u32, filters: u32) -> SurfaceLayers {
    SurfaceLayers { memberships, filters }
}

#[test]
fn rigid_shapes_never_make_a_pair() {
    let [(_, solid), (_, mesh)] = solid_and_mesh();
    for shapes in [[&mesh, &mesh], [&mesh, &solid], [&solid, &mesh]] {
        let mut app = app();
        let [first, second] = shapes.map(|shape| app.world_mut().spawn(RigidShape(shape.clone())).id());
        insert(&mut app, second, at(0.1, 0.1, 0.1));
        let floor = app.world_mut().spawn(RigidShape(trimesh(&sheet()))).id();
        for _ in 0..3 {
            app.update();
            assert!(store(&app).pairs().is_empty());
            assert_eq!(app.world().resource::<DetectionDiagnostics>().pairs_kept, 0);
            insert(&mut app, first, at(0.0, 0.01, 0.0));
        }
        // A surface touches each of them.
        let ball = spawn(&mut app, &ball(), THIN);
        app.update();
        for shape in [first, second, floor] {
            assert!(!between(&mut app, ball, shape).is_empty());
        }
        assert_eq!(store(&app).pairs().len(), 3);
    }
}

#[test]
fn meshes_and_solids_meet_surfaces_on_their_layers_alike() {
    for (name, shape) in solid_and_mesh().into_iter().chain([("ball", SharedShape::ball(0.4))]) {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), (THIN, layers(0b01, 0b10)));
        let shape = app.world_mut().spawn((RigidShape(shape), at(0.1, 0.42, 0.2))).id();
        for (of_shape, meets) in [
            (layers(0b10, 0b01), true),
            (layers(0b01, 0b01), false),
            (layers(0b10, 0b10), false),
            (layers(0b11, 0b11), true),
            (layers(0, u32::MAX), false),
        ] {
            insert(&mut app, shape, of_shape);
            app.update();
            assert_eq!(!between(&mut app, sheet, shape).is_empty(), meets, "{name} {of_shape:?}");
        }
        insert(&mut app, shape, layers(0b10, 0b01));
        insert(&mut app, sheet, layers(0b100, 0b10));
        app.update();
        assert_eq!(all(&mut app), [], "{name}");
    }
}

#[test]
fn meshes_and_solids_are_disabled_and_announced_alike() {
    for (name, shape) in solid_and_mesh() {
        let mut app = app();
        keep_journal(&mut app, Update);
        let sheet = spawn(&mut app, &sheet(), THIN);
        let place = at(0.1, 0.42, 0.2);
        let shape = app.world_mut().spawn((RigidShape(shape), place, ContactEventsEnabled)).id();
        observe(&mut app, shape);
        app.update();
        assert_eq!(messages(&mut app), [Started(sheet, shape)], "{name}");
        app.update();
        assert_eq!(messages(&mut app), [], "{name}");
        insert(&mut app, shape, SurfaceDisabled);
        app.update();
        assert_eq!((status(&app, shape), messages(&mut app)), (SurfaceStatus::Disabled, vec![Ended(sheet, shape)]));
        assert_eq!(all(&mut app), [], "{name}");
        app.world_mut().entity_mut(shape).remove::<SurfaceDisabled>();
        app.update();
        assert_eq!(messages(&mut app), [Started(sheet, shape)], "{name}");
        insert(&mut app, shape, at(0.1, 2.0, 0.2));
        app.update();
        assert_eq!(messages(&mut app), [Ended(sheet, shape)], "{name}");
        insert(&mut app, shape, place);
        app.world_mut().entity_mut(shape).remove::<ContactEventsEnabled>();
        app.update();
        assert_eq!(messages(&mut app), [], "{name}: no events were requested");
        assert!(!of(&mut app, shape).is_empty(), "{name}");
        insert(&mut app, shape, ContactEventsEnabled);
        app.world_mut().despawn(shape);
        app.update();
        assert_eq!(messages(&mut app), [], "{name}: despawned before a tick has seen the request");
    }
}

#[test]
fn pairs_with_meshes_and_solids_come_in_the_order_of_the_game() {
    for (name, shape) in solid_and_mesh() {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), THIN);
        let shapes = [5, 3, 9].map(|order| {
            let place = at(0.1 + 0.01 * order as f32, 0.42, 0.2);
            app.world_mut().spawn((RigidShape(shape.clone()), place, SurfaceOrder(order))).id()
        });
        let order = |app: &App| store(app).pairs().iter().map(|pair| pair.b.entity()).collect::<Vec<_>>();
        app.update();
        assert_eq!(order(&app), [shapes[1], shapes[0], shapes[2]], "{name}");
        insert(&mut app, shapes[2], SurfaceOrder(1));
        app.update();
        assert_eq!(order(&app), [shapes[2], shapes[1], shapes[0]], "{name}");
        // A surface comes first, whatever its order.
        insert(&mut app, sheet, SurfaceOrder(100));
        app.update();
        assert_eq!(order(&app), [shapes[2], shapes[1], shapes[0]], "{name}");
        assert!(store(&app).pairs().iter().all(|pair| pair.a == ContactSide::Surface(sheet)), "{name}");
    }
}

#[test]
fn a_teleported_mesh_forgets_the_side() {
    for teleported in [true, false] {
        let mut app = app();
        let dart = [Vec3::ZERO, Vec3::new(0.3, 1.0, 0.0), Vec3::new(-0.3, 1.0, 0.2)];
        let dart = DeformableSurface::from_mesh(&dart, &[[0, 1, 2]]).expect("one triangle is a valid mesh");
        let dart = app.world_mut().spawn((dart, THIN, at(0.1, 0.03, 0.2))).id();
        let floor = app.world_mut().spawn(RigidShape(trimesh(&sheet()))).id();
        app.update();
        insert(&mut app, floor, at(0.0, 0.06, 0.0));
        if teleported {
            insert(&mut app, floor, Teleported);
        }
        app.update();
        assert!(app.world().get::<Teleported>(floor).is_none());
        let contacts = between(&mut app, dart, floor);
        let of_vertex = |contact: &&Seen| contact.feature_vertices.0.as_slice() == [VertexId(0)];
        let lowest = contacts.iter().find(of_vertex).expect("its lowest vertex is near the floor");
        let expected = if teleported { 0.03 } else { -0.03 };
        assert_near(lowest.distance, expected, rounding(1.0), teleported);
        assert_near_vector(lowest.normal, Vec3::Y * expected.signum(), rounding(1.0), teleported);
    }
}

#[test]
fn contacts_read_from_the_side_of_a_shape_are_mirrored() {
    for (name, shape) in solid_and_mesh() {
        for height in [0.42, 0.38, 0.1] {
            let mut app = app();
            let sheet = spawn(&mut app, &sheet(), THIN);
            let ball = spawn(&mut app, &ball(), (THIN, at(0.2, height + 0.8, 0.1)));
            let shape = app.world_mut().spawn((RigidShape(shape.clone()), at(0.1, height, 0.2))).id();
            app.update();
            let (every, of_shape) = (all(&mut app), of(&mut app, shape));
            let with_shape: Vec<&Seen> = every.iter().filter(|contact| contact.b.entity() == shape).collect();
            assert!(with_shape.len() > 2 && with_shape.len() == of_shape.len(), "{name} {height}");
            for (one, other) in with_shape.into_iter().zip(&of_shape) {
                assert!(matches!(one.a, ContactSide::Surface(entity) if entity == sheet || entity == ball));
                assert_eq!(one.b, ContactSide::Shape(shape), "{name}");
                assert_swapped(one, other);
                // Contacts do not move the vertices of a shape.
                for entry in one.stencil.iter().chain(&other.stencil) {
                    assert_ne!(entry.entity, shape, "{name} {one:?}");
                }
                assert_near(one.stencil.iter().map(|entry| entry.weight).sum(), -1.0, rounding(1.0), name);
                assert_eq!(one.triangles.1.is_some(), name == "mesh");
                assert_eq!(one.feature_vertices.1.is_empty(), name != "mesh");
                assert!((one.normal.length() - 1.0).abs() < 1.0e-5);
            }
            for surface in [sheet, ball] {
                let between = between(&mut app, shape, surface);
                assert!(between.iter().all(|contact| contact.a == ContactSide::Shape(shape)), "{name}");
                assert!(of(&mut app, surface).iter().all(|contact| contact.a == ContactSide::Surface(surface)));
            }
            let nearest = deepest(&between(&mut app, sheet, shape)).distance;
            assert!(
                if height > 0.4 { (nearest - 0.02).abs() < rounding(1.0) } else { nearest <= 0.0 },
                "{name} {nearest}"
            );
        }
    }
}
