//! The particles of one tick: the vertices of all bodies, and the vertices of other objects that contacts touch.

use glam::DVec3;

use crate::kernel::xpbd::{OnBody, ParticleRows, Placed, RigidBodies};

/// Particles in world space and double precision, in structure-of-arrays form, at the beginning and at the end of a
/// tick. In between, they are [rows](ParticleRows).
///
/// A particle with an inverse mass of 0 is kinematic: it moves from `start` to `end` in a straight line, whatever
/// pushes it.
#[derive(Clone, Debug, Default)]
pub struct Particles {
    /// Position at the beginning of the tick.
    pub start: Vec<DVec3>,
    /// Position at the end of the tick, for a kinematic particle.
    pub end: Vec<DVec3>,
    /// Solved position.
    pub position: Vec<DVec3>,
    /// In world units per second.
    pub velocity: Vec<DVec3>,
    /// One over the mass; 0 for a kinematic particle.
    pub inverse_mass: Vec<f64>,
    /// The number of the rigid body that a particle is on, if contacts push that.
    pub body: Vec<Option<u32>>,
}

impl Particles {
    #[must_use]
    pub fn len(&self) -> usize {
        self.start.len()
    }

    pub fn clear(&mut self) {
        let Self { start, end, position, velocity, inverse_mass, body } = self;
        inverse_mass.clear();
        body.clear();
        for list in [start, end, position, velocity] {
            list.clear();
        }
    }

    /// Appends a particle that forces and constraints move.
    pub fn push_moved(&mut self, position: DVec3, velocity: DVec3, inverse_mass: f64) {
        self.push(position, position, velocity, inverse_mass, None);
    }

    /// Appends a kinematic particle.
    pub fn push_driven(&mut self, start: DVec3, end: DVec3) {
        self.push_on_body(None, [start, end]);
    }

    /// Appends a kinematic particle, on a rigid body if one is given.
    pub fn push_on_body(&mut self, body: Option<u32>, [start, end]: [DVec3; 2]) {
        self.push(start, end, DVec3::ZERO, 0.0, body);
    }

    /// Whether a particle is on a rigid body that contacts push.
    #[must_use]
    pub fn is_on_body(&self, particle: u32) -> bool {
        self.body[particle as usize].is_some()
    }

    /// Lets rigid bodies carry the particles on them, from a number on.
    pub fn carry(&self, first: usize, rows: &ParticleRows, bodies: &mut RigidBodies) {
        bodies.carry(
            rows.starts(&self.start),
            (first..self.len()).filter_map(|particle| {
                Some(OnBody { particle, body: self.body[particle]?, ends: [self.start[particle], self.end[particle]] })
            }),
        );
    }

    /// Makes a particle follow the trajectory of another one that is kinematic.
    pub fn pin(&mut self, particle: usize, to: usize) {
        self.inverse_mass[particle] = 0.0;
        self.velocity[particle] = DVec3::ZERO;
        self.start[particle] = self.start[to];
        self.end[particle] = self.end[to];
        self.position[particle] = self.start[to];
    }

    /// Whether forces and constraints move a particle.
    #[must_use]
    pub fn is_free(&self, particle: u32) -> bool {
        self.inverse_mass[particle as usize] > 0.0
    }

    /// Makes a particle kinematic: it moves from where it is to `end`.
    pub fn drive(&mut self, particle: usize, end: DVec3) {
        self.inverse_mass[particle] = 0.0;
        self.velocity[particle] = DVec3::ZERO;
        self.end[particle] = end;
    }

    /// Begins a tick.
    pub fn begin(&self, rows: &mut ParticleRows) {
        rows.begin((0..self.len()).map(|particle| self.placed(particle)));
    }

    /// Adds the particles that have been appended since, when `share` of the tick has passed.
    pub fn extend(&self, rows: &mut ParticleRows, share: f32) {
        rows.extend((rows.count()..self.len()).map(|particle| self.placed(particle)), share);
    }

    fn placed(&self, particle: usize) -> Placed {
        Placed {
            way: self.end[particle] - self.start[particle],
            velocity: self.velocity[particle],
            inverse_mass: self.inverse_mass[particle],
        }
    }

    /// Ends a tick.
    pub fn take(&mut self, rows: &ParticleRows) {
        for particle in 0..self.len() {
            let [displacement, velocity] = rows.state(particle);
            self.velocity[particle] = velocity;
            self.position[particle] = if self.inverse_mass[particle] > 0.0 {
                self.start[particle] + displacement
            } else {
                self.end[particle]
            };
        }
    }

    fn push(&mut self, start: DVec3, end: DVec3, velocity: DVec3, inverse_mass: f64, body: Option<u32>) {
        self.start.push(start);
        self.end.push(end);
        self.position.push(start);
        self.velocity.push(velocity);
        self.inverse_mass.push(inverse_mass);
        self.body.push(body);
    }
}
