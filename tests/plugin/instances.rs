//! Several entities from one mesh.

use std::sync::Arc;

use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::icosphere;
use glam::Vec3;

use crate::world::{
    OVER_A_FACE, THIN, app, assert_near, ball, between, deepest, insert, of, place, points, rounding, sheet, spawn,
    status, store, surface, write_positions,
};

#[test]
fn instances_share_the_adjacency_and_touch_on_their_own() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let mesh = icosphere(2, 0.3);
    let (prototype, positions) = surface(&mesh);
    let instances: Vec<Entity> =
        (0..5).map(|_| app.world_mut().spawn((prototype.instance(), positions.clone(), THIN)).id()).collect();
    for &instance in &instances {
        let own = app.world().get::<DeformableSurface>(instance).expect("the entity is a surface");
        assert!(Arc::ptr_eq(own.topology(), prototype.topology()));
        assert_eq!(own.mean_edge(), prototype.mean_edge());
    }
    // Each instance has its own height and shape. One shrinks to a tenth.
    for (number, &instance) in instances.iter().enumerate() {
        place(&mut app, instance, Vec3::new(-1.6 + 0.8 * number as f32, 3.0, 0.2));
    }
    app.update();
    assert_eq!(store(&app).pairs().len(), 0);
    place(&mut app, instances[1], Vec3::new(-0.8, 0.33, 0.2));
    let shrunk: Vec<Vec3> = points(&mesh).iter().map(|point| *point * 0.1).collect();
    write_positions(&mut app, instances[3], &shrunk);
    place(&mut app, instances[3], Vec3::new(0.8, 0.05, 0.2));
    app.update();
    assert_near(deepest(&between(&mut app, instances[1], sheet)).distance, 0.03, rounding(1.0), "lowered");
    assert_near(deepest(&between(&mut app, instances[3], sheet)).distance, 0.02, rounding(1.0), "shrunk");
    for untouched in [0, 2, 4] {
        assert_eq!(of(&mut app, instances[untouched]), []);
    }
    assert_eq!(store(&app).pairs().len(), 2);

    // One instance touches another.
    place(&mut app, instances[0], Vec3::new(0.0, 5.0, 0.0));
    place(&mut app, instances[2], Vec3::new(0.0, 5.63, 0.0));
    app.update();
    let poles = between(&mut app, instances[2], instances[0]);
    assert_near(deepest(&poles).distance, 0.03, rounding(6.0), "pole over pole");
}

#[test]
fn an_instance_waits_for_positions_of_its_own() {
    let mut app = app();
    let (prototype, positions) = surface(&ball());
    let instance = app.world_mut().spawn(prototype.instance()).id();
    app.update();
    assert_eq!(status(&app, instance), SurfaceStatus::Waiting);
    insert(&mut app, instance, positions);
    app.update();
    assert_eq!(status(&app, instance), SurfaceStatus::Active);
}

#[test]
fn an_instance_outlives_the_one_it_was_made_from() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), THIN);
    let first = spawn(&mut app, &ball(), THIN);
    let copy = app.world().get::<DeformableSurface>(first).expect("the entity is a surface").instance();
    let positions = app.world().get::<SurfacePositions>(first).expect("the entity is a surface").clone();
    app.update();
    app.world_mut().despawn(first);
    let second = app.world_mut().spawn((copy, positions, THIN)).id();
    place(&mut app, second, OVER_A_FACE + Vec3::Y * 0.53);
    app.update();
    assert_near(deepest(&between(&mut app, second, sheet)).distance, 0.03, rounding(1.0), "second");
}
