//! Tunnelling against speed: a ball shot at a sheet, a sheet at a sheet, and a needle at a closed surface, with each
//! method, with and without continuous detection.

use bevy_circumsphere::{CircumsphereSettings, prelude::*, response::XpbdSettings};
use circumsphere_examples::{
    headless::recording::Recorder,
    scenes::{Scene, Shot, TICK, Variation, bullet_cloth::Target, scene},
};
use circumsphere_reports::finding::{Finding, Outcome, figure, happens_less, percent, table};
use circumsphere_support::random::Random;
use glam::{Quat, Vec3};
use indicatif::ProgressBar;
use serde::Serialize;

use super::{options::Extent, player::variation, tested::Tested};

/// Speeds in thicknesses per tick.
const SPEEDS: [f32; 11] = [0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];

/// Objects and targets, with their names.
pub const TARGETS: [(Target, &str); 3] =
    [(Target::Sheet, "ball at sheet"), (Target::SheetBySheet, "sheet at sheet"), (Target::Closed, "needle at organ")];

/// Number of ticks per shot. The slowest shot reaches its target in the tenth tick.
const TICKS: u32 = 30;

/// Largest sideways displacement of a shot, in meters.
const ASIDE: f32 = 0.02;

/// Largest tilt of a shot, in radians. The rotation about the vertical axis is not limited.
const TILT: f32 = 0.15;

/// All shots of one kind at one speed.
#[derive(Clone, Debug, Serialize)]
pub struct TunnellingRow {
    pub target: &'static str,
    #[serde(serialize_with = "super::report::name_of_method")]
    pub method: Tested,
    pub continuous: bool,
    /// Initial speed, in thicknesses per tick.
    pub speed: f32,
    pub shots: usize,
    /// Shots with at least one vertex on the wrong side at the end, judged in f64.
    pub tunnelled: usize,
    pub rate: f64,
    /// Vertices on the wrong side, mean over all shots.
    pub vertices: f64,
    /// Whether each shot tunnelled. All methods get the same shots.
    #[serde(skip)]
    pub which: Vec<bool>,
}

/// Makes all shots of every kind at every speed.
pub fn measure(extent: Extent, progress: &ProgressBar) -> Vec<TunnellingRow> {
    let speeds = extent.pick(&SPEEDS[6..8], &SPEEDS[..]);
    progress.set_length((TARGETS.len() * 2 * Tested::ALL.len() * speeds.len()) as u64);
    let mut rows = Vec::new();
    for (target, name) in TARGETS {
        for continuous in [false, true] {
            // Continuous detection of fast objects is slow, so there are fewer shots.
            let shots = extent.pick(1, if continuous { 2 } else { 10 });
            for method in Tested::ALL {
                for &speed in speeds {
                    let base = Variation { continuous, ..variation(method) };
                    let counts = shoot(&base, Shot { target, speed }, shots);
                    let which: Vec<bool> = counts.iter().map(|&count| count > 0).collect();
                    let tunnelled = which.iter().filter(|&&one| one).count();
                    rows.push(TunnellingRow {
                        target: name,
                        method,
                        continuous,
                        speed,
                        shots,
                        tunnelled,
                        rate: tunnelled as f64 / shots as f64,
                        vertices: counts.iter().sum::<usize>() as f64 / shots as f64,
                        which,
                    });
                    progress.inc(1);
                }
            }
        }
    }
    rows
}

/// Number of tunnelled vertices of each shot. All methods get the same shots.
pub fn shoot(base: &Variation, shot: Shot, shots: usize) -> Vec<usize> {
    // No gravity, so that the speed stays as given.
    let response = XpbdSettings { gravity: Vec3::ZERO, ..base.response };
    let variation = Variation { response, shot, ..*base };
    let mut random = Random::new(0x005E_ED0F_5407);
    (0..shots)
        .map(|_| {
            let mut scene = scene("bullet_cloth", &variation, Recorder::default()).expect("the scene exists");
            aim(&mut scene, shot, &mut random);
            (0..TICKS).for_each(|_| scene.tick());
            scene.tunnelled()
        })
        .collect()
}

/// Rotates and displaces the object before its flight. The displacement includes up to one tick of flight, so that the
/// object can reach its target at any moment of a tick.
fn aim(scene: &mut Scene, shot: Shot, random: &mut Random) {
    let body = *scene.stage.bodies.last().expect("something is shot");
    let thickness = match scene.stage.app.world().get::<SurfaceThickness>(body) {
        Some(&SurfaceThickness::World(thickness)) => thickness,
        _ => 0.0,
    };
    let turn = Quat::from_rotation_x(TILT * random.signed_unit())
        * Quat::from_rotation_z(TILT * random.signed_unit())
        * Quat::from_rotation_y(std::f32::consts::PI * random.signed_unit());
    let way = shot.speed * thickness;
    let offset = Vec3::new(ASIDE * random.signed_unit(), way * random.unit() as f32, ASIDE * random.signed_unit());
    let positions = scene.stage.positions(body);
    let middle = positions.iter().sum::<Vec3>() / positions.len() as f32;
    let lowest = |positions: &[Vec3]| positions.iter().map(|position| position.y).fold(f32::INFINITY, f32::min);
    let turned: Vec<Vec3> = positions.iter().map(|&position| middle + turn * (position - middle)).collect();
    let lift = Vec3::Y * (lowest(positions) - lowest(&turned));
    scene.stage.move_vertices(body, turned.into_iter().map(|position| position + lift + offset).enumerate());
}

/// Share of tunnelled shots among the rows that `wanted` selects.
fn share(rows: &[TunnellingRow], wanted: impl Fn(&TunnellingRow) -> bool) -> f64 {
    let (mut tunnelled, mut shots) = (0, 0);
    for row in rows.iter().filter(|row| wanted(row)) {
        tunnelled += row.tunnelled;
        shots += row.shots;
    }
    tunnelled as f64 / shots.max(1) as f64
}

pub fn finding(rows: &[TunnellingRow]) -> Finding {
    let without = |method| share(rows, |row| row.method == method && !row.continuous);
    let [own, polygon] = [Tested::Circumsphere, Tested::Polygon].map(without);
    let with = |is_exact: bool| share(rows, |row| row.continuous && row.method.method().is_exact() == is_exact);
    let [exact, spheres] = [true, false].map(with);
    let fastest = rows.iter().map(|row| row.speed).fold(0.0, f32::max);
    let first = |method: Tested| {
        let speeds = rows.iter().filter(|row| row.method == method && !row.continuous && row.tunnelled > 0);
        let first = speeds.map(|row| row.speed).fold(f32::INFINITY, f32::min);
        if first.is_finite() { format!("from {first} thicknesses per tick on") } else { "at no speed".to_owned() }
    };
    let which = |method: Tested| {
        rows.iter().filter(move |row| row.method == method && !row.continuous).flat_map(|row| &row.which)
    };
    let resists = happens_less(which(Tested::Circumsphere), which(Tested::Polygon));
    let stops = match (exact == 0.0, spheres == 0.0) {
        (true, true) => Outcome::Holds,
        (true, false) => Outcome::HoldsInPart,
        _ => Outcome::Fails,
    };
    Finding {
        claim: format!(
            "circumspheres let less through than polygons, and with continuous detection nothing gets through at up to \
             {fastest} thicknesses per tick"
        ),
        found: format!(
            "without continuous detection, {} of the shots tunnel with circumspheres ({}), {} with osculating spheres \
             on smooth surfaces ({}), and {} with polygons ({}); with continuous detection, {} tunnel with exact \
             methods and {} with sphere methods",
            percent(own),
            first(Tested::Circumsphere),
            percent(without(Tested::Osculating)),
            first(Tested::Osculating),
            percent(polygon),
            first(Tested::Polygon),
            percent(exact),
            percent(spheres)
        ),
        outcome: Outcome::all(&[resists, stops]),
    }
}

/// Duration of a tick of the shots, in seconds.
pub fn seconds_per_tick() -> f64 {
    TICK.as_secs_f64()
}

pub fn tables(rows: &[TunnellingRow]) -> String {
    let mut header = vec!["shot".to_owned(), "continuous".to_owned(), "speed (thicknesses per tick)".to_owned()];
    header.extend(Tested::ALL.map(|method| format!("{method:?}")));
    let mut lines = Vec::new();
    for (_, target) in TARGETS {
        for continuous in [false, true] {
            let own = |method: Tested| {
                rows.iter()
                    .filter(move |row| row.target == target && row.continuous == continuous && row.method == method)
            };
            for first in own(Tested::ALL[0]) {
                let cell = |method| {
                    own(method).find(|row| row.speed == first.speed).map_or_else(String::new, |row| percent(row.rate))
                };
                let continuous = if continuous { "yes" } else { "no" };
                let mut line = vec![target.to_owned(), continuous.to_owned(), figure(f64::from(first.speed))];
                line.extend(Tested::ALL.map(cell));
                lines.push(line);
            }
        }
    }
    table(&header, lines)
}

/// The variation for shots, with the given settings of caps.
pub fn with_caps(phi: f32, curvature_threshold: f32) -> Variation {
    let base = variation(Tested::Circumsphere);
    Variation { detection: CircumsphereSettings { sphere_offset: phi, curvature_threshold, ..base.detection }, ..base }
}
