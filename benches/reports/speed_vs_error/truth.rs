//! The f64 reference for a scene, computed once at the largest contact distance and used for all distances.

use super::scene::{Scene, wide};
use circumsphere_truth::{ClosestKind, closest_features, touching_pairs_between_tree, touching_pairs_tree};
use glam::DVec3;
use std::{num::NonZero, thread};

/// Relative band around the contact distance in which either answer is right, because f32 inputs are rounded.
pub const BAND: f64 = 1.0e-4;

/// If two triangles are closer than this share of their size, rounding of f32 positions hides the direction between
/// them.
const NO_DIRECTION: f64 = 1.0e-4;

/// Identifies a pair of triangles: both bodies, the lower one first, and both triangles.
pub type PairName = [u32; 4];

/// Two triangles within the largest contact distance.
#[derive(Clone, Copy, Debug)]
pub struct TruePair {
    pub name: PairName,
    pub distance: f64,
    pub crosses: bool,
    /// Unit vector from the first triangle to the second, between their closest points. `None` if they cross or nearly
    /// do.
    pub direction: Option<DVec3>,
    /// The longest edge of both triangles.
    pub size: f64,
}

/// The pairs of one measured tick, sorted by name.
pub type TrueTick = Vec<TruePair>;

/// The pairs within `distance_edges` plus the band, for each measured tick.
pub fn truth(scene: &Scene, distance_edges: f64) -> Vec<TrueTick> {
    let threads = thread::available_parallelism().map_or(1, NonZero::get).min(scene.measured.len());
    let mut ticks: Vec<TrueTick> = vec![TrueTick::new(); scene.measured.len()];
    let share = scene.measured.len().div_ceil(threads);
    thread::scope(|scope| {
        let work = scene.measured.chunks(share).zip(ticks.chunks_mut(share)).map(|(numbers, ticks)| {
            scope.spawn(move || {
                for (&tick, pairs) in numbers.iter().zip(ticks) {
                    *pairs = true_tick(scene, tick, distance_edges);
                }
            })
        });
        // Join the threads one by one, because heap usage is measured next. The end of the scope does not wait until a
        // thread has freed its last bytes.
        for thread in work.collect::<Vec<_>>() {
            thread.join().expect("the reference does not panic");
        }
    });
    ticks
}

fn true_tick(scene: &Scene, tick: usize, distance_edges: f64) -> TrueTick {
    let (_, distance) = scene.thickness(distance_edges);
    let limit = distance * (1.0 + 2.0 * BAND);
    let positions: Vec<Vec<DVec3>> = scene.bodies.iter().map(|body| wide(&body.ticks[tick])).collect();
    let mut pairs = Vec::new();
    for [a, b] in scene.body_pairs() {
        let (body_a, body_b) = (&scene.bodies[a], &scene.bodies[b]);
        let touching = if a == b {
            touching_pairs_tree(&positions[a], &body_a.triangles, &body_a.weld, limit)
        } else {
            touching_pairs_between_tree(&positions[a], &body_a.triangles, &positions[b], &body_b.triangles, limit)
        };
        pairs.extend(touching.into_iter().map(|pair| {
            let corners = |body: usize, triangle: u32| {
                scene.bodies[body].triangles[triangle as usize].map(|vertex| positions[body][vertex as usize])
            };
            let (own, other) = (corners(a, pair.triangle_a), corners(b, pair.triangle_b));
            let closest = closest_features(&own, &other);
            let longest =
                |corners: &[DVec3; 3]| (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max);
            let size = longest(&own).max(longest(&other));
            let crosses = closest.kind == ClosestKind::Crossing;
            let direction = (!crosses && pair.distance > NO_DIRECTION * size)
                .then(|| (closest.point_b - closest.point_a).normalize_or_zero());
            TruePair {
                name: [a as u32, b as u32, pair.triangle_a, pair.triangle_b],
                distance: pair.distance,
                crosses,
                direction,
                size,
            }
        }));
    }
    pairs
}
