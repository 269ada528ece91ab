//! The promises of the feature `diagnostic`: what the stages did is in the store of diagnostics, tick by tick.

use std::{collections::BTreeSet, time::Duration};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CollisionDiagnosticsPlugin, ContactStore,
    detection::{DetectionDiagnostics, StageDiagnostics},
    prelude::*,
    response::{XpbdBody, XpbdDiagnostics, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_diagnostic::{DiagnosticPath, DiagnosticsStore};
use bevy_time::Time;
use circumsphere_support::scenes::{Diagonals, grid, icosphere};
use glam::Vec3;

/// Sheets and a ball that touch each other by all methods, with smooth surfaces and filters, so that every stage runs.
fn app(has_response: bool) -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update)).init_resource::<Time>();
    app.add_plugins(TetrahedralContainmentPlugin);
    if has_response {
        app.add_plugins(XpbdResponsePlugin::new(Update));
    }
    app.add_plugins(CollisionDiagnosticsPlugin::new(Update));
    app.finish();
    app.cleanup();
    let sheet = grid(4, 4, 1.0, 1.0, Diagonals::Uniform);
    let mut spawn = |height: f32, method: ContactMethod, shape: SurfaceShape| {
        let positions: Vec<Vec3> = sheet.positions.iter().map(|&point| Vec3::from(point) + Vec3::Y * height).collect();
        let (surface, positions) =
            DeformableSurface::from_mesh(&positions, &sheet.triangles).expect("the mesh is sound");
        let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH).expect("the mesh can be a body");
        let extra = (SurfaceThickness::World(0.05), method, shape, SweptCollision);
        app.world_mut().spawn((surface, positions, body, extra));
    };
    for (place, method) in
        [(0, ContactMethod::Exact), (1, ContactMethod::Circumsphere), (2, ContactMethod::BoundingSphere)]
    {
        spawn(0.2 * place as f32, method, SurfaceShape::Flat);
        spawn(0.2 * place as f32 + 0.06, method, SurfaceShape::Flat);
    }
    spawn(0.6, ContactMethod::Exact, SurfaceShape::Smooth);
    let ball = icosphere(1, 0.3);
    let points: Vec<Vec3> = ball.positions.iter().map(|&point| Vec3::from(point) + Vec3::Y * 0.9).collect();
    let ball = DeformableSurface::from_mesh(&points, &ball.triangles).expect("the mesh is sound");
    app.world_mut().spawn((ball, SurfaceShape::Smooth, SurfaceThickness::World(0.05)));
    app.insert_resource(ContactFilter::new(|pair| !pair.triangle_a.0.is_multiple_of(5)));
    app
}

fn tick(app: &mut App) {
    app.world_mut().resource_mut::<Time>().advance_by(Duration::from_millis(16));
    app.update();
}

fn value(app: &App, path: &str) -> Option<f64> {
    let store = app.world().resource::<DiagnosticsStore>();
    store.get_measurement(&DiagnosticPath::new(path.to_owned())).map(|measurement| measurement.value)
}

#[test]
fn the_store_has_what_every_stage_did() {
    let mut app = app(true);
    for _ in 0..3 {
        tick(&mut app);
        let detection = app.world().resource::<DetectionDiagnostics>();
        let mut ran = BTreeSet::new();
        for StageDiagnostics { name, duration, pairs_in, pairs_out } in &detection.stages {
            assert!(CollisionDiagnosticsPlugin::STAGES.contains(name), "{name} has no entry");
            assert!(ran.insert(*name), "{name} ran once");
            let of = |what: &str| value(&app, &format!("collision/{}/{what}", name.replace(' ', "_")));
            assert_eq!(of("time"), Some(duration.as_secs_f64() * 1.0e3), "{name}");
            assert_eq!(of("pairs_in"), Some(*pairs_in as f64), "{name}");
            assert_eq!(of("pairs_out"), Some(*pairs_out as f64), "{name}");
        }
        for name in CollisionDiagnosticsPlugin::STAGES.iter().filter(|name| !ran.contains(**name)) {
            let time = value(&app, &format!("collision/{}/time", name.replace(' ', "_")));
            assert_eq!(time, Some(0.0), "{name} did not run");
        }
        assert!(ran.len() > 10, "{ran:?}");
        assert_eq!(value(&app, "collision/time"), Some(detection.total().as_secs_f64() * 1.0e3));
        let store = app.world().resource::<ContactStore>();
        assert!(store.contact_count() > 50);
        assert_eq!(value(&app, "collision/contacts"), Some(store.contact_count() as f64));
        assert_eq!(value(&app, "collision/touching"), Some(store.touching_count() as f64));
        let response = app.world().resource::<XpbdDiagnostics>();
        assert_eq!(response.bodies, 7);
        for (path, count) in [
            ("bodies", response.bodies),
            ("asleep", response.asleep),
            ("contacts", response.contacts),
            ("impacts", response.impacts),
        ] {
            assert_eq!(value(&app, &format!("collision/response/{path}")), Some(count as f64), "{path}");
        }
        for (path, time) in [("gather", response.gathering), ("solve", response.solving), ("guard", response.guarding)]
        {
            let milliseconds = value(&app, &format!("collision/response/{path}/time"));
            assert_eq!(milliseconds, Some(time.as_secs_f64() * 1.0e3), "{path}");
            assert!(milliseconds > Some(0.0));
        }
    }
    let history = app.world().resource::<DiagnosticsStore>().get(&DiagnosticPath::new("collision/exact/time"));
    assert_eq!(history.expect("it is registered").history_len(), 3, "one measurement a tick");
}

#[test]
fn without_a_response_its_entries_are_off() {
    let mut app = app(false);
    tick(&mut app);
    assert!(value(&app, "collision/contacts").is_some_and(|contacts| contacts > 50.0));
    assert_eq!(value(&app, "collision/response/bodies"), None);
    let store = app.world().resource::<DiagnosticsStore>();
    let enabled = store.iter().filter(|diagnostic| diagnostic.is_enabled);
    assert_eq!(enabled.count(), 3 + 3 * CollisionDiagnosticsPlugin::STAGES.len());
}
