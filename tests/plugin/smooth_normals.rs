//! Smooth normals of contacts: for bodies of every kind, at any pose, and only where there is something to smooth.

use bevy_app::prelude::*;
use bevy_circumsphere::{geometry::CreaseAngle, prelude::*};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, cuboid, icosphere};
use glam::{Quat, Vec3};

use crate::world::{
    THIN, all, app, assert_near_vector, at, ball, insert, place, rounding, sheet, spawn, surface, write_positions,
};

/// The contacts of two bodies: exact and smooth normal, both from the second to the first, and the distance.
type Normals = Vec<(Vec3, Vec3, f32)>;

fn normals(app: &mut App, a: Entity, b: Entity) -> Normals {
    app.update();
    read(app, a, b)
}

fn read(app: &mut App, a: Entity, b: Entity) -> Normals {
    let system = move |contacts: SurfaceContacts, smooth: SmoothNormals| -> Normals {
        contacts.between(a, b).map(|contact| (-contact.normal(), -smooth.of(&contact), contact.distance())).collect()
    };
    app.world_mut().run_system_once(system).expect("contacts can be read")
}

/// The largest error of exact and of smooth normals, as their distance from the true normal.
fn errors(normals: &Normals, truth: Vec3) -> (f32, f32) {
    let worst = |of: fn(&(Vec3, Vec3, f32)) -> Vec3| {
        normals.iter().map(|normals| of(normals).distance(truth)).fold(0.0, f32::max)
    };
    (worst(|normals| normals.0), worst(|normals| normals.1))
}

/// Bodies that can be placed on the sheet, with their names.
fn bodies(app: &mut App) -> Vec<(&'static str, Entity)> {
    let mut bodies = vec![
        ("ball", app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), Transform::default())).id()),
        ("capsule", app.world_mut().spawn((RigidShape(SharedShape::capsule_x(0.3, 0.5)), Transform::default())).id()),
        ("ball mesh", spawn(app, &ball(), THIN)),
    ];
    for (_, body) in &mut bodies {
        insert(app, *body, SurfaceDisabled);
    }
    bodies
}

#[test]
fn whatever_slides_over_a_sheet_feels_a_plane() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), SurfaceThickness::World(0.1));
    for (name, body) in bodies(&mut app) {
        app.world_mut().entity_mut(body).remove::<SurfaceDisabled>();
        let (mut contacts, mut ghosts) = (0, 0);
        for tick in 0..40 {
            // Over inner edges and vertices at every angle, from both sides of the sheet, and pressed into it.
            let height = [0.53, 0.505, 0.48][tick % 3];
            for side in [1.0, -1.0] {
                place(&mut app, body, Vec3::new(0.037 * tick as f32 - 0.7, side * height, 0.021 * tick as f32 - 0.4));
                insert(&mut app, body, Teleported);
                if name == "ball mesh" && height < 0.5 {
                    continue;
                }
                for (exact, smooth, _) in normals(&mut app, body, sheet) {
                    // The sheet is exactly flat.
                    assert_near_vector(smooth, Vec3::Y * side, 1.0e-6, (name, tick, side, exact));
                    contacts += 1;
                    ghosts += usize::from(exact.distance(Vec3::Y * side) > 0.1);
                }
            }
        }
        assert!(contacts > 100 && ghosts > 50, "{name}: {ghosts} of {contacts} exact normals lean");
        insert(&mut app, body, SurfaceDisabled);
    }
}

#[test]
fn balls_of_triangles_part_along_the_line_between_their_centers() {
    for method in ContactMethod::ALL.into_iter().filter(|&method| method != ContactMethod::BoundingSphere) {
        let mut app = app();
        let large = spawn(&mut app, &icosphere(2, 1.0), (THIN, method));
        let small = spawn(&mut app, &icosphere(2, 0.4), (THIN, method));
        let mut seen = 0;
        for turn in 0..24 {
            let line = Quat::from_rotation_y(0.26 * turn as f32) * Quat::from_rotation_z(0.37 * turn as f32) * Vec3::X;
            // For two one-sided bodies, the closest features tell how far they have passed each other.
            place(&mut app, small, line * [1.41, 1.39, 1.36][turn % 3]);
            let mut found = normals(&mut app, small, large);
            // If the two have passed each other, some exact normals lead back in. These are left as they are.
            found.retain(|(exact, smooth, _)| {
                let leads_out = exact.dot(line) > 0.1;
                assert!(leads_out || exact.dot(*smooth) > 0.0, "{method:?} {turn}: {exact} {smooth}");
                leads_out
            });
            if found.is_empty() {
                continue;
            }
            let (exact, smooth) = errors(&found, line);
            // Radii of curvature are estimated from facets. They deviate from the sphere by a tenth of the angle
            // between facets, 0.3.
            assert!(smooth <= 0.03, "{method:?} {turn}: {smooth}, exact {exact}");
            seen += usize::from(exact > 0.1);
        }
        assert!(seen > 8, "{method:?}: exact normals are wrong in only {seen} of 24 places");
    }
}

#[test]
fn what_slides_over_a_ball_of_triangles_feels_no_edges() {
    let mut app = app();
    let ground = spawn(&mut app, &icosphere(3, 3.0), SurfaceThickness::World(0.05));
    let ball = app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), Transform::default())).id();
    let mesh = spawn(&mut app, &icosphere(2, 0.5), SurfaceThickness::World(0.0));
    // A path that is tilted against the mesh, so that it crosses edges at all angles.
    let axis = Quat::from_rotation_x(0.4) * Quat::from_rotation_z(0.3);
    let turn = 0.002;
    let mut largest = [[0.0_f32; 2]; 2];
    let mut last: [Option<[Vec3; 2]>; 2] = [None; 2];
    for tick in 0..300 {
        let line = axis * (Quat::from_rotation_y(turn * tick as f32) * Vec3::X);
        for (side, body) in [ball, mesh].into_iter().enumerate() {
            insert(&mut app, [ball, mesh][1 - side], SurfaceDisabled);
            app.world_mut().entity_mut(body).remove::<SurfaceDisabled>();
            place(&mut app, body, line * 3.515);
            let found = normals(&mut app, body, ground);
            let deepest = found.iter().min_by(|one, other| one.2.total_cmp(&other.2)).expect("the bodies touch");
            let deepest = [deepest.0, deepest.1];
            if let Some(last) = last[side] {
                for kind in 0..2 {
                    largest[side][kind] = largest[side][kind].max(deepest[kind].distance(last[kind]));
                }
            }
            last[side] = Some(deepest);
        }
    }
    for [exact, smooth] in largest {
        // The line turns by `turn` per tick. Facets turn by 0.1. Radii from facets are off by 0.006 of that, the square
        // of half a triangle's angle.
        assert!(smooth <= turn + 6.0e-4, "{smooth}");
        assert!(exact > 5.0 * turn, "exact normals jump: {exact}");
    }
}

#[test]
fn a_plane_body_on_a_ball_of_triangles_has_the_planes_normal() {
    let mut app = app();
    let ball = spawn(&mut app, &icosphere(2, 1.0), THIN);
    let plank = app.world_mut().spawn((RigidShape(SharedShape::cuboid(2.0, 0.1, 2.0)), Transform::default())).id();
    let ground =
        app.world_mut().spawn((RigidShape(SharedShape::halfspace(parry3d::math::Vector::Y)), at(0.0, -9.0, 0.0))).id();
    let mut seen = 0;
    for tick in 0..20 {
        place(&mut app, ball, Vec3::new(0.03 * tick as f32, 0.0, 0.0));
        insert(&mut app, ball, Transform::from_rotation(Quat::from_rotation_x(0.11 * tick as f32)));
        place(&mut app, plank, Vec3::new(0.0, 1.12, 0.0));
        place(&mut app, ground, Vec3::new(0.0, -1.01, 0.0));
        for (other, normal) in [(plank, Vec3::NEG_Y), (ground, Vec3::Y)] {
            for (_, smooth, _) in normals(&mut app, ball, other) {
                assert_near_vector(smooth, normal, 1.0e-6, (tick, normal));
                seen += 1;
            }
        }
    }
    assert!(seen > 40, "{seen}");
}

#[test]
fn a_box_keeps_its_edges() {
    // A ball at an edge, a corner, and a face of a box: the smooth normals are those of the exact contact.
    let mut app = app();
    let block = spawn(&mut app, &cuboid([0.5, 0.5, 0.5], 3), THIN);
    let ball = app.world_mut().spawn((RigidShape(SharedShape::ball(0.3)), Transform::default())).id();
    for direction in [Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 2.0, 0.0), Vec3::new(3.0, 1.0, 2.0), Vec3::Z] {
        let nearest = direction.signum() * 0.5 * direction.abs().min(Vec3::ONE).ceil();
        let nearest = nearest + Vec3::new(0.0, 0.0, if direction.z == 0.0 { 0.07 } else { 0.0 });
        let outward = direction.normalize();
        place(&mut app, ball, nearest + outward * 0.32);
        let found = normals(&mut app, ball, block);
        let deepest = found.iter().min_by(|one, other| one.2.total_cmp(&other.2)).expect("the bodies touch");
        assert_near_vector(deepest.0, outward, 1.0e-5, direction);
        assert_near_vector(deepest.1, outward, 1.0e-5, direction);
    }
}

#[test]
fn a_vertex_in_a_solid_leaves_it_along_the_smooth_normal() {
    let dart = Mesh { positions: vec![[0.0; 3], [0.3, 1.0, 0.0], [-0.3, 1.0, 0.2]], triangles: vec![[0, 1, 2]] };
    let mut app = app();
    let solid = spawn(&mut app, &icosphere(2, 1.0), THIN);
    let dart = spawn(&mut app, &dart, THIN);
    let mut seen = 0;
    for turn in 0..20 {
        let outward = Quat::from_rotation_y(0.31 * turn as f32) * Quat::from_rotation_z(0.2 * turn as f32) * Vec3::Y;
        let pose = Transform::from_translation(outward * 0.95).with_rotation(Quat::from_rotation_arc(Vec3::Y, outward));
        insert(&mut app, dart, pose);
        let found = normals(&mut app, dart, solid);
        let deepest = found.iter().filter(|normals| normals.2 < 0.0).min_by(|one, other| one.2.total_cmp(&other.2));
        let Some((exact, smooth, _)) = deepest else { continue };
        // The smooth normal is radial at the foot of the perpendicular on the facet. This point is off the radius by
        // the depth times the error of the facet.
        assert_near_vector(*smooth, outward, 0.05 * exact.distance(outward).max(1.0e-3) * 1.5, turn);
        seen += usize::from(exact.distance(outward) > 0.02);
    }
    assert!(seen > 8, "{seen}");
}

#[test]
fn smooth_normals_follow_poses_and_sides() {
    let place = at(0.11, 1.02, 0.23).with_rotation(Quat::from_rotation_z(0.4));
    let under = |parent: Transform, scale: f32| {
        let mut app = app();
        let thin = SurfaceThickness::World(0.05 * scale);
        let parent = app.world_mut().spawn(parent).id();
        let first = spawn(&mut app, &icosphere(2, 0.6), (thin, ChildOf(parent)));
        let second = spawn(&mut app, &icosphere(3, 0.5), (thin, place, ChildOf(parent)));
        let found = normals(&mut app, first, second);
        let swapped = read(&mut app, second, first);
        assert_eq!(found.len(), swapped.len());
        for (one, other) in found.iter().zip(&swapped) {
            assert_eq!((one.0, one.1), (-other.0, -other.1), "from the other side");
        }
        found
    };
    let here = under(Transform::default(), 1.0);
    assert!(here.len() > 3 && here.iter().any(|(exact, smooth, _)| exact.distance(*smooth) > 0.05));
    for mirror in [Vec3::ONE, Vec3::new(-1.0, 1.0, 1.0), Vec3::new(1.0, -1.0, 1.0), Vec3::NEG_ONE] {
        for scale in [1.0, 3.0, 0.25] {
            let rotation = Quat::from_rotation_x(0.7) * Quat::from_rotation_y(-1.2);
            let parent = Transform::from_xyz(3.0, 2.0, -1.0).with_rotation(rotation).with_scale(mirror * scale);
            let there = under(parent, scale);
            assert_eq!(here.len(), there.len());
            for (one, other) in here.iter().zip(&there) {
                // Positions are rounded once more in the frame of the pair, which moves the contact points.
                assert_near_vector(other.1, rotation * (one.1 * mirror), 1.0e-4, (mirror, scale));
            }
        }
    }
}

#[test]
fn a_surface_may_be_gone_or_written_before_its_normals_are_read() {
    let mut app = app();
    let large = spawn(&mut app, &icosphere(2, 1.0), THIN);
    let small = spawn(&mut app, &icosphere(2, 0.4), (THIN, at(1.4, 0.05, 0.1)));
    let before = normals(&mut app, small, large);
    assert!(before.iter().any(|(exact, smooth, _)| exact.distance(*smooth) > 0.01));
    // Rotated about its center, the ball is as round as before.
    let turned: Vec<Vec3> =
        crate::world::points(&icosphere(2, 1.0)).iter().map(|point| Vec3::new(point.z, point.x, point.y)).collect();
    write_positions(&mut app, large, &turned);
    for (_, smooth, _) in read(&mut app, small, large) {
        assert!(smooth.is_normalized());
    }
    write_positions(&mut app, large, &[Vec3::NAN; 162]);
    write_positions(&mut app, small, &[]);
    for (exact, smooth, _) in read(&mut app, small, large) {
        assert_near_vector(smooth, exact, rounding(1.0), "the positions are unknown");
    }
    app.world_mut().despawn(large);
    app.world_mut().despawn(small);
    for (exact, smooth, _) in read(&mut app, small, large) {
        assert_near_vector(smooth, exact, rounding(1.0), "the surface is gone");
    }
}

#[test]
fn the_crease_angle_is_a_setting() {
    let mut app = app();
    let solid = spawn(&mut app, &icosphere(1, 1.0), THIN);
    let ball = app.world_mut().spawn((RigidShape(SharedShape::ball(0.3)), Transform::default())).id();
    let line = Vec3::new(0.3, 1.0, 0.2).normalize();
    place(&mut app, ball, line * 1.29);
    let round = errors(&normals(&mut app, ball, solid), line).1;
    app.world_mut().resource_mut::<CircumsphereSettings>().crease_angle = 0.0;
    let sharp = normals(&mut app, ball, solid);
    assert!(round < 0.03 && errors(&sharp, line).1 > 3.0 * round, "{round} {sharp:?}");
    // The exact normal is right at the closest point of a convex body, so no smooth normal has to be brought into
    // range.
    let deepest = sharp.iter().min_by(|one, other| one.2.total_cmp(&other.2)).expect("the bodies touch");
    assert_near_vector(deepest.1, deepest.0, 1.0e-5, "all edges are creases");
    // The method takes the crease angle as an argument, and positions from any source.
    let positions = surface(&icosphere(1, 1.0)).1.0;
    let system = move |contacts: SurfaceContacts, smooth: SmoothNormals| {
        for contact in contacts.iter() {
            let own = contact.smooth_normal(|_| Some(&positions), CreaseAngle::new(0.0));
            assert_eq!(own, smooth.of(&contact));
        }
        contacts.iter().count()
    };
    assert!(app.world_mut().run_system_once(system).expect("contacts can be read") > 0);
    assert!(!all(&mut app).is_empty());
}
