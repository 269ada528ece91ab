//! Shows a box edge that `Circumsphere` misses, tick by tick, with the step at which each missed pair was dropped.
//!
//! `cargo run --release --example missed_edge -- [options]`; `--help` lists the options. A beam is lowered edge first
//! onto a mattress. `Exact` finds the true touching pairs, the chosen method finds some of them, and [`PairFates`]
//! says what happened to the others.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::{self, Display, Formatter},
    io::{self, Write},
    process::ExitCode,
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    detection::PairFates,
    geometry::{PairFate, TopologyError},
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use circumsphere_examples::headless::{
    BAD_INPUT, detect, headless_app,
    method::Method,
    move_surface,
    recording::{Recorder, RecordingError, RecordingOptions},
};
use circumsphere_support::scenes::{MovingScene, beam_on_mattress};
use clap::{ArgAction, Parser};
use glam::Vec3;

/// Half the contact distance, which is a tenth of the mattress's edges.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.01);

/// Watch a method miss the edge of a beam that is lowered onto a mattress, and see at which step.
#[derive(Parser, Debug)]
#[command(name = "missed_edge", allow_negative_numbers = true)]
struct Options {
    /// Method to compare with Exact
    #[arg(long, value_enum, default_value_t = Method::Circumsphere)]
    method: Method,
    /// Height of a flat triangle's sphere center below its plane, in radii of the triangle
    #[arg(long, default_value_t = CircumsphereSettings::default().sphere_offset)]
    sphere_offset: f32,
    /// Drop pairs of caps if a plane separates their triangles
    #[arg(long, value_name = "BOOL", default_value_t = CircumsphereSettings::default().plane_cull, action = ArgAction::Set)]
    plane_cull: bool,
    /// Widen safety cones by the angle to the neighbors
    #[arg(long, value_name = "BOOL", default_value_t = CircumsphereSettings::default().widen_cones, action = ArgAction::Set)]
    widen_cones: bool,
    /// Number of parts that the beam is split into along its length
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000))]
    beam_cells: u16,
    /// Number of ticks in which the beam is lowered
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=1000))]
    ticks: u16,
    #[command(flatten)]
    recording: RecordingOptions,
}

#[derive(Debug, thiserror::Error)]
enum MissedEdgeError {
    #[error(transparent)]
    Mesh(#[from] TopologyError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

fn main() -> ExitCode {
    let options = Options::parse();
    match compare(&options) {
        Ok(comparison) => {
            // The reader of the table may have closed the pipe.
            let _ = write!(io::stdout(), "{comparison}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// An app with both bodies, tested by one method.
struct Stage {
    app: App,
    mattress: Entity,
    beam: Entity,
}

impl Stage {
    fn new(
        scene: &MovingScene,
        method: ContactMethod,
        settings: CircumsphereSettings,
        recorder: Recorder,
    ) -> Result<Self, TopologyError> {
        let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, recorder);
        let mut spawn = |body: usize, name: &'static str| {
            let surface = DeformableSurface::from_mesh(&positions(scene, body, 0), &scene.bodies[body].triangles)?;
            Ok(app.world_mut().spawn((surface, method, THICKNESS, Name::new(name))).id())
        };
        let (mattress, beam) = (spawn(0, "mattress")?, spawn(1, "beam")?);
        Ok(Self { app, mattress, beam })
    }

    /// The touching triangles of mattress and beam at a tick.
    fn play(&mut self, scene: &MovingScene, tick: usize) -> BTreeSet<[u32; 2]> {
        for (body, entity) in [self.mattress, self.beam].into_iter().enumerate() {
            move_surface(&mut self.app, entity, positions(scene, body, tick));
        }
        detect(&mut self.app);
        let store = self.app.world().resource::<ContactStore>();
        store.touching().map(|pair| [pair.triangle_a, pair.triangle_b]).collect()
    }

    /// Counts the fates of pairs. `None` is for pairs that the broad phase did not pair.
    fn fates(&mut self, pairs: Vec<[u32; 2]>) -> BTreeMap<Option<PairFate>, usize> {
        let (mattress, beam) = (self.mattress, self.beam);
        let count = move |fates: PairFates| {
            let mut counts = BTreeMap::new();
            for &[of_mattress, of_beam] in &pairs {
                let fate = fates.between((mattress, TriangleId(of_mattress)), (beam, TriangleId(of_beam)));
                *counts.entry(fate).or_default() += 1;
            }
            counts
        };
        self.app.world_mut().run_system_once(count).expect("detection has run")
    }
}

fn positions(scene: &MovingScene, body: usize, tick: usize) -> Vec<Vec3> {
    scene.bodies[body].ticks[tick].iter().copied().map(Vec3::from_array).collect()
}

/// Results of a tick.
struct Tick {
    /// Depth of the beam's edge below the crest of the mattress; negative above it.
    sunk: f32,
    touching: usize,
    found: usize,
    false_pairs: usize,
    /// The steps that dropped the touching pairs that were not found.
    dropped: BTreeMap<Option<PairFate>, usize>,
}

struct Comparison {
    method: ContactMethod,
    ticks: Vec<Tick>,
}

/// Plays the scene with both methods, and records the chosen one.
fn compare(options: &Options) -> Result<Comparison, MissedEdgeError> {
    let scene = beam_on_mattress(usize::from(options.beam_cells), usize::from(options.ticks));
    let settings = CircumsphereSettings {
        sphere_offset: options.sphere_offset,
        plane_cull: options.plane_cull,
        widen_cones: options.widen_cones,
        threads: 1,
        ..CircumsphereSettings::default()
    };
    let recorder = options.recording.rerun.as_deref().map(|path| options.recording.recorder(path)).transpose()?;
    let mut asked = Stage::new(&scene, options.method.into(), settings, recorder.unwrap_or_default())?;
    let mut refined = Stage::new(&scene, ContactMethod::Exact, settings, Recorder::default())?;
    let height = |body: usize, tick: usize| scene.bodies[body].ticks[tick].iter().map(|position| position[1]);
    let play = |tick: usize| {
        let (found, touching) = (asked.play(&scene, tick), refined.play(&scene, tick));
        let (crest, edge) = (height(0, tick).fold(f32::MIN, f32::max), height(1, tick).fold(f32::MAX, f32::min));
        Tick {
            sunk: crest - edge,
            touching: touching.len(),
            found: found.intersection(&touching).count(),
            false_pairs: found.difference(&touching).count(),
            dropped: asked.fates(touching.difference(&found).copied().collect()),
        }
    };
    Ok(Comparison { method: options.method.into(), ticks: (0..usize::from(options.ticks)).map(play).collect() })
}

impl Display for Comparison {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let method = self.method;
        writeln!(formatter, "A beam is lowered edge first onto a mattress: {method:?} against Exact.\n")?;
        writeln!(formatter, "tick     sunk  touching  found  missed  false  missed ones dropped by")?;
        // Ticks are counted from 1, as in a recording.
        for (number, tick) in (1..).zip(&self.ticks) {
            let &Tick { sunk, touching, found, false_pairs, .. } = tick;
            let missed = touching - found;
            let dropped: Vec<String> =
                tick.dropped.iter().map(|(&fate, count)| format!("{} {count}", name(fate))).collect();
            let dropped = dropped.join(", ");
            let row =
                format!("{number:4}  {sunk:7.4}  {touching:8}  {found:5}  {missed:6}  {false_pairs:5}  {dropped}");
            writeln!(formatter, "{}", row.trim_end())?;
        }
        let total = |count: &dyn Fn(&Tick) -> usize| self.ticks.iter().map(count).sum::<usize>();
        let (touching, found) = (total(&|tick| tick.touching), total(&|tick| tick.found));
        let touched = total(&|tick| usize::from(tick.touching > 0));
        let unseen = total(&|tick| usize::from(tick.touching > 0 && tick.found == 0));
        let false_pairs = total(&|tick| tick.false_pairs);
        writeln!(formatter, "\nThe two touch in {touched} ticks; in {unseen} of them {method:?} finds none of it.")?;
        writeln!(
            formatter,
            "It finds {found} of {touching} touching pairs over all ticks, and {false_pairs} that do not touch."
        )
    }
}

fn name(fate: Option<PairFate>) -> &'static str {
    fate.map_or("broad phase", PairFate::name)
}
