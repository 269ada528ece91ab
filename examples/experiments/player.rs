//! Plays a scene, tick by tick, for an experiment: from a start that is a little another one each time, and only as long as
//! it does not fly apart.

use bevy_circumsphere::{prelude::*, response::XpbdBody};
use bevy_ecs::prelude::*;
use circumsphere_support::random::Random;
use glam::Vec3;

use super::{
    headless::recording::Recorder,
    scenes::{
        Scene, Stage, Variation,
        measure::{Jitter, Measure, Tick, settled},
        scene,
    },
};

/// The paper's three kinds of scenes, and ours of that kind.
pub const KINDS: [(&str, &str); 3] = [("stable", "cloth_drop"), ("precision", "soft_tissue"), ("efficiency", "pile")];

/// In mean edges: far below what one sees, and enough to make another course of what is chaotic.
const DISTURBANCE: f32 = 1.0e-5;

/// Nothing falls or is pushed as fast, in meters per second: what is faster has been thrown by the solver.
const THROWN: f32 = 30.0;

/// A scene that is being played.
pub struct Player {
    pub scene: Scene,
    pub ticks: Vec<Tick>,
    /// Of all vertices, tick by tick: see [`Steadiness::trembling`].
    trembling: Vec<f64>,
    /// Whether something has been thrown. Nothing that follows means anything.
    pub is_broken: bool,
    /// Where the bodies' vertices were when the last tick began, and one tick before.
    last: [Vec<Vec<Vec3>>; 2],
    measure: Measure,
}

/// How quiet the settled ticks of a scene are.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steadiness {
    /// Mean way in a tick of the vertices that are in contact, in mean edges.
    pub jitter: f64,
    /// The mean second difference of all vertices that are free to move, in mean edges a tick: what of their motion is not steady. The
    /// same vertices for every method, where those in contact are others.
    pub trembling: f64,
    /// The share of contacts that come or go in a tick.
    pub churn: f64,
}

impl Player {
    /// The scene of that name; `repetition` tells how its start is disturbed.
    pub fn new(name: &str, variation: &Variation, repetition: u64) -> Self {
        let mut scene = scene(name, variation, Recorder::default()).expect("experiments play scenes that there are");
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

    /// Plays a tick. Whether another one may follow.
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

    /// Plays until the scene has shown what it is about, at most `most` ticks, and calls `look` after each.
    pub fn play(&mut self, most: usize, mut look: impl FnMut(&Self)) {
        while self.ticks.len() < (self.scene.ticks as usize).min(most) && self.tick() {
            look(self);
        }
    }

    /// Where the vertices of a body were when the last tick began: what its detection has seen.
    pub fn detected_positions(&self, body: usize) -> &[Vec3] {
        &self.last[0][body]
    }

    /// Of the settled ticks; `None` where there is nothing to tell of.
    pub fn steadiness(&self) -> Option<Steadiness> {
        let range = settled(&self.scene, self.ticks.len());
        let quiet = &self.ticks[range.clone()];
        if self.is_broken || quiet.is_empty() {
            return None;
        }
        let jitter: Jitter = quiet.iter().map(|tick| tick.jitter).sum();
        // There is no second difference in the first tick.
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
            let body = stage.app.world().get::<XpbdBody>(entity).expect("the scene's bodies stay");
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
    let body = stage.app.world().get::<XpbdBody>(entity).expect("the scene's bodies stay");
    let is_fine = |velocity: &Vec3| velocity.length() <= THROWN;
    !body.velocities.iter().all(is_fine) || !stage.positions(entity).iter().all(|position| position.is_finite())
}

/// A variation whose contacts are tested by `method`, where things are when a tick begins: what the method misses is missed.
pub fn variation(method: ContactMethod) -> Variation {
    Variation { method, continuous: false, extent: super::scenes::Extent::Small, ..Variation::default() }
}
