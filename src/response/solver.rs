//! One tick of XPBD with small substeps: predict positions, solve constraints, derive velocities from positions.
//!
//! The solver knows particles and constraints, but no entities. Threads work on slabs of space that have no
//! particle in common, and that depend on nothing but the scene, so the result is the same to the bit for any number of
//! threads.
//!
//! Stretch and contact constraints are stiff and are solved with symmetric Gauss–Seidel sweeps: forward, then backward.
//! A sweep in one direction is not a symmetric operator and has some complex eigenvalues. With velocities derived from
//! positions, such modes gain energy in every substep, which shows as trembling that never decays. With symmetric
//! sweeps every mode decays.

use std::{mem, sync::Arc};

use glam::{DVec3, Vec3};

use super::{
    contact::SolverContacts, material::XpbdMaterial, particles::Particles, reaction::Reactions, rest::RestShape,
    settings::XpbdSettings,
};
use crate::kernel::{
    mesh::topology::SurfaceTopology,
    simd::parallel::{Team, share},
    xpbd::{
        Air, Attachments, Elasticity, Evaluation, Hinges, MovingRows, ParticleRows, RigidBodies, Sails, Slabs, Springs,
        Starts, Tethered, Tethers, Tetrahedra, Volumes,
    },
};

/// How often tetrahedra in slabs and those between slabs take turns to be kept upright: what moves one flattens the other.
const MOST_ROUNDS: usize = 8;

/// The particles and constraints of one body.
pub(super) struct SolverBody {
    /// Its first particle. The others follow in the order of its vertices.
    pub(super) first: usize,
    pub(super) topology: Arc<SurfaceTopology>,
    pub(super) rest: Arc<RestShape>,
    pub(super) material: XpbdMaterial,
    /// World length of a unit in the surface's own frame.
    pub(super) scale: f64,
    /// The air around it, if that moves it.
    pub(super) air: Option<Air>,
}

/// Internal constraints of a body: those in a slab, or those between slabs.
#[derive(Default)]
struct Part {
    /// The number of the body.
    body: usize,
    /// The slab of the body at rest, or the number of these.
    slab: usize,
    /// The slab of this tick that its middle vertex is in.
    place: usize,
    springs: Springs,
    hinges: Hinges,
    tetrahedra: Tetrahedra,
    sails: Sails,
    /// Whether its body has contacts.
    is_touched: bool,
}

impl Part {
    fn begin(&mut self, bodies: &[SolverBody], start: Starts<'_>) {
        let &mut Self { body, slab, ref mut springs, ref mut hinges, ref mut tetrahedra, ref mut sails, .. } = self;
        let body = &bodies[body];
        sails.clear();
        springs.clear();
        hinges.clear();
        tetrahedra.clear();
        let XpbdMaterial { stretch_compliance, bend_compliance, damping, .. } = body.material;
        if stretch_compliance.is_finite() || damping > 0.0 {
            springs.add((&body.rest.springs, slab), body.first, body.scale, start);
        }
        if bend_compliance.is_finite() {
            hinges.add((&body.rest.hinges, slab), body.first, start);
        }
        tetrahedra.add((&body.rest.tetrahedra, slab), body.first, body.scale, start);
        if body.air.is_some() {
            sails.add((&body.rest.sails, slab), body.first, body.scale, start);
        }
    }

    fn begin_step(&mut self) {
        self.springs.begin_step();
        self.hinges.begin_step();
        self.tetrahedra.begin_step();
    }

    fn blow(&self, bodies: &[SolverBody], rows: MovingRows<'_>, step: f64) {
        if let Some(air) = bodies[self.body].air {
            self.sails.blow(rows, air, step as f32);
        }
    }

    fn bend(&mut self, bodies: &[SolverBody], rows: MovingRows<'_>, step: f64) {
        let compliance = bodies[self.body].material.bend_compliance;
        if compliance.is_finite() {
            self.hinges.solve(rows, per_step(compliance, step) as f32);
        }
    }

    fn stretch(&mut self, bodies: &[SolverBody], rows: MovingRows<'_>, step: f64, is_backward: bool) {
        let &XpbdMaterial { stretch_compliance, young_modulus, poisson_ratio, .. } = &bodies[self.body].material;
        let elasticity = Elasticity::new(young_modulus, poisson_ratio, step);
        if is_backward {
            self.tetrahedra.solve(rows, elasticity, true);
        }
        if stretch_compliance.is_finite() {
            self.springs.solve(rows, per_step(stretch_compliance, step) as f32, step as f32, is_backward);
        }
        if !is_backward {
            self.tetrahedra.solve(rows, elasticity, false);
        }
    }

    /// Returns whether anything has moved. What nothing touches has been folded by its own elasticity, and must be able to
    /// unfold.
    fn keep_upright(&mut self, rows: MovingRows<'_>) -> bool {
        self.is_touched && self.tetrahedra.keep_upright(rows)
    }

    fn damp(&self, bodies: &[SolverBody], rows: MovingRows<'_>, step: f64) {
        let damped = f64::from(bodies[self.body].material.damping) * step;
        let share = damped / (1.0 + damped);
        if share > 0.0 {
            self.springs.damp(rows, share as f32);
        }
    }
}

/// A compliance that is scaled to the substep.
fn per_step(compliance: f32, step: f64) -> f64 {
    f64::from(compliance) / (step * step)
}

/// The internal constraints of all bodies in a tick. What is in different slabs has no particle in common, so slabs are
/// solved at the same time. Then comes what is between slabs.
#[derive(Default)]
struct Inners {
    slabs: Vec<Part>,
    /// One for each body.
    between: Vec<Part>,
    volumes: Volumes,
    /// The volume of each body, if it has one.
    of_bodies: Vec<Option<usize>>,
    has_tetrahedra: bool,
}

impl Inners {
    /// Orders parts by the slabs of a tick, so that mostly the same thread solves what is near each other, and its contacts.
    fn arrange(&mut self, bodies: &[SolverBody], space: &Slabs) {
        let Self { slabs, between, .. } = self;
        slabs.resize_with(bodies.iter().map(|body| body.rest.parts.len()).sum(), Part::default);
        between.resize_with(bodies.len(), Part::default);
        let mut parts = slabs.iter_mut();
        for (number, (body, between)) in bodies.iter().zip(between).enumerate() {
            for (slab, vertices) in body.rest.parts.iter().enumerate() {
                let Some(part) = parts.next() else { return };
                let middle = vertices.get(vertices.len() / 2);
                (part.body, part.slab) = (number, slab);
                part.place = middle.map_or(0, |&vertex| space.of(body.first as u32 + vertex));
            }
            (between.body, between.slab) = (number, body.rest.parts.len());
        }
        slabs.sort_by_key(|part| part.place);
    }

    /// Begins a tick whose parts are in order.
    fn begin(&mut self, team: &dyn Team, bodies: &[SolverBody], start: Starts<'_>) {
        let Self { slabs, between, volumes, of_bodies, has_tetrahedra } = self;
        share(team, slabs, |part| part.begin(bodies, start));
        for part in &mut *between {
            part.begin(bodies, start);
        }
        volumes.clear();
        of_bodies.clear();
        of_bodies.extend(bodies.iter().map(
            |&SolverBody { first, scale, ref rest, ref material, ref topology, .. }| {
                let volume = rest.volume.as_ref().filter(|_| material.volume_compliance.is_finite());
                volume.map(|volume| volumes.add(volume, (first, topology.vertex_count()), scale, start))
            },
        ));
        *has_tetrahedra = slabs.iter().chain(&*between).any(|part| !part.tetrahedra.is_empty());
    }

    fn begin_step(&mut self, bodies: &[SolverBody], contacts: &SolverContacts) {
        for part in self.slabs.iter_mut().chain(&mut self.between) {
            let SolverBody { first, topology, .. } = &bodies[part.body];
            part.is_touched = !part.tetrahedra.is_empty() && contacts.touches(*first..first + topology.vertex_count());
            part.begin_step();
        }
        self.volumes.begin_step();
    }

    /// Lets the winds act on velocities.
    fn blow(&mut self, team: &dyn Team, bodies: &[SolverBody], rows: MovingRows<'_>, step: f64) {
        if bodies.iter().any(|body| body.air.is_some()) {
            share(team, &mut self.slabs, |part| part.blow(bodies, rows, step));
            self.between.iter().for_each(|part| part.blow(bodies, rows, step));
        }
    }

    fn solve(&mut self, team: &dyn Team, bodies: &[SolverBody], rows: &mut ParticleRows, step: f64) {
        let Self { slabs, between, volumes, of_bodies, .. } = self;
        let moving = rows.moving();
        share(team, slabs, |part| part.bend(bodies, moving, step));
        for part in &mut *between {
            part.bend(bodies, moving, step);
        }
        for (body, volume) in bodies.iter().zip(of_bodies) {
            if let &mut Some(volume) = volume {
                volumes.solve(volume, rows, per_step(body.material.volume_compliance, step));
            }
        }
        let moving = rows.moving();
        share(team, slabs, |part| part.stretch(bodies, moving, step, false));
        for part in between {
            part.stretch(bodies, moving, step, false);
            part.stretch(bodies, moving, step, true);
        }
        share(team, slabs, |part| part.stretch(bodies, moving, step, true));
    }

    /// Gives tetrahedra that contacts have inverted or flattened some volume. Returns whether there were any.
    fn keep_upright(&mut self, team: &dyn Team, rows: MovingRows<'_>) -> bool {
        let Self { slabs, between, has_tetrahedra, .. } = self;
        if !*has_tetrahedra {
            return false;
        }
        for _ in 0..MOST_ROUNDS {
            share(team, slabs, |part| {
                part.keep_upright(rows);
            });
            let mut is_any = false;
            for part in &mut *between {
                is_any |= part.keep_upright(rows);
            }
            if !is_any {
                break;
            }
        }
        slabs.iter().chain(&*between).any(|part| part.tetrahedra.is_any_raised())
    }

    /// Ends a substep, after velocities have been derived.
    fn end_step(&mut self, team: &dyn Team, rows: MovingRows<'_>) {
        if self.has_tetrahedra {
            share(team, &mut self.slabs, |part| part.tetrahedra.end_step(rows));
            self.between.iter().for_each(|part| part.tetrahedra.end_step(rows));
        }
    }

    fn damp(&mut self, team: &dyn Team, bodies: &[SolverBody], rows: MovingRows<'_>, step: f64) {
        share(team, &mut self.slabs, |part| part.damp(bodies, rows, step));
        for part in &self.between {
            part.damp(bodies, rows, step);
        }
    }
}

/// The state of one tick. It is refilled every tick and keeps its memory.
#[derive(Default)]
pub(super) struct Solver {
    pub(super) particles: Particles,
    pub(super) bodies: Vec<SolverBody>,
    pub(super) contacts: SolverContacts,
    pub(super) rigid_bodies: RigidBodies,
    /// Forces on particles.
    pub(super) forces: Vec<(u32, Vec3)>,
    tethers: Tethers,
    attachments: Attachments,
    pub(super) rows: ParticleRows,
    inners: Inners,
    /// Velocities at the beginning of the tick.
    first_velocities: Vec<DVec3>,
    /// Whether the tick has not been solved yet.
    is_new: bool,
}

/// Adds contacts before a substep, which is given, counted from 1. Returns whether there are any.
pub(super) type AddContacts<'a> = &'a mut dyn FnMut(&mut Solver, u32) -> bool;

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
        self.rigid_bodies.clear();
        self.forces.clear();
        self.tethers.clear();
        self.attachments.clear();
    }

    /// Adds a tether. A particle with a tether of length 0 is kinematic.
    pub(super) fn tether(&mut self, tethered: &Tethered) {
        let particle = tethered.particle as usize;
        if tethered.longest <= 0.0 {
            self.particles.drive(particle, tethered.places[1]);
        } else {
            self.tethers.push(*tethered);
        }
    }

    /// Keeps particles, each of them named once, within distances of kinematic ones.
    pub(super) fn attach(&mut self, attached: impl Iterator<Item = ([usize; 2], f64)>) {
        self.attachments.add(attached);
    }

    /// Begins a tick, which may be solved more than once.
    pub(super) fn begin(&mut self) {
        let Self { particles, bodies, contacts, rows, inners, tethers, attachments, first_velocities, is_new, .. } =
            self;
        first_velocities.clone_from(&particles.velocity);
        let parts = bodies
            .iter()
            .flat_map(|body| body.rest.parts.iter().map(|part| part.iter().map(|&vertex| body.first as u32 + vertex)));
        rows.arrange(contacts.slabs(), particles.len(), parts);
        inners.arrange(bodies, contacts.slabs());
        let start = rows.starts(&particles.start);
        tethers.begin(start);
        attachments.begin(start);
        *is_new = true;
    }

    /// Resets the tick to its beginning. Particles added since then start now.
    pub(super) fn begin_again(&mut self) {
        let Particles { start, position, velocity, .. } = &mut self.particles;
        position.clone_from(start);
        velocity[..self.first_velocities.len()].copy_from_slice(&self.first_velocities);
    }

    /// Advances all particles by `duration` seconds, which must be more than 0. `add_contacts` may add contacts before
    /// every substep but the first. The result is the same for any number of threads.
    pub(super) fn advance(
        &mut self,
        team: &dyn Team,
        duration: f64,
        settings: &XpbdSettings,
        add_contacts: AddContacts<'_>,
    ) -> Solved {
        let step = duration / f64::from(settings.substeps);
        let mut solved = Solved::default();
        if mem::take(&mut self.is_new) {
            self.inners.begin(team, &self.bodies, self.rows.starts(&self.particles.start));
        }
        self.particles.begin(&mut self.rows);
        self.rigid_bodies.begin();
        self.particles.carry(0, &self.rows, &mut self.rigid_bodies);
        self.contacts.begin_solution(team, &self.particles, self.rows.moving());
        for substep in 1..=settings.substeps {
            if substep > 1 {
                let is_any_new = add_contacts(self, substep);
                let passed = (f64::from(substep - 1) / f64::from(settings.substeps)) as f32;
                let known = self.rows.count();
                self.particles.extend(&mut self.rows, passed);
                self.particles.carry(known, &self.rows, &mut self.rigid_bodies);
                self.rigid_bodies.place(self.rows.moving(), passed);
                if is_any_new {
                    self.contacts.extend(team, &self.particles, self.rows.moving(), passed);
                }
            }
            let Self { bodies, contacts, rigid_bodies, forces, tethers, attachments, rows, inners, .. } = self;
            for body in &*bodies {
                let kept = (1.0 - f64::from(body.material.drag) * step).max(0.0);
                if kept < 1.0 {
                    rows.slow_down(body.first, body.topology.vertex_count(), kept as f32);
                }
            }
            inners.blow(team, bodies, rows.moving(), step);
            rows.apply_forces(forces, step as f32);
            let share = f64::from(substep) / f64::from(settings.substeps);
            rows.predict(team, step as f32, settings.gravity, share as f32);
            rigid_bodies.predict(step);
            rigid_bodies.place(rows.moving(), share as f32);
            rigid_bodies.set_speeds(rows.moving(), step as f32);
            let push_out = (f64::from(settings.push_out_speed) * step) as f32;
            let rate = duration.recip() as f32;
            let evaluation = Evaluation { step: step as f32, push_out, share: share as f32, rate };
            contacts.begin_step(team, rows.moving(), rigid_bodies, evaluation);
            inners.begin_step(bodies, contacts);
            for _ in 0..settings.iterations {
                inners.solve(team, bodies, rows, step);
                attachments.solve(rows.moving(), (share * duration) as f32);
                tethers.solve(team, rows.moving(), share as f32);
                contacts.solve(team, rows.moving(), rigid_bodies, share as f32);
                if inners.keep_upright(team, rows.moving()) {
                    contacts.separate_again(team, rows.moving(), rigid_bodies, share as f32);
                    inners.keep_upright(team, rows.moving());
                }
            }
            rows.update_velocities(team, step as f32);
            inners.damp(team, bodies, rows.moving(), step);
            inners.end_step(team, rows.moving());
            contacts.end_step(team, rows.moving(), rigid_bodies, step);
            let [acting, pressing] = contacts.counts();
            solved.contact_solves += acting * settings.iterations as usize;
            solved.pressing = pressing;
        }
        self.particles.take(&self.rows);
        solved
    }

    /// Adds the impulses of the contacts that were asked for, of a solution with substeps of `step` seconds.
    pub(super) fn react(&mut self, step: f64, reactions: &mut Reactions) {
        self.contacts.reactions(|number, sum| reactions.add(number, sum / step));
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
}
