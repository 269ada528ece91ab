//! Cost of the response per contact: a tick of a stack of sheets at rest, with and without the response.
//!
//! Every tick is detected from scratch. Items are contacts that the solver watches, so the difference of the two times
//! per item is the cost of the response to one contact.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings,
    prelude::*,
    response::{XpbdBody, XpbdDiagnostics, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_time::Time;
use circumsphere_support::scenes::cloth_layers;
use divan::{Bencher, counter::ItemsCount};
use glam::Vec3;

const TICK: Duration = Duration::from_nanos(1_000_000_000 / 60);

/// Five sheets of 20 by 20 vertices on the ground, after two seconds.
fn stack() -> App {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
    app.insert_resource(CircumsphereSettings { threads: 1, memory: false, ..CircumsphereSettings::default() });
    app.init_resource::<Time>();
    app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
    for (layer, mesh) in cloth_layers(5, 20, 0.025, 0.006).into_iter().enumerate() {
        let mesh = mesh.rotate([0.0, 1.0, 0.0], 0.2 * layer as f32).translate([0.0, 0.006, 0.0]);
        let positions: Vec<Vec3> = mesh.positions.into_iter().map(Vec3::from_array).collect();
        let (surface, positions) =
            DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("a sheet is a mesh");
        let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH).expect("cloth is a material");
        app.world_mut().spawn((surface, positions, body, SurfaceThickness::World(0.002)));
    }
    app.finish();
    app.cleanup();
    (0..120).for_each(|_| tick(&mut app, TICK));
    app
}

fn tick(app: &mut App, duration: Duration) {
    app.world_mut().resource_mut::<Time>().advance_by(duration);
    app.update();
}

#[divan::bench(args = [false, true])]
fn stack_at_rest(bencher: Bencher, with_response: bool) {
    let mut app = stack();
    let contacts = app.world().resource::<XpbdDiagnostics>().contacts;
    // A tick of zero duration runs detection, but no response.
    let duration = if with_response { TICK } else { Duration::ZERO };
    bencher.counter(ItemsCount::new(contacts)).bench_local(move || tick(&mut app, duration));
}
