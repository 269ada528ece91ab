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
