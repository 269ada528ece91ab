//! Records every tick for the Rerun viewer, layer by layer, without a screen.
//!
//! It only reads the state of the tick: once after detection, before the response, and once at the end of the tick for
//! the result. The timelines are `tick` and, if the app has a clock, `simulated_time`.

mod blueprint;
mod cells;
mod colors;
mod contacts;
mod meshes;
mod names;
mod pairs;
mod patches;
mod recorder;
mod series;
mod settings;
mod surfaces;
mod tetrahedra;
mod text_log;
mod values;

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use ::rerun::{
    RecordingStream, RecordingStreamBuilder, RecordingStreamError, TimeCell, TimePoint, TimelineName, ViewCoordinates,
    sink::MemorySinkStorage,
};
use bevy_app::prelude::*;
use bevy_ecs::{prelude::*, schedule::InternedScheduleLabel};
use bevy_time::Time;

use self::{
    meshes::ShownBodies,
    names::Names,
    recorder::{Layer, Shown, Thinned, TickWriter},
    series::Series,
    tetrahedra::Solids,
};
use crate::{
    contacts::{SurfaceContacts, TouchingSides},
    debug::tick::{Detected, Touches},
    detection::{DetectionDiagnostics, UsedHash},
    kernel::mesh::bounds::Aabb,
    schedule::{DeformableSystems, add_to_host_schedule, run_detection},
    surface::{ActiveSurfaces, DeformableSurface, RigidShape, SurfacePositions, SurfaceQuarantined},
};
pub use settings::RerunSettings;

/// The timelines of a recording.
const TICK: &str = "tick";
const SIMULATED_TIME: &str = "simulated_time";

/// The application name of the recordings. The viewer keeps a layout for each name.
const APPLICATION: &str = "bevy_circumsphere";

/// Why nothing can be recorded.
#[derive(Debug, thiserror::Error)]
pub enum RerunError {
    /// The file cannot be written.
    #[error("cannot record to {}: {source}", .path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// The underlying error.
        source: Box<RecordingStreamError>,
    },
    /// The address is not the address of a viewer.
    #[error("cannot send a recording to {address}: {source}")]
    Viewer {
        /// The address.
        address: String,
        /// The underlying error.
        source: Box<RecordingStreamError>,
    },
    /// No viewer listens at this address.
    #[error("no viewer listens at {address}: start the viewer (`rerun`) before the game")]
    NoViewer {
        /// The address.
        address: String,
    },
    /// The recording cannot be started.
    #[error("cannot start a recording: {0}")]
    Start(Box<RecordingStreamError>),
}

/// Records every tick for the [Rerun](https://rerun.io) viewer: to a file, to a viewer, to memory, or to a stream of
/// your own. [`RerunSettings`] selects what is recorded. Contacts are the same with and without it.
///
/// It needs [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins). Without a sink, as in
/// [`DeformableRerunPlugin::default`], nothing is recorded or computed.
///
/// A file is complete when the app has been dropped. Before that, or if the program is killed or ends with
/// `std::process::exit`, the file can be opened up to the last write, but `rerun rrd verify` reports that its end is
/// missing.
#[derive(Clone)]
pub struct DeformableRerunPlugin {
    stream: RecordingStream,
}

impl Default for DeformableRerunPlugin {
    /// Records nothing.
    fn default() -> Self {
        Self { stream: RecordingStream::disabled() }
    }
}

impl DeformableRerunPlugin {
    /// Records to a file (`.rrd`). An existing file is replaced.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn to_file(path: impl AsRef<Path>) -> Result<Self, RerunError> {
        let path = path.as_ref();
        match RecordingStreamBuilder::new(APPLICATION).save(path) {
            Ok(stream) => Ok(Self { stream }),
            Err(source) => Err(RerunError::File { path: path.to_owned(), source: Box::new(source) }),
        }
    }

    /// Records to a running viewer at an address, which is `rerun+http://127.0.0.1:9876/proxy` for a viewer on this
    /// machine with default settings. The viewer must already be running. This call waits for it for up to five
    /// seconds.
    ///
    /// # Errors
    /// If the address is invalid, or no viewer listens there.
    pub fn to_viewer(address: &str) -> Result<Self, RerunError> {
        let address = address.to_owned();
        match RecordingStreamBuilder::new(APPLICATION).connect_grpc_opts(address.as_str()) {
            // Without a viewer, the stream would fill up, stall the game, and then keep it from exiting.
            Ok(stream) if stream.flush_blocking().is_err() => Err(RerunError::NoViewer { address }),
            Ok(stream) => Ok(Self { stream }),
            Err(source) => Err(RerunError::Viewer { address, source: Box::new(source) }),
        }
    }

    /// Records to memory. Take the recorded messages from the returned storage.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn to_memory() -> Result<(Self, MemorySinkStorage), RerunError> {
        let memory = RecordingStreamBuilder::new(APPLICATION).memory();
        let (stream, storage) = memory.map_err(|source| RerunError::Start(Box::new(source)))?;
        Ok((Self { stream }, storage))
    }

    /// Records to a stream of your own, together with what you log yourself. The clock of the stream is not touched.
    /// The viewer gets the layout of this crate, which shows your own 3D data, but not your own curves and texts.
    #[must_use]
    pub fn to_stream(stream: RecordingStream) -> Self {
        Self { stream }
    }
}

impl Plugin for DeformableRerunPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<RerunSettings>();
        app.insert_resource(Recorder::new(self.stream.clone()));
        add_to_host_schedule::<Self>(app, false, add_systems);
    }

    fn finish(&self, app: &mut App) {
        add_to_host_schedule::<Self>(app, true, add_systems);
    }
}

fn add_systems(app: &mut App, schedule: InternedScheduleLabel) {
    app.add_systems(
        schedule,
        (
            record_detection.in_set(DeformableSystems::Detect).after(run_detection),
            record_answer.in_set(DeformableSystems::Log),
        )
            .distributive_run_if(is_recording),
    );
}

/// The stream, and what has been sent to it.
#[derive(Resource)]
struct Recorder {
    stream: RecordingStream,
    shown: Shown,
    names: Names,
    bodies: ShownBodies,
    series: Series,
    tick: RecordedTick,
    /// Time that recording the last recorded tick took.
    cost: Duration,
    /// Layers for which the game's log already has the warning about thinning.
    warned: BTreeSet<Layer>,
    /// Whether the layout has been sent to the viewer.
    has_layout: bool,
}

/// The tick that is being recorded.
#[derive(Default)]
struct RecordedTick {
    time: TimePoint,
    /// Whether the layers of this tick are recorded.
    has_layers: bool,
    cost: Duration,
    newly_thinned: Vec<(Layer, Thinned)>,
}

impl Recorder {
    fn new(stream: RecordingStream) -> Self {
        Self {
            stream,
            shown: Shown::default(),
            names: Names::default(),
            bodies: ShownBodies::default(),
            series: Series::default(),
            tick: RecordedTick::default(),
            cost: Duration::ZERO,
            warned: BTreeSet::new(),
            has_layout: false,
        }
    }
}

fn is_recording(recorder: Res<Recorder>) -> bool {
    recorder.stream.is_enabled()
}

fn record_detection(
    mut recorder: ResMut<Recorder>,
    settings: Res<RerunSettings>,
    (detected, solids, hash): (Detected, Solids, Option<Res<UsedHash>>),
    surfaces: Query<&DeformableSurface>,
    diagnostics: Res<DetectionDiagnostics>,
    given: Query<&Name>,
    clock: Option<Res<Time>>,
) {
    let start = Instant::now();
    let Recorder { stream, shown, names, bodies, series, tick, cost, has_layout, .. } = &mut *recorder;
    let number = detected.contacts.tick();
    let mut time = TimePoint::default();
    time.insert_cell(
        TimelineName::from_static_str(TICK),
        TimeCell::from_sequence(i64::try_from(number).unwrap_or(i64::MAX)),
    );
    if let Some(clock) = clock {
        time.insert_cell(TimelineName::from_static_str(SIMULATED_TIME), TimeCell::from(clock.elapsed()));
    }
    let has_layers = number.is_multiple_of(u64::from(settings.every.max(1)));
    *tick = RecordedTick { time: time.clone(), has_layers, ..RecordedTick::default() };
    names.update(&detected, &given);
    if !settings.series {
        series.forget();
    }
    if !has_layers && !settings.series {
        return;
    }
    let touches = Touches::new(&detected);
    let steadiness = settings.series.then(|| series.observe(&detected, &surfaces, names, &touches));
    if has_layers {
        // Without surfaces there is nothing to look at yet.
        if !*has_layout && !detected.active.surfaces.is_empty() {
            *has_layout = true;
            lay_out(stream, &detected.active);
        }
        let mut writer = TickWriter::new(stream, time, settings.bytes_per_tick, shown);
        if let Some(steadiness) = &steadiness {
            series.draw(&mut writer, &diagnostics, &settings, steadiness, *cost);
        }
        bodies.draw(&mut writer, &detected, &settings, names, &touches);
        contacts::draw(&mut writer, &detected, &settings, names, &surfaces);
        if settings.penetrations {
            tetrahedra::draw_containments(&mut writer, &solids, names);
        }
        patches::draw(&mut writer, &detected, settings.patches, names, &touches);
        tetrahedra::draw(&mut writer, &solids, settings.tetrahedra, names);
        pairs::draw(&mut writer, &detected, settings.pairs, names, &touches);
        surfaces::draw(&mut writer, &detected, &settings, names, &touches);
        cells::draw(&mut writer, &detected, hash.as_deref().copied(), settings.cells, names, &touches);
        tick.newly_thinned = writer.finish();
    }
    tick.cost = start.elapsed();
}

/// Sends the up axis and the layout to the viewer.
fn lay_out(stream: &RecordingStream, active: &ActiveSurfaces) {
    let up = stream.log_static(recorder::path([]), &ViewCoordinates::RIGHT_HAND_Y_UP());
    let boxes: Vec<Aabb> = active.surfaces.iter().map(|surface| surface.world_bounds).collect();
    if let Err(error) = up.and_then(|()| blueprint::send(stream, &boxes)) {
        log::warn!("the recording has no layout: {error}");
    }
}

#[expect(clippy::too_many_arguments, reason = "the results of a tick are spread over many resources and components")]
fn record_answer(
    mut recorder: ResMut<Recorder>,
    settings: Res<RerunSettings>,
    active: Res<ActiveSurfaces>,
    contacts: SurfaceContacts,
    positions: Query<&SurfacePositions>,
    touching: Option<Res<TouchingSides>>,
    quarantines: Option<MessageReader<SurfaceQuarantined>>,
    given: Query<(Option<&Name>, Has<RigidShape>)>,
) {
    let start = Instant::now();
    let Recorder { stream, shown, names, series, tick, cost, warned, .. } = &mut *recorder;
    let mut writer = TickWriter::new(stream, tick.time.clone(), settings.bytes_per_tick, shown);
    if settings.series && tick.has_layers {
        series.draw_answer(&mut writer, &contacts, &active, &positions);
    }
    if let Some(touching) = touching {
        text_log::contacts(&mut writer, &touching, names);
    }
    if let Some(mut quarantines) = quarantines {
        let quarantines: Vec<&SurfaceQuarantined> = quarantines.read().collect();
        for quarantine in &quarantines {
            if let Ok((name, is_shape)) = given.get(quarantine.entity) {
                names.add(quarantine.entity, if is_shape { "shape" } else { "surface" }, name.map(Name::as_str));
            }
        }
        text_log::quarantines(&mut writer, &quarantines, names);
    }
    text_log::thinned(&mut writer, &tick.newly_thinned, settings.bytes_per_tick, warned);
    names.retain(&active);
    if tick.has_layers {
        *cost = tick.cost + start.elapsed();
    }
}
