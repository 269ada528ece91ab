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

impl Features {
    fn particles(&self) -> ArrayVec<u32, 6> {
        match self {
            Self::VertexFace(places) | Self::EdgeEdge(places) => places.iter().copied().collect(),
            Self::Plane { particles, .. } => particles.iter().map(|&(particle, _)| particle).collect(),
        }
    }
}

/// A contact that the solver watches.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactConstraint {
    /// What meets.
    pub features: Features,
    /// Unit vector from the second side to the first when the tick begins.
    pub normal: DVec3,
    /// The distance to keep.
    pub distance: f64,
    /// Static and dynamic friction.
    pub friction: [f64; 2],
    /// A lower bound of the separation when the tick begins; negative infinity where none is known.
    pub apart: f64,
    /// The normal where they were last looked at.
    last_normal: DVec3,
    /// Separation when the last step ended in which they were looked at.
    left: f64,
}

impl ContactConstraint {
    /// A contact; `normal` is the unit vector from the second side to the first.
    #[must_use]
    pub fn new(features: Features, normal: DVec3, distance: f64, friction: [f64; 2]) -> Self {
        Self { features, normal, distance, friction, apart: f64::NEG_INFINITY, last_normal: normal, left: 0.0 }
    }

    /// The greatest speed of a particle that it acts on, in a tick of `duration` seconds.
    #[must_use]
    pub fn fastest(&self, particles: &Particles, duration: f64) -> f64 {
        let speeds = self.features.particles().into_iter().map(|particle| particles.speed(particle as usize, duration));
        speeds.fold(0.0, f64::max)
    }

    /// Whether it acts on a particle that nothing moves.
    #[must_use]
    pub fn is_on_firm_ground(&self, particles: &Particles) -> bool {
        self.features.particles().into_iter().any(|particle| particles.inverse_mass[particle as usize] <= 0.0)
    }

    /// Looks where the features are when a tick begins, unless they are known to be apart.
    pub fn begin_tick(&mut self, particles: &Particles) {
        self.last_normal = self.normal;
        if self.apart <= 0.0 {
            self.apart = self.look(particles).separation(particles);
        }
        self.left = self.apart;
    }

    /// Whether the sides may come together in this step, once everything has moved as it would without them.
    #[inline]
    #[must_use]
    pub fn may_meet(&self, particles: &Particles) -> bool {
        let reach = |places: &[u32; 4]| places.map(|place| particles.reach[place as usize]);
        match &self.features {
            Features::VertexFace(places) => {
                let [vertex, a, b, c] = reach(places);
                self.apart <= vertex + a.max(b).max(c)
            }
            Features::EdgeEdge(places) => {
                let [a, b, c, d] = reach(places);
                self.apart <= a.max(b) + c.max(d)
            }
            Features::Plane { .. } => true,
        }
    }

    /// Looks where the features are in a step, once everything has moved as it would without them. `None` where they are too far
    /// apart to act. What separation is missing already is made up for by at most `push_out`.
    pub fn begin_step(&mut self, particles: &Particles, push_out: f64) -> Option<ActingContact> {
        let mut looked = self.look(particles);
        let separation = looked.separation(particles);
        let way = looked.points.iter().map(|point| particles.way[point.particle as usize]).fold(0.0, f64::max);
        // Solving may move what is pushed as far again.
        if separation > 2.0 * way {
            self.left = separation;
            return None;
        }
        looked.weight = looked.points.iter().map(|point| point.weight * point.mobility).sum();
        if looked.weight <= 0.0 {
            return None;
        }
        looked.target = (self.left + push_out).min(0.0);
        looked.opening = looked.normal.dot(looked.sum(&particles.velocity));
        Some(looked)
    }

    /// Ends a step in which it acted: sees what separation is left.
    pub fn end_step(&mut self, acted: &ActingContact, particles: &Particles) {
        self.left = acted.separation(particles);
    }

    /// The contact as it is where everything is now.
    fn look(&mut self, particles: &Particles) -> ActingContact {
        let mut looked = ActingContact { friction: self.friction, ..ActingContact::default() };
        let mut add = |particle: u32, weight: f64| {
            if weight != 0.0 {
                let mobility = weight * particles.inverse_mass[particle as usize];
                looked.points.push(Point { particle, weight, mobility });
            }
        };
        let at = |places: &[u32; 4]| places.map(|place| particles.position[place as usize]);
        let (places, Meeting { weights, normal }) = match &self.features {
            Features::Plane { particles: entries, offset } => {
                entries.iter().for_each(|&(particle, weight)| add(particle, weight));
                (looked.normal, looked.offset) = (self.normal, *offset);
                return looked;
            }
            Features::VertexFace(places) => (places, vertex_face(&at(places), self.last_normal)),
            Features::EdgeEdge(places) => (places, edge_edge(&at(places), self.last_normal)),
        };
        places.iter().zip(weights).for_each(|(&particle, weight)| add(particle, weight));
        self.last_normal = normal;
        (looked.normal, looked.offset) = (normal, -self.distance);
        looked
    }
}

/// A particle with its weight in a contact, and how far a unit of push moves it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    particle: u32,
    weight: f64,
    mobility: f64,
}

/// A contact that may act in a step, with the weights and the normal that it has in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActingContact {
    points: ArrayVec<Point, 6>,
    normal: DVec3,
    /// What is added to the weighted sum along the normal to get the separation.
    offset: f64,
    /// The least separation asked for: 0, or less where some was missing already.
    target: f64,
    /// `Σ w a²`.
    weight: f64,
    /// How fast it was opening when the step began.
    opening: f64,
    friction: [f64; 2],
    multiplier: f64,
    sliding: DVec3,
}

impl ActingContact {
    /// Whether it has to push to keep the sides apart.
    #[must_use]
    pub fn presses(&self) -> bool {
        self.multiplier > 0.0
    }

    fn sum(&self, values: &[DVec3]) -> DVec3 {
        self.points.iter().map(|point| values[point.particle as usize] * point.weight).sum()
    }

    fn separation(&self, particles: &Particles) -> f64 {
        self.normal.dot(self.sum(&particles.position)) + self.offset
    }

    fn push(&self, values: &mut [DVec3], push: DVec3) {
        for point in &self.points {
            values[point.particle as usize] += push * point.mobility;
        }
    }

    /// Pushes the sides apart as far as they are too near.
    pub fn separate(&mut self, particles: &mut Particles) {
        let missing = self.target - self.separation(particles);
        let before = self.multiplier;
        self.multiplier = (before + missing / self.weight).max(0.0);
        let change = self.multiplier - before;
        if change != 0.0 {
            self.push(&mut particles.position, self.normal * change);
        }
    }

    /// Holds the sides along the surface, as far as friction goes.
    pub fn rub(&mut self, particles: &mut Particles) {
        if !self.presses() && self.sliding == DVec3::ZERO || self.friction[0] <= 0.0 {
            return;
        }
        let slid = self.sum(&particles.position) - self.sum(&particles.previous);
        let slid = slid - self.normal * self.normal.dot(slid);
        let wanted = self.sliding - slid / self.weight;
        let [holding, sliding] = self.friction.map(|coefficient| coefficient * self.multiplier);
        let length = wanted.length();
        let held = if length <= holding { wanted } else { wanted * (slipping(length, holding).max(sliding) / length) };
        let change = held - self.sliding;
        self.sliding = held;
        self.push(&mut particles.position, change);
    }

    /// Takes away the velocity with which the sides would part after having been pushed: contacts do not bounce.
    pub fn settle_velocity(&self, particles: &mut Particles) {
        if !self.presses() {
            return;
        }
        let opening = self.normal.dot(self.sum(&particles.velocity));
        let surplus = opening - self.opening.max(0.0);
        if surplus > 0.0 {
            self.push(&mut particles.velocity, self.normal * (-surplus / self.weight));
        }
    }
}
