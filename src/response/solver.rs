//! One tick of XPBD with small substeps: predict positions, solve constraints, derive velocities from positions.
//!
//! The solver knows particles and constraints, but no entities. Everything runs in one fixed order on one thread, so
//! the result is the same to the bit for any number of threads in detection.
//!
//! Stretch and contact constraints are stiff and are solved with symmetric Gauss–Seidel sweeps: forward, then backward.
//! A sweep in one direction is not a symmetric operator and has some complex eigenvalues. With velocities derived from
//! positions, such modes gain energy in every substep, which shows as trembling that never decays. With symmetric
//! sweeps every mode decays.

use std::{ops::Range, sync::Arc};

use glam::{DVec3, Vec3};

use super::{
    body::{RestShape, XpbdMaterial},
    contact::SolverContacts,
    particles::Particles,
    reaction::Reactions,
    settings::XpbdSettings,
};
use crate::kernel::{
    mesh::topology::SurfaceTopology,
    xpbd::{Air, Evaluation, Hinges, ParticleRows, Springs, Tethered, Tethers, Volumes, Winds},
};

/// The particles and constraints of one body.
pub(super) struct SolverBody {
    /// Its first particle. The others follow in the order of its vertices.
    pub(super) first: usize,
    pub(super) topology: Arc<SurfaceTopology>,
    pub(super) rest: Arc<RestShape>,
    pub(super) material: XpbdMaterial,
    /// World length of a unit in the surface's own frame.
    pub(super) scale: f64,
}

/// Where the constraints of a body are among those of all bodies.
struct Inner {
    springs: Range<usize>,
    hinges: Range<usize>,
    volume: Option<usize>,
}

/// The internal constraints of all bodies in a tick.
#[derive(Default)]
struct Inners {
    springs: Springs,
    hinges: Hinges,
    volumes: Volumes,
    of_bodies: Vec<Inner>,
}

impl Inners {
    fn begin(&mut self, bodies: &[SolverBody], start: &[DVec3]) {
        let Self { springs, hinges, volumes, of_bodies } = self;
        springs.clear();
        hinges.clear();
        volumes.clear();
        of_bodies.clear();
        of_bodies.extend(bodies.iter().map(|body| {
            let &SolverBody { first, scale, ref rest, ref material, ref topology } = body;
            let own = (first, topology.vertex_count());
            let is_kept = material.volume_compliance.is_finite();
            let volume = rest.volume.as_ref().filter(|_| is_kept);
            Inner {
                springs: springs.add(&rest.springs, first, scale, start),
                hinges: hinges.add(&rest.hinges, first, start),
                volume: volume.map(|volume| volumes.add(volume, own, scale, start)),
            }
        }));
    }

    fn begin_step(&mut self) {
        self.springs.begin_step();
        self.hinges.begin_step();
        self.volumes.begin_step();
    }

    fn solve(&mut self, bodies: &[SolverBody], rows: &mut ParticleRows, step: f64) {
        let Self { springs, hinges, volumes, of_bodies } = self;
        let per_step = |compliance: f32| f64::from(compliance) / (step * step);
        for (body, inner) in bodies.iter().zip(of_bodies) {
            let material = &body.material;
            if material.bend_compliance.is_finite() {
                hinges.solve(inner.hinges.clone(), rows, per_step(material.bend_compliance) as f32);
            }
            if let Some(volume) = inner.volume {
                volumes.solve(volume, rows, per_step(material.volume_compliance));
            }
            if material.stretch_compliance.is_finite() {
                let compliance = per_step(material.stretch_compliance) as f32;
                springs.solve(inner.springs.clone(), rows, compliance, step as f32);
            }
        }
    }

    fn damp(&self, bodies: &[SolverBody], rows: &mut ParticleRows, step: f64) {
        for (body, inner) in bodies.iter().zip(&self.of_bodies) {
            let damped = f64::from(body.material.damping) * step;
            let share = damped / (1.0 + damped);
            if share > 0.0 {
                self.springs.damp(inner.springs.clone(), rows, share as f32);
            }
        }
    }
}

/// The state of one tick. It is refilled every tick and keeps its memory.
#[derive(Default)]
pub(super) struct Solver {
    pub(super) particles: Particles,
    pub(super) bodies: Vec<SolverBody>,
    pub(super) contacts: SolverContacts,
    /// Forces on particles.
    pub(super) forces: Vec<(u32, Vec3)>,
    tethers: Tethers,
    winds: Winds,
    rows: ParticleRows,
    inners: Inners,
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
        self.forces.clear();
        self.tethers.clear();
        self.winds.clear();
    }

    /// Adds a tether. A particle with a tether of length 0 is kinematic.
    pub(super) fn tether(&mut self, tethered: &Tethered) {
        let particle = tethered.particle as usize;
        if tethered.longest <= 0.0 {
            self.particles.drive(particle, tethered.places[1]);
        } else {
            self.tethers.push(tethered, self.particles.start[particle]);
        }
    }

    /// Puts a body into a wind.
    pub(super) fn blow(&mut self, air: Air, triangles: &[[u32; 3]], first: usize) {
        self.winds.add(air, triangles, first, &self.particles.start);
    }

    /// Begins a tick, which may be solved more than once.
    pub(super) fn begin(&mut self) {
        self.first_velocities.clone_from(&self.particles.velocity);
        self.inners.begin(&self.bodies, &self.particles.start);
    }

    /// Resets the tick to its beginning. Particles added since then start now.
    pub(super) fn begin_again(&mut self) {
        let Particles { start, position, velocity, .. } = &mut self.particles;
        position.clone_from(start);
        velocity[..self.first_velocities.len()].copy_from_slice(&self.first_velocities);
    }

    /// Advances all particles by `duration` seconds, which must be more than 0.
    pub(super) fn advance(&mut self, duration: f64, settings: &XpbdSettings) -> Solved {
        let Self { particles, bodies, contacts, forces, tethers, winds, rows, inners, .. } = self;
        let step = duration / f64::from(settings.substeps);
        let mut solved = Solved::default();
        particles.begin(rows);
        contacts.begin(particles);
        for substep in 1..=settings.substeps {
            for body in &*bodies {
                let kept = (1.0 - f64::from(body.material.drag) * step).max(0.0);
                rows.slow_down(body.first, body.topology.vertex_count(), kept as f32);
            }
            winds.blow(rows, step as f32);
            rows.apply_forces(forces, step as f32);
            let share = f64::from(substep) / f64::from(settings.substeps);
            rows.predict(step as f32, settings.gravity, share as f32);
            let push_out = (f64::from(settings.push_out_speed) * step) as f32;
            let rate = duration.recip() as f32;
            contacts.begin_step(rows, Evaluation { step: step as f32, push_out, share: share as f32, rate });
            inners.begin_step();
            for _ in 0..settings.iterations {
                inners.solve(bodies, rows, step);
                tethers.solve(rows, share as f32);
                contacts.solve(rows);
            }
            rows.update_velocities(step as f32);
            inners.damp(bodies, rows, step);
            contacts.end_step(rows);
            let [acting, pressing] = contacts.counts();
            solved.contact_solves += acting * settings.iterations as usize;
            solved.pressing = pressing;
        }
        particles.take(rows);
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
