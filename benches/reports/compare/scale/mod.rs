//! Growth of time and memory with the number of triangles and bodies.
//!
//! Three scenes are measured at several sizes, on one thread: a crumpled sheet, bodies that are apart, and bodies in a
//! pile. In every tick all vertices and poses change, and [`Teleported`] prevents the reuse of earlier results. The
//! slope is that of the least-squares line through the medians in a log-log plot. A slope of 1 means proportional to
//! the number of triangles. It is only meaningful if contacts grow in proportion to triangles, so the slope of contacts
//! is printed too.

mod memory;
mod scenes;

use std::{
    fmt::{self, Display, Formatter},
    time::{Duration, Instant},
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    detection::{CandidateTrianglePairs, DetectionDiagnostics},
    prelude::*,
};
use bevy_ecs::prelude::*;
use circumsphere_examples::headless::{detect, headless_app, move_surface, recording::Recorder};
use circumsphere_reports::statistics::{log_slope, median};
use circumsphere_support::random::Random;
use cpu_time::ThreadTime;
use glam::Vec3;
use serde::Serialize;

use self::{memory::Memory, scenes::Scene};
use super::{
    measure::timed,
    report::{grouped, short},
};

/// Numbers of triangles of the crumpled sheet, half a decade apart, for the short and the long sweep.
const SHEETS: [usize; 5] = [1_000, 3_162, 10_000, 31_623, 100_000];
const LONG_SHEETS: [usize; 7] = [1_000, 3_162, 10_000, 31_623, 100_000, 316_228, 1_000_000];

/// Numbers of bodies that are apart, and in a pile. In a small pile, a larger share of the bodies is on the outside, so
/// contacts grow faster than bodies. That is a property of the scene, and it raises the slope of contacts above 1.
const APART: [usize; 4] = [216, 343, 512, 1_000];
const PILED: [usize; 4] = [27, 48, 64, 100];

/// Number of triangles of the sheets whose memory is measured.
const WEIGHED: usize = 100_000;

/// The methods to measure. The baseline tests every candidate and is too slow.
const METHODS: [ContactMethod; 4] =
    [ContactMethod::BoundingSphere, ContactMethod::Circumsphere, ContactMethod::Closest, ContactMethod::Exact];

/// The project's own limits: the steepest slope, and the largest number of bytes per triangle.
const STEEPEST: f64 = 1.1;
const HEAVIEST: f64 = 400.0;

/// Largest and smallest number of measured ticks, and the time limit after which the smallest number suffices.
const TICKS: usize = 16;
const FEWEST_TICKS: usize = 5;
const PATIENCE: Duration = Duration::from_millis(1500);

/// The sizes to measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sweep {
    Short,
    /// Up to a million triangles.
    Long,
}

/// All results about growth.
#[derive(Serialize)]
pub struct Scale {
    series: Vec<Series>,
    memory: Vec<Memory>,
}

/// One method on one scene at several sizes.
#[derive(Serialize)]
struct Series {
    scene: &'static str,
    method: String,
    sizes: Vec<Size>,
    /// Slopes of candidates and contacts, to compare the slope of times with.
    candidates_slope: Option<f64>,
    contacts_slope: Option<f64>,
    stages: Vec<Growth>,
}

impl Series {
    fn slope(&self, values: impl Iterator<Item = f64>) -> Option<f64> {
        let triangles = self.sizes.iter().map(|size| size.triangles as f64);
        log_slope(&triangles.zip(values).collect::<Vec<_>>())
    }
}

/// A scene at one size.
#[derive(Serialize)]
struct Size {
    bodies: usize,
    triangles: usize,
    surface_pairs: usize,
    candidates: usize,
    touching: usize,
    contacts: usize,
}

/// Times of one stage, or of the whole tick, at every size. 0 at sizes that did not run the stage.
#[derive(Default, Serialize)]
struct Growth {
    stage: &'static str,
    median_ms: Vec<f64>,
    least_ms: Vec<f64>,
    /// `None` if no size took any time.
    slope: Option<f64>,
    /// Slope of the minima. Other programs disturb long ticks more than short ones, and minima less than medians.
    least_slope: Option<f64>,
}

impl Growth {
    fn resize(&mut self, sizes: usize) {
        self.median_ms.resize(sizes, 0.0);
        self.least_ms.resize(sizes, 0.0);
    }
}

/// Displacement of a vertex along each axis in [`Stage::creep`], for edges of length 1: far less than the contact
/// distance.
const CREEP: f32 = 1.0e-3;

const WHOLE: &str = "cold tick";
/// The same tick without the time that other programs took.
const PROCESSOR: &str = "cold tick, processor time";

/// A scene in an app.
struct Stage {
    app: App,
    surfaces: Vec<Entity>,
    tick: usize,
}

impl Stage {
    fn new(scene: &Scene, method: ContactMethod) -> Self {
        let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
        let surfaces = scene.bodies.iter().map(|body| {
            let surface =
                DeformableSurface::from_mesh(&body.states[0].positions, &body.triangles).expect("it is a valid mesh");
            let mut surface = app.world_mut().spawn((surface, body.states[0].pose, scene.sidedness, method));
            if scene.meets_itself {
                surface.insert(SelfCollision);
            }
            surface.id()
        });
        let surfaces = surfaces.collect();
        // Trees are built in the first tick.
        detect(&mut app);
        Self { app, surfaces, tick: 0 }
    }

    /// Moves everything to the other of its two states.
    fn advance(&mut self, scene: &Scene) {
        self.tick += 1;
        for (&surface, body) in self.surfaces.iter().zip(&scene.bodies) {
            let state = &body.states[self.tick % 2];
            move_surface(&mut self.app, surface, state.positions.clone());
            self.app.world_mut().entity_mut(surface).insert((state.pose, Teleported));
        }
    }

    /// Moves every vertex a little, in its own random direction.
    fn creep(&mut self) {
        let mut random = Random::new(1);
        for &surface in &self.surfaces {
            let Some(mut positions) = self.app.world_mut().get_mut::<SurfacePositions>(surface) else { continue };
            for position in &mut positions.0 {
                *position += CREEP * Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
            }
        }
    }

    fn size(&self, scene: &Scene) -> Size {
        let world = self.app.world();
        let store = world.resource::<ContactStore>();
        let candidates = world.resource::<CandidateTrianglePairs>();
        Size {
            bodies: scene.bodies.len(),
            triangles: scene.triangles(),
            surface_pairs: candidates.pairs().len(),
            candidates: candidates.triangle_pair_count(),
            touching: store.touching_count(),
            contacts: store.contact_count(),
        }
    }
}

/// Milliseconds of each tick, for the whole tick and for each stage.
fn play(stage: &mut Stage, scene: &Scene) -> Vec<(&'static str, Vec<f64>)> {
    let milliseconds = |duration: Duration| duration.as_secs_f64() * 1.0e3;
    let mut times = vec![(WHOLE, Vec::new())];
    let start = Instant::now();
    // Buffers grow in the first two ticks.
    for tick in 0..TICKS + 2 {
        // Stop after a pair of ticks, so that counts are always taken in the same of the two states.
        if tick % 2 == 0 && tick > FEWEST_TICKS + 2 && start.elapsed() > PATIENCE {
            break;
        }
        stage.advance(scene);
        let processor = ThreadTime::now();
        let (duration, ()) = timed(|| stage.app.update());
        let worked = processor.elapsed();
        if tick < 2 {
            continue;
        }
        times[0].1.push(milliseconds(duration));
        let parts = &stage.app.world().resource::<DetectionDiagnostics>().stages;
        let parts = parts.iter().map(|part| (part.name, part.duration));
        for (part, duration) in [(PROCESSOR, worked)].into_iter().chain(parts) {
            if let Some((_, times)) = times.iter_mut().find(|(name, _)| *name == part) {
                times.push(milliseconds(duration));
            } else {
                times.push((part, vec![milliseconds(duration)]));
            }
        }
    }
    times
}

/// Measures one scene at all sizes with all methods. The methods take turns at each size, so that each scene is built
/// only once.
fn measure_series(
    name: &'static str,
    sizes: &[usize],
    make: fn(usize) -> Scene,
    report: &mut impl FnMut(&str),
) -> Vec<Series> {
    let new_series = |method: &ContactMethod| Series {
        scene: name,
        method: format!("{method:?}"),
        sizes: Vec::new(),
        candidates_slope: None,
        contacts_slope: None,
        stages: Vec::new(),
    };
    let mut all: Vec<Series> = METHODS.iter().map(new_series).collect();
    for (place, &size) in sizes.iter().enumerate() {
        let scene = make(size);
        for (series, &method) in all.iter_mut().zip(&METHODS) {
            report(&format!("{name}, {} triangles: {method:?}", grouped(scene.triangles() as u64)));
            let mut stage = Stage::new(&scene, method);
            for (name, times) in play(&mut stage, &scene) {
                let known = series.stages.iter().position(|growth| growth.stage == name);
                let stage = known.unwrap_or_else(|| {
                    // Smaller sizes did not run this stage.
                    series.stages.push(Growth { stage: name, ..Growth::default() });
                    series.stages.len() - 1
                });
                let growth = &mut series.stages[stage];
                growth.resize(place);
                growth.least_ms.push(times.iter().copied().fold(f64::INFINITY, f64::min));
                growth.median_ms.push(median(times).unwrap_or_default());
            }
            series.sizes.push(stage.size(&scene));
        }
    }
    for series in &mut all {
        series.candidates_slope = series.slope(series.sizes.iter().map(|size| size.candidates as f64));
        series.contacts_slope = series.slope(series.sizes.iter().map(|size| size.contacts as f64));
        for stage in 0..series.stages.len() {
            series.stages[stage].resize(sizes.len());
            series.stages[stage].slope = series.slope(series.stages[stage].median_ms.iter().copied());
            series.stages[stage].least_slope = series.slope(series.stages[stage].least_ms.iter().copied());
        }
    }
    all
}

impl Scale {
    pub fn measure(sweep: Sweep, mut report: impl FnMut(&str)) -> Self {
        let sheets: &[usize] = if sweep == Sweep::Long { &LONG_SHEETS } else { &SHEETS };
        let mut series = measure_series("a crumpled sheet", sheets, scenes::crumpled, &mut report);
        series.extend(measure_series("bodies apart", &APART, scenes::apart, &mut report));
        series.extend(measure_series("bodies in a pile", &PILED, scenes::piled, &mut report));
        let memory = METHODS
            .into_iter()
            .map(|method| {
                report(&format!("memory: {method:?}"));
                Memory::measure(method, WEIGHED)
            })
            .collect();
        Self { series, memory }
    }
}

impl Display for Series {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let mut line = |name: &str, values: Vec<String>, last: &str| {
            write!(out, "{name:40}")?;
            for value in values {
                write!(out, " {value:>10}")?;
            }
            writeln!(out, "  {last}")
        };
        let numbers = |count: fn(&Size) -> usize| self.sizes.iter().map(|size| grouped(count(size) as u64)).collect();
        let per_triangle = |count: fn(&Size) -> usize| {
            self.sizes.iter().map(|size| short(count(size) as f64 / size.triangles as f64)).collect()
        };
        line(&format!("{}, {}", self.scene, self.method), numbers(|size| size.triangles), "triangles")?;
        if self.sizes.iter().any(|size| size.bodies > 1) {
            line("", numbers(|size| size.bodies), "bodies")?;
            line("", numbers(|size| size.surface_pairs), "body pairs")?;
        }
        line("", per_triangle(|size| size.candidates), "candidates per △")?;
        line("", per_triangle(|size| size.contacts), "contacts per △")?;
        for growth in &self.stages {
            let name =
                if growth.stage == WHOLE { "  cold tick, ms".to_owned() } else { format!("    {}", growth.stage) };
            let slope = growth.slope.map_or_else(|| "-".to_owned(), |slope| format!("slope {slope:.2}"));
            line(&name, growth.median_ms.iter().map(|&time| short(time)).collect(), &slope)?;
        }
        Ok(())
    }
}

impl Display for Scale {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        writeln!(out, "\nGrowth on one thread: median times, and the slopes of the medians\n")?;
        for series in &self.series {
            writeln!(out, "{series}")?;
        }
        for memory in &self.memory {
            writeln!(out, "{memory}")?;
        }
        writeln!(
            out,
            "{:52} {:>8} {:>10} {:>10} {:>10} {:>10}",
            "bar", "", "medians", "minima", "processor", "contacts"
        )?;
        let verdict = |holds: bool| if holds { "holds" } else { "does not hold" };
        for series in &self.series {
            let of = |stage: &str| series.stages.iter().find(|growth| growth.stage == stage);
            let Some((whole, slope)) = of(WHOLE).and_then(|whole| Some((whole, whole.slope?))) else { continue };
            let what = format!("slope, {}, {}", series.scene, series.method);
            let number = |slope: Option<f64>| slope.map_or_else(|| "-".to_owned(), |slope| format!("{slope:.2}"));
            let (least, processor) = (number(whole.least_slope), number(of(PROCESSOR).and_then(|growth| growth.slope)));
            let (limit, contacts) = (format!("≤ {STEEPEST}"), number(series.contacts_slope));
            let holds = verdict(slope <= STEEPEST);
            writeln!(out, "{what:52} {limit:>8} {slope:>10.2} {least:>10} {processor:>10} {contacts:>10}  {holds}")?;
        }
        for memory in &self.memory {
            let (what, bytes) =
                (format!("bytes per triangle, {}", memory.method), memory.bytes_per_triangle_without_pairs);
            writeln!(
                out,
                "{what:52} {:>8} {bytes:>10.0} {:>32}  {}",
                format!("≤ {HEAVIEST}"),
                "",
                verdict(bytes <= HEAVIEST)
            )?;
        }
        Ok(())
    }
}
