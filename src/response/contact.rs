//! Contact constraints: keep the contact distance, with friction along the surface.
//!
//! A contact names the features that were close when the tick began. In every substep the solver evaluates the feature
//! pair at its current positions, on the side where it was, which gives a constraint `C = n·(Σ a p − Σ b p) − d ≥ 0`
//! with a Lagrange multiplier of at least 0. Friction is a constraint of its own with a bounded multiplier. It sticks
//! up to the static share of the normal multiplier and slides with the dynamic share (Macklin et al. 2014, "Unified
//! Particle Physics"), without a jump in between.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{
    features::{Meeting, edge_edge, vertex_face},
    particles::Particles,
};

/// Share of the slip by which friction weakens, until only the dynamic share is left. With a jump from static to
/// dynamic friction, anything at rest near the limit would alternate between stick and slip forever. With this ramp, an
/// object held by its weight reaches dynamic friction at a speed of `(μ_s − μ_d) / 0.05` times the speed that gravity
/// adds in a substep: 3 centimeters per second by default.
const WEAKENING: f64 = 0.05;

/// The friction for a `wanted` that is larger than the static limit: `held = holding − WEAKENING (wanted − held)`.
fn slipping(wanted: f64, holding: f64) -> f64 {
    (holding - WEAKENING * wanted) / (1.0 - WEAKENING)
}

/// The features of a contact, as known at the beginning of the tick.
#[derive(Clone, Debug, PartialEq)]
pub enum Features {
    /// A vertex (the first particle) and a face.
    VertexFace([u32; 4]),
    /// Two edges.
    EdgeEdge([u32; 4]),
    /// Particles with signed weights, and one normal and offset for the whole tick.
    Plane {
        /// The particles and their weights.
        particles: ArrayVec<(u32, f64), 6>,
        /// Added to the weighted sum of the particles along the normal to get the separation.
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
    /// The features of both sides.
    pub features: Features,
    /// Unit vector from the second side to the first at the beginning of the tick.
    pub normal: DVec3,
    /// The contact distance to keep, in world units.
    pub distance: f64,
    /// Static and dynamic friction coefficients.
    pub friction: [f64; 2],
    /// A lower bound of the separation at the beginning of the tick; negative infinity if none is known.
    pub apart: f64,
    /// The normal at the last evaluation.
    last_normal: DVec3,
    /// Separation at the end of the last substep in which the features were evaluated.
    left: f64,
}

impl ContactConstraint {
    /// A contact constraint. `normal` is the unit vector from the second side to the first.
    #[must_use]
    pub fn new(features: Features, normal: DVec3, distance: f64, friction: [f64; 2]) -> Self {
        Self { features, normal, distance, friction, apart: f64::NEG_INFINITY, last_normal: normal, left: 0.0 }
    }

    /// Highest speed of a particle of the contact, in a tick of `duration` seconds.
    #[must_use]
    pub fn fastest(&self, particles: &Particles, duration: f64) -> f64 {
        let speeds = self.features.particles().into_iter().map(|particle| particles.speed(particle as usize, duration));
        speeds.fold(0.0, f64::max)
    }

    /// Whether one of its particles is static or kinematic.
    #[must_use]
    pub fn is_on_firm_ground(&self, particles: &Particles) -> bool {
        self.features.particles().into_iter().any(|particle| particles.inverse_mass[particle as usize] <= 0.0)
    }

    /// Evaluates the features at the beginning of a tick, unless they are known to be apart.
    pub fn begin_tick(&mut self, particles: &Particles) {
        self.last_normal = self.normal;
        if self.apart <= 0.0 {
            self.apart = self.look(particles).separation(particles);
        }
        self.left = self.apart;
    }

    /// Whether the sides may come together in this substep, given the unconstrained positions.
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

    /// Evaluates the features at the unconstrained positions of a substep. `None` if they are too far apart to act, or
    /// nothing in the contact can move. An overlap that existed before is reduced by at most `push_out`.
    pub fn begin_step(&mut self, particles: &Particles, push_out: f64) -> Option<ActingContact> {
        let mut looked = self.look(particles);
        let separation = looked.separation(particles);
        let way = looked.points.iter().map(|point| particles.way[point.particle as usize]).fold(0.0, f64::max);
        // Constraints may move the particles as far again.
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

    /// Ends a substep in which the contact acted, and records the separation that is left.
    pub fn end_step(&mut self, acted: &ActingContact, particles: &Particles) {
        self.left = acted.separation(particles);
    }

    /// Evaluates the contact at the current positions.
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

/// A particle with its weight in a contact, and its displacement per unit of push.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    particle: u32,
    weight: f64,
    mobility: f64,
}

/// A contact that may act in a substep, with its weights and normal in that substep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActingContact {
    points: ArrayVec<Point, 6>,
    normal: DVec3,
    /// Added to the weighted sum along the normal to get the separation.
    offset: f64,
    /// The separation to reach: 0, or less if the sides overlapped before the substep.
    target: f64,
    /// `Σ w a²`.
    weight: f64,
    /// Separating speed at the beginning of the substep.
    opening: f64,
    friction: [f64; 2],
    multiplier: f64,
    sliding: DVec3,
}

impl ActingContact {
    /// Whether it pushes in this substep.
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

    /// Pushes the sides apart to the target separation.
    pub fn separate(&mut self, particles: &mut Particles) {
        let missing = self.target - self.separation(particles);
        let before = self.multiplier;
        self.multiplier = (before + missing / self.weight).max(0.0);
        let change = self.multiplier - before;
        if change != 0.0 {
            self.push(&mut particles.position, self.normal * change);
        }
    }

    /// Applies friction: holds the sides along the surface, within the friction limits.
    pub fn apply_friction(&mut self, particles: &mut Particles) {
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

    /// Removes the separating velocity that a push has added: contacts do not bounce.
    pub fn remove_bounce(&self, particles: &mut Particles) {
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
