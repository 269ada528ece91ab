//! φ and the curvature threshold: shots that tunnel, missed pairs, and needless tests.

use std::collections::BTreeSet;

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, ContactStore, detection::DetectionDiagnostics, prelude::*};
use bevy_ecs::prelude::*;
use circumsphere_examples::{
    headless::{detect, headless_app, move_surface, recording::Recorder},
    scenes::{Shot, bullet_cloth::Target},
};
use circumsphere_reports::{
    finding::{Finding, Outcome, figure, happens_less, percent, table},
    statistics::mean,
};
use circumsphere_support::{
    recording::RecordingError,
    scenes::{Fineness, MovingScene, beam_on_mattress, moving_scene},
};
use glam::Vec3;
use indicatif::ProgressBar;
use serde::Serialize;

use super::{
    ReportError,
    options::Extent,
    tunnelling::{shoot, with_caps},
};

const PHIS: [f32; 6] = [0.0, 0.25, 0.5, 1.0, 2.0, 5.0];
const THRESHOLDS: [f32; 4] = [0.5, 1.0, 2.0, 4.0];

/// Speeds in thicknesses per tick, in the range in which shots begin to tunnel.
const SPEEDS: [f32; 5] = [10.0, 20.0, 40.0, 70.0, 100.0];

/// Scenes in which touching pairs are counted, besides the beam that is lowered edge first.
const MOVING: [&str; 4] = ["box_on_edge_and_corner", "soft_spheres", "ribbed_panel", "cloth_over_ball"];

const CLOTH_FALL: &[u8] = include_bytes!("../../../assets/cloth_fall.bin");

/// Tunnelling, missed pairs, and needless tests of one setting.
#[derive(Clone, Debug, Serialize)]
pub struct CapsRow {
    pub phi: f32,
    pub curvature_threshold: f32,
    pub shots: usize,
    pub tunnelled: usize,
    pub tunnelling_rate: f64,
    /// Touching pairs of triangles, found by the exact method.
    pub true_pairs: usize,
    /// Share of true pairs that are missed.
    pub missed_share: f64,
    /// The same between the mattress and the beam that is lowered edge first.
    pub missed_share_on_edge: f64,
    /// Pairs whose spheres overlap. They go to the cone test.
    pub examined_pairs: usize,
    /// Share of examined pairs that do not touch.
    pub needless_share: f64,
    /// Share of reported pairs that do not touch.
    pub false_share: f64,
    /// Whether each shot tunnelled. All settings get the same shots.
    #[serde(skip)]
    pub which: Vec<bool>,
}

/// A scene with its touching pairs in each tick.
struct Judged {
    scene: MovingScene,
    thickness: SurfaceThickness,
    is_on_edge: bool,
    touching: Vec<BTreeSet<[u32; 4]>>,
}

/// Plays every scene with every setting.
pub fn measure(extent: Extent, progress: &ProgressBar) -> Result<Vec<CapsRow>, ReportError> {
    let phis = extent.pick(&PHIS[2..4], &PHIS[..]);
    let thresholds = extent.pick(&THRESHOLDS[2..3], &THRESHOLDS[..]);
    let (shots, speeds) = extent.pick((1, &SPEEDS[3..4]), (5, &SPEEDS[..]));
    let scenes = scenes(extent).map_err(ReportError::Scene)?;
    progress.set_length((phis.len() * thresholds.len()) as u64);
    let mut rows = Vec::new();
    for &curvature_threshold in thresholds {
        for &phi in phis {
            let base = with_caps(phi, curvature_threshold);
            let counts: Vec<usize> =
                speeds.iter().flat_map(|&speed| shoot(&base, Shot { target: Target::Sheet, speed }, shots)).collect();
            let which: Vec<bool> = counts.iter().map(|&count| count > 0).collect();
            let tunnelled = which.iter().filter(|&&one| one).count();
            let mut all = Counted::default();
            let mut on_edge = Counted::default();
            for judged in &scenes {
                let counted = count(judged, base.detection);
                if judged.is_on_edge {
                    on_edge.add(&counted);
                }
                all.add(&counted);
            }
            rows.push(CapsRow {
                phi,
                curvature_threshold,
                shots: counts.len(),
                tunnelled,
                tunnelling_rate: tunnelled as f64 / counts.len() as f64,
                true_pairs: all.truth,
                missed_share: share(all.truth - all.matched, all.truth),
                missed_share_on_edge: share(on_edge.truth - on_edge.matched, on_edge.truth),
                examined_pairs: all.examined,
                needless_share: share(all.examined - all.matched.min(all.examined), all.examined),
                false_share: share(all.found - all.matched, all.found),
                which,
            });
            progress.inc(1);
        }
    }
    Ok(rows)
}

fn share(part: usize, whole: usize) -> f64 {
    part as f64 / whole.max(1) as f64
}

fn scenes(extent: Extent) -> Result<Vec<Judged>, RecordingError> {
    let ticks = extent.pick(3, 12);
    let fineness = extent.pick(Fineness::Coarse, Fineness::Middle);
    let mut scenes = Vec::new();
    for cells in [1, 40] {
        scenes.push((beam_on_mattress(cells, ticks), SurfaceThickness::World(0.01), true));
    }
    for name in MOVING {
        let scene = moving_scene(name, fineness, ticks, CLOTH_FALL)?.expect("the listed scenes exist");
        scenes.push((scene, SurfaceThickness::default(), false));
    }
    Ok(scenes
        .into_iter()
        .map(|(scene, thickness, is_on_edge)| {
            let mut judged = Judged { scene, thickness, is_on_edge, touching: Vec::new() };
            let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
            judged.touching =
                play(&judged, ContactMethod::Exact, settings).into_iter().map(|(touching, _)| touching).collect();
            judged
        })
        .collect())
}

/// The touching pairs that a method finds in each tick, and the number of pairs that go to its cone test.
fn play(judged: &Judged, method: ContactMethod, settings: CircumsphereSettings) -> Vec<(BTreeSet<[u32; 4]>, usize)> {
    let Judged { scene, thickness, .. } = judged;
    let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
    let positions = |body: usize, tick: usize| -> Vec<Vec3> {
        scene.bodies[body].ticks[tick].iter().map(|&position| Vec3::from(position)).collect()
    };
    let entities: Vec<Entity> = (0..scene.bodies.len())
        .map(|body| {
            let (surface, positions) = DeformableSurface::from_mesh(&positions(body, 0), &scene.bodies[body].triangles)
                .expect("the scene is valid");
            let mut entity = app.world_mut().spawn((surface, positions, method, *thickness));
            if scene.bodies[body].touches_itself {
                entity.insert(SelfCollision);
            }
            entity.id()
        })
        .collect();
    (0..scene.bodies[0].ticks.len())
        .map(|tick| {
            for (body, &entity) in entities.iter().enumerate() {
                move_surface(&mut app, entity, positions(body, tick));
            }
            detect(&mut app);
            let store = app.world().resource::<ContactStore>();
            let number =
                |entity: Entity| entities.iter().position(|&own| own == entity).map_or(u32::MAX, |place| place as u32);
            let mut touching = BTreeSet::new();
            for pair in store.pairs() {
                let sides = [number(pair.a.entity()), number(pair.b.entity())];
                let triangles = pair.touching.iter();
                touching.extend(triangles.map(|both| [sides[0], sides[1], both.triangle_a, both.triangle_b]));
            }
            let stages = &app.world().resource::<DetectionDiagnostics>().stages;
            let examined = stages.iter().filter(|stage| stage.name == "overlap").map(|stage| stage.pairs_out).sum();
            (touching, examined)
        })
        .collect()
}

/// Counts of pairs of triangles over a scene.
#[derive(Clone, Copy, Debug, Default)]
struct Counted {
    truth: usize,
    found: usize,
    matched: usize,
    examined: usize,
}

impl Counted {
    fn add(&mut self, other: &Self) {
        self.truth += other.truth;
        self.found += other.found;
        self.matched += other.matched;
        self.examined += other.examined;
    }
}

fn count(judged: &Judged, settings: CircumsphereSettings) -> Counted {
    let mut counted = Counted::default();
    for ((found, examined), truth) in play(judged, ContactMethod::Circumsphere, settings).iter().zip(&judged.touching) {
        counted.add(&Counted {
            truth: truth.len(),
            found: found.len(),
            matched: found.intersection(truth).count(),
            examined: *examined,
        });
    }
    counted
}

/// A measure at the smallest and at the largest φ, mean over all thresholds.
fn ends(rows: &[CapsRow], value: fn(&CapsRow) -> f64) -> Option<[f64; 2]> {
    let phis = || rows.iter().map(|row| row.phi);
    let at = |phi: f32| mean(rows.iter().filter(|row| row.phi == phi).map(value));
    Some([at(phis().fold(f32::INFINITY, f32::min))?, at(phis().fold(0.0, f32::max))?])
}

pub fn finding(rows: &[CapsRow]) -> Finding {
    let claim = "spheres about the circumcenter (φ = 0) resist tunnelling best, and flatter caps (larger φ) avoid \
                 needless tests";
    let measures: Option<[_; 3]> = (|| {
        Some([
            ends(rows, |row| row.tunnelling_rate)?,
            ends(rows, |row| row.needless_share)?,
            ends(rows, |row| row.missed_share)?,
        ])
    })();
    let Some([tunnelling, needless, missed]) = measures else {
        return Finding {
            claim: claim.to_owned(),
            found: "nothing was measured".to_owned(),
            outcome: Outcome::Undecided,
        };
    };
    let least = rows.iter().map(|row| row.phi).fold(f32::INFINITY, f32::min);
    let largest = rows.iter().map(|row| row.phi).fold(0.0, f32::max);
    let which = |phi: f32| rows.iter().filter(move |row| row.phi == phi).flat_map(|row| &row.which);
    let spares = if needless[1] < needless[0] { Outcome::Holds } else { Outcome::Fails };
    let both = |[first, last]: [f64; 2]| format!("{} and {}", percent(first), percent(last));
    Finding {
        claim: claim.to_owned(),
        found: format!(
            "at φ = {least} and φ = {largest}, respectively, {} of the shots tunnel, {} of the examined pairs do not \
             touch, and {} of the touching pairs are missed",
            both(tunnelling),
            both(needless),
            both(missed)
        ),
        outcome: Outcome::all(&[happens_less(which(least), which(largest)), spares]),
    }
}

pub fn tables(rows: &[CapsRow]) -> String {
    let header = [
        "threshold",
        "φ",
        "shots that tunnel",
        "touching pairs missed",
        "missed under the beam's edge",
        "pairs examined",
        "examined needlessly",
        "reported pairs false",
    ];
    table(
        &header.map(str::to_owned),
        rows.iter().map(|row| {
            vec![
                row.curvature_threshold.to_string(),
                row.phi.to_string(),
                percent(row.tunnelling_rate),
                percent(row.missed_share),
                percent(row.missed_share_on_edge),
                figure(row.examined_pairs as f64),
                percent(row.needless_share),
                percent(row.false_share),
            ]
        }),
    )
}
