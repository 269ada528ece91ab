//! Rigid shapes of every kind against surfaces, where the distance is known in closed form.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, grid};
use glam::{IVec3, Quat, Vec3};
use parry3d::{math::Pose as ParryPose, utils::Array2};

use crate::world::{
    Announcement::{Ended, Started},
    Seen, THIN, all, app, assert_all_consistent, assert_consistent, assert_near, assert_near_vector, assert_swapped,
    at, ball, between, deepest, insert, keep_journal, messages, observe, of, rounding, sheet, spawn, status,
};

/// A shape whose lowest point is `reach` below its center and above the inside of one of the sheet's faces.
struct Case {
    name: &'static str,
    shape: SharedShape,
    rotation: Quat,
    scale: f32,
    reach: f32,
}

fn cases() -> Vec<Case> {
    let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    let root = 3.0_f32.sqrt();
    // Rotates the diagonal of a cube straight down, so that the cube stands on its corner.
    let on_corner = Quat::from_rotation_arc(Vec3::ONE.normalize(), Vec3::NEG_Y);
    let octahedron = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|corner| corner * 0.4);
    let hull = || SharedShape::convex_hull(&octahedron).expect("an octahedron is convex");
    let mut cases = Vec::new();
    for scale in [1.0, 0.5, 2.0] {
        let mut case = |name, shape, rotation, reach: f32| {
            cases.push(Case { name, shape, rotation, scale, reach: reach * scale });
        };
        case("ball", SharedShape::ball(0.4), Quat::from_rotation_x(1.0), 0.4);
        case("cuboid", SharedShape::cuboid(0.3, 0.2, 0.4), Quat::IDENTITY, 0.2);
        case("cuboid on its side", SharedShape::cuboid(0.3, 0.2, 0.4), quarter, 0.3);
        case("cube on its corner", SharedShape::cuboid(0.2, 0.2, 0.2), on_corner, 0.2 * root);
        case("capsule standing", SharedShape::capsule_y(0.3, 0.2), Quat::IDENTITY, 0.5);
        case("capsule lying", SharedShape::capsule_y(0.3, 0.2), quarter, 0.2);
        case("octahedron", hull(), Quat::IDENTITY, 0.4);
        case("octahedron on its side", hull(), Quat::from_rotation_arc(Vec3::ONE.normalize(), Vec3::Y), 0.4 / root);
        case("half-space", SharedShape::halfspace(Vec3::NEG_Y), Quat::IDENTITY, 0.0);
        case("half-space, turned", SharedShape::halfspace(Vec3::X), quarter.inverse(), 0.0);
        case("cylinder", SharedShape::cylinder(0.3, 0.2), Quat::IDENTITY, 0.3);
        case("cylinder lying", SharedShape::cylinder(0.3, 0.2), quarter, 0.2);
        case("cone", SharedShape::cone(0.3, 0.2), Quat::IDENTITY, 0.3);
        case("cone on its apex", SharedShape::cone(0.3, 0.2), quarter * quarter, 0.3);
        case("rounded cuboid", SharedShape::round_cuboid(0.2, 0.1, 0.2, 0.05), Quat::IDENTITY, 0.15);
        case("rounded cylinder", SharedShape::round_cylinder(0.3, 0.2, 0.05), quarter, 0.25);
        case("rounded cone", SharedShape::round_cone(0.3, 0.2, 0.05), quarter * quarter, 0.35);
    }
    cases
}

fn tolerance() -> f32 {
    2.0 * rounding(2.0)
}

#[test]
fn the_separation_of_a_shape_over_a_sheet_is_its_height() {
    for case in cases() {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), THIN);
        let shape = app.world_mut().spawn(RigidShape(case.shape.clone())).id();
        for gap in [0.03, 0.01, 0.049, 0.2, 0.04] {
            let transform =
                at(0.1, case.reach + gap, 0.2).with_rotation(case.rotation).with_scale(Vec3::splat(case.scale));
            insert(&mut app, shape, transform);
            app.update();
            let what = (case.name, case.scale, gap);
            assert_eq!(status(&app, shape), SurfaceStatus::Active, "{what:?}");
            let contacts = between(&mut app, sheet, shape);
            if gap > 0.1 {
                assert_eq!(contacts, [], "{what:?}");
                continue;
            }
            assert!(!contacts.is_empty(), "{what:?}");
            let nearest = deepest(&contacts);
            assert_near(nearest.distance, gap, tolerance(), what);
            assert_near(nearest.separation, gap - 0.05, tolerance(), what);
            assert_near_vector(nearest.normal, Vec3::Y, tolerance(), what);
            assert_near(nearest.points.0.y, 0.0, tolerance(), what);
            assert_near(nearest.points.1.y, gap, tolerance(), what);
            assert_eq!((nearest.a, nearest.b), (ContactSide::Surface(sheet), ContactSide::Shape(shape)));
            for contact in &contacts {
                assert_consistent(app.world(), contact, 4.0);
            }
            let swapped = between(&mut app, shape, sheet);
            assert_eq!(contacts.len(), swapped.len());
            contacts.iter().zip(&swapped).for_each(|(one, other)| assert_swapped(one, other));
            assert_eq!(of(&mut app, shape), swapped);
            assert_eq!(all(&mut app), contacts);
        }
    }
}

#[test]
fn a_sheet_through_a_ball_is_as_deep_as_the_ball_reaches_past_it() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let ball = app.world_mut().spawn(RigidShape(SharedShape::ball(0.4))).id();
    for height in [0.3, 0.1, -0.1, -0.3] {
        insert(&mut app, ball, at(0.1, height, 0.2));
        app.update();
        let contacts = between(&mut app, sheet, ball);
        let nearest = deepest(&contacts);
        assert_near(nearest.distance, height.abs() - 0.4, rounding(1.0), height);
        assert_near_vector(nearest.normal, Vec3::Y * height.signum(), rounding(1.0), height);
        assert_all_consistent(app.world(), &contacts, 4.0);
    }
    // Through the exact center, no side is nearer. The depth is the radius, and there is still a direction.
    insert(&mut app, ball, at(0.1, 0.0, 0.2));
    app.update();
    let contacts = between(&mut app, sheet, ball);
    assert_near(deepest(&contacts).distance, -0.4, rounding(1.0), "center");
    assert_near(deepest(&contacts).normal.y.abs(), 1.0, rounding(1.0), "center");
}

#[test]
fn a_vertex_inside_a_shape_is_as_deep_as_the_nearest_way_out() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let cuboid = app.world_mut().spawn((RigidShape(SharedShape::cuboid(0.2, 0.3, 0.2)), at(0.05, 0.25, 0.0))).id();
    app.update();
    // Only the vertex at the origin is inside. It is 0.05 above the bottom and farther from every side.
    let contacts = between(&mut app, sheet, cuboid);
    let nearest = deepest(&contacts);
    assert_near(nearest.distance, -0.05, rounding(1.0), nearest);
    assert_near_vector(nearest.normal, Vec3::Y, rounding(1.0), nearest);
    assert_near_vector(nearest.points.0, Vec3::ZERO, rounding(1.0), nearest);
    assert_near_vector(nearest.points.1, Vec3::NEG_Y * 0.05, rounding(1.0), nearest);
    assert_all_consistent(app.world(), &contacts, 4.0);
}

#[test]
fn shapes_announce_their_contacts_and_never_touch_each_other() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let events = ContactEventsEnabled;
    let sheet = spawn(&mut app, &sheet(), THIN);
    let shape = app.world_mut().spawn((RigidShape(SharedShape::ball(0.4)), at(0.1, 0.42, 0.2), events)).id();
    let twin = app.world_mut().spawn((RigidShape(SharedShape::ball(0.4)), at(0.1, 0.42, 0.2), events)).id();
    observe(&mut app, shape);
    app.update();
    assert_eq!(messages(&mut app), [Started(sheet, shape), Started(sheet, twin)]);
    insert(&mut app, twin, SurfaceDisabled);
    app.update();
    assert_eq!(messages(&mut app), [Ended(sheet, twin)]);
    assert_eq!(status(&app, twin), SurfaceStatus::Disabled);
    app.world_mut().entity_mut(twin).remove::<SurfaceDisabled>();
    app.update();
    assert_eq!(messages(&mut app), [Started(sheet, twin)]);
    app.world_mut().entity_mut(twin).remove::<RigidShape>();
    app.update();
    assert_eq!(messages(&mut app), [Ended(sheet, twin)]);
    // Another shape on the same entity, which also touches.
    insert(&mut app, shape, RigidShape(SharedShape::cuboid(0.4, 0.4, 0.4)));
    app.update();
    assert_eq!(messages(&mut app), []);
    app.world_mut().despawn(shape);
    app.update();
    assert_eq!(messages(&mut app), [Ended(sheet, shape)]);
    assert_eq!(all(&mut app), []);
}

#[test]
fn a_replaced_shape_is_the_new_one_at_once_even_while_it_was_disabled() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let shape = app.world_mut().spawn((RigidShape(SharedShape::ball(0.4)), at(0.1, 0.42, 0.2))).id();
    app.update();
    assert_near(deepest(&between(&mut app, sheet, shape)).distance, 0.02, rounding(1.0), "ball");
    insert(&mut app, shape, SurfaceDisabled);
    app.update();
    insert(&mut app, shape, RigidShape(SharedShape::ball(0.41)));
    app.update();
    app.world_mut().entity_mut(shape).remove::<SurfaceDisabled>();
    app.update();
    assert_near(deepest(&between(&mut app, sheet, shape)).distance, 0.01, rounding(1.0), "larger ball");
    app.world_mut().entity_mut(shape).remove::<RigidShape>();
    app.update();
    insert(&mut app, shape, RigidShape(SharedShape::ball(0.39)));
    app.update();
    assert_near(deepest(&between(&mut app, sheet, shape)).distance, 0.03, rounding(1.0), "smaller ball");
}

#[test]
fn a_ball_that_falls_on_a_floor_touches_it_with_its_lowest_vertices() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let floor = app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), at(0.0, -1.0, 0.0))).id();
    let mesh = ball();
    let ball = spawn(&mut app, &mesh, (THIN, ContactEventsEnabled));
    let mut touched_before = false;
    for step in 0..40 {
        let height = 0.2 - 0.02 * step as f32;
        insert(&mut app, ball, at(0.3, height, -0.2));
        app.update();
        // Against a plane, the true distance is the height of each vertex.
        let heights: Vec<f32> = mesh.positions.iter().map(|position| position[1] + height + 1.0).collect();
        let contacts = between(&mut app, ball, floor);
        let touching: Vec<usize> = (0..heights.len()).filter(|&vertex| heights[vertex] <= 0.05).collect();
        // A height on the threshold may be rounded to either side of it.
        let uncertain = heights.iter().filter(|height| (**height - 0.05).abs() < rounding(1.5)).count();
        assert!(contacts.len().abs_diff(touching.len()) <= uncertain, "at {height}");
        for contact in &contacts {
            assert_eq!(contact.stencil.len(), 1, "{contact:?}");
            let vertex = contact.stencil[0].vertex.index();
            assert_near(contact.distance, heights[vertex], rounding(1.5), contact);
            assert_near_vector(contact.normal, Vec3::NEG_Y, rounding(1.0), contact);
            assert_near(contact.points.1.y, -1.0, rounding(1.5), contact);
            assert_consistent(app.world(), contact, 2.0);
        }
        let touches = !contacts.is_empty();
        let expected = if touches && !touched_before { vec![Started(ball, floor)] } else { vec![] };
        assert_eq!(messages(&mut app), expected, "at {height}");
        touched_before = touches;
    }
    assert!(touched_before);
}

#[test]
fn a_large_face_touches_a_small_shape_over_its_middle() {
    // No vertex and no edge is near: the contact is with the inside of one face.
    let mut app = app();
    let face = spawn(&mut app, &grid(1, 1, 100.0, 100.0, Diagonals::Uniform), THIN);
    for (shape, reach) in [
        (SharedShape::ball(0.1), 0.1),
        (SharedShape::capsule_y(0.1, 0.1), 0.2),
        (SharedShape::cuboid(0.1, 0.1, 0.1), 0.1),
    ] {
        let shape = app.world_mut().spawn((RigidShape(shape), at(20.0, reach + 0.02, 7.0))).id();
        app.update();
        let contacts = between(&mut app, face, shape);
        assert_near(deepest(&contacts).distance, 0.02, rounding(50.0), "over");
        // The face crosses the shape: the shape's edges pierce it, or the shape's center is nearer than its radius.
        insert(&mut app, shape, at(20.0, 0.05, 7.0));
        app.update();
        let contacts: Vec<Seen> = between(&mut app, face, shape);
        assert!(!contacts.is_empty() && deepest(&contacts).distance <= 0.0, "{contacts:?}");
        app.world_mut().despawn(shape);
    }
}

#[test]
fn shapes_of_every_other_kind_are_as_far_as_their_lowest_point() {
    let [a, b, c] = [Vec3::new(-0.3, 0.0, -0.3), Vec3::new(0.3, 0.0, -0.3), Vec3::new(0.0, 0.0, 0.4)];
    let corners = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|corner| corner * 0.3);
    let compound = SharedShape::compound(vec![
        (ParryPose::from_translation(Vec3::new(-0.2, 0.2, 0.0)), SharedShape::ball(0.2)),
        (ParryPose::from_translation(Vec3::new(0.3, 0.3, 0.0)), SharedShape::cuboid(0.1, 0.1, 0.1)),
    ]);
    let flat = Array2::new(3, 3, vec![0.0; 9]);
    let rounded_hull = SharedShape::round_convex_hull(&corners, 0.05).expect("an octahedron is convex");
    for (name, shape, reach) in [
        ("mesh", SharedShape::trimesh(vec![a, b, c], vec![[0, 1, 2]]).expect("one triangle is a valid mesh"), 0.0),
        ("height field", SharedShape::heightfield(flat, Vec3::new(0.5, 1.0, 0.5)), 0.0),
        ("voxels", SharedShape::voxels(Vec3::splat(0.2), &[IVec3::ZERO, IVec3::X, IVec3::Y]), 0.0),
        ("polyline", SharedShape::polyline(vec![a, b, c], None), 0.0),
        ("triangle", SharedShape::triangle(a, b, c), 0.0),
        ("segment", SharedShape::segment(a, b), 0.0),
        ("compound", compound, 0.0),
        ("rounded triangle", SharedShape::round_triangle(a, b, c, 0.1), 0.1),
        ("rounded hull", rounded_hull, 0.35),
    ] {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), THIN);
        let shape = app.world_mut().spawn(RigidShape(shape)).id();
        for gap in [0.03, 0.01, 0.2] {
            insert(&mut app, shape, at(0.1, reach + gap, 0.2));
            app.update();
            assert_eq!(status(&app, shape), SurfaceStatus::Active, "{name}");
            let contacts = between(&mut app, sheet, shape);
            assert_eq!(contacts.is_empty(), gap > 0.1, "{name}");
            if gap < 0.1 {
                assert_near(deepest(&contacts).distance, gap, tolerance(), (name, gap));
                assert_near_vector(deepest(&contacts).normal, Vec3::Y, tolerance(), (name, gap));
                assert_all_consistent(app.world(), &contacts, 4.0);
            }
        }
    }
}

#[test]
fn a_shape_moved_by_a_parent_is_where_its_parent_is() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let parent = app.world_mut().spawn(Transform::default()).id();
    let shape = app.world_mut().spawn((RigidShape(SharedShape::ball(0.4)), at(0.1, 0.0, 0.2), ChildOf(parent))).id();
    for gap in [0.02, 0.3, 0.04] {
        insert(&mut app, parent, at(0.0, 0.4 + gap, 0.0));
        app.update();
        let contacts = between(&mut app, sheet, shape);
        assert_eq!(contacts.is_empty(), gap > 0.05);
        if !contacts.is_empty() {
            assert_near(deepest(&contacts).distance, gap, rounding(1.0), gap);
        }
    }
}
