//! The deepest contact, the deepest of each vertex, manifolds, and relative velocities.

use bevy_circumsphere::prelude::*;
use bevy_ecs::system::RunSystemOnce;
use bevy_transform::components::Transform;
use glam::{Quat, Vec3};

use crate::world::{THIN, app, at, ball, sheet, surface};

#[test]
fn the_deepest_contact_is_the_lowest_point_of_a_ball() {
    let mut app = app();
    let below = app.world_mut().spawn((surface(&sheet()), THIN)).id();
    let above = app.world_mut().spawn((surface(&ball()), THIN, at(0.1, 0.53, 0.2))).id();
    app.update();
    let read = move |contacts: SurfaceContacts| {
        let deepest = contacts.deepest(above, below).expect("they touch");
        assert_eq!(deepest.a(), ContactSide::Surface(above));
        // The ball has a vertex at its very bottom.
        assert!((deepest.distance() - 0.03).abs() < 1.0e-6, "{deepest:?}");
        assert!(contacts.between(above, below).count() > 4);
        assert!(contacts.between(above, below).all(|contact| contact.separation() >= deepest.separation()));
        let mirrored = contacts.deepest(below, above).expect("they touch");
        assert_eq!((mirrored.key(), mirrored.normal()), (deepest.key(), -deepest.normal()));
        assert!(contacts.deepest(above, above).is_none());
    };
    app.world_mut().run_system_once(read).expect("it runs");
}

#[test]
fn every_vertex_has_its_own_deepest_contact() {
    let mut app = app();
    let below = app.world_mut().spawn((surface(&sheet()), THIN)).id();
    let tilted = Transform::from_xyz(0.0, 0.05, 0.0).with_rotation(Quat::from_rotation_x(0.01));
    app.world_mut().spawn((surface(&sheet()), THIN, tilted));
    app.update();
    let read = move |contacts: SurfaceContacts| {
        let deepest = contacts.deepest_per_vertex(below);
        assert!(deepest.len() > 20 && deepest.is_sorted_by_key(|(vertex, _)| vertex.0));
        let mut acting = 0;
        for contact in contacts.contacts_with(below) {
            for entry in contact.stencil().into_iter().filter(|entry| entry.entity == below) {
                let kept = deepest.iter().find(|(vertex, _)| *vertex == entry.vertex).expect("every vertex has one").1;
                assert!(kept.separation() <= contact.separation());
                assert!(kept.stencil().iter().any(|of_kept| of_kept.vertex == entry.vertex));
                acting += 1;
            }
        }
        assert!(acting > deepest.len(), "there was something to choose from");
    };
    app.world_mut().run_system_once(read).expect("it runs");
}

#[test]
fn a_manifold_of_two_sheets_spans_their_corners() {
    let mut app = app();
    let below = app.world_mut().spawn((surface(&sheet()), THIN)).id();
    let above = app.world_mut().spawn((surface(&sheet()), THIN, at(0.0, 0.04, 0.0))).id();
    app.update();
    let read = move |contacts: SurfaceContacts| {
        let all = contacts.between(below, above).count();
        let manifold = contacts.manifold(below, above, 4);
        assert_eq!(manifold.len(), 4);
        let points: Vec<Vec3> = manifold.iter().map(|contact| contact.points().0).collect();
        // The sheets are 4 by 4: the three after the deepest are at corners, since nothing is farther.
        for point in &points[1..] {
            assert!(point.x.abs() > 1.99 && point.z.abs() > 1.99, "{points:?}");
        }
        let distinct = contacts.manifold(below, above, usize::MAX);
        assert!(distinct.len() <= all && distinct.len() >= 81, "{} of {all}", distinct.len());
        for (place, contact) in distinct.iter().enumerate() {
            assert!(distinct[..place].iter().all(|other| other.points().0 != contact.points().0));
        }
        assert!(contacts.manifold(below, above, 0).is_empty() && contacts.manifold(above, above, 3).is_empty());
    };
    app.world_mut().run_system_once(read).expect("it runs");
}

#[test]
fn relative_velocities_are_those_of_the_contact_points() {
    let mut app = app();
    let turning = app.world_mut().spawn((surface(&sheet()), THIN)).id();
    let sliding = app.world_mut().spawn((surface(&ball()), THIN, at(0.7, 0.53, 0.4))).id();
    let floor = app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), at(0.0, -0.04, 0.0))).id();
    app.update();
    let read = move |contacts: SurfaceContacts, surfaces: bevy_ecs::system::Query<&SurfacePositions>| {
        let (spin, slide, rise) = (Vec3::new(0.0, 2.0, 0.0), Vec3::new(1.0, -3.0, 0.5), Vec3::new(0.0, 0.25, 0.0));
        let of_vertex = |entity, vertex: VertexId| {
            if entity == sliding {
                return slide;
            }
            spin.cross(surfaces.get(entity).expect("it is a surface").0[vertex.index()])
        };
        let of_shape = |entity, _| if entity == floor { rise } else { Vec3::NAN };
        for contact in contacts.between(turning, sliding) {
            let expected = slide - spin.cross(contact.points().0);
            let found = contact.relative_velocity(of_vertex, of_shape);
            assert!(found.distance(expected) < 1.0e-5, "{found} {expected}");
        }
        let on_floor: Vec<_> = contacts.between(floor, turning).collect();
        assert!(on_floor.len() > 10);
        for contact in on_floor {
            let expected = spin.cross(contact.points().1) - rise;
            assert!(contact.relative_velocity(of_vertex, of_shape).distance(expected) < 1.0e-5);
        }
    };
    app.world_mut().run_system_once(read).expect("it runs");
}
