//! Plays a recording in a headless app and asks queries of its frames.

use std::time::{Duration, Instant};

use bevy_app::prelude::*;
use bevy_circumsphere::{ClosestPoint, RayHit, geometry::TopologyError, prelude::*};
use bevy_ecs::system::RunSystemOnce;
use circumsphere_examples::headless::{headless_app, move_surface, recording::Recorder};
use circumsphere_support::{random::Random, recording::Recording};
use glam::Vec3;

/// Random rays, and points, for each frame, where no files are given.
const AROUND: usize = 1000;

/// A ray at a frame.
#[derive(Clone, Copy)]
pub struct Ray {
    pub frame: usize,
    pub origin: Vec3,
    pub direction: Vec3,
    pub max_distance: f32,
}

/// A point beside a frame.
#[derive(Clone, Copy)]
pub struct Point {
    pub frame: usize,
    pub position: Vec3,
    pub max_distance: f32,
}

/// What is asked, in the order of the files.
#[derive(Default)]
pub struct Queries {
    pub rays: Vec<Ray>,
    pub points: Vec<Point>,
}

impl Queries {
    /// Random rays through the box of the first frame, from around it, and points in there, for every frame.
    pub fn around(recording: &Recording) -> Self {
        let points = || recording.frames[0].iter().copied().map(Vec3::from_array);
        let (min, max) =
            points().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), point| (min.min(point), max.max(point)));
        let (center, half) = ((min + max) * 0.5, (max - min) * 0.5);
        let mut random = Random::new(1);
        let mut vector = || Vec3::from_array([0; 3].map(|_| random.signed_unit()));
        let mut queries = Self::default();
        for frame in 0..recording.frames.len() {
            for _ in 0..AROUND {
                let origin = center + vector().normalize_or(Vec3::Y) * 2.0 * half.length();
                let target = center + vector() * half;
                queries.rays.push(Ray { frame, origin, direction: target - origin, max_distance: f32::INFINITY });
                queries.points.push(Point { frame, position: center + vector() * half, max_distance: f32::INFINITY });
            }
        }
        queries
    }
}

/// The numbers of the items of each frame.
fn by_frame(frames: usize, of: impl Iterator<Item = usize>) -> Vec<Vec<usize>> {
    let mut numbers = vec![Vec::new(); frames];
    for (number, frame) in of.enumerate() {
        numbers[frame].push(number);
    }
    numbers
}

/// What the queries of one frame took. The first of them may update the tree.
pub struct FrameTimes {
    pub rays: usize,
    pub hits: usize,
    pub ray_time: Duration,
    pub points: usize,
    pub point_time: Duration,
}

/// All answers, in the order of the files.
pub struct Answers {
    pub hits: Vec<Option<RayHit>>,
    pub closest: Vec<Option<ClosestPoint>>,
    pub frames: Vec<FrameTimes>,
}

/// Plays the frames that are asked about.
pub fn play(recording: &Recording, queries: &Queries) -> Result<Answers, TopologyError> {
    let positions = |frame: usize| recording.frames[frame].iter().copied().map(Vec3::from_array).collect::<Vec<_>>();
    let mut app = headless_app(
        DeformableCollisionPlugins::new(Update).build(),
        CircumsphereSettings::default(),
        Recorder::default(),
    );
    let surface = DeformableSurface::from_mesh(&positions(0), &recording.triangles)?;
    let entity = app.world_mut().spawn((surface, QueryOnly)).id();
    let rays = by_frame(recording.frames.len(), queries.rays.iter().map(|ray| ray.frame));
    let points = by_frame(recording.frames.len(), queries.points.iter().map(|point| point.frame));
    let mut answers =
        Answers { hits: vec![None; queries.rays.len()], closest: vec![None; queries.points.len()], frames: Vec::new() };
    for (frame, (rays, points)) in rays.iter().zip(&points).enumerate() {
        if rays.is_empty() && points.is_empty() {
            continue;
        }
        move_surface(&mut app, entity, positions(frame));
        app.update();
        let rays: Vec<(usize, Ray)> = rays.iter().map(|&number| (number, queries.rays[number])).collect();
        let points: Vec<(usize, Point)> = points.iter().map(|&number| (number, queries.points[number])).collect();
        let (ray_count, point_count) = (rays.len(), points.len());
        let ask = move |query: SurfaceQuery| {
            let filter = SurfaceQueryFilter::default();
            let start = Instant::now();
            let hits: Vec<_> = rays
                .iter()
                .map(|(number, ray)| (*number, query.cast_ray(ray.origin, ray.direction, ray.max_distance, &filter)))
                .collect();
            let ray_time = start.elapsed();
            let start = Instant::now();
            let closest: Vec<_> = points
                .iter()
                .map(|(number, point)| (*number, query.closest_point(point.position, point.max_distance, &filter)))
                .collect();
            (hits, ray_time, closest, start.elapsed())
        };
        let (hits, ray_time, closest, point_time) =
            app.world_mut().run_system_once(ask).expect("the plugins insert what queries read");
        answers.frames.push(FrameTimes {
            rays: ray_count,
            hits: hits.iter().filter(|(_, hit)| hit.is_some()).count(),
            ray_time,
            points: point_count,
            point_time,
        });
        for (number, hit) in hits {
            answers.hits[number] = hit;
        }
        for (number, found) in closest {
            answers.closest[number] = found;
        }
    }
    Ok(answers)
}
