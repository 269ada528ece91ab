//! The contacts that the solver watches, sorted by kind.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::particles::Particles;
use crate::kernel::xpbd::{
    Contact, Contacts, Evaluation, FeatureKind, FeatureParticles, FoundContacts, ParticleRows, Plane,
    coloring::{Coloring, NONE},
};

/// Sweeps over the contacts in an iteration. A vertex between several contacts is pushed by each of them. In a cloth at
/// rest on a ball, one sweep leaves 9 % of the contact distance open, two 2 %, and four 1 %.
const SWEEPS: usize = 4;

/// The features of a contact, as known at the beginning of the tick.
#[derive(Clone, Debug, PartialEq)]
pub enum Features {
    /// A vertex (the first particle) and a face.
    VertexFace(FeatureParticles),
    /// Two edges.
    EdgeEdge(FeatureParticles),
    /// Particles with signed weights, and one normal and offset for the whole tick.
    Plane {
        /// The particles and their weights.
        particles: ArrayVec<(u32, f64), 6>,
        /// Added to the weighted sum of the particles along the normal to get the separation.
        offset: f64,
    },
}

impl Features {
    fn particles(&self) -> impl Iterator<Item = u32> {
        let (named, weighted): (&[u32], &[(u32, f64)]) = match self {
            Self::VertexFace(places) | Self::EdgeEdge(places) => (places, &[]),
            Self::Plane { particles, .. } => (&[], particles),
        };
        named.iter().copied().chain(weighted.iter().map(|&(particle, _)| particle))
    }
}

/// A contact for the solver to watch.
pub type ContactConstraint = Contact<Features>;

impl ContactConstraint {
    /// Whether the side that the solver does not move is the first, in the order in which the solver has them: of two
    /// edges, a free one comes first.
    #[must_use]
    pub fn is_first_driven(&self, particles: &Particles) -> bool {
        let is_driven = |particle: u32| !particles.is_free(particle);
        match &self.parts {
            Features::VertexFace([vertex, ..]) => is_driven(*vertex),
            Features::EdgeEdge(_) => false,
            Features::Plane { particles: entries, .. } => {
                entries.iter().filter(|&&(particle, _)| is_driven(particle)).map(|(_, weight)| weight).sum::<f64>()
                    > 0.0
            }
        }
    }

    /// Whether one of its particles is static or kinematic.
    fn is_on_firm_ground(&self, particles: &Particles) -> bool {
        self.parts.particles().any(|particle| !particles.is_free(particle))
    }
}

/// All contacts of a tick. Those with static or kinematic particles come first: a symmetric sweep ends with the first
/// contact, so they have the last word. Otherwise a stack would be pressed into the ground.
#[derive(Debug, Default)]
pub struct SolverContacts {
    /// Those with a static or kinematic particle, and the others.
    found: [FoundContacts; 2],
    colored: [Contacts; 2],
    coloring: Coloring,
}

impl SolverContacts {
    pub fn clear(&mut self) {
        self.found.iter_mut().for_each(FoundContacts::clear);
    }

    #[must_use]
    pub fn len(&self) -> usize {
        self.found.iter().map(FoundContacts::len).sum()
    }

    /// Adds a contact between particles that exist already.
    pub fn push(&mut self, constraint: ContactConstraint, particles: &Particles) {
        let found = &mut self.found[usize::from(!constraint.is_on_firm_ground(particles))];
        let (contact, features) = constraint.split();
        let is_free = |particle: u32| particles.is_free(particle);
        match features {
            Features::VertexFace(parts) => {
                found.push_features(FeatureKind::VertexFace, contact.between(parts), is_free);
            }
            Features::EdgeEdge(parts) => found.push_features(FeatureKind::EdgeEdge, contact.between(parts), is_free),
            Features::Plane { particles: entries, offset } => {
                let mut parts =
                    Plane { particles: [NONE; 6], weights: [0.0; 6], drive: DVec3::ZERO, separation: offset };
                let mut count = 0;
                for (particle, weight) in entries {
                    let (start, end) = (particles.start[particle as usize], particles.end[particle as usize]);
                    parts.separation += contact.normal.dot(start * weight);
                    if is_free(particle) {
                        (parts.particles[count], parts.weights[count]) = (particle, weight);
                        count += 1;
                    } else {
                        parts.drive += (end - start) * weight;
                    }
                }
                found.push_plane(contact.between(parts));
            }
        }
    }

    /// Begins a tick.
    pub fn begin(&mut self, particles: &Particles) {
        let Self { found, colored, coloring } = self;
        let is_free = |particle: u32| particles.is_free(particle);
        for (colored, found) in colored.iter_mut().zip(found) {
            colored.begin(found, &particles.start, is_free, coloring);
        }
    }

    /// Evaluates all contacts at the unconstrained positions of a substep, and pushes by a share of the last push.
    pub fn begin_step(&mut self, rows: &mut ParticleRows, evaluation: Evaluation) {
        self.colored.iter_mut().for_each(|colored| colored.begin_step(rows, evaluation));
        self.colored.iter_mut().for_each(|colored| colored.push_again(rows));
    }

    /// Pushes the sides of all contacts apart, [`SWEEPS`] times there and back, then applies friction, there and back.
    /// Friction runs after all normal multipliers are final, because they are its limits. If a contact stopped pressing
    /// after its friction was solved, it would release what it holds.
    pub fn solve(&mut self, rows: &mut ParticleRows) {
        let [firm, loose] = &mut self.colored;
        for _ in 0..SWEEPS {
            firm.separate(rows, false);
            loose.separate(rows, false);
            loose.separate(rows, true);
            firm.separate(rows, true);
        }
        firm.rub(rows, false);
        loose.rub(rows, false);
        loose.rub(rows, true);
        firm.rub(rows, true);
    }

    /// Ends a substep, after velocities have been derived.
    pub fn end_step(&mut self, rows: &mut ParticleRows) {
        self.colored.iter_mut().for_each(|colored| colored.end_step(rows));
    }

    /// Calls `add` with the number of every reaction, and with the sum of the contact's multipliers in all substeps.
    pub fn reactions(&mut self, mut add: impl FnMut(u32, DVec3)) {
        self.colored.iter_mut().for_each(|colored| colored.reactions(&mut add));
    }

    /// The number of contacts that may act in this substep, and of those that press.
    #[must_use]
    pub fn counts(&mut self) -> [usize; 2] {
        self.colored
            .iter_mut()
            .map(Contacts::counts)
            .fold([0; 2], |[acting, pressing], [a, p]| [acting + a, pressing + p])
    }
}
