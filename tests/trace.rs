//! The promise of the feature `trace`: each stage has a span, in the order in which the stages run.

use std::{
    fmt::Debug,
    sync::{Arc, Mutex},
    time::Duration,
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    detection::DetectionDiagnostics,
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_time::Time;
use circumsphere_support::scenes::{Diagonals, grid};
use glam::Vec3;
use tracing::{
    Event, Metadata, Subscriber,
    field::{Field, Visit},
    span::{Attributes, Id, Record},
    subscriber::with_default,
};

/// What happens to spans: their names when they are entered, and `None` when one is left.
type Log = Arc<Mutex<Vec<Option<String>>>>;

/// Writes down spans of this crate.
struct Recorder {
    log: Log,
    /// The names of all spans, by number.
    names: Mutex<Vec<String>>,
}

/// The field `name` of a span.
#[derive(Default)]
struct Name(String);

impl Visit for Name {
    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "name" {
            value.clone_into(&mut self.0);
        }
    }

    fn record_debug(&mut self, _: &Field, _: &dyn Debug) {}
}

impl Subscriber for Recorder {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_span() && metadata.target().starts_with("bevy_circumsphere")
    }

    fn new_span(&self, span: &Attributes<'_>) -> Id {
        assert_eq!(span.metadata().name(), "collision stage");
        let mut name = Name::default();
        span.record(&mut name);
        let mut names = self.names.lock().expect("no thread has panicked");
        names.push(name.0);
        Id::from_u64(names.len() as u64)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, _: &Event<'_>) {}

    fn enter(&self, span: &Id) {
        let names = self.names.lock().expect("no thread has panicked");
        let name = names[span.into_u64() as usize - 1].clone();
        self.log.lock().expect("no thread has panicked").push(Some(name));
    }

    fn exit(&self, _: &Id) {
        self.log.lock().expect("no thread has panicked").push(None);
    }
}

#[test]
fn every_stage_has_a_span_that_ends_before_the_next_one_begins() {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update))).init_resource::<Time>();
    let sheet = grid(4, 4, 1.0, 1.0, Diagonals::Uniform);
    let mut spawn = |height: f32, method: ContactMethod| {
        let positions: Vec<Vec3> = sheet.positions.iter().map(|&point| Vec3::from(point) + Vec3::Y * height).collect();
        let (surface, positions) =
            DeformableSurface::from_mesh(&positions, &sheet.triangles).expect("the mesh is sound");
        let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH).expect("the mesh can be a body");
        app.world_mut().spawn((surface, positions, body, SurfaceThickness::World(0.05), method, SweptCollision));
    };
    spawn(0.0, ContactMethod::Exact);
    spawn(0.06, ContactMethod::Circumsphere);
    spawn(0.12, ContactMethod::Circumsphere);
    spawn(0.18, ContactMethod::BoundingSphere);
    spawn(0.24, ContactMethod::BoundingSphere);
    app.world_mut().resource_mut::<Time>().advance_by(Duration::from_millis(16));
    let log = Log::default();
    let recorder = Recorder { log: Arc::clone(&log), names: Mutex::default() };
    with_default(recorder, || app.update());
    let log = log.lock().expect("no thread has panicked");
    assert!(log.chunks(2).all(|both| both[0].is_some() && both[1].is_none()), "no span is in another one");
    let spans: Vec<&str> = log.iter().flatten().map(String::as_str).collect();
    // Stages that had nothing to do are not listed, but have a span.
    let mut left = spans.iter();
    let stages = &app.world().resource::<DetectionDiagnostics>().stages;
    assert!(stages.len() > 9, "{stages:?}");
    for stage in stages {
        assert!(left.any(|span| *span == stage.name), "{} has no span after those before it: {spans:?}", stage.name);
    }
    assert_eq!(spans[spans.len() - 3..], ["gather", "solve", "guard"]);
}
