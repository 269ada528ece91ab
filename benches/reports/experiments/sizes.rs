//! How much fits into a frame: cloths of 3,000 vertices that settle on hilly ground of 100,000 triangles each. Sizes
//! start at a sixteenth of such a scene and grow until a tick takes longer than a frame.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings,
    detection::DetectionDiagnostics,
    prelude::*,
    response::{XpbdDiagnostics, XpbdMaterial},
};
use bevy_ecs::prelude::*;
use circumsphere_examples::{
    headless::{headless_app, move_surface, recording::Recorder},
    scenes::Stage,
};
use circumsphere_reports::{
    cloth_scenes::{DEFORMING, HILLS_FALL, HILLS_THICKNESS, STATIC, cloths_above_hills},
    finding::{Finding, Outcome, figure, percent, table},
    statistics::median,
};
use circumsphere_support::scenes::Mesh;
use glam::Vec3;
use indicatif::ProgressBar;
use serde::Serialize;

use super::{options::Extent, player::variation, tested::Tested};

/// A frame at 60 frames per second, in milliseconds.
pub const FRAME_MS: f64 = 1_000.0 / 60.0;

/// Multiples of the paper's scene.
const MULTIPLES: [f64; 8] = [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// Above this multiple, only one method is measured, because the response takes far longer than a frame.
const MOST_RESPONSES: f64 = 2.0;

const THICKNESS: SurfaceThickness = SurfaceThickness::World(HILLS_THICKNESS);

/// Number of measured ticks after the cloths have fallen.
const MEASURED: usize = 9;

/// A size and the median times per tick, on one thread.
#[derive(Clone, Debug, Serialize)]
pub struct SizesRow {
    #[serde(serialize_with = "super::report::name_of_method")]
    pub method: Tested,
    /// Multiple of the paper's scene.
    pub multiple: f64,
    pub deforming_vertices: usize,
    pub static_triangles: usize,
    /// Contacts within the contact distance, at the end.
    pub contacts: usize,
    /// Time to detect the same motion without a response and without a margin, in milliseconds.
    pub time_detection_alone_ms: f64,
    /// Time to detect with the margin of the response, in milliseconds.
    pub time_detection_ms: f64,
    pub time_response_ms: f64,
    /// Share of a frame at 60 frames per second.
    pub frame_share_detection_alone: f64,
    pub frame_share_with_response: f64,
}

/// Measures one multiple after the other, until detection alone takes longer than a frame with both methods.
pub fn measure(extent: Extent, progress: &ProgressBar) -> Vec<SizesRow> {
    let multiples = extent.pick(&MULTIPLES[..1], &MULTIPLES[..]);
    let (fall, measured) = extent.pick((3, 3), (HILLS_FALL, MEASURED));
    progress.set_length(multiples.len() as u64);
    let mut rows: Vec<SizesRow> = Vec::new();
    for &multiple in multiples {
        rows.extend(measure_size(multiple, fall, measured));
        progress.inc(1);
        if rows.iter().rev().take(2).all(|row| row.time_detection_alone_ms > FRAME_MS) {
            break;
        }
    }
    rows
}

/// Results of the measured ticks with a response: median times, the contacts at the end, and the motion.
struct Played {
    detection: f64,
    response: f64,
    contacts: usize,
    motion: Vec<Vec<Vec<Vec3>>>,
}

fn play(method: Tested, ground: &Mesh, cloths: &[Mesh], fall: usize, measured: usize) -> Played {
    let mut stage = Stage::new(&variation(method), Recorder::default());
    stage.add_obstacle("ground", ground, THICKNESS);
    for cloth in cloths {
        stage.add_body("cloth", cloth, XpbdMaterial::CLOTH, |body| body, (SelfCollision, THICKNESS));
    }
    (0..fall).for_each(|_| stage.tick());
    let (mut detection, mut response, mut contacts, mut motion) = (Vec::new(), Vec::new(), 0, Vec::new());
    for _ in 0..measured {
        motion.push(stage.bodies.iter().map(|&body| stage.positions(body).to_vec()).collect());
        stage.tick();
        let world = stage.app.world();
        let diagnostics = world.resource::<XpbdDiagnostics>();
        let times = [diagnostics.gathering, diagnostics.solving, diagnostics.guarding];
        response.push(1.0e3 * times.iter().map(Duration::as_secs_f64).sum::<f64>());
        detection.push(1.0e3 * world.resource::<DetectionDiagnostics>().total().as_secs_f64());
        contacts =
            stage.with_contacts(|contacts| contacts.iter().filter(|contact| contact.separation() <= 0.0).count());
    }
    let [detection, response] = [detection, response].map(|times| median(times).unwrap_or_default());
    Played { detection, response, contacts, motion }
}

fn measure_size(multiple: f64, fall: usize, measured: usize) -> Vec<SizesRow> {
    let (ground, cloths) = cloths_above_hills(multiple);
    let own = play(Tested::Circumsphere, &ground, &cloths, fall, measured);
    let exact = (multiple <= MOST_RESPONSES).then(|| play(Tested::Exact, &ground, &cloths, fall, measured));
    // Each method replays the motion that resulted from its own contacts.
    [(Tested::Circumsphere, Some(own)), (Tested::Exact, exact)]
        .into_iter()
        .filter_map(|(method, played)| {
            let played = played?;
            let alone = median(replay(method, &ground, &cloths, &played.motion)).unwrap_or_default();
            Some(SizesRow {
                method,
                multiple,
                deforming_vertices: cloths.iter().map(|cloth| cloth.positions.len()).sum(),
                static_triangles: ground.triangles.len(),
                contacts: played.contacts,
                time_detection_alone_ms: alone,
                time_detection_ms: played.detection,
                time_response_ms: played.response,
                frame_share_detection_alone: alone / FRAME_MS,
                frame_share_with_response: (played.detection + played.response) / FRAME_MS,
            })
        })
        .collect()
}

/// Detection times of a motion without a response. The first detection, which builds trees, is left out.
fn replay(method: Tested, ground: &Mesh, cloths: &[Mesh], motion: &[Vec<Vec<Vec3>>]) -> Vec<f64> {
    let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
    let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
    let mut spawn = |mesh: &Mesh, is_cloth: bool| {
        let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
        let (surface, positions) =
            DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("the meshes are valid");
        let mut entity = app.world_mut().spawn((surface, positions, method.method(), THICKNESS));
        if is_cloth {
            entity.insert(SelfCollision);
        }
        entity.id()
    };
    spawn(ground, false);
    let cloths: Vec<Entity> = cloths.iter().map(|cloth| spawn(cloth, true)).collect();
    let times = motion.iter().map(|tick| {
        for (&cloth, positions) in cloths.iter().zip(tick) {
            move_surface(&mut app, cloth, positions.clone());
        }
        app.update();
        1.0e3 * app.world().resource::<DetectionDiagnostics>().total().as_secs_f64()
    });
    let times: Vec<f64> = times.collect();
    times[1..].to_vec()
}

/// Number of deforming vertices at which a tick takes a whole frame, interpolated logarithmically between measured
/// sizes. `None` if the measured sizes do not cross that limit.
fn vertices_in_a_frame(rows: &[&SizesRow], share: fn(&SizesRow) -> f64) -> Option<f64> {
    let points: Vec<(f64, f64)> = rows.iter().map(|row| (row.deforming_vertices as f64, share(row))).collect();
    points.windows(2).find(|pair| pair[0].1 <= 1.0 && pair[1].1 > 1.0).map(|pair| {
        let [from, to] = [pair[0], pair[1]].map(|(vertices, share)| (vertices.ln(), share.ln()));
        (from.0 - (to.0 - from.0) * from.1 / (to.1 - from.1)).exp()
    })
}

/// Describes a method's share of a frame at the paper's size, and the size at which a tick takes a whole frame.
fn told(rows: &[SizesRow], method: Tested, share: fn(&SizesRow) -> f64) -> Option<(String, f64)> {
    let own: Vec<&SizesRow> = rows.iter().filter(|row| row.method == method).collect();
    let taken = share(own.iter().find(|row| row.multiple == 1.0)?);
    let (least, most) = (own[0].deforming_vertices, own[own.len() - 1].deforming_vertices);
    let full = match vertices_in_a_frame(&own, share) {
        Some(vertices) => format!("a whole frame at {} vertices", figure(vertices)),
        None if taken > 1.0 => format!("already more than a frame at {least} vertices"),
        None => format!("still less than a frame at {most} vertices"),
    };
    Some((format!("{} of a frame ({full})", percent(taken)), taken))
}

pub fn finding(rows: &[SizesRow]) -> Finding {
    let claim = format!(
        "{DEFORMING} deforming vertices among {STATIC} static triangles fit into a frame of {} ms",
        figure(FRAME_MS)
    );
    let alone = |row: &SizesRow| row.frame_share_detection_alone;
    let with = |row: &SizesRow| row.frame_share_with_response;
    let [own, exact] = [Tested::Circumsphere, Tested::Exact]
        .map(|method| Some((told(rows, method, alone)?, told(rows, method, with)?)));
    let (Some((own, own_whole)), Some((exact, exact_whole))) = (own, exact) else {
        return Finding { claim, found: "that size was not measured".to_owned(), outcome: Outcome::Undecided };
    };
    let fits = |share: f64| if share <= 1.0 { Outcome::Holds } else { Outcome::Fails };
    Finding {
        claim,
        found: format!(
            "on one thread, detection alone takes {} with circumspheres and {} with the exact method; with the \
             response, a tick takes {} and {}",
            own.0, exact.0, own_whole.0, exact_whole.0
        ),
        outcome: Outcome::all(&[fits(own.1), fits(own_whole.1)]),
    }
}

pub fn tables(rows: &[SizesRow]) -> String {
    let header = [
        "method",
        "deforming vertices",
        "static triangles",
        "contacts",
        "detection alone (ms)",
        "share of a frame",
        "detection + response (ms)",
        "share of a frame",
    ];
    table(
        &header.map(str::to_owned),
        rows.iter().map(|row| {
            vec![
                format!("{:?}", row.method),
                row.deforming_vertices.to_string(),
                row.static_triangles.to_string(),
                row.contacts.to_string(),
                figure(row.time_detection_alone_ms),
                percent(row.frame_share_detection_alone),
                format!("{} + {}", figure(row.time_detection_ms), figure(row.time_response_ms)),
                percent(row.frame_share_with_response),
            ]
        }),
    )
}
