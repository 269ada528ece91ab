//! Which side is outside. For solids it follows from their mesh, for sheets from the previous ticks.

use bevy_app::prelude::*;
use bevy_circumsphere::{detection::DetectionDiagnostics, geometry::FeatureKind, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, cuboid, icosphere};
use glam::{Quat, Vec3};

use crate::world::{
    Seen, THIN, app, assert_all_consistent, assert_consistent, assert_near, assert_near_vector, at, ball, between,
    deepest, insert, points, rounding, sheet, spawn, surface, write_positions,
};

/// A triangle that points down. Its lowest vertex is the origin, and the others are 1 above it.
fn dart() -> Mesh {
    Mesh { positions: vec![[0.0, 0.0, 0.0], [0.3, 1.0, 0.0], [-0.3, 1.0, 0.2]], triangles: vec![[0, 1, 2]] }
}

fn vertex_face(contacts: &[Seen]) -> Vec<&Seen> {
    contacts.iter().filter(|contact| contact.kind == FeatureKind::VertexFace).collect()
}

#[test]
fn a_vertex_in_a_solid_is_pushed_out_of_the_nearest_face() {
    let mut app = app();
    let solid = spawn(&mut app, &cuboid([1.0, 1.0, 1.0], 1), THIN);
    let dart = spawn(&mut app, &dart(), THIN);
    for (outward, place) in [
        (Vec3::Y, Vec3::new(0.1, 0.96, 0.3)),
        (Vec3::NEG_Y, Vec3::new(0.1, -0.96, 0.3)),
        (Vec3::X, Vec3::new(0.96, 0.1, 0.3)),
        (Vec3::NEG_Z, Vec3::new(0.2, 0.1, -0.96)),
    ] {
        // The dart comes from outside, with its lowest vertex first.
        let rotation = Quat::from_rotation_arc(Vec3::Y, outward);
        insert(&mut app, dart, Transform::from_translation(place).with_rotation(rotation));
        app.update();
        let contacts = between(&mut app, dart, solid);
        let nearest = deepest(&contacts);
        assert_near(nearest.distance, -0.04, rounding(2.0), (outward, nearest));
        assert_near(nearest.separation, -0.14, rounding(2.0), outward);
        assert_near_vector(nearest.normal, -outward, rounding(2.0), outward);
        assert_all_consistent(app.world(), &contacts, 2.0);
        // Pushed out along the normal by its depth, it only just touches.
        insert(&mut app, dart, Transform::from_translation(place - nearest.normal * 0.04).with_rotation(rotation));
        app.update();
        assert_near(deepest(&between(&mut app, dart, solid)).distance, 0.0, rounding(2.0), outward);
    }
}

#[test]
fn nothing_outside_a_solid_has_a_negative_distance() {
    // Solids that are thinner and thicker than the contact distance, with several triangles per side, above, beside,
    // and at the corners of a sheet. The true distance is the height of the lowest point.
    for half_extents in [[0.5, 0.5, 0.5], [0.5, 0.02, 0.5], [0.02, 0.5, 0.3], [0.03, 0.03, 0.03], [2.5, 0.01, 2.5]] {
        for subdivisions in [1, 3] {
            for rotation in [Quat::IDENTITY, Quat::from_rotation_y(0.4), Quat::from_rotation_z(0.5)] {
                let mesh = cuboid(half_extents, subdivisions);
                let lowest = points(&mesh).iter().map(|point| (rotation * *point).y).fold(f32::INFINITY, f32::min);
                for place in [[0.1, 0.2], [0.0, 0.0], [1.9, 0.3], [2.0, 2.0]] {
                    for gap in [0.03, 0.005, 0.09] {
                        let mut app = app();
                        let sheet = spawn(&mut app, &sheet(), THIN);
                        let translation = Vec3::new(place[0], gap - lowest, place[1]);
                        let transform = Transform::from_translation(translation).with_rotation(rotation);
                        let solid = spawn(&mut app, &mesh, (THIN, transform));
                        app.update();
                        let contacts = between(&mut app, sheet, solid);
                        let what = (half_extents, subdivisions, rotation, place, gap);
                        for contact in &contacts {
                            assert!(contact.distance >= gap - rounding(4.0), "{what:?}: {contact:?}");
                            // A solid above the sheet separates when the sheet moves down, or sideways past its border.
                            assert!(contact.normal.y > -1.0e-3, "{what:?}: {contact:?}");
                        }
                        // The lowest corners of the largest solid are beside the sheet.
                        if place == [0.1, 0.2] && half_extents[0] < 2.0 {
                            assert_near(deepest(&contacts).distance, gap, rounding(4.0), what);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn two_solids_part_along_the_normal_from_one_to_the_other() {
    let mut app = app();
    let large = spawn(&mut app, &cuboid([1.0, 1.0, 1.0], 2), THIN);
    let small = spawn(&mut app, &ball(), THIN);
    for gap in [0.04, 0.01, -0.01, -0.03] {
        insert(&mut app, small, at(0.13, 1.5 + gap, 0.17));
        app.update();
        let contacts = between(&mut app, small, large);
        let nearest = deepest(&contacts);
        assert_near(nearest.distance, gap, rounding(2.0), (gap, nearest));
        assert_near_vector(nearest.normal, Vec3::NEG_Y, 1.0e-4, gap);
    }
}

#[test]
fn edges_of_solids_that_have_passed_each_other_are_as_deep_as_they_overlap() {
    // Two bars that lie across each other, each on an edge.
    let bar = |along_x: bool| if along_x { [2.0, 0.3, 0.3] } else { [0.3, 0.3, 2.0] };
    let on_edge = 0.3 * std::f32::consts::SQRT_2;
    for subdivisions in [1, 2] {
        let mut app = app();
        let lower = spawn(&mut app, &cuboid(bar(false), subdivisions), THIN);
        insert(&mut app, lower, Transform::from_rotation(Quat::from_rotation_z(std::f32::consts::FRAC_PI_4)));
        let upper = spawn(&mut app, &cuboid(bar(true), subdivisions), THIN);
        for gap in [0.04, -0.02, -0.06] {
            let turned = Quat::from_rotation_x(std::f32::consts::FRAC_PI_4);
            insert(&mut app, upper, at(0.11, 2.0 * on_edge + gap, 0.07).with_rotation(turned));
            app.update();
            let contacts = between(&mut app, upper, lower);
            let nearest = deepest(&contacts);
            assert_near(nearest.distance, gap, rounding(2.0), (gap, nearest));
            assert_eq!(nearest.kind, FeatureKind::EdgeEdge);
            assert_near_vector(nearest.normal, Vec3::NEG_Y, 1.0e-4, gap);
            assert_all_consistent(app.world(), &contacts, 2.0);
        }
    }
}

/// A body that may pass a sheet. Its lowest vertex is at the origin of its frame.
fn passers() -> [(&'static str, Mesh, Sidedness); 2] {
    [
        ("dart", dart(), Sidedness::Auto),
        ("ball taken as a sheet", icosphere(2, 0.02).translate([0.0, 0.02, 0.0]), Sidedness::TwoSided),
    ]
}

fn passing(app: &mut App, mesh: &Mesh, sidedness: Sidedness, ball_first: bool) -> (Entity, Entity) {
    let place = at(0.1, 0.03, 0.2);
    if ball_first {
        let passer = spawn(app, mesh, (THIN, sidedness, place));
        (spawn(app, &sheet(), THIN), passer)
    } else {
        (spawn(app, &sheet(), THIN), spawn(app, mesh, (THIN, sidedness, place)))
    }
}

#[track_caller]
fn assert_side(app: &mut App, sheet: Entity, passer: Entity, distance: f32, normal: Vec3, what: &str) {
    let contacts = between(app, passer, sheet);
    let contacts = vertex_face(&contacts);
    assert!(!contacts.is_empty(), "{what}");
    let lowest = contacts.iter().min_by(|a, b| a.points.0.y.total_cmp(&b.points.0.y)).expect("there is a contact");
    assert_near(lowest.distance, distance, rounding(1.0), what);
    for contact in contacts {
        assert_near_vector(contact.normal, -normal, rounding(1.0), what);
        assert_consistent(app.world(), contact, 4.0);
    }
}

#[test]
fn what_passes_a_sheet_between_two_ticks_stays_on_its_side() {
    for (name, mesh, sidedness) in passers() {
        for passer_first in [false, true] {
            let mut app = app();
            let (sheet, passer) = passing(&mut app, &mesh, sidedness, passer_first);
            app.update();
            assert_side(&mut app, sheet, passer, 0.03, Vec3::Y, name);
            for height in [-0.03, -0.06, -0.03, 0.02, -0.01] {
                insert(&mut app, passer, at(0.1, height, 0.2));
                app.update();
                assert_side(&mut app, sheet, passer, height, Vec3::Y, name);
            }
        }
    }
}

#[test]
fn a_sheet_that_passes_something_keeps_its_side_too() {
    let mut app = app();
    let (cloth, passer) = passing(&mut app, &dart(), Sidedness::Auto, false);
    app.update();
    for height in [0.06, -0.04, 0.08] {
        let moved: Vec<Vec3> = points(&sheet()).iter().map(|point| *point + Vec3::Y * height).collect();
        write_positions(&mut app, cloth, &moved);
        app.update();
        assert_side(&mut app, cloth, passer, 0.03 - height, Vec3::Y, "the sheet moves");
    }
}

#[test]
fn the_side_is_remembered_in_the_frame_of_the_bodies() {
    // Both are turned upside down while one passes the other.
    let mut app = app();
    let (sheet, passer) = passing(&mut app, &dart(), Sidedness::Auto, false);
    let parent = app.world_mut().spawn(Transform::default()).id();
    for child in [sheet, passer] {
        insert(&mut app, child, ChildOf(parent));
    }
    app.update();
    insert(&mut app, parent, Transform::from_rotation(Quat::from_rotation_x(std::f32::consts::PI)));
    insert(&mut app, passer, at(0.1, -0.03, 0.2));
    app.update();
    let contacts = between(&mut app, passer, sheet);
    let passed = vertex_face(&contacts)[0];
    assert_near(passed.distance, -0.03, rounding(1.0), passed);
    assert_near_vector(passed.normal, Vec3::Y, rounding(1.0), passed);
}

#[test]
fn whatever_breaks_with_the_past_forgets_the_side() {
    type Break = fn(&mut App, Entity, Entity);
    let breaks: [(&str, Break); 7] = [
        ("teleported body", |app, _, passer| insert(app, passer, Teleported)),
        ("teleported sheet", |app, sheet, _| insert(app, sheet, Teleported)),
        ("disabled for a tick", |app, sheet, _| {
            insert(app, sheet, SurfaceDisabled);
            app.update();
            app.world_mut().entity_mut(sheet).remove::<SurfaceDisabled>();
        }),
        ("made anew", |app, _, passer| insert(app, passer, surface(&dart()))),
        ("removed for a tick", |app, _, passer| {
            app.world_mut().entity_mut(passer).remove::<DeformableSurface>();
            app.update();
            insert(app, passer, surface(&dart()));
        }),
        ("quarantined for a tick", |app, sheet, _| {
            insert(app, sheet, SurfaceThickness::World(-1.0));
            app.update();
            insert(app, sheet, THIN);
        }),
        ("apart for a tick", |app, _, passer| {
            insert(app, passer, at(0.1, 5.0, 0.2));
            app.update();
            insert(app, passer, at(0.1, -0.03, 0.2));
        }),
    ];
    for (name, break_with_the_past) in breaks {
        let mut app = app();
        let (sheet, passer) = passing(&mut app, &dart(), Sidedness::Auto, false);
        // A dart that reaches through the sheet does not break with the past: only its lowest vertex is near, from
        // below.
        app.update();
        insert(&mut app, passer, at(0.1, -0.03, 0.2));
        app.update();
        assert_side(&mut app, sheet, passer, -0.03, Vec3::Y, name);
        break_with_the_past(&mut app, sheet, passer);
        app.update();
        assert_side(&mut app, sheet, passer, 0.03, Vec3::NEG_Y, name);
        // From now on, this is the side that it is on.
        insert(&mut app, passer, at(0.1, 0.02, 0.2));
        app.update();
        assert_side(&mut app, sheet, passer, -0.02, Vec3::NEG_Y, name);
    }
}

#[test]
fn a_margin_does_not_forget_the_side() {
    let mut app = app();
    app.insert_resource(CircumsphereSettings { margin: 0.1, ..Default::default() });
    let (sheet, passer) = passing(&mut app, &dart(), Sidedness::Auto, false);
    for height in [0.17, 0.05, -0.05, -0.17, -0.02, 0.03] {
        insert(&mut app, passer, at(0.1, height, 0.2));
        app.update();
        assert_side(&mut app, sheet, passer, height, Vec3::Y, "margin");
    }
}

#[test]
fn a_solid_has_no_memory() {
    let mut app = app();
    let (sheet, passer) =
        passing(&mut app, &cuboid([0.3, 0.3, 0.3], 1).translate([0.0, 0.3, 0.0]), Sidedness::Auto, false);
    for height in [0.03, -0.02, 0.03] {
        insert(&mut app, passer, at(0.1, height, 0.2));
        app.update();
        assert_near(deepest(&between(&mut app, passer, sheet)).distance, height, rounding(1.0), height);
    }
    // An open mesh can also be one-sided: a vertex below a one-sided floor has passed it.
    insert(&mut app, sheet, Sidedness::OneSided);
    insert(&mut app, passer, surface(&dart()));
    for height in [-0.02, 0.03, -0.03] {
        insert(&mut app, passer, (at(0.1, height, 0.2), Teleported));
        app.update();
        assert_side(&mut app, sheet, passer, height, Vec3::Y, "floor");
    }
}

#[test]
fn a_change_of_order_does_not_forget_the_side() {
    let tile =
        Mesh { positions: vec![[-3.0, 0.0, -3.0], [0.0, 0.0, 5.0], [5.0, 0.0, -3.0]], triangles: vec![[0, 1, 2]] };
    for (name, mesh, sidedness) in passers() {
        // Of two surfaces with the same number of triangles, the first one gives the frame.
        for floor in [sheet(), tile.clone()] {
            for turn in [0.0, 2.0] {
                let mut app = app();
                let place = |height: f32| at(0.1, height, 0.2).with_rotation(Quat::from_rotation_y(turn));
                let cloth = spawn(&mut app, &floor, THIN);
                let passer = spawn(&mut app, &mesh, (THIN, sidedness, place(0.03)));
                app.update();
                assert_side(&mut app, cloth, passer, 0.03, Vec3::Y, name);
                let steps = [(-0.03, [2, 1]), (-0.06, [1, 2]), (-0.06, [2, 1]), (0.02, [0, 0]), (-0.01, [9, 8])];
                for (height, [order_of_cloth, order_of_passer]) in steps {
                    insert(&mut app, cloth, SurfaceOrder(order_of_cloth));
                    insert(&mut app, passer, (SurfaceOrder(order_of_passer), place(height)));
                    app.update();
                    assert_side(&mut app, cloth, passer, height, Vec3::Y, name);
                }
            }
        }
    }
}

#[test]
fn a_change_of_order_does_not_forget_the_side_of_what_moves_a_little() {
    let mut app = app();
    let cloth = spawn(&mut app, &sheet(), THIN);
    let at_height = |height: f32| -> Vec<Vec3> {
        points(&dart()).iter().map(|&point| point + Vec3::new(0.1, height, 0.2)).collect()
    };
    let passer = spawn(&mut app, &dart(), THIN);
    let mut followed = 0;
    for step in 0..40_u16 {
        let height = 0.02 - 0.001 * f32::from(step);
        write_positions(&mut app, passer, &at_height(height));
        if step % 5 == 4 {
            let order = u32::from(step / 5) % 2;
            insert(&mut app, passer, SurfaceOrder(order));
            insert(&mut app, cloth, SurfaceOrder(1 - order));
        }
        app.update();
        assert_side(&mut app, cloth, passer, height, Vec3::Y, "small steps");
        followed += app.world().resource::<DetectionDiagnostics>().lists_reused;
    }
    assert!(followed > 5, "the pair does not use its list");
}
