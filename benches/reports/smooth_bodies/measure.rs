//! Measures the errors and the times of one scene at one resolution, flat and smooth in turn.

use std::{hint::black_box, time::Duration};

use bevy_app::prelude::*;
use bevy_circumsphere::{ContactMethod, prelude::*};
use bevy_ecs::{prelude::*, system::SystemState};
use circumsphere_examples::headless::{headless_app, move_surface, recording::Recorder};
use circumsphere_reports::statistics::{mean, median};
use circumsphere_truth::BodyDistance;
use cpu_time::ProcessTime;
use glam::{DVec3, Vec3};
use serde::Serialize;

use super::{
    bodies::{Body, BodyMesh},
    scenes::{GAPS, Moment, Scene},
};

/// By how many edges the contact distance exceeds the gap, so that flat triangles, which are inside the bodies, are
/// still found.
const REACH: f64 = 0.5;

/// The default contact distance of two surfaces in mean edges.
pub const DEFAULT_DISTANCE: f64 = 0.1;

pub const SHAPES: [SurfaceShape; 2] = [SurfaceShape::Flat, SurfaceShape::Smooth];

/// One scene at one resolution with one method and one surface shape. The size of the first body is 1: half of its
/// longest extent. Columns whose names start with `time` are times. All others are equal in any two runs on one machine.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    pub scene: &'static str,
    pub method: String,
    pub shape: String,
    pub level: u32,
    /// Mean of the two meshes.
    pub triangles: f64,
    /// Mean of the two meshes' mean edges, in sizes.
    pub edge: f64,
    pub poses: usize,
    /// Poses without any contact. They have no error.
    pub lost_poses: usize,
    /// Absolute error of the least distance: mean, median, and 95th percentile over poses, in sizes and in edges.
    pub error_mean: Option<f64>,
    pub error_median: Option<f64>,
    pub error_p95: Option<f64>,
    pub error_mean_edges: Option<f64>,
    pub error_p95_edges: Option<f64>,
    /// Angle between the normal of the closest contact and the true one, in degrees.
    pub normal_mean_degrees: Option<f64>,
    pub normal_median_degrees: Option<f64>,
    pub normal_p95_degrees: Option<f64>,
    /// Share of the poses at the smaller gap in which nothing is within the default contact distance.
    pub missed_share: Option<f64>,
    /// Median over poses of the mean tick.
    pub time_ms: f64,
}

/// Two surfaces in an app, on one thread.
pub struct Player {
    app: App,
    surfaces: [Entity; 2],
    contacts: SystemState<SurfaceContacts<'static>>,
}

impl Player {
    pub fn new(meshes: &[BodyMesh; 2], at_rest: &Moment, method: ContactMethod, shape: SurfaceShape) -> Self {
        let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
        let surfaces = [0, 1].map(|side| {
            let positions = at_rest.body(side).positions(&meshes[side]);
            let surface =
                DeformableSurface::from_mesh(&positions, &meshes[side].triangles).expect("a generated mesh is valid");
            app.world_mut().spawn((surface, SurfaceThickness::World(0.0), method, shape)).id()
        });
        let contacts = SystemState::new(app.world_mut());
        Self { app, surfaces, contacts }
    }

    pub fn set_contact_distance(&mut self, distance: f64) {
        for surface in self.surfaces {
            *self.app.world_mut().get_mut(surface).expect("it was spawned with a thickness") =
                SurfaceThickness::World((0.5 * distance) as f32);
        }
    }

    /// Writes positions, then detects and reads every contact. Only the latter two are timed, in time of the processor:
    /// other programs would prolong the clock's, and long ticks more often than short ones.
    pub fn tick(&mut self, positions: &[Vec<Vec3>; 2]) -> Duration {
        for (surface, positions) in self.surfaces.into_iter().zip(positions) {
            move_surface(&mut self.app, surface, positions.clone());
        }
        let start = ProcessTime::now();
        self.app.update();
        let contacts = self.contacts.get(self.app.world()).expect("the plugins insert the store");
        contacts.iter().for_each(|contact| _ = black_box(contact.distance()));
        start.elapsed()
    }

    /// The least distance of the last tick and its normal, from the first surface to the second.
    pub fn least(&mut self) -> Option<(f64, DVec3)> {
        let contacts = self.contacts.get(self.app.world()).expect("the plugins insert the store");
        let least = contacts
            .between(self.surfaces[0], self.surfaces[1])
            .min_by(|one, other| one.distance().total_cmp(&other.distance()))?;
        Some((f64::from(least.distance()), least.normal().as_dvec3()))
    }
}

impl Moment {
    fn body(&self, side: usize) -> Body {
        if side == 0 { self.first } else { Body::Closed(self.second) }
    }

    pub fn meshes(&self, level: u32) -> [BodyMesh; 2] {
        [0, 1].map(|side| self.body(side).mesh(level))
    }

    pub fn positions(&self, meshes: &[BodyMesh; 2]) -> [Vec<Vec3>; 2] {
        [0, 1].map(|side| self.body(side).positions(&meshes[side]))
    }

    /// Mean of the two meshes' mean edges.
    pub fn mean_edge(&self, meshes: &[BodyMesh; 2]) -> f64 {
        0.5 * (self.body(0).mean_edge(&meshes[0]) + self.body(1).mean_edge(&meshes[1]))
    }
}

/// The angle between two unit vectors in degrees, accurate near 0.
pub fn degrees_between(one: DVec3, other: DVec3) -> f64 {
    one.cross(other).length().atan2(one.dot(other)).to_degrees()
}

/// What one surface shape measures, pose by pose.
#[derive(Default)]
struct Record {
    errors: Vec<f64>,
    normals: Vec<f64>,
    lost: usize,
    near: usize,
    missed: usize,
    times: Vec<f64>,
}

impl Record {
    fn add(&mut self, least: Option<(f64, DVec3)>, truth: &BodyDistance) {
        match least {
            Some((distance, normal)) => {
                self.errors.push((distance - truth.distance).abs());
                self.normals.push(degrees_between(normal, truth.normal));
            }
            None => self.lost += 1,
        }
    }

    /// Whether the default contact distance would have found the contact.
    fn add_near(&mut self, least: Option<(f64, DVec3)>, edge: f64) {
        self.near += 1;
        self.missed += usize::from(least.is_none_or(|(distance, _)| distance > DEFAULT_DISTANCE * edge));
    }
}

/// The smallest value that 95 % of the values do not exceed.
fn p95(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get((sorted.len() * 95).div_ceil(100).saturating_sub(1)).copied()
}

/// Measures a scene at one resolution with one method: one cell for flat and one for smooth surfaces. In each pose, one
/// plays after the other, in alternating order.
pub fn measure(
    scene: &Scene,
    poses_per_gap: usize,
    timed_ticks: usize,
    level: u32,
    method: ContactMethod,
) -> [Cell; 2] {
    let at_rest = scene.at_rest();
    let meshes = at_rest.meshes(level);
    let edge = at_rest.mean_edge(&meshes);
    let mut players = SHAPES.map(|shape| Player::new(&meshes, &at_rest, method, shape));
    let mut records = [(); 2].map(|()| Record::default());
    let poses = poses_per_gap * GAPS.len();
    for number in 0..poses {
        let pose = scene.pose(number);
        let gap = GAPS[number % GAPS.len()];
        // The first tick warms up: bodies jump to their pose, and its errors are measured.
        let moments: Vec<Moment> = (0..=timed_ticks).map(|tick| pose.moment(tick, gap * edge)).collect();
        let positions: Vec<[Vec<Vec3>; 2]> = moments.iter().map(|moment| moment.positions(&meshes)).collect();
        let truth = moments[0].truth();
        let order = if number % 4 < 2 { [0, 1] } else { [1, 0] };
        for shape in order {
            let (player, record) = (&mut players[shape], &mut records[shape]);
            player.set_contact_distance((gap + REACH) * edge);
            player.tick(&positions[0]);
            let least = player.least();
            record.add(least, &truth);
            if gap < DEFAULT_DISTANCE {
                record.add_near(least, edge);
            }
            let time: Duration = positions[1..].iter().map(|positions| player.tick(positions)).sum();
            record.times.push(time.as_secs_f64() * 1.0e3 / timed_ticks as f64);
        }
    }
    let mut records = records.into_iter();
    SHAPES.map(|shape| {
        let record = records.next().expect("there is one for each shape");
        let edges = |value: Option<f64>| value.map(|value| value / edge);
        let error_mean = mean(record.errors.iter().copied());
        let error_p95 = p95(&record.errors);
        Cell {
            scene: scene.name,
            method: format!("{method:?}"),
            shape: format!("{shape:?}"),
            level,
            triangles: 0.5 * (meshes[0].triangles.len() + meshes[1].triangles.len()) as f64,
            edge,
            poses,
            lost_poses: record.lost,
            error_mean,
            error_median: median(record.errors),
            error_p95,
            error_mean_edges: edges(error_mean),
            error_p95_edges: edges(error_p95),
            normal_mean_degrees: mean(record.normals.iter().copied()),
            normal_p95_degrees: p95(&record.normals),
            normal_median_degrees: median(record.normals),
            missed_share: (record.near > 0).then(|| record.missed as f64 / record.near as f64),
            time_ms: median(record.times).unwrap_or_default(),
        }
    })
}
