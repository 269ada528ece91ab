//! The contacts that the solver watches, sorted by kind.

use std::ops::Range;

use arrayvec::ArrayVec;
use glam::DVec3;

use super::particles::Particles;
use crate::kernel::{
    simd::parallel::{Sequential, Team, share, share_all},
    xpbd::{
        At, Contact, Contacts, Evaluation, FeatureKind, FeatureParticles, FoundContacts, MovingRows, Place, Plane,
        RigidBodies, Slabs,
        coloring::{Coloring, NONE, in_order},
    },
};

/// Sweeps over the contacts in an iteration. A vertex between several contacts is pushed by each of them. In a cloth at
/// rest on a ball, one sweep leaves 9 % of the contact distance open, two 2 %, and four 1 %.
const SWEEPS: usize = 4;

/// Sweeps that push apart what is still too near after friction. With none, the friction of its neighbors holds a contact
/// of a heap too deep by half the contact distance, for ever; with two, none by more than 6 %.
const RECOVERIES: usize = 2;

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
            Features::EdgeEdge([first, ..]) => particles.is_on_body(*first),
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

/// Contacts in one slab, or between slabs.
#[derive(Debug, Default)]
struct List {
    found: FoundContacts,
    colored: Contacts,
    coloring: Coloring,
}

/// Contacts of one place: those that have a static or kinematic particle, and those that have none.
type Lists = [List; 2];

const FIRM: usize = 0;
const LOOSE: usize = 1;

/// In slabs, across each even slab and the next, across each odd one and the next, and what reaches farther.
const PHASES: usize = 4;

/// Another thread does not pay off for fewer contacts in a sweep.
const LEAST_SHARED: usize = 256;

/// What a sweep does to contacts, which it may go through backward.
type Work = fn(&mut Contacts, MovingRows<'_>, bool);

/// One pass over the firm or the loose contacts.
#[derive(Clone, Copy)]
struct Sweep {
    kind: usize,
    is_backward: bool,
    work: Work,
}

/// The most sweeps between which nothing else happens.
const MOST_SWEEPS: usize = 4 * (SWEEPS + 1 + RECOVERIES);

const fn there(work: Work) -> [Sweep; 2] {
    [Sweep { kind: FIRM, is_backward: false, work }, Sweep { kind: LOOSE, is_backward: false, work }]
}

const fn there_and_back(work: Work) -> [Sweep; 4] {
    let [firm, loose] = there(work);
    [firm, loose, Sweep { is_backward: true, ..loose }, Sweep { is_backward: true, ..firm }]
}

/// All contacts of a tick. Those with static or kinematic particles come first: a symmetric sweep ends with the first
/// contact, so they have the last word. Otherwise a stack would be pressed into the ground.
///
/// They are solved in phases. Contacts in different slabs have no free particle in common, so all slabs are solved at the
/// same time. Then come those across a slab and the next: those of every other slab have none in common either. The few
/// that reach farther come last.
#[derive(Debug, Default)]
pub struct SolverContacts {
    slabs: Slabs,
    phases: [Vec<Lists>; PHASES],
    /// Whether each particle is in a contact. Those at the end that are in none may be missing.
    are_touched: Vec<bool>,
}

impl SolverContacts {
    /// Forgets all contacts, and splits the space between the particles of all bodies.
    pub fn begin(&mut self, particles: &Particles) {
        self.slabs.split(&particles.start);
        self.are_touched.clear();
        let count = self.slabs.count();
        for (phase, count) in self.phases.iter_mut().zip([count, count / 2, (count - 1) / 2, 1]) {
            phase.resize_with(count, Lists::default);
        }
        self.lists_mut().for_each(|list| list.found.clear());
    }

    /// The slabs that space is split into in this tick.
    #[must_use]
    pub const fn slabs(&self) -> &Slabs {
        &self.slabs
    }

    fn lists(&self) -> impl Iterator<Item = &List> {
        self.phases.iter().flat_map(|phase| phase.as_flattened())
    }

    fn lists_mut(&mut self) -> impl Iterator<Item = &mut List> {
        self.phases.iter_mut().flat_map(|phase| phase.as_flattened_mut())
    }

    /// Whether any of these particles is in a contact.
    #[must_use]
    pub fn touches(&self, mut particles: Range<usize>) -> bool {
        particles.any(|particle| self.are_touched.get(particle).is_some_and(|is_touched| *is_touched))
    }

    /// The contacts of the place that particles are at.
    fn lists_at(&mut self, particles: impl Iterator<Item = u32>) -> Option<&mut Lists> {
        let [in_slabs, across_even, across_odd, far] = &mut self.phases;
        match self.slabs.place(particles) {
            Place::In(slab) => in_slabs.get_mut(slab),
            Place::Across(slab) if slab.is_multiple_of(2) => across_even.get_mut(slab / 2),
            Place::Across(slab) => across_odd.get_mut(slab / 2),
            Place::Far => far.first_mut(),
        }
    }

    /// Calls `work` with every list, in any order.
    fn for_each(&mut self, team: &dyn Team, work: impl Fn(&mut List) + Sync) {
        let team = if self.len() >= LEAST_SHARED { team } else { &Sequential };
        let phases = self.phases.each_mut().map(|phase| phase.as_flattened_mut());
        share_all(team, phases, work);
    }

    /// Runs one sweep after the other, each phase by phase, or backward. Steps that follow each other in the same phase are
    /// one job: its places have no free particle in common, so threads need not meet in between.
    fn sweep(&mut self, team: &dyn Team, rows: MovingRows<'_>, sweeps: &[Sweep]) {
        let mut steps: ArrayVec<(usize, Sweep), { MOST_SWEEPS * PHASES }> = ArrayVec::new();
        for sweep in sweeps {
            let phases = in_order(PHASES, sweep.is_backward);
            let has_any = |&phase: &usize| self.phases[phase].iter().any(|lists| !lists[sweep.kind].found.is_empty());
            steps.extend(phases.filter(has_any).map(|phase| (phase, *sweep)));
        }
        for job in steps.chunk_by(|one, next| one.0 == next.0) {
            let Some(phase) = job.first().and_then(|&(phase, _)| self.phases.get_mut(phase)) else { continue };
            let lengths = phase.iter().flat_map(|lists| job.iter().map(|(_, sweep)| lists[sweep.kind].found.len()));
            let team = if lengths.sum::<usize>() >= LEAST_SHARED { team } else { &Sequential };
            share(team, phase, |lists| {
                for (_, Sweep { kind, is_backward, work }) in job {
                    work(&mut lists[*kind].colored, rows, *is_backward);
                }
            });
        }
    }

    #[must_use]
    pub fn len(&self) -> usize {
        self.lists().map(|list| list.found.len()).sum()
    }

    /// Adds a contact between particles that exist already.
    pub fn push(&mut self, constraint: &ContactConstraint, particles: &Particles) {
        for particle in constraint.parts.particles() {
            let particle = particle as usize;
            if self.are_touched.len() <= particle {
                self.are_touched.resize(particle + 1, false);
            }
            self.are_touched[particle] = true;
        }
        let kind = if constraint.is_on_firm_ground(particles) { FIRM } else { LOOSE };
        let Some(lists) = self.lists_at(constraint.parts.particles()) else { return };
        let found = &mut lists[kind].found;
        // What is on a rigid body moves as contacts push it.
        let is_free = |particle: u32| particles.is_free(particle) || particles.is_on_body(particle);
        match &constraint.parts {
            Features::VertexFace(parts) => {
                found.push_features((FeatureKind::VertexFace, parts), constraint, is_free);
            }
            Features::EdgeEdge(parts) => {
                found.push_features((FeatureKind::EdgeEdge, parts), constraint, is_free);
            }
            &Features::Plane { particles: ref entries, offset } => {
                let mut parts =
                    Plane { particles: [NONE; 6], weights: [0.0; 6], drive: DVec3::ZERO, separation: offset };
                let mut count = 0;
                for &(particle, weight) in entries {
                    let (start, end) = (particles.start[particle as usize], particles.end[particle as usize]);
                    parts.separation += constraint.normal.dot(start * weight);
                    if is_free(particle) {
                        (parts.particles[count], parts.weights[count]) = (particle, weight);
                        count += 1;
                    } else {
                        parts.drive += (end - start) * weight;
                    }
                }
                found.push_plane(&constraint.between(parts));
            }
        }
    }

    /// Begins a solution.
    pub fn begin_solution(&mut self, team: &dyn Team, particles: &Particles, rows: MovingRows<'_>) {
        self.lists_mut().for_each(|list| list.colored.clear());
        self.extend(team, particles, rows, 0.0);
    }

    /// Takes over the contacts that have been added since the solution began, when `share` of the tick has passed.
    pub fn extend(&mut self, team: &dyn Team, particles: &Particles, rows: MovingRows<'_>, share: f32) {
        let is_free = |particle: u32| particles.is_free(particle);
        let at = At { start: rows.starts(&particles.start), rows, share };
        self.for_each(team, |List { found, colored, coloring }| colored.extend(found, is_free, coloring, &at));
    }

    /// Evaluates all contacts at the unconstrained positions of a substep, and pushes by a share of the last push.
    pub fn begin_step(
        &mut self,
        team: &dyn Team,
        rows: MovingRows<'_>,
        bodies: &mut RigidBodies,
        evaluation: Evaluation,
    ) {
        self.for_each(team, |list| list.colored.begin_step(rows, evaluation));
        if bodies.is_any_pushed() {
            bodies.begin_counting();
            self.soften(|number, _| {
                bodies.count(number);
                None
            });
            self.soften(|number, normal| bodies.yielding(number, normal));
        }
        self.sweep(team, rows, &there(|contacts, rows, _| contacts.push_again(rows)));
        self.give_way(rows, bodies, evaluation.share);
    }

    fn soften(&mut self, mut visit: impl FnMut(u32, DVec3) -> Option<[f64; 2]>) {
        self.lists_mut().for_each(|list| list.colored.soften(&mut visit));
    }

    /// Moves rigid bodies by what contacts have pushed so far in this substep. When it ends, `share` of the tick has passed.
    fn give_way(&mut self, rows: MovingRows<'_>, bodies: &mut RigidBodies, share: f32) {
        if bodies.is_any_pushed() {
            bodies.give_way(|add| self.lists_mut().for_each(|list| list.colored.pushes(false, &mut *add)));
            bodies.place(rows, share);
        }
    }

    /// Pushes the sides of all contacts apart, [`SWEEPS`] times there and back, then applies friction, there and back.
    /// Friction runs after all normal multipliers are final, because they are its limits. If a contact stopped pressing
    /// after its friction was solved, it would release what it holds. What friction then leaves too near is only pushed.
    pub fn solve(&mut self, team: &dyn Team, rows: MovingRows<'_>, bodies: &mut RigidBodies, share: f32) {
        let separations = [Contacts::separate as Work; SWEEPS];
        let all = separations.into_iter().chain([Contacts::rub as Work]).chain([Contacts::recover as Work; RECOVERIES]);
        if bodies.is_any_pushed() {
            for work in all {
                self.sweep(team, rows, &there_and_back(work));
                self.give_way(rows, bodies, share);
            }
        } else {
            let sweeps: ArrayVec<Sweep, MOST_SWEEPS> = all.flat_map(there_and_back).collect();
            self.sweep(team, rows, &sweeps);
        }
    }

    /// Pushes the sides of all contacts apart once more, there and back, after something else has moved them.
    pub fn separate_again(&mut self, team: &dyn Team, rows: MovingRows<'_>, bodies: &mut RigidBodies, share: f32) {
        self.sweep(team, rows, &there_and_back(Contacts::separate));
        self.give_way(rows, bodies, share);
    }

    /// Ends a substep, after velocities have been derived.
    pub fn end_step(&mut self, team: &dyn Team, rows: MovingRows<'_>, bodies: &mut RigidBodies, step: f64) {
        self.sweep(team, rows, &there(|contacts, rows, _| contacts.end_step(rows)));
        if bodies.is_any_pushed() {
            bodies.end_step(step, |add| self.lists_mut().for_each(|list| list.colored.pushes(true, &mut *add)));
        }
    }

    /// Calls `add` with the number of every reaction, and with the sum of the contact's multipliers in all substeps.
    pub fn reactions(&mut self, mut add: impl FnMut(u32, DVec3)) {
        self.lists_mut().for_each(|list| list.colored.reactions(&mut add));
    }

    /// The number of contacts that may act in this substep, and of those that press.
    #[must_use]
    pub fn counts(&mut self) -> [usize; 2] {
        let counts = self.lists_mut().map(|list| list.colored.counts());
        counts.fold([0; 2], |[acting, pressing], [a, p]| [acting + a, pressing + p])
    }
}
