//! The particles of one tick: the vertices of all bodies, and the vertices of other objects that contacts touch.

use glam::DVec3;

/// Particles in world space and double precision, in structure-of-arrays form.
///
/// A particle with an inverse mass of 0 is kinematic: it moves from `start` to `end` in a straight line, whatever
/// pushes it.
#[derive(Clone, Debug, Default)]
pub struct Particles {
    /// Position at the beginning of the tick.
    pub start: Vec<DVec3>,
    /// Position at the end of the tick, for a kinematic particle.
    pub end: Vec<DVec3>,
    /// Position at the beginning of the substep.
    pub previous: Vec<DVec3>,
    /// Current position.
    pub position: Vec<DVec3>,
    /// In world units per second.
    pub velocity: Vec<DVec3>,
    /// One over the mass; 0 for a kinematic particle.
    pub inverse_mass: Vec<f64>,
    /// Length of the unconstrained displacement in this substep.
    pub way: Vec<f64>,
    /// Upper bound of the distance from `start` at the end of this substep: the distance to the unconstrained position,
    /// plus twice the unconstrained displacement for the effect of constraints.
    pub reach: Vec<f64>,
}

impl Particles {
    #[must_use]
    pub fn len(&self) -> usize {
        self.start.len()
    }

    pub fn clear(&mut self) {
        let Self { start, end, previous, position, velocity, inverse_mass, way, reach } = self;
        [inverse_mass, way, reach].into_iter().for_each(Vec::clear);
        for list in [start, end, previous, position, velocity] {
            list.clear();
        }
    }

    /// Appends a particle that forces and constraints move.
    pub fn push_moved(&mut self, position: DVec3, velocity: DVec3, inverse_mass: f64) {
        self.push(position, position, velocity, inverse_mass);
    }

    /// Appends a kinematic particle.
    pub fn push_driven(&mut self, start: DVec3, end: DVec3) {
        self.push(start, end, DVec3::ZERO, 0.0);
    }

    /// Speed of a particle at the beginning of a tick of `duration` seconds.
    #[must_use]
    pub fn speed(&self, particle: usize, duration: f64) -> f64 {
        if self.inverse_mass[particle] > 0.0 {
            self.velocity[particle].length()
        } else {
            self.start[particle].distance(self.end[particle]) / duration
        }
    }

    /// Makes a particle follow the trajectory of another one that is kinematic.
    pub fn pin(&mut self, particle: usize, to: usize) {
        self.inverse_mass[particle] = 0.0;
        self.velocity[particle] = DVec3::ZERO;
        self.start[particle] = self.start[to];
        self.end[particle] = self.end[to];
        self.previous[particle] = self.start[to];
        self.position[particle] = self.start[to];
    }

    fn push(&mut self, start: DVec3, end: DVec3, velocity: DVec3, inverse_mass: f64) {
        self.start.push(start);
        self.end.push(end);
        self.previous.push(start);
        self.position.push(start);
        self.velocity.push(velocity);
        self.inverse_mass.push(inverse_mass);
    }

    /// Begins a substep of `step` seconds, in which kinematic particles reach `share` of their trajectory.
    pub fn predict(&mut self, step: f64, gravity: DVec3, share: f64) {
        self.way.resize(self.len(), 0.0);
        self.reach.resize(self.len(), 0.0);
        for particle in 0..self.len() {
            let (start, position) = (self.start[particle], self.position[particle]);
            let way = if self.inverse_mass[particle] > 0.0 {
                self.velocity[particle] += gravity * step;
                self.velocity[particle] * step
            } else {
                let way = start.lerp(self.end[particle], share) - position;
                self.velocity[particle] = way / step;
                way
            };
            self.previous[particle] = position;
            self.position[particle] = position + way;
            self.way[particle] = way.length();
            self.reach[particle] = self.position[particle].distance(start) + 2.0 * self.way[particle];
        }
    }

    /// Ends a substep: derives velocities from the change of positions.
    pub fn update_velocities(&mut self, step: f64) {
        for particle in 0..self.len() {
            self.velocity[particle] = (self.position[particle] - self.previous[particle]) / step;
        }
    }
}
