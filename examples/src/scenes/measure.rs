//! Measures each tick of a scene, and summarizes a run.

use std::{
    collections::{BTreeSet, HashSet},
    iter::Sum,
    ops::{Add, Range},
    time::{Duration, Instant},
};

use bevy_circumsphere::{detection::DetectionDiagnostics, geometry::ContactKey, prelude::*, response::XpbdDiagnostics};
use bevy_ecs::prelude::*;
use glam::Vec3;

use super::{Energy, Scene, Stage};

/// Contacts count as touching up to this share of the contact distance beyond it. A resting contact is at the contact
/// distance within rounding, and must not count as ended in every second tick.
const TOUCHING: f32 = 0.05;

/// Motion of vertices in contact, in mean edges of their surface. Stored as sums, so that ticks can be added.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jitter {
    /// Sum of `|x_t − x_{t−1}|`.
    step: f64,
    /// Sum of `|x_t − 2 x_{t−1} + x_{t−2}|`: the part that is not steady motion.
    second: f64,
    count: usize,
}

impl Jitter {
    /// Mean displacement of a vertex in a tick; 0 if nothing was in contact.
    pub fn step(&self) -> f64 {
        self.step / self.count.max(1) as f64
    }

    /// Mean second difference; 0 if nothing was in contact.
    pub fn second_difference(&self) -> f64 {
        self.second / self.count.max(1) as f64
    }
}

impl Add for Jitter {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { step: self.step + other.step, second: self.second + other.second, count: self.count + other.count }
    }
}

impl Sum for Jitter {
    fn sum<I: Iterator<Item = Self>>(jitters: I) -> Self {
        jitters.fold(Self::default(), Add::add)
    }
}

/// Results of a tick. Contacts are those detected at its beginning. Everything else describes its end.
#[derive(Clone, Debug, Default)]
pub struct Tick {
    /// Time of detection.
    pub detection: Duration,
    /// Time of the response.
    pub response: Duration,
    /// Time of the whole tick, including the overhead of Bevy.
    pub whole: Duration,
    /// Feature pairs within the contact distance.
    pub contacts: usize,
    /// Contacts that the solver watched.
    pub watched: usize,
    /// Contacts that pushed in the last substep.
    pub pressing: usize,
    /// Largest contact distance among these contacts, in world units; 0 without contacts.
    pub contact_distance: f64,
    /// Overlap of the deepest contact with the contact distance, in world units; 0 if none overlaps.
    pub deepest: f64,
    /// Mean overlap of all contacts that overlap, in world units.
    pub mean_depth: f64,
    /// Contacts that are crossings according to detection: an edge pierces a face.
    pub crossings: usize,
    /// Share of contacts that are in only one of this tick and the last; 0 without contacts.
    pub churn: f64,
    /// Jitter of the vertices in contact.
    pub jitter: Jitter,
    pub energy: Energy,
}

/// Plays a scene and measures every tick.
#[derive(Default)]
pub struct Measure {
    /// Positions of each body's vertices, one and two ticks ago.
    last: Vec<[Vec<Vec3>; 2]>,
    contacts: HashSet<(ContactSide, ContactSide, ContactKey)>,
}

impl Measure {
    /// Plays the next tick.
    pub fn tick(&mut self, scene: &mut Scene) -> Tick {
        let start = Instant::now();
        scene.tick();
        let whole = start.elapsed();
        let world = scene.stage.app.world();
        let detection = world.resource::<DetectionDiagnostics>().total();
        let response = world.resource::<XpbdDiagnostics>();
        let (watched, pressing) = (response.contacts, response.pressing);
        let response = response.gathering + response.solving + response.guarding;
        let mut tick =
            Tick { detection, response, whole, watched, pressing, energy: Energy::of(&scene.stage), ..Tick::default() };
        let touching = self.look_at_contacts(&mut scene.stage, &mut tick);
        tick.jitter = self.follow(&scene.stage, &touching);
        tick
    }

    /// Fills in what contacts show, and returns the vertices in contact.
    fn look_at_contacts(&mut self, stage: &mut Stage, tick: &mut Tick) -> BTreeSet<(Entity, VertexId)> {
        let mut touching = BTreeSet::new();
        let mut named = HashSet::with_capacity(self.contacts.len());
        let (mut depths, mut deep) = (0.0, 0usize);
        stage.with_contacts(|contacts| {
            for contact in contacts.iter() {
                if contact.separation() > TOUCHING * contact.contact_distance() {
                    continue;
                }
                tick.contact_distance = tick.contact_distance.max(contact.contact_distance().into());
                named.insert((contact.a(), contact.b(), contact.key()));
                let (first, second) = contact.feature_vertices();
                touching.extend(first.into_iter().map(|vertex| (contact.a().entity(), vertex)));
                touching.extend(second.into_iter().map(|vertex| (contact.b().entity(), vertex)));
                tick.crossings += usize::from(contact.is_crossing());
                let depth = -f64::from(contact.separation());
                if depth > 0.0 {
                    depths += depth;
                    deep += 1;
                    tick.deepest = tick.deepest.max(depth);
                }
            }
        });
        tick.contacts = named.len();
        tick.mean_depth = depths / deep.max(1) as f64;
        let shared = named.intersection(&self.contacts).count();
        let all = named.len() + self.contacts.len() - shared;
        tick.churn = (all - shared) as f64 / all.max(1) as f64;
        self.contacts = named;
        touching
    }

    /// Measures the motion of vertices, from the third tick on.
    fn follow(&mut self, stage: &Stage, touching: &BTreeSet<(Entity, VertexId)>) -> Jitter {
        let mut jitter = Jitter::default();
        self.last.resize_with(stage.bodies.len(), <[Vec<Vec3>; 2]>::default);
        for (&entity, [last, before]) in stage.bodies.iter().zip(&mut self.last) {
            let edge = f64::from(stage.surface(entity).mean_edge());
            let positions = stage.positions(entity);
            let own = touching.range((entity, VertexId(0))..=(entity, VertexId(u32::MAX)));
            if before.len() == positions.len() {
                for vertex in own.map(|(_, vertex)| vertex.index()) {
                    let [now, last, before] = [positions[vertex], last[vertex], before[vertex]].map(Vec3::as_dvec3);
                    jitter.step += now.distance(last) / edge;
                    jitter.second += (now - 2.0 * last + before).length() / edge;
                    jitter.count += 1;
                }
            }
            std::mem::swap(last, before);
            last.clear();
            last.extend_from_slice(positions);
        }
        jitter
    }
}

/// The settled ticks among the `played` ones: those that the scene names, or the last quarter if the scene ended before
/// them or went on beyond its end.
pub fn settled(scene: &Scene, played: usize) -> Range<usize> {
    let named = scene.settled.start as usize..played.min(scene.settled.end as usize);
    let goes_on = played > scene.ticks as usize;
    if named.is_empty() || goes_on { played - played / 4..played } else { named }
}
