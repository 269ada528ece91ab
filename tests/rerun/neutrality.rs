//! Contacts, events, and remembered state are bit-identical, whatever is recorded.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    debug::{DeformableRerunPlugin, RerunSettings},
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};
use rerun::sink::MemorySinkStorage;

use crate::world::{Scene, everything, near, place, stream};

const TICKS: u32 = 9;

/// Messages and entity events, in the order in which they arrived.
#[derive(Resource, Default)]
struct Journal(Vec<String>);

fn read(
    names: Query<&Name>,
    mut journal: ResMut<Journal>,
    mut started: MessageReader<SurfaceContactStart>,
    mut ended: MessageReader<SurfaceContactEnd>,
    mut quarantined: MessageReader<SurfaceQuarantined>,
) {
    let name = |entity| names.get(entity).map_or("gone", Name::as_str).to_owned();
    let lines = started.read().map(|message| format!("started {} {}", name(message.entity), name(message.other)));
    let mut lines: Vec<String> = lines.collect();
    lines.extend(ended.read().map(|message| format!("ended {} {}", name(message.entity), name(message.other))));
    lines.extend(quarantined.read().map(|message| format!("{} {:?}", name(message.entity), message.reason)));
    journal.0.append(&mut lines);
}

fn observe(on: On<SurfaceContactStart>, names: Query<&Name>, mut journal: ResMut<Journal>) {
    let name = |entity| names.get(entity).map_or("gone", Name::as_str).to_owned();
    journal.0.push(format!("observed {} {}", name(on.entity), name(on.other)));
}

/// The store by names, for a bitwise comparison: `Debug` writes the shortest number that reads back as the same float.
fn fingerprint(app: &App, scene: &Scene) -> Vec<String> {
    let store = app.world().resource::<ContactStore>();
    let mut lines = vec![format!("tick {}", store.tick())];
    for pair in store.pairs() {
        let name = scene.pair_name(pair.a.entity(), pair.b.entity());
        lines.push(format!("{name} {} {} {:?}", pair.contact_distance, pair.nearest, pair.frame_pose));
        lines.extend(pair.contacts.iter().map(|contact| format!("{contact:?}")));
        lines.extend(pair.touching.iter().map(|touching| format!("{touching:?}")));
    }
    lines
}

/// How a run is recorded.
#[derive(Clone, Debug)]
enum Recording {
    Absent,
    NoSink,
    Of(RerunSettings),
}

struct Outcome {
    ticks: Vec<Vec<String>>,
    journal: Vec<String>,
    messages: usize,
    penetrating: usize,
}

fn run(method: ContactMethod, threads: usize, recording: &Recording) -> Outcome {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let mut storage: Option<MemorySinkStorage> = None;
    match recording {
        Recording::Absent => {}
        Recording::NoSink => {
            app.add_plugins(DeformableRerunPlugin::default());
        }
        Recording::Of(settings) => {
            let (stream, sink) = stream();
            storage = Some(sink);
            app.add_plugins(DeformableRerunPlugin::to_stream(stream)).insert_resource(settings.clone());
        }
    }
    app.insert_resource(CircumsphereSettings { threads, margin: 0.004, ..Default::default() });
    app.init_resource::<Journal>().add_observer(observe);
    app.add_systems(Update, read.in_set(DeformableSystems::Log));
    let scene = Scene::spawn(&mut app, method);
    for entity in [scene.crumpled, scene.floor] {
        app.world_mut().entity_mut(entity).insert(ContactEventsEnabled);
    }
    let (mut ticks, mut penetrating) = (Vec::new(), 0);
    for tick in 0..TICKS {
        scene.advance(&mut app, tick);
        // Down through the flat sheet and the floor, so that sides are remembered.
        place(&mut app, scene.crumpled, |transform| transform.translation.y -= 0.04);
        if tick == 5 {
            app.world_mut().get_mut::<SurfacePositions>(scene.ball).expect("the entity is a surface").0[0].x = f32::NAN;
        } else if tick == 8 {
            app.world_mut().get_mut::<SurfacePositions>(scene.ball).expect("the entity is a surface").0[0].x = 0.0;
        }
        app.update();
        penetrating +=
            app.world().resource::<ContactStore>().contacts().filter(|contact| contact.distance < 0.0).count();
        ticks.push(fingerprint(&app, &scene));
    }
    let journal = std::mem::take(&mut app.world_mut().resource_mut::<Journal>().0);
    let messages = storage.map_or(0, |storage| storage.take().len());
    Outcome { ticks, journal, messages, penetrating }
}

#[test]
fn contacts_and_events_are_the_same_whoever_records_them() {
    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(4).build());
    assert!(pool.thread_num() > 1, "the task pool has one thread, so there is nothing to compare");
    for method in ContactMethod::ALL {
        let alone = run(method, 1, &Recording::Absent);
        let lines: usize = alone.ticks.iter().map(Vec::len).sum();
        assert!(lines > 1000, "{method:?}: {lines} lines");
        assert!(alone.penetrating > 30, "{method:?}: only {} contacts have passed each other", alone.penetrating);
        assert!(alone.journal.len() >= 6, "{method:?}: {:?}", alone.journal);
        let of = [
            Recording::NoSink,
            Recording::Of(RerunSettings::default()),
            Recording::Of(everything()),
            Recording::Of(RerunSettings { every: 3, bytes_per_tick: 30_000, ..near() }),
        ];
        for (place, recording) in of.iter().enumerate() {
            // Each method runs with one thread, with several, and with each recording.
            let threads = place % 2;
            let found = run(method, threads, recording);
            for (tick, (expected, found)) in alone.ticks.iter().zip(&found.ticks).enumerate() {
                assert!(expected == found, "{method:?} differs in tick {tick} with {recording:?}");
            }
            assert_eq!(found.journal, alone.journal, "{method:?} with {recording:?}");
            assert_eq!(found.messages > 0, matches!(recording, Recording::Of(_)));
        }
    }
}
