//! Where recordings go, which errors are reported, and that nothing runs without a sink.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::BufReader,
    panic::{AssertUnwindSafe, catch_unwind},
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    debug::{DeformableRerunPlugin, RerunError, RerunSettings},
    prelude::*,
};
use rerun::{external::re_log_encoding::rrd::Decoder, log::LogMsg};

use crate::{
    recording::{Path, Recording},
    world::{Recorded, Scene, everything},
};

fn app(plugin: DeformableRerunPlugin) -> (App, Scene) {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), plugin));
    let scene = Scene::spawn(&mut app, ContactMethod::Circumsphere);
    (app, scene)
}

/// The message of a panic.
fn said(panicking: impl FnOnce()) -> Option<String> {
    let payload = catch_unwind(AssertUnwindSafe(panicking)).err()?;
    let text = payload.downcast_ref::<String>().cloned();
    Some(text.or_else(|| payload.downcast_ref::<&str>().map(|&text| text.to_owned())).unwrap_or_default())
}

#[test]
fn without_a_sink_no_system_runs() {
    // A system that runs without its settings panics. If nothing panics, no system has run.
    let update_without_settings = |plugin: DeformableRerunPlugin| {
        let (mut app, _) = app(plugin);
        app.world_mut().remove_resource::<RerunSettings>();
        said(move || app.update())
    };
    let (to_memory, storage) = DeformableRerunPlugin::to_memory().expect("memory can be written to");
    assert!(update_without_settings(to_memory).is_some_and(|said| said.contains("Resource does not exist")));
    drop(storage.take());
    assert_eq!(update_without_settings(DeformableRerunPlugin::default()), None);
    let disabled = DeformableRerunPlugin::to_stream(rerun::RecordingStream::disabled());
    assert_eq!(update_without_settings(disabled), None);
}

#[test]
fn without_the_group_the_plugin_says_what_to_do() {
    let said = said(|| App::new().add_plugins(DeformableRerunPlugin::default()).finish());
    let said = said.expect("the plugin panics without the group");
    assert!(said.contains("DeformableRerunPlugin") && said.contains("DeformableCollisionPlugins"), "{said}");
}

#[test]
fn the_plugin_may_come_before_the_group() {
    let (to_memory, storage) = DeformableRerunPlugin::to_memory().expect("memory can be written to");
    let mut app = App::new();
    app.add_plugins((to_memory, DeformableCollisionPlugins::new(Update)));
    app.finish();
    app.cleanup();
    Scene::spawn(&mut app, ContactMethod::Circumsphere);
    app.update();
    assert!(storage.take().len() > 10, "the tick is recorded");
}

#[test]
fn a_file_that_cannot_be_written_and_an_address_that_is_none_are_named() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("missing").join("sleeve.rrd");
    let error = DeformableRerunPlugin::to_file(&path).err().expect("the folder is missing");
    assert!(matches!(&error, RerunError::File { path: found, .. } if *found == path));
    assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    for address in ["", "nonsense", "http://", "ftp://127.0.0.1:9876/proxy", "rerun+http://127.0.0.1:port/proxy"] {
        let Err(error) = DeformableRerunPlugin::to_viewer(address) else { panic!("{address:?} is not an address") };
        assert!(matches!(&error, RerunError::Viewer { address: found, .. } if found == address), "{error}");
        assert!(error.to_string().contains(address));
    }
}

#[test]
fn a_viewer_that_is_not_there_is_an_error_at_once_and_not_a_game_that_stalls() {
    // A port that was free a moment ago and on which nobody listens.
    let free = std::net::TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let address = format!("rerun+http://{}/proxy", free.expect("there is a free port"));
    let Err(error) = DeformableRerunPlugin::to_viewer(&address) else { panic!("nobody listens at {address}") };
    assert!(matches!(&error, RerunError::NoViewer { address: found } if *found == address), "{error}");
    assert!(error.to_string().contains(&address), "{error}");
}

fn rows_of_entities(recording: &Recording) -> BTreeMap<Path, usize> {
    let mut rows = BTreeMap::new();
    for row in &recording.rows {
        *rows.entry(row.path.clone()).or_insert(0) += 1;
    }
    rows
}

#[test]
fn a_file_is_whole_when_the_app_has_been_dropped() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("a sleeve.rrd");
    std::fs::write(&path, "something that was there before").expect("the folder can be written to");
    let run = |plugin: DeformableRerunPlugin| {
        let (mut app, scene) = app(plugin);
        app.insert_resource(everything());
        for tick in 0..5 {
            scene.advance(&mut app, tick);
            app.update();
        }
    };
    run(DeformableRerunPlugin::to_file(&path).expect("the file can be written"));
    let file = BufReader::new(File::open(&path).expect("the file has been written"));
    let mut decoder = Decoder::<LogMsg>::decode_eager(file).expect("the file starts like a recording");
    let messages: Vec<LogMsg> =
        decoder.by_ref().map(|message| message.expect("every message can be decoded")).collect();
    let footers = decoder.rrd_manifests().expect("the footer can be decoded");
    assert_eq!(footers.len(), 2, "one for the recording, one for its layout");
    let from_file = Recording::of(messages);

    let (plugin, storage) = DeformableRerunPlugin::to_memory().expect("memory can be written to");
    run(plugin);
    let from_memory = Recording::of(storage.take());
    assert!(from_file.rows.len() > 200 && from_file.layout.len() > 20);
    assert_eq!(rows_of_entities(&from_file), rows_of_entities(&from_memory));
    assert_eq!(from_file.layout.len(), from_memory.layout.len());
}

#[test]
fn recording_to_memory_takes_what_the_game_asks_for() {
    let (plugin, storage) = DeformableRerunPlugin::to_memory().expect("memory can be written to");
    let (mut app, scene) = app(plugin);
    app.update();
    let first = Recording::of(storage.take());
    assert!(first.layers().contains(&"contacts"), "{:?}", first.layers());
    scene.advance(&mut app, 0);
    app.update();
    let second = Recording::of(storage.take());
    assert!(second.rows.iter().filter(|row| !row.times.is_empty()).all(|row| row.tick() == 2));
    assert_eq!(storage.num_msgs(), 0);
}

#[test]
fn a_game_without_events_is_recorded_without_what_started_and_ended() {
    use bevy_app::PluginGroup;
    use bevy_circumsphere::ContactEventsPlugin;
    let (stream, storage) = crate::world::stream();
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<ContactEventsPlugin>());
    app.add_plugins(DeformableRerunPlugin::to_stream(stream));
    Scene::spawn(&mut app, ContactMethod::Exact);
    app.update();
    app.update();
    let recording = Recording::of(storage.take());
    assert!(recording.below(&["contacts"]).len() > 6 && recording.below(&["log"]).is_empty());
}

#[test]
fn detection_by_hand_empty_worlds_and_a_hundred_surfaces_are_recorded() {
    use bevy_circumsphere::SurfaceDetection;

    use crate::world::{THIN, contacts, place, sheet, spawn};
    let mut recorded = Recorded::new(everything());
    for _ in 0..3 {
        recorded.tick();
        assert!(
            recorded.last.layers().iter().all(|layer| ["", "series"].contains(layer)),
            "{:?}",
            recorded.last.layers()
        );
    }
    let mesh = sheet(1);
    let mut surfaces = Vec::new();
    for number in 0..100 {
        let at = bevy_transform::components::Transform::from_xyz(0.0, 0.03 * number as f32, 0.0);
        surfaces.push(spawn(&mut recorded.app, &format!("sheet {number}"), &mesh, (THIN, at)));
    }
    recorded.tick();
    assert_eq!(recorded.viewer.below(&["meshes"]).len(), 100);
    let shown_pairs = |recorded: &Recorded| {
        let points = recorded.viewer.of(&["contacts", "points", "all pairs"]).expect("the surfaces touch");
        points.texts("pair").into_iter().collect::<BTreeSet<_>>().len()
    };
    assert_eq!(shown_pairs(&recorded), 99);

    // Detect once more by hand before the next tick, which then is the sixth.
    recorded.app.world_mut().run_schedule(SurfaceDetection);
    assert!(recorded.take().rows.is_empty(), "only the schedule's own detection is recorded");
    place(&mut recorded.app, surfaces[0], |transform| transform.translation.y = -3.0);
    recorded.tick();
    assert!(recorded.last.rows.iter().filter(|row| !row.times.is_empty()).all(|row| row.tick() == 6));
    assert_eq!(shown_pairs(&recorded), 98);
    let shown: usize =
        recorded.viewer.below(&["contacts", "points"]).values().map(|shown| shown.floats("distance").len()).sum();
    assert_eq!(shown, contacts(&mut recorded.app).len());

    for entity in surfaces {
        recorded.app.world_mut().despawn(entity);
    }
    recorded.tick();
    let left: Vec<&str> = recorded.viewer.0.keys().map(|path| path[0].as_str()).collect();
    assert!(left.iter().all(|layer| ["series", "log"].contains(layer)), "{left:?}");
    recorded.tick();
    assert!(recorded.last.clears().is_empty());
}
