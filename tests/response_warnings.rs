//! Warnings that the response logs, and how often. A separate process, because a logger captures the whole process.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::{
    scenes::{Mesh, cloth, icosphere},
    warnings::logged_by,
};
use glam::Vec3;

fn app() -> App {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
    app.init_resource::<Time>();
    app
}

fn add(app: &mut App, mesh: &Mesh, height: f32, material: XpbdMaterial, extra: impl Bundle) -> Entity {
    let points: Vec<Vec3> = mesh.positions.iter().map(|&point| Vec3::from(point) + Vec3::Y * height).collect();
    let (surface, positions) = DeformableSurface::from_mesh(&points, &mesh.triangles).unwrap();
    let body = XpbdBody::new(&surface, &positions, material).unwrap();
    app.world_mut().spawn((surface, positions, body, extra)).id()
}

fn tick(app: &mut App) {
    app.world_mut().resource_mut::<Time>().advance_by(Duration::from_secs_f64(1.0 / 60.0));
    app.update();
}

fn about<'a>(warnings: &'a [String], word: &str) -> Vec<&'a String> {
    warnings.iter().filter(|warning| warning.contains(word)).collect()
}

#[test]
fn a_fast_body_that_is_not_swept_is_warned_of_once() {
    let mut first = None;
    let warnings = logged_by(|| {
        let mut app = app();
        let sheet = cloth(8, 0.1);
        // The first body rests as long as there is no gravity.
        app.world_mut().resource_mut::<XpbdSettings>().gravity = Vec3::ZERO;
        add(&mut app, &sheet, 0.0, XpbdMaterial::CLOTH, ());
        let fast = add(&mut app, &sheet, 10.0, XpbdMaterial::CLOTH, ());
        app.world_mut().get_mut::<XpbdBody>(fast).unwrap().velocities.fill(Vec3::Y);
        first = Some(fast);
        (0..5).for_each(|_| tick(&mut app));
        app.world_mut().resource_mut::<XpbdSettings>().gravity = Vec3::NEG_Y * 100.0;
        (0..30).for_each(|_| tick(&mut app));
    });
    let fast = about(&warnings, "SweptCollision");
    assert_eq!(fast.len(), 1, "{warnings:?}");
    assert!(fast[0].contains(&first.unwrap().to_string()), "{fast:?}");
}

#[test]
fn a_swept_body_that_falls_and_comes_to_rest_is_not_warned_of() {
    let warnings = logged_by(|| {
        let mut app = app();
        app.world_mut().spawn((RigidShape(SharedShape::cuboid(2.0, 0.1, 2.0)), Transform::from_xyz(0.0, -0.1, 0.0)));
        app.world_mut().spawn((RigidShape(SharedShape::ball(0.2)), Transform::from_xyz(0.0, 0.2, 0.0)));
        add(&mut app, &cloth(12, 0.1), 1.5, XpbdMaterial::CLOTH, (SweptCollision, SelfCollision));
        (0..240).for_each(|_| {
            tick(&mut app);
            assert_eq!(app.world().resource::<XpbdDiagnostics>().impacts_remaining, 0);
        });
    });
    assert!(warnings.is_empty(), "{warnings:?}");
}

#[test]
fn a_body_between_two_jaws_is_warned_of_once_for_as_long_as_they_are_shut() {
    let warnings = logged_by(|| {
        let mut app = app();
        let jaw = || RigidShape(SharedShape::cuboid(1.0, 0.5, 1.0));
        let jaws = [1.2, -1.2].map(|height| app.world_mut().spawn((jaw(), Transform::from_xyz(0.0, height, 0.0))).id());
        add(&mut app, &icosphere(2, 0.5), 0.0, XpbdMaterial::SOFT, (SweptCollision, SelfCollision));
        let mut close = |ticks: usize, by: f32| {
            let mut squeezed = 0;
            for _ in 0..ticks {
                for (jaw, sign) in jaws.into_iter().zip([1.0, -1.0]) {
                    app.world_mut().get_mut::<Transform>(jaw).unwrap().translation.y -= sign * by;
                }
                tick(&mut app);
                let diagnostics = app.world().resource::<XpbdDiagnostics>();
                let is_told = diagnostics.impacts_remaining > 0 || diagnostics.inside > 0;
                squeezed += usize::from(is_told || !diagnostics.jammed.is_empty());
            }
            squeezed
        };
        let squeezed = close(40, 0.02);
        assert!(squeezed > 1, "{squeezed} ticks");
        close(40, -0.02);
        close(10, 0.0);
    });
    assert_eq!(about(&warnings, "squeezed").len(), 1, "{warnings:?}");
}

/// Cells of 0.1 m whose diagonals are 0.14 m long: two edges in three are 0.1 m.
#[test]
fn cloth_that_is_thicker_than_its_edges_are_long_is_named_when_it_is_made() {
    let sheet = cloth(8, 0.1);
    let spawn = |app: &mut App, thickness: f32, extra: (Name, SelfCollision)| {
        add(app, &sheet, 0.0, XpbdMaterial::CLOTH, (SurfaceThickness::World(thickness), SweptCollision, extra))
    };
    let said = |thickness: f32, scale: f32, ticks: usize| {
        logged_by(|| {
            let mut app = app();
            app.world_mut().resource_mut::<XpbdSettings>().gravity = Vec3::ZERO;
            let body = spawn(&mut app, thickness, (Name::new("Cape"), SelfCollision));
            app.world_mut().entity_mut(body).insert(Transform::from_scale(Vec3::splat(scale)));
            (0..ticks).for_each(|_| tick(&mut app));
            // Another mesh makes another body.
            if ticks > 2 {
                let points: Vec<Vec3> = sheet.positions.iter().map(|&point| Vec3::from(point)).collect();
                let other = DeformableSurface::from_mesh(&points, &sheet.triangles[1..]).unwrap();
                app.world_mut().entity_mut(body).insert(other);
                tick(&mut app);
            }
        })
    };
    // Twice the thickness is 0.098 m and 0.102 m, as seen from edges of 0.1 m; and of 0.2 m and 0.05 m.
    for (thickness, scale, is_thick) in
        [(0.049, 1.0, false), (0.051, 1.0, true), (0.098, 2.0, false), (0.026, 0.5, true)]
    {
        let warnings = said(thickness, scale, 2);
        assert_eq!(about(&warnings, "touches itself at rest").len(), usize::from(is_thick), "{warnings:?}");
        assert!(!is_thick || warnings[0].contains("(Cape)"), "{warnings:?}");
    }
    assert_eq!(about(&said(0.051, 1.0, 3), "touches itself at rest").len(), 2);
}

#[test]
fn thick_cloth_that_does_not_meet_itself_at_rest_is_not_warned_of() {
    let sheet = cloth(8, 0.1);
    let points: Vec<Vec3> = sheet.positions.iter().map(|&point| Vec3::from(point)).collect();
    let (surface, rest) = DeformableSurface::from_mesh(&points, &sheet.triangles).unwrap();
    let sewn = RestContactsIgnored::new(&surface, &rest.0, 0.12).unwrap();
    let warnings = logged_by(|| {
        let mut app = app();
        let thick = (SurfaceThickness::World(0.06), SweptCollision);
        add(&mut app, &sheet, 0.0, XpbdMaterial::CLOTH, thick);
        let body = XpbdBody::new(&surface, &rest, XpbdMaterial::CLOTH).unwrap();
        let far = SurfacePositions(rest.0.iter().map(|at| *at + Vec3::Y * 9.0).collect());
        app.world_mut().spawn((surface, far, body, thick, SelfCollision, sewn));
        (0..2).for_each(|_| tick(&mut app));
    });
    assert!(about(&warnings, "touches itself at rest").is_empty(), "{warnings:?}");
}

#[test]
fn what_is_quarantined_is_called_by_its_name() {
    let said = logged_by(|| {
        let mut app = app();
        let thickness = SurfaceThickness::World(-1.0);
        add(&mut app, &cloth(2, 0.1), 0.0, XpbdMaterial::CLOTH, (Name::new("Flag"), thickness));
        app.world_mut().spawn((Name::new("Crate"), RigidShape(SharedShape::ball(-1.0))));
        tick(&mut app);
    });
    let named: Vec<_> = ["(Flag)", "(Crate)"].map(|name| about(&said, name).len()).into();
    assert_eq!(named, [1, 1], "{said:?}");
}

#[test]
fn plugins_that_do_not_fit_are_named_and_stop_nothing() {
    let said = logged_by(|| {
        let mut app = App::new();
        app.add_plugins(XpbdResponsePlugin::new(Update)).init_resource::<Time>();
        app.finish();
        app.cleanup();
        tick(&mut app);
    });
    assert_eq!(about(&said, "do not move without DeformableCollisionPlugins").len(), 1, "{said:?}");
    let said = logged_by(|| {
        let mut app = App::new();
        app.add_plugins((DeformableCollisionPlugins::new(PostUpdate), XpbdResponsePlugin::new(Update)));
        app.init_resource::<Time>();
        app.finish();
        app.cleanup();
        tick(&mut app);
    });
    assert_eq!(about(&said, "the same schedule").len(), 1, "{said:?}");
}

#[test]
fn a_pin_that_is_no_vertex_is_named() {
    let said = logged_by(|| {
        let mesh = icosphere(0, 1.0);
        let points: Vec<Vec3> = mesh.positions.iter().map(|&point| Vec3::from(point)).collect();
        let (surface, positions) = DeformableSurface::from_mesh(&points, &mesh.triangles).unwrap();
        _ = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH).unwrap().pinned([VertexId(0), VertexId(99)]);
    });
    assert_eq!(about(&said, "vertex 99 cannot be pinned").len(), 1, "{said:?}");
}
