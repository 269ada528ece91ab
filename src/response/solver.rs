//! One tick of XPBD with small substeps: predict positions, solve constraints, derive velocities from positions.
//!
//! The solver knows particles and constraints, but no entities. Everything runs in one fixed order on one thread, so
//! the result is the same to the bit for any number of threads in detection.
//!
//! Stretch and contact constraints are stiff and are solved with symmetric Gauss–Seidel sweeps: forward, then backward.
//! A sweep in one direction is not a symmetric operator and has some complex eigenvalues. With velocities derived from
//! positions, such modes gain energy in every substep, which shows as trembling that never decays. With symmetric
//! sweeps every mode decays.

use std::sync::Arc;

use glam::DVec3;

use super::{
    body::{RestShape, XpbdMaterial},
    constraints::{Spring, solve_volume},
    contact::{ActingContact, ContactConstraint},
    particles::Particles,
    settings::XpbdSettings,
};
use crate::kernel::mesh::topology::SurfaceTopology;

/// The particles and constraints of one body.
pub(super) struct SolverBody {
    /// Its first particle. The others follow in the order of its vertices.
    pub(super) first: usize,
    pub(super) topology: Arc<SurfaceTopology>,
    pub(super) rest: Arc<RestShape>,
    pub(super) material: XpbdMaterial,
    /// World length of a unit in the surface's own frame.
    pub(super) scale: f64,
    /// Lagrange multipliers of the springs, hinges, and volume in one substep.
    multipliers: Vec<f64>,
}

impl SolverBody {
    pub(super) fn new(
        first: usize,
        topology: Arc<SurfaceTopology>,
        rest: Arc<RestShape>,
        material: XpbdMaterial,
        scale: f64,
    ) -> Self {
        let multipliers = vec![0.0; rest.springs.len() + rest.hinges.len() + 1];
        Self { first, topology, rest, material, scale, multipliers }
    }

    fn vertex_count(&self) -> usize {
        self.topology.vertex_count()
    }

    fn slow_down(&self, particles: &mut Particles, step: f64) {
        let kept = (1.0 - f64::from(self.material.drag) * step).max(0.0);
        let own = self.first..self.first + self.vertex_count();
        particles.velocity[own].iter_mut().for_each(|velocity| *velocity *= kept);
    }

    fn damp(&self, particles: &mut Particles, step: f64) {
        let damped = f64::from(self.material.damping) * step;
        let share = damped / (1.0 + damped);
        if share > 0.0 {
            self.rest.springs.iter().for_each(|spring| spring.damp(particles, self.first, share));
        }
    }

    fn solve(&mut self, particles: &mut Particles, step: f64, gradients: &mut Vec<DVec3>) {
        let own = (self.first, self.vertex_count());
        let per_step = |compliance: f32| f64::from(compliance) / (step * step);
        let (springs, others) = self.multipliers.split_at_mut(self.rest.springs.len());
        let (hinges, volume) = others.split_at_mut(self.rest.hinges.len());
        if self.material.bend_compliance.is_finite() {
            let compliance = per_step(self.material.bend_compliance);
            for (hinge, multiplier) in self.rest.hinges.iter().zip(hinges) {
                hinge.solve(particles, self.first, compliance, multiplier);
            }
        }
        if let (Some(rest), true) = (self.rest.volume, self.material.volume_compliance.is_finite()) {
            let compliance = per_step(self.material.volume_compliance);
            let wanted = rest * self.scale.powi(3);
            let triangles = self.topology.welded_triangles();
            solve_volume(particles, own, triangles, wanted, compliance, &mut volume[0], gradients);
        }
        if self.material.stretch_compliance.is_finite() {
            let compliance = per_step(self.material.stretch_compliance);
            there_and_back(springs.len(), |place| {
                let spring = self.rest.springs[place];
                let spring = Spring { length: spring.length * self.scale, ..spring };
                spring.solve(particles, self.first, compliance, step, &mut springs[place]);
            });
        }
    }
}

/// Visits the indices of a list forward and then backward: a symmetric sweep.
fn there_and_back(count: usize, mut solve: impl FnMut(usize)) {
    (0..count).for_each(&mut solve);
    (0..count).rev().for_each(solve);
}

/// The state of one tick. It is refilled every tick and keeps its memory.
#[derive(Default)]
pub(super) struct Solver {
    pub(super) particles: Particles,
    pub(super) bodies: Vec<SolverBody>,
    pub(super) contacts: Vec<ContactConstraint>,
    /// The contacts that may act in the current substep, with their indices in `contacts`.
    acting: Vec<(u32, ActingContact)>,
    gradients: Vec<DVec3>,
    /// Velocities at the beginning of the tick.
    first_velocities: Vec<DVec3>,
}

/// What one call of [`Solver::advance`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Solved {
    /// Number of contact solves, over all substeps and iterations.
    pub(super) contact_solves: usize,
    /// Number of contacts that pushed in the last substep.
    pub(super) pressing: usize,
}

impl Solver {
    pub(super) fn clear(&mut self) {
        self.particles.clear();
        self.bodies.clear();
        self.contacts.clear();
    }

    /// Saves the velocities at the beginning of a tick, so that it can be solved again.
    pub(super) fn remember(&mut self) {
        self.first_velocities.clone_from(&self.particles.velocity);
    }

    /// Resets the tick to its beginning. Particles added since then start now.
    pub(super) fn begin_again(&mut self) {
        let Particles { start, position, velocity, .. } = &mut self.particles;
        position.clone_from(start);
        velocity[..self.first_velocities.len()].copy_from_slice(&self.first_velocities);
    }

    /// Advances all particles by `duration` seconds, which must be more than 0.
    pub(super) fn advance(&mut self, duration: f64, settings: &XpbdSettings) -> Solved {
        let step = duration / f64::from(settings.substeps);
        let gravity = settings.gravity.as_dvec3();
        let mut solved = Solved::default();
        self.contacts.iter_mut().for_each(|contact| contact.begin_tick(&self.particles));
        // A symmetric sweep ends with the first contact. Contacts with static or kinematic particles come first, so
        // that they have the last word. Otherwise a stack would be pressed into the ground.
        let is_loose = |contact: &ContactConstraint| !contact.is_on_firm_ground(&self.particles);
        if !self.contacts.is_sorted_by_key(is_loose) {
            self.contacts.sort_by_key(is_loose);
        }
        for substep in 1..=settings.substeps {
            self.bodies.iter().for_each(|body| body.slow_down(&mut self.particles, step));
            let share = f64::from(substep) / f64::from(settings.substeps);
            self.particles.predict(step, gravity, share);
            self.choose_contacts(step, settings);
            for body in &mut self.bodies {
                body.multipliers.fill(0.0);
            }
            for _ in 0..settings.iterations {
                for body in &mut self.bodies {
                    body.solve(&mut self.particles, step, &mut self.gradients);
                }
                let Self { acting, particles, .. } = self;
                there_and_back(acting.len(), |place| acting[place].1.separate(particles));
                // Friction runs after all normal multipliers are final, because they are its limits. If a contact
                // stopped pressing after its friction was solved, it would release what it holds.
                there_and_back(acting.len(), |place| acting[place].1.apply_friction(particles));
                solved.contact_solves += acting.len();
            }
            self.particles.update_velocities(step);
            self.bodies.iter().for_each(|body| body.damp(&mut self.particles, step));
            for (place, contact) in &self.acting {
                self.contacts[*place as usize].end_step(contact, &self.particles);
                contact.remove_bounce(&mut self.particles);
            }
        }
        solved.pressing = self.acting.iter().filter(|(_, contact)| contact.presses()).count();
        solved
    }

    /// Moves welded vertices to the vertices that they are welded to.
    pub(super) fn follow_welds(&mut self) {
        for body in self.bodies.iter().filter(|body| body.topology.is_welded()) {
            for (vertex, &weld) in body.topology.weld().iter().enumerate() {
                let (particle, followed) = (body.first + vertex, body.first + weld as usize);
                self.particles.start[particle] = self.particles.start[followed];
                self.particles.position[particle] = self.particles.position[followed];
                self.particles.velocity[particle] = self.particles.velocity[followed];
            }
        }
    }

    fn choose_contacts(&mut self, step: f64, settings: &XpbdSettings) {
        let Self { particles, contacts, acting, .. } = self;
        acting.clear();
        for (place, contact) in (0..).zip(contacts) {
            if contact.may_meet(particles) {
                let push_out = f64::from(settings.push_out_speed) * contact.distance * step;
                acting.extend(contact.begin_step(particles, push_out).map(|acting| (place, acting)));
            }
        }
    }
}
