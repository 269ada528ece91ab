//! The physics scenes that the examples, the experiments and the tests play: bodies, what they meet, and what moves.
//!
//! A scene is built by name and played tick by tick; `measure` looks at what a tick did, `truth` judges the result in f64.

pub mod bullet_cloth;
mod cloth_drop;
mod energy;
mod layers;
mod level;
pub mod measure;
pub mod options;
mod pile;
pub mod program;
mod skirt;
mod soft_tissue;
mod stage;
pub mod truth;
mod walking_skirt;

use std::ops::Range;

use bevy_circumsphere::{prelude::*, response::XpbdSettings};

pub use self::{
    bullet_cloth::Shot,
    energy::Energy,
    stage::{Stage, TICK},
};
use crate::headless::recording::Recorder;

/// The names that [`scene`] knows.
pub const SCENES: [&str; 8] =
    ["cloth_drop", "layers", "soft_tissue", "pile", "skirt", "bullet_cloth", "walking_skirt", "level"];

/// The scene of that name, or `None` where there is none.
pub fn scene(name: &str, variation: &Variation, recorder: Recorder) -> Option<Scene> {
    let build = match name {
        "cloth_drop" => cloth_drop::cloth_drop,
        "layers" => layers::layers,
        "soft_tissue" => soft_tissue::soft_tissue,
        "pile" => pile::pile,
        "skirt" => skirt::skirt,
        "bullet_cloth" => bullet_cloth::bullet_cloth,
        "walking_skirt" => walking_skirt::walking_skirt,
        "level" => level::level,
        _ => return None,
    };
    Some(build(variation, recorder))
}

/// How large a scene is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Extent {
    /// Some hundred triangles: for tests.
    Small,
    /// Some thousand.
    #[default]
    Usual,
}

impl Extent {
    fn pick<T>(self, small: T, usual: T) -> T {
        match self {
            Self::Small => small,
            Self::Usual => usual,
        }
    }
}

/// What can be varied about a scene.
#[derive(Clone, Copy, Debug)]
pub struct Variation {
    /// How contacts are detected.
    pub method: ContactMethod,
    /// Settings of the detection, its threads among them: 1 by default.
    pub detection: CircumsphereSettings,
    /// Settings of the response.
    pub response: XpbdSettings,
    /// Whether everything that moves has [`SweptCollision`]; true by default.
    pub continuous: bool,
    /// How large it is.
    pub extent: Extent,
    /// What `bullet_cloth` shoots at what.
    pub shot: Shot,
    /// How fast the character of `walking_skirt` walks, 0 to 10 meters per second.
    pub walking_speed: f64,
    /// How fast the ball of `level` flies, in meters per second.
    pub ball_speed: f64,
}

impl Default for Variation {
    fn default() -> Self {
        Self {
            method: ContactMethod::default(),
            detection: CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() },
            response: XpbdSettings::default(),
            continuous: true,
            extent: Extent::default(),
            shot: Shot::default(),
            walking_speed: 1.2,
            ball_speed: 30.0,
        }
    }
}

/// A scene that is being played.
pub struct Scene {
    /// Its world.
    pub stage: Stage,
    /// How many ticks it takes to see what it is about.
    pub ticks: u32,
    /// The ticks in which nothing new happens, of those: where jitter tells something.
    pub settled: Range<u32>,
    /// Whether the truth is asked after every tick, not only at the end.
    pub is_judged: bool,
    /// Moves what physics does not move to where it is at a time, in seconds since the start.
    animate: Box<dyn FnMut(&mut Stage, f64)>,
    /// How many vertices are where they can only have come through something, closed surfaces left aside.
    passed: Box<dyn Fn(&Stage) -> usize>,
}

impl Scene {
    /// A scene in which only physics moves something. The last quarter of its ticks is settled.
    fn new(stage: Stage, ticks: u32) -> Self {
        let settled = ticks - ticks / 4..ticks;
        Self { stage, ticks, settled, is_judged: false, animate: Box::new(|_, _| ()), passed: Box::new(|_| 0) }
    }

    fn animated(self, animate: impl FnMut(&mut Stage, f64) + 'static) -> Self {
        Self { animate: Box::new(animate), ..self }
    }

    fn passed(self, passed: impl Fn(&Stage) -> usize + 'static) -> Self {
        Self { passed: Box::new(passed), ..self }
    }

    fn judged(self) -> Self {
        Self { is_judged: true, ..self }
    }

    /// Plays one tick.
    pub fn tick(&mut self) {
        let time = self.stage.next_time();
        (self.animate)(&mut self.stage, time);
        self.stage.tick();
    }

    /// How many vertices of bodies have tunnelled: are inside a closed surface or a rigid shape, or behind what they cannot have
    /// passed. Those that are nowhere count too, or a body that has burst would pass for one that was stopped.
    pub fn tunnelled(&self) -> usize {
        let stage = &self.stage;
        let inside = truth::vertices_inside(stage) + truth::vertices_in_shapes(stage);
        truth::vertices_nowhere(stage) + inside + (self.passed)(stage)
    }
}
