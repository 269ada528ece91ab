//! Plays a scene tick by tick for an experiment. Each repetition starts slightly differently, and ends if the scene
//! flies apart.

use bevy_circumsphere::response::XpbdBody;
use bevy_ecs::prelude::*;
use circumsphere_examples::{
    headless::recording::Recorder,
    scenes::{
        self, Scene, Stage, Variation,
        measure::{Jitter, Measure, Tick, settled},
        scene,
    },
};
use circumsphere_support::random::Random;
use glam::Vec3;

use super::tested::Tested;

/// The three kinds of scenes in the paper, and our scene of each kind.
pub const KINDS: [(&str, &str); 3] = [("stable", "cloth_drop"), ("precision", "soft_tissue"), ("efficiency", "pile")];

/// Disturbance of the start, in mean edges. It is far too small to be visible, but enough to change the course of a
/// chaotic scene.
const DISTURBANCE: f32 = 1.0e-5;

/// Speed limit in meters per second. Nothing falls or is pushed this fast. Anything faster was thrown by the solver.
const THROWN: f32 = 30.0;

/// A scene in play.
pub struct Player {
    pub scene: Scene,
    pub ticks: Vec<Tick>,
    /// Trembling of each tick: see [`Steadiness::trembling`].
    trembling: Vec<f64>,
    /// Whether a vertex was thrown. Results after that are meaningless.
    pub is_broken: bool,
    /// Positions of the bodies' vertices at the beginning of the last tick, and one tick before.
    last: [Vec<Vec<Vec3>>; 2],
    measure: Measure,
}

/// Steadiness of the settled ticks of a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steadiness {
    /// Mean displacement per tick of the vertices in contact, in mean edges.
    pub jitter: f64,
    /// Mean second difference of all free vertices, in mean edges per tick: the unsteady part of their motion. Unlike
    /// the vertices in contact, the free vertices are the same for every method.
    pub trembling: f64,
    /// Share of contacts that come or go in a tick.
    pub churn: f64,
}

impl Player {
    /// Sets up the scene with the given name. `repetition` seeds the disturbance of the start.
    pub fn new(name: &str, variation: &Variation, repetition: u64) -> Self {
        let mut scene = scene(name, variation, Recorder::default()).expect("experiments only play existing scenes");
        let mut random = Random::new(0x5EED ^ repetition);
        for body in scene.stage.bodies.clone() {
            let reach = DISTURBANCE * scene.stage.surface(body).mean_edge();
            let mut positions = scene.stage.positions(body).to_vec();
            for position in &mut positions {
                *position += reach * Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
            }
            scene.stage.move_vertices(body, positions.into_iter().enumerate());
        }
        Self {
            scene,
            ticks: Vec::new(),
            trembling: Vec::new(),
            is_broken: false,
            last: <[Vec<Vec<Vec3>>; 2]>::default(),
            measure: Measure::default(),
        }
    }

    /// Plays a tick. Returns whether the scene may go on.
    pub fn tick(&mut self) -> bool {
        let stage = &self.scene.stage;
        let now: Vec<Vec<Vec3>> = stage.bodies.iter().map(|&body| stage.positions(body).to_vec()).collect();
        self.last.swap(0, 1);
        self.last[0] = now;
        self.ticks.push(self.measure.tick(&mut self.scene));
        let stage = &self.scene.stage;
        self.is_broken = stage.bodies.iter().any(|&body| is_thrown(stage, body));
        if !self.last[1].is_empty() {
            self.trembling.push(self.second_difference());
        }
        !self.is_broken
    }

    /// Plays at most `most` ticks of the scene, until it breaks, and calls `look` after each.
    pub fn play(&mut self, most: usize, mut look: impl FnMut(&Self)) {
        while self.ticks.len() < (self.scene.ticks as usize).min(most) && self.tick() {
            look(self);
        }
    }

    /// Positions of a body's vertices at the beginning of the last tick, as its detection used them.
    pub fn detected_positions(&self, body: usize) -> &[Vec3] {
        &self.last[0][body]
    }

    /// Steadiness of the settled ticks. `None` if the scene broke or has no settled ticks.
    pub fn steadiness(&self) -> Option<Steadiness> {
        let range = settled(&self.scene, self.ticks.len());
        let quiet = &self.ticks[range.clone()];
        if self.is_broken || quiet.is_empty() {
            return None;
        }
        let jitter: Jitter = quiet.iter().map(|tick| tick.jitter).sum();
        // The first tick has no second difference.
        let trembling = &self.trembling[range.start.saturating_sub(1)..range.end - 1];
        Some(Steadiness {
            jitter: jitter.step(),
            trembling: trembling.iter().sum::<f64>() / trembling.len().max(1) as f64,
            churn: quiet.iter().map(|tick| tick.churn).sum::<f64>() / quiet.len() as f64,
        })
    }

    fn second_difference(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0_usize);
        let stage = &self.scene.stage;
        for (place, &entity) in stage.bodies.iter().enumerate() {
            let edge = f64::from(stage.surface(entity).mean_edge());
            let body = stage.app.world().get::<XpbdBody>(entity).expect("bodies are never removed");
            let [last, before] = [&self.last[0][place], &self.last[1][place]];
            for (vertex, now) in stage.positions(entity).iter().enumerate() {
                if body.inverse_masses[vertex] > 0.0 {
                    let [now, last, before] = [*now, last[vertex], before[vertex]].map(Vec3::as_dvec3);
                    sum += (now - 2.0 * last + before).length() / edge;
                    count += 1;
                }
            }
        }
        sum / count.max(1) as f64
    }
}

fn is_thrown(stage: &Stage, entity: Entity) -> bool {
    let body = stage.app.world().get::<XpbdBody>(entity).expect("bodies are never removed");
    let is_fine = |velocity: &Vec3| velocity.length() <= THROWN;
    !body.velocities.iter().all(is_fine) || !stage.positions(entity).iter().all(|position| position.is_finite())
}

/// A variation that detects contacts as tested, and only at the beginning of each tick, so that missed pairs stay
/// missed.
pub fn variation(tested: Tested) -> Variation {
    let (method, shape) = (tested.method(), tested.shape());
    Variation { method, shape, continuous: false, extent: scenes::Extent::Small, ..Variation::default() }
}
