//! Contacts as constraints: never nearer than the contact distance, and friction along the surface.
//!
//! A contact names the features that met when the tick began. In every step the pair of features is looked at where it
//! is by then, on the side where it was, and gives a constraint `C = n·(Σ a p − Σ b p) − d ≥ 0` with the multiplier kept at
//! or above 0. Friction holds up to the static share of the normal multiplier and slides with the dynamic one (Macklin et
//! al. 2014, "Unified Particle Physics"), as a constraint of its own with a bounded multiplier, without a jump in between.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{
    features::{Meeting, edge_edge, vertex_face},
    particles::Particles,
};

/// Friction loses this share of what a contact slips by, until the dynamic one is left. With a jump from static to dynamic
/// friction what rests near the limit slips and sticks forever; as it is, what rests by its weight is at dynamic friction
/// from a speed of `(μ_s − μ_d) / 0.05` times what gravity adds in a substep: 3 centimeters a second by default.
const WEAKENING: f64 = 0.05;

/// What friction holds of `wanted`, where that is more than the static one: `held = holding − WEAKENING (wanted − held)`.
fn slipping(wanted: f64, holding: f64) -> f64 {
    (holding - WEAKENING * wanted) / (1.0 - WEAKENING)
}

/// What is known of a contact when the tick begins.
#[derive(Clone, Debug, PartialEq)]
pub enum Features {
    /// A vertex, the first particle, and a face.
    VertexFace([u32; 4]),
    /// Two edges.
    EdgeEdge([u32; 4]),
    /// Particles with signed weights, one normal for the whole tick, and the separation where the contact was
    /// detected, with the share of it that is due to where the particles were then.
    Plane {
        /// Which, and with which weights.
        particles: ArrayVec<(u32, f64), 6>,
        /// What is added to the sum of the weighted particles along the normal, to get the separation.
        offset: f64,
    },
}

/// A contact in the solver.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactConstraint {
    /// What meets.
    pub features: Features,
    /// Unit vector from the second side to the first where they were last looked at.
    pub normal: DVec3,
    /// That when the tick began.
    first_normal: DVec3,
    /// The distance to keep.
    pub distance: f64,
    /// Static and dynamic friction.
    pub friction: [f64; 2],
    step: Step,
    /// Separation when the last step ended.
    left: f64,
    /// A lower bound of the separation, and how far everything had gone when it held.
    clear: (f64, f64),
}

/// A contact in one step.
#[derive(Clone, Debug, Default, PartialEq)]
struct Step {
    particles: ArrayVec<(u32, f64), 6>,
    /// What is added to the weighted sum along the normal to get the separation.
    offset: f64,
    /// The least separation asked for: 0, or less where some was missing already.
    target: f64,
    /// `Σ w a²`.
    weight: f64,
    /// How fast it was opening when the step began.
    opening: f64,
    multiplier: f64,
    sliding: DVec3,
}

impl ContactConstraint {
    /// A contact; `normal` is the unit vector from the second side to the first.
    #[must_use]
    pub fn new(features: Features, normal: DVec3, distance: f64, friction: [f64; 2]) -> Self {
        let clear = (f64::NEG_INFINITY, 0.0);
        Self { features, normal, first_normal: normal, distance, friction, step: Step::default(), left: 0.0, clear }
    }

    /// Tells on which side the first feature is when the tick begins.
    pub fn set_normal(&mut self, normal: DVec3) {
        self.normal = normal;
        self.first_normal = normal;
    }

    /// The greatest speed of a particle that it acts on, in a tick of `duration` seconds.
    #[must_use]
    pub fn fastest(&self, particles: &Particles, duration: f64) -> f64 {
        let speed = |particle: u32| particles.speed(particle as usize, duration);
        match &self.features {
            Features::VertexFace(places) | Features::EdgeEdge(places) => {
                places.iter().map(|&place| speed(place)).fold(0.0, f64::max)
            }
            Features::Plane { particles, .. } => particles.iter().map(|&(place, _)| speed(place)).fold(0.0, f64::max),
        }
    }

    /// How hard it was pushed in the last step: the multiplier, 0 where it did not touch.
    #[must_use]
    pub fn multiplier(&self) -> f64 {
        self.step.multiplier
    }

    /// Looks where the features are when a tick begins.
    pub fn begin_tick(&mut self, particles: &Particles) {
        self.normal = self.first_normal;
        let separation = self.look(particles);
        self.left = separation;
        self.clear = (separation, 0.0);
    }

    /// Looks where the features are in a step, once everything has moved as it would without them. `travelled` is how far
    /// the fastest particle has gone since the tick began, and `reach` how far one has gone in this step: a contact that
    /// cannot close in it is passed over, and `false` is returned. What separation is missing already is made up for by at
    /// most `push_out`.
    pub fn begin_step(&mut self, particles: &Particles, travelled: f64, reach: f64, push_out: f64) -> bool {
        self.step.multiplier = 0.0;
        let (separation, then) = self.clear;
        // Solving may move what is pushed as far again.
        if separation - 2.0 * (travelled - then) > 4.0 * reach {
            return false;
        }
        let separation = self.look(particles);
        self.clear = (separation - 2.0 * reach, travelled);
        if separation > 2.0 * reach {
            self.left = separation;
            return false;
        }
        let weighted = |&(particle, weight): &(u32, f64)| particles.inverse_mass[particle as usize] * weight * weight;
        self.step.weight = self.step.particles.iter().map(weighted).sum();
        if self.step.weight <= 0.0 {
            return false;
        }
        self.step.sliding = DVec3::ZERO;
        self.step.target = (self.left + push_out).min(0.0);
        self.step.opening = self.normal.dot(self.sum(&particles.velocity));
        true
    }

    /// Ends a step in which the contact took part: sees what separation is left.
    pub fn end_step(&mut self, particles: &Particles) {
        self.left = self.separation(particles);
    }

    /// Fills in this step's weights and offset, and returns the separation.
    fn look(&mut self, particles: &Particles) -> f64 {
        let step = &mut self.step;
        let at = |places: &[u32; 4]| places.map(|place| particles.position[place as usize]);
        let (places, Meeting { weights, normal }) = match &self.features {
            Features::Plane { particles: entries, offset } => {
                step.particles.clone_from(entries);
                step.offset = *offset;
                return self.separation(particles);
            }
            Features::VertexFace(places) => (places, vertex_face(&at(places), self.normal)),
            Features::EdgeEdge(places) => (places, edge_edge(&at(places), self.normal)),
        };
        self.normal = normal;
        step.particles.clear();
        step.particles.extend(places.iter().copied().zip(weights).filter(|&(_, weight)| weight != 0.0));
        step.offset = -self.distance;
        self.separation(particles)
    }

    fn sum(&self, values: &[DVec3]) -> DVec3 {
        self.step.particles.iter().map(|&(particle, weight)| values[particle as usize] * weight).sum()
    }

    fn separation(&self, particles: &Particles) -> f64 {
        self.normal.dot(self.sum(&particles.position)) + self.step.offset
    }

    fn push(&self, values: &mut [DVec3], inverse_mass: &[f64], push: DVec3) {
        for &(particle, weight) in &self.step.particles {
            values[particle as usize] += push * (weight * inverse_mass[particle as usize]);
        }
    }

    /// Pushes the sides apart as far as they are too near.
    pub fn separate(&mut self, particles: &mut Particles) {
        let missing = self.step.target - self.separation(particles);
        let before = self.step.multiplier;
        self.step.multiplier = (before + missing / self.step.weight).max(0.0);
        let change = self.step.multiplier - before;
        if change != 0.0 {
            self.push(&mut particles.position, &particles.inverse_mass, self.normal * change);
        }
    }

    /// Holds the sides along the surface, as far as friction goes.
    pub fn rub(&mut self, particles: &mut Particles) {
        if self.step.multiplier <= 0.0 && self.step.sliding == DVec3::ZERO || self.friction[0] <= 0.0 {
            return;
        }
        let slid: DVec3 = self
            .step
            .particles
            .iter()
            .map(|&(place, weight)| (particles.position[place as usize] - particles.previous[place as usize]) * weight)
            .sum();
        let slid = slid - self.normal * self.normal.dot(slid);
        let wanted = self.step.sliding - slid / self.step.weight;
        let [holding, sliding] = self.friction.map(|coefficient| coefficient * self.step.multiplier);
        let length = wanted.length();
        let held = if length <= holding { wanted } else { wanted * (slipping(length, holding).max(sliding) / length) };
        let change = held - self.step.sliding;
        self.step.sliding = held;
        self.push(&mut particles.position, &particles.inverse_mass, change);
    }

    /// Takes away the velocity with which the sides would part after having been pushed: contacts do not bounce.
    pub fn settle_velocity(&self, particles: &mut Particles) {
        if self.step.multiplier <= 0.0 {
            return;
        }
        let opening = self.normal.dot(self.sum(&particles.velocity));
        let surplus = opening - self.step.opening.max(0.0);
        if surplus > 0.0 {
            let change = self.normal * (-surplus / self.step.weight);
            self.push(&mut particles.velocity, &particles.inverse_mass, change);
        }
    }
}
