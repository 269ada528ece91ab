//! Data that no method needs takes no memory.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature, prelude::*,
};
use bevy_ecs::{entity::EntityHashMap, prelude::*};
use circumsphere_support::scenes::cuboid;
use glam::Vec3;

use crate::world::{EXACT_METHODS, THIN, app, at, ball, insert, points, sheet, spawn, store, surface, write_positions};

/// The capacity, in triangles, of each per-triangle component: curvature, balls, spheres, cones.
fn held(app: &App, entity: Entity) -> [usize; 4] {
    let entity = app.world().entity(entity);
    let curvature =
        entity.get::<TriangleCurvature>().map_or(0, |it| it.curvatures.capacity().max(it.dihedrals.capacity()));
    let balls = entity.get::<EnclosingBalls>().map_or(0, |it| it.capacity());
    let spheres = entity.get::<Circumspheres>().map_or(0, |it| it.centers.capacity().max(it.radii.capacity()));
    let cones = entity.get::<TriangleCones>().map_or(0, |it| it.axes.capacity().max(it.cosines.capacity()));
    [curvature, balls, spheres, cones]
}

fn counts(app: &App, entity: Entity) -> [usize; 4] {
    let entity = app.world().entity(entity);
    [
        entity.get::<TriangleCurvature>().map_or(0, |it| it.curvatures.len()),
        entity.get::<EnclosingBalls>().map_or(0, |it| it.len()),
        entity.get::<Circumspheres>().map_or(0, |it| it.centers.len()),
        entity.get::<TriangleCones>().map_or(0, |it| it.axes.len()),
    ]
}

#[test]
fn spheres_are_held_only_while_a_method_asks_for_them() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let ball = spawn(&mut app, &ball(), (THIN, at(0.1, 0.53, 0.2)));
    let set_methods = |app: &mut App, method: ContactMethod| {
        insert(app, sheet, method);
        insert(app, ball, method);
        app.update();
        app.update();
    };
    for exact in EXACT_METHODS {
        set_methods(&mut app, exact);
        assert_eq!(held(&app, ball), [0; 4], "{exact:?}");
        assert_eq!(held(&app, sheet), [0; 4], "{exact:?}");

        set_methods(&mut app, ContactMethod::Circumsphere);
        assert_eq!(counts(&app, ball), [320, 0, 320, 320]);
        assert_eq!(counts(&app, sheet), [128, 0, 128, 128]);
        set_methods(&mut app, exact);
        assert_eq!(held(&app, ball), [0; 4], "{exact:?} after Circumsphere");
        assert_eq!(held(&app, sheet), [0; 4], "{exact:?} after Circumsphere");

        set_methods(&mut app, ContactMethod::BoundingSphere);
        assert_eq!(counts(&app, ball), [0, 320, 0, 0]);
        assert_eq!(counts(&app, sheet), [0, 128, 0, 0]);
        set_methods(&mut app, exact);
        assert_eq!(held(&app, ball), [0; 4], "{exact:?} after BoundingSphere");
        assert_eq!(held(&app, sheet), [0; 4], "{exact:?} after BoundingSphere");
    }
}

#[test]
fn a_surface_that_nothing_is_near_has_no_spheres_whatever_its_method() {
    let mut app = app();
    let lonely = spawn(&mut app, &ball(), (THIN, ContactMethod::Circumsphere));
    spawn(&mut app, &ball(), (THIN, ContactMethod::Circumsphere, at(9.0, 0.0, 0.0)));
    app.update();
    assert_eq!(held(&app, lonely), [0; 4]);
}

#[test]
fn spheres_follow_a_replaced_mesh() {
    let mut app = app();
    let method = ContactMethod::Circumsphere;
    spawn(&mut app, &sheet(), (THIN, method));
    let body = spawn(&mut app, &ball(), (THIN, method, at(0.1, 0.53, 0.2)));
    for (mesh, triangles) in [(cuboid([0.5; 3], 1), 12), (cuboid([0.5; 3], 9), 972), (ball(), 320)] {
        app.update();
        insert(&mut app, body, surface(&mesh));
        app.update();
        assert_eq!(counts(&app, body), [triangles, 0, triangles, triangles]);
    }
}

#[test]
fn unchanged_exact_surfaces_do_not_count_as_changed_spheres() {
    #[derive(Resource, Default)]
    struct Changes(usize);
    let mut app = app();
    app.init_resource::<Changes>();
    spawn(&mut app, &sheet(), THIN);
    spawn(&mut app, &ball(), (THIN, at(0.1, 0.53, 0.2)));
    app.update();
    app.add_systems(
        Last,
        |mut changes: ResMut<Changes>, spheres: Query<(), Or<(Changed<Circumspheres>, Changed<TriangleCones>)>>| {
            changes.0 += spheres.iter().count();
        },
    );
    app.update();
    app.world_mut().resource_mut::<Changes>().0 = 0;
    app.update();
    app.update();
    assert_eq!(app.world().resource::<Changes>().0, 0);
}

/// For each surface, whether its curvature, balls, spheres, and cones have changed since the last tick.
#[derive(Resource, Default)]
struct Written(EntityHashMap<[bool; 4]>);

type Parts = (
    Ref<'static, TriangleCurvature>,
    Ref<'static, EnclosingBalls>,
    Ref<'static, Circumspheres>,
    Ref<'static, TriangleCones>,
);

fn see_what_is_written(mut written: ResMut<Written>, surfaces: Query<(Entity, Parts)>) {
    written.0 = surfaces
        .iter()
        .map(|(surface, (curvature, balls, spheres, cones))| {
            (surface, [curvature.is_changed(), balls.is_changed(), spheres.is_changed(), cones.is_changed()])
        })
        .collect();
}

#[test]
fn a_surface_at_rest_keeps_its_spheres_while_others_move() {
    const BY_BALLS: [bool; 4] = [false, true, false, false];
    const BY_CAPS: [bool; 4] = [true, false, true, true];
    const NOTHING: [bool; 4] = [false; 4];
    for (method, all) in [(ContactMethod::BoundingSphere, BY_BALLS), (ContactMethod::Circumsphere, BY_CAPS)] {
        let mut app = app();
        app.init_resource::<Written>().add_systems(Last, see_what_is_written);
        let ground = spawn(&mut app, &sheet(), (THIN, method));
        let body = spawn(&mut app, &ball(), (THIN, method, at(0.1, 0.53, 0.2)));
        let tick = |app: &mut App, expected: [[bool; 4]; 2], what: &str| {
            app.update();
            assert!(store(app).touching_count() > 10, "{method:?}: {what}");
            let written = &app.world().resource::<Written>().0;
            assert_eq!([written[&ground], written[&body]], expected, "{method:?}: {what}");
        };
        // New components count as changed.
        app.update();
        app.update();
        let round = points(&ball());
        for by in [0.01, 0.02, 0.03] {
            let bent: Vec<Vec3> = round.iter().map(|&point| point + by * point.x * point.x).collect();
            write_positions(&mut app, body, &bent);
            tick(&mut app, [NOTHING, all], "the body bends");
        }
        insert(&mut app, body, at(0.1, 0.52, 0.2));
        tick(&mut app, [NOTHING, NOTHING], "the body moves without deforming");
        insert(&mut app, ground, Teleported);
        tick(&mut app, [all, NOTHING], "the ground is teleported");
        app.world_mut().resource_mut::<CircumsphereSettings>().sphere_offset = 0.4;
        tick(&mut app, [all, all], "settings change");
        app.world_mut().resource_mut::<CircumsphereSettings>().memory = false;
        tick(&mut app, [all, all], "memory is off");
        tick(&mut app, [all, all], "memory is off, in the next tick too");
    }
}
