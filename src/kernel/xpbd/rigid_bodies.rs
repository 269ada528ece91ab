//! Rigid bodies that contacts push while the solver steps.
//!
//! Something else, a physics engine or the game, has decided how such a body moves in the tick. Contacts make it deviate from
//! that: the deviation is a translation and a rotation about the center of mass, with velocities of their own. Points on the
//! body are kinematic particles, which follow the path and the deviation.
//!
//! Within a sweep over the contacts a body stands still, so that contacts need not be solved one after another. All push as if
//! each had the same share of the body to itself, and the body then moves by the sum of the pushes: mass splitting (Tonge,
//! Benevolenski and Voroshilov 2012, "Mass splitting for jitter-free parallel rigid body simulation"). No push overshoots,
//! however light the body is.

use glam::{DMat3, DQuat, DVec3};

use super::rows::{MovingRows, Starts};

/// By how much something deviates from its path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Of the center of mass, in world units.
    pub translation: DVec3,
    /// About the center of mass.
    pub rotation: DQuat,
}

impl Default for Deviation {
    fn default() -> Self {
        Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY }
    }
}

impl Deviation {
    /// Followed by a translation, and by a rotation vector in radians.
    fn then(self, translation: DVec3, turn: DVec3) -> Self {
        self.followed_by(Self { translation, rotation: DQuat::from_scaled_axis(turn) })
    }

    /// Followed by another one.
    #[must_use]
    pub fn followed_by(self, next: Self) -> Self {
        Self { translation: self.translation + next.translation, rotation: (next.rotation * self.rotation).normalize() }
    }
}

/// A rigid body when a tick begins.
#[derive(Clone, Copy, Debug)]
pub struct RigidBody {
    /// One over the mass, in 1/kg, along each axis of the world. 0 where nothing moves it.
    pub inverse_mass: DVec3,
    /// Inverse of the inertia tensor about the center of mass, in the axes of the world.
    pub inverse_inertia: DMat3,
    /// The center of mass at both ends of the path.
    pub center: [DVec3; 2],
    /// Velocity of the deviation at the beginning, in world units per second and radians per second.
    pub velocity: [DVec3; 2],
}

impl RigidBody {
    /// How fast an impulse makes the point that it acts on, at an arm from the center of mass.
    fn response(&self, arm: DVec3, impulse: DVec3) -> DVec3 {
        impulse * self.inverse_mass + (self.inverse_inertia * arm.cross(impulse)).cross(arm)
    }
}

/// A rigid body within a tick.
#[derive(Clone, Debug)]
struct Moving {
    body: RigidBody,
    deviation: Deviation,
    /// The deviation if nothing pushed the body in this substep.
    predicted: Deviation,
    velocity: [DVec3; 2],
    /// The number of contacts that may push it in this substep.
    contacts: u32,
    /// Sum of the pushes and of their moments, times the duration of a substep.
    pushes: [DVec3; 2],
}

/// A contact that pushes a rigid body.
#[derive(Clone, Copy, Debug)]
struct Pusher {
    body: u32,
    /// From the center of mass to the contact point, at the beginning of the tick.
    arm: DVec3,
    /// 1 if the body is the first side of the contact, and −1 if it is the second.
    sign: f64,
}

/// A kinematic particle on a rigid body.
#[derive(Clone, Copy, Debug)]
struct Carried {
    row: u32,
    body: u32,
    /// From the center of mass to the particle at the beginning of the tick, and by how much that changes along the path.
    arm: [DVec3; 2],
    way: DVec3,
}

/// A particle on a rigid body, with the ends of its path.
#[derive(Clone, Copy, Debug)]
pub struct OnBody {
    /// The particle.
    pub particle: usize,
    /// The body.
    pub body: u32,
    /// Where the path begins and ends.
    pub ends: [DVec3; 2],
}

/// The rigid bodies of a tick.
#[derive(Clone, Debug, Default)]
pub struct RigidBodies {
    bodies: Vec<Moving>,
    /// By number. `None` where what a contact pushes has no mass.
    pushers: Vec<Option<Pusher>>,
    carried: Vec<Carried>,
}

impl RigidBodies {
    /// Forgets all bodies, contacts, and particles.
    pub fn clear(&mut self) {
        let Self { bodies, pushers, carried } = self;
        bodies.clear();
        pushers.clear();
        carried.clear();
    }

    /// Adds a body, and returns its number.
    pub fn push(&mut self, body: RigidBody) -> u32 {
        self.bodies.push(Moving {
            body,
            deviation: Deviation::default(),
            predicted: Deviation::default(),
            velocity: body.velocity,
            contacts: 0,
            pushes: [DVec3::ZERO; 2],
        });
        self.bodies.len() as u32 - 1
    }

    /// Whether anything pushes any of the bodies.
    #[must_use]
    pub const fn is_any_pushed(&self) -> bool {
        !self.pushers.is_empty()
    }

    /// Says that the contact with a number, greater than those before, pushes a body at a point, and whether the body is its
    /// first side.
    pub fn push_at(&mut self, number: u32, body: u32, point: DVec3, is_first: bool) {
        self.pushers.resize(number as usize, None);
        let arm = point - self.bodies[body as usize].body.center[0];
        self.pushers.push(Some(Pusher { body, arm, sign: if is_first { 1.0 } else { -1.0 } }));
    }

    /// Begins a solution: bodies are back on their paths, without any particles.
    pub fn begin(&mut self) {
        self.carried.clear();
        for moving in &mut self.bodies {
            moving.deviation = Deviation::default();
            moving.velocity = moving.body.velocity;
        }
    }

    /// Takes particles along.
    pub fn carry(&mut self, starts: Starts<'_>, particles: impl Iterator<Item = OnBody>) {
        let Self { bodies, carried, .. } = self;
        carried.extend(particles.map(|OnBody { particle, body, ends: [start, end] }| {
            let [first, last] = bodies[body as usize].body.center;
            let arm = start - first;
            Carried { row: starts.row(particle), body, arm: [arm, end - last - arm], way: end - start }
        }));
    }

    /// Begins a substep of `step` seconds: bodies deviate farther at their velocities.
    pub fn predict(&mut self, step: f64) {
        for Moving { deviation, predicted, velocity: [linear, angular], .. } in &mut self.bodies {
            *deviation = deviation.then(*linear * step, *angular * step);
            *predicted = *deviation;
        }
    }

    /// Moves particles to where they are when `share` of the tick has passed.
    pub fn place(&self, rows: MovingRows<'_>, share: f32) {
        let share = f64::from(share);
        for &Carried { row, body, arm: [arm, change], way } in &self.carried {
            let Deviation { translation, rotation } = self.bodies[body as usize].deviation;
            let arm = arm + change * share;
            rows.place(row, (way * share + translation + (rotation * arm - arm)).as_vec3());
        }
    }

    /// Sets the velocities of particles, in a substep of `step` seconds.
    pub fn set_speeds(&self, rows: MovingRows<'_>, step: f32) {
        self.carried.iter().for_each(|carried| rows.set_speed(carried.row, step));
    }

    /// Forgets how many contacts bodies have.
    pub fn begin_counting(&mut self) {
        self.bodies.iter_mut().for_each(|moving| moving.contacts = 0);
    }

    /// Counts a contact.
    pub fn count(&mut self, number: u32) {
        if let Some(Pusher { body, .. }) = pusher(&self.pushers, number) {
            self.bodies[body as usize].contacts += 1;
        }
    }

    /// What a contact has to add to the sum of inverse masses, along its normal and across, if it pushes a body that all
    /// contacts that were counted may push at the same time.
    #[must_use]
    pub fn yielding(&self, number: u32, normal: DVec3) -> Option<[f64; 2]> {
        let Pusher { body, arm, .. } = pusher(&self.pushers, number)?;
        let Moving { body, contacts, .. } = &self.bodies[body as usize];
        let response = |impulse: DVec3| body.response(arm, impulse);
        let [u, v] = [normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector())];
        let [of_u, of_v] = [response(u), response(v)];
        let (a, b, c) = (u.dot(of_u), u.dot(of_v), v.dot(of_v));
        let across = 0.5 * (a + c) + (0.25 * (a - c) * (a - c) + b * b).sqrt();
        let count = f64::from(*contacts);
        Some([count * normal.dot(response(normal)), count * across])
    }

    /// Adds up the pushes of contacts, each on the contact's first side and times the duration of a substep. `each` calls its
    /// argument with all of them.
    fn add_up(&mut self, each: impl FnOnce(&mut dyn FnMut(u32, DVec3))) {
        let Self { bodies, pushers, .. } = self;
        for moving in &mut *bodies {
            moving.pushes = [DVec3::ZERO; 2];
        }
        each(&mut |number, push| {
            let Some(Pusher { body, arm, sign }) = pusher(pushers, number) else { return };
            let push = push * sign;
            let [sum, moment] = &mut bodies[body as usize].pushes;
            *sum += push;
            *moment += arm.cross(push);
        });
    }

    /// Moves bodies by what all contacts have pushed so far in this substep.
    pub fn give_way(&mut self, each: impl FnOnce(&mut dyn FnMut(u32, DVec3))) {
        self.add_up(each);
        for Moving { body, deviation, predicted, pushes: [push, moment], .. } in &mut self.bodies {
            *deviation = predicted.then(*push * body.inverse_mass, body.inverse_inertia * *moment);
        }
    }

    /// Ends a substep of `step` seconds, after the bounce has been removed from pushes.
    pub fn end_step(&mut self, step: f64, each: impl FnOnce(&mut dyn FnMut(u32, DVec3))) {
        self.add_up(each);
        for Moving { body, velocity: [linear, angular], pushes: [push, moment], .. } in &mut self.bodies {
            *linear += *push * (body.inverse_mass / step);
            *angular += body.inverse_inertia * (*moment / step);
        }
    }

    /// The deviation of a body, and its velocities.
    #[must_use]
    pub fn state(&self, body: u32) -> (Deviation, [DVec3; 2]) {
        let Moving { deviation, velocity, .. } = &self.bodies[body as usize];
        (*deviation, *velocity)
    }

    /// From the center of mass to a point at the end of the tick.
    #[must_use]
    pub fn arm_of(&self, body: u32, point: DVec3) -> DVec3 {
        let Moving { body, deviation, .. } = &self.bodies[body as usize];
        point - body.center[1] - deviation.translation
    }

    /// Velocity of the deviation at the end of an arm.
    #[must_use]
    pub fn speed_at(&self, body: u32, arm: DVec3) -> DVec3 {
        let [linear, angular] = self.bodies[body as usize].velocity;
        linear + angular.cross(arm)
    }

    /// How fast a unit impulse makes a body along itself, at the end of an arm.
    #[must_use]
    pub fn mobility(&self, body: u32, arm: DVec3, along: DVec3) -> f64 {
        along.dot(self.bodies[body as usize].body.response(arm, along))
    }

    /// Gives a body an impulse at the end of an arm.
    pub fn strike(&mut self, body: u32, arm: DVec3, impulse: DVec3) {
        let Moving { body, velocity: [linear, angular], .. } = &mut self.bodies[body as usize];
        *linear += impulse * body.inverse_mass;
        *angular += body.inverse_inertia * arm.cross(impulse);
    }

    /// Where a point at the end of the tick would be if its body did not deviate.
    #[must_use]
    pub fn on_path(&self, body: u32, point: DVec3) -> DVec3 {
        let Moving { body, deviation: Deviation { translation, rotation }, .. } = &self.bodies[body as usize];
        let center = body.center[1];
        center + rotation.inverse() * (point - center - *translation)
    }
}

/// The contact with a number, if it pushes a body.
fn pusher(pushers: &[Option<Pusher>], number: u32) -> Option<Pusher> {
    pushers.get(number as usize).copied().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MASS: f64 = 0.4;
    const RADIUS: f64 = 0.3;

    /// A ball that moves by one along x.
    fn ball() -> RigidBody {
        RigidBody {
            inverse_mass: DVec3::splat(1.0 / MASS),
            inverse_inertia: DMat3::from_diagonal(DVec3::splat(2.5 / (MASS * RADIUS * RADIUS))),
            center: [DVec3::Y, DVec3::Y + DVec3::X],
            velocity: [DVec3::ZERO; 2],
        }
    }

    #[test]
    fn a_ball_yields_by_its_mass_along_the_normal_and_by_seven_halves_of_that_across() {
        let mut bodies = RigidBodies::default();
        let ball = bodies.push(ball());
        let normal = DVec3::new(1.0, -2.0, 0.5).normalize();
        // Two of these three contacts are counted. The other numbers push nothing that has a mass.
        for number in [1, 3, 4] {
            bodies.push_at(number, ball, DVec3::Y + normal * RADIUS, number == 3);
        }
        bodies.begin_counting();
        for number in [0, 1, 4, 9] {
            bodies.count(number);
        }
        assert_eq!([0, 2, 9].map(|number| bodies.yielding(number, normal)), [None; 3]);
        let [along, across] = bodies.yielding(3, normal).unwrap();
        assert!((along - 2.0 / MASS).abs() < 1.0e-12 && (across - 7.0 / MASS).abs() < 1.0e-9, "{along}, {across}");
    }

    #[test]
    fn pushes_move_and_turn_a_body_and_become_velocities_when_the_substep_ends() {
        let (mut bodies, step) = (RigidBodies::default(), 0.01);
        let ball = bodies.push(ball());
        let arm = DVec3::new(0.0, RADIUS, 0.0);
        bodies.push_at(0, ball, DVec3::Y + arm, true);
        bodies.push_at(1, ball, DVec3::Y - arm, false);
        bodies.begin();
        bodies.predict(step);
        // A push on top, and one back below, where the ball is the second side: a pure couple.
        let push = DVec3::X * 2.0e-5;
        bodies.give_way(|add| [0, 1, 7].into_iter().for_each(|number| add(number, push)));
        let (deviation, velocity) = bodies.state(ball);
        let turn = 2.0 * RADIUS * push.x * 2.5 / (MASS * RADIUS * RADIUS);
        assert!(deviation.translation.length() < 1.0e-15, "{deviation:?}");
        assert!(deviation.rotation.to_scaled_axis().distance(DVec3::NEG_Z * turn) < 1.0e-12, "{deviation:?}");
        assert_eq!(velocity, [DVec3::ZERO; 2]);
        // What is told again does not add up.
        bodies.give_way(|add| add(0, push));
        bodies.end_step(step, |add| add(0, push));
        let (deviation, [linear, angular]) = bodies.state(ball);
        assert!(deviation.translation.distance(push / MASS) < 1.0e-15, "{deviation:?}");
        assert!(linear.distance(push / (MASS * step)) < 1.0e-12 && (angular.z + 0.5 * turn / step).abs() < 1.0e-9);
        // Where a point of the path's end is carried to, and back.
        let (point, center) = (DVec3::new(1.1, 1.2, -0.1), DVec3::Y + DVec3::X);
        let carried = center + deviation.translation + deviation.rotation * (point - center);
        assert!(carried.distance(point) > 1.0e-5 && bodies.on_path(ball, carried).distance(point) < 1.0e-12);
        bodies.begin();
        assert_eq!(bodies.state(ball), (Deviation::default(), [DVec3::ZERO; 2]), "back on its path");
    }

    #[test]
    fn a_strike_makes_the_point_that_it_hits_as_fast_as_the_mobility_says() {
        let mut bodies = RigidBodies::default();
        let ball = bodies.push(RigidBody { inverse_mass: DVec3::new(3.0, 0.0, 1.0), ..ball() });
        let (arm, along) = (DVec3::new(0.1, -0.2, 0.15), DVec3::new(2.0, 1.0, -3.0).normalize());
        bodies.strike(ball, arm, along * 0.7);
        let speed = along.dot(bodies.speed_at(ball, arm));
        assert!((speed - 0.7 * bodies.mobility(ball, arm, along)).abs() < 1.0e-12, "{speed}");
        assert_eq!(bodies.state(ball).1[0].y, 0.0, "the axis is locked");
    }
}
