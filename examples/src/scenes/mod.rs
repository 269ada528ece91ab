//! The physics scenes that examples, experiments, and tests play.
//!
//! A scene is built by name and played tick by tick. `measure` observes each tick, and `truth` judges the result in
//! f64.

pub mod bullet_cloth;
pub mod cloth_drop;
mod energy;
mod garment;
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

/// The names that [`scene`] accepts.
pub const SCENES: [&str; 9] =
    ["cloth_drop", "layers", "soft_tissue", "pile", "skirt", "bullet_cloth", "walking_skirt", "garment", "level"];

/// The scene with that name, or `None`.
pub fn scene(name: &str, variation: &Variation, recorder: Recorder) -> Option<Scene> {
    let build = match name {
        "cloth_drop" => cloth_drop::cloth_drop,
        "layers" => layers::layers,
        "soft_tissue" => soft_tissue::soft_tissue,
        "pile" => pile::pile,
        "skirt" => skirt::skirt,
        "bullet_cloth" => bullet_cloth::bullet_cloth,
        "walking_skirt" => walking_skirt::walking_skirt,
        "garment" => garment::garment,
        "level" => level::level,
        _ => return None,
    };
    Some(build(variation, recorder))
}

/// Size of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Extent {
    /// A few hundred triangles, for tests.
    Small,
    /// A few thousand triangles.
    #[default]
    Usual,
}

impl Extent {
    pub fn pick<T>(self, small: T, usual: T) -> T {
        match self {
            Self::Small => small,
            Self::Usual => usual,
        }
    }
}

/// The variable parameters of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Variation {
    /// Contact method.
    pub method: ContactMethod,
    /// Shape of every surface.
    pub shape: SurfaceShape,
    /// Settings of detection. The number of threads is 1 by default.
    pub detection: CircumsphereSettings,
    /// Settings of the response. By default, bodies stay awake, so that measurements show the solver.
    pub response: XpbdSettings,
    /// Whether everything that moves has [`SweptCollision`]; true by default.
    pub continuous: bool,
    pub extent: Extent,
    /// Object, target, and speed in `bullet_cloth`.
    pub shot: Shot,
    /// Walking speed of the character in `walking_skirt` and `garment`, from 0 to 10 meters per second.
    pub walking_speed: f64,
    /// Speed of the ball in `level`, in meters per second.
    pub ball_speed: f64,
}

impl Default for Variation {
    fn default() -> Self {
        Self {
            method: ContactMethod::default(),
            shape: SurfaceShape::default(),
            detection: CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() },
            response: XpbdSettings { sleep_speed: 0.0, ..XpbdSettings::default() },
            continuous: true,
            extent: Extent::default(),
            shot: Shot::default(),
            walking_speed: 1.2,
            ball_speed: 30.0,
        }
    }
}

/// A scene in play.
pub struct Scene {
    /// The world of the scene.
    pub stage: Stage,
    /// Number of ticks that show the point of the scene.
    pub ticks: u32,
    /// The ticks in which nothing new happens, in which jitter is meaningful.
    pub settled: Range<u32>,
    /// Whether the truth is evaluated after every tick, not only at the end.
    pub is_judged: bool,
    /// Moves kinematic objects to their places at a time, in seconds since the start.
    animate: Box<dyn FnMut(&mut Stage, f64)>,
    /// Number of vertices at places that they can only have reached by tunnelling, closed surfaces excluded.
    passed: Box<dyn Fn(&Stage) -> usize>,
}

impl Scene {
    /// A scene in which nothing is kinematic. The last quarter of its ticks counts as settled.
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

    pub fn tick(&mut self) {
        let time = self.stage.next_time();
        (self.animate)(&mut self.stage, time);
        self.stage.tick();
    }

    /// Number of body vertices that have tunnelled: they are inside a closed surface or a rigid shape, or behind
    /// something that they cannot have passed. Vertices that are not finite count too. Otherwise a body that has
    /// exploded would pass for one that was stopped.
    pub fn tunnelled(&self) -> usize {
        let stage = &self.stage;
        let inside = truth::vertices_inside(stage) + truth::vertices_in_shapes(stage);
        truth::vertices_nowhere(stage) + inside + (self.passed)(stage)
    }
}
