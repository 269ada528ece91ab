//! Projects colliding features beyond separating planes, for all impacts together.
//!
//! Every impact gives a plane between its two features at the time of impact. The result is the set of ends closest to
//! the solved ones, weighted by mass, that lie on the right side of all planes: projected Gauss–Seidel with nonnegative
//! multipliers over the impacts of all rounds (D. Harmon et al. 2008, "Robust treatment of simultaneous collisions").
//! Motion along the planes is free, so squeezed vertices give way to the side.

use arrayvec::ArrayVec;
use bevy_ecs::prelude::*;
use glam::DVec3;

use super::mesh::{Mesh, MeshPair};
use crate::{
    kernel::{
        ccd::PairImpact,
        xpbd::{MOST_LEVER, RigidBodies},
    },
    response::{gather::Gatherer, particles::Particles, reaction::Reactions, scene::Scene},
};

/// Largest number of sweeps over all planes.
const MOST_SWEEPS: usize = 64;

/// Ends are accepted if no plane misses more than this share of the separation, without its solid part.
const GOOD: f64 = 0.1;

/// Velocities are accepted if no plane misses more than this share of the largest initial error.
const GOOD_SPEED: f64 = 1.0e-3;

/// The separating plane of an impact.
struct Plane {
    /// Particles with their weights, positive on the side that the normal points to.
    entries: ArrayVec<(u32, f64), 6>,
    normal: DVec3,
    /// Lower bound of `normal · Σ weight position` at the end of the part.
    least: f64,
    /// Lower bound of `normal · Σ weight velocity`.
    least_velocity: f64,
    /// Highest speed of the kinematic vertices in the impact.
    driven_speed: f64,
    /// What [`mobility`] gives for its particles.
    mobility: f64,
    /// What it strikes that answers.
    struck: Option<Struck>,
    tolerance: f64,
    multiplier: f64,
}

/// Where an impact strikes something that has a mass, or that wants its reaction.
#[derive(Clone, Copy)]
struct Struck {
    entity: Entity,
    point: DVec3,
    /// 1 if the normal points to it, and −1 if it points away.
    sign: f64,
    /// Its rigid body, if it has a mass, and the arm of the point.
    body: Option<(u32, DVec3)>,
}

/// Which objects that the solver does not move answer to impacts.
pub(super) struct Answers<'a> {
    pub(super) scene: &'a Scene<'a, 'a>,
    pub(super) gatherer: &'a Gatherer,
    pub(super) bodies: &'a RigidBodies,
}

impl Answers<'_> {
    /// What an impact strikes at a point, if that answers.
    fn at(&self, entity: Entity, point: DVec3, sign: f64) -> Option<Struck> {
        let body = self.gatherer.rigid_body(entity).map(|body| (body, self.bodies.arm_of(body, point)));
        self.gatherer.answers(self.scene, entity).then_some(Struck { entity, point, sign, body })
    }
}

impl Struck {
    /// Velocity of the body's deviation along a normal.
    fn speed(&self, bodies: &RigidBodies, normal: DVec3) -> f64 {
        self.body.map_or(0.0, |(body, arm)| self.sign * normal.dot(bodies.speed_at(body, arm)))
    }

    /// How fast a unit impulse makes it.
    fn mobility(&self, bodies: &RigidBodies, normal: DVec3) -> f64 {
        self.body.map_or(0.0, |(body, arm)| bodies.mobility(body, arm, normal))
    }

    fn strike(&self, bodies: &mut RigidBodies, impulse: DVec3) {
        if let Some((body, arm)) = self.body {
            bodies.strike(body, arm, impulse * self.sign);
        }
    }
}

/// `Σ weight² / mass`, and at least what [`MOST_LEVER`] asks for.
fn mobility(particles: &Particles, entries: &[(u32, f64)]) -> f64 {
    let (mut sum, mut lightest) = (0.0, 0.0_f64);
    for &(particle, weight) in entries {
        let inverse_mass = particles.inverse_mass[particle as usize];
        sum += weight * weight * inverse_mass;
        lightest = lightest.max(inverse_mass);
    }
    sum.max(lightest / f64::from(MOST_LEVER * MOST_LEVER))
}

/// The planes of all rounds of one part of a tick.
#[derive(Default)]
pub(super) struct Planes {
    all: Vec<Plane>,
    /// The longest way of anything in the impacts before they were resolved.
    longest_way: f64,
    /// The largest separation that is kept, without its solid part.
    widest: f64,
}

impl Plane {
    fn sum(&self, values: &[DVec3]) -> f64 {
        self.normal.dot(self.entries.iter().map(|&(particle, weight)| values[particle as usize] * weight).sum())
    }

    fn push(&self, values: &mut [DVec3], inverse_mass: &[f64], by: f64) {
        for &(particle, weight) in &self.entries {
            let particle = particle as usize;
            values[particle] += self.normal * (by * weight * inverse_mass[particle]);
        }
    }
}

impl Planes {
    pub(super) fn clear(&mut self) {
        self.all.clear();
        (self.longest_way, self.widest) = (0.0, 0.0);
    }

    /// Adds the plane of an impact, in a part of the tick that lasts `duration` seconds. `solved` are the positions before
    /// any projection.
    pub(super) fn add(
        &mut self,
        particles: &Particles,
        solved: &[DVec3],
        meshes: &[Mesh],
        (pair, found): &(MeshPair, PairImpact),
        answers: &Answers<'_>,
        duration: f64,
    ) {
        let impact = &found.impact;
        let normal = -impact.normal;
        let mut entries: ArrayVec<(u32, f64), 6> = ArrayVec::new();
        let (mut ahead, mut moved, mut fastest) = (DVec3::ZERO, DVec3::ZERO, 0.0_f64);
        let mut struck = None;
        let sides = [(found.triangle_a, impact.barycentric_a, 1.0), (found.triangle_b, impact.barycentric_b, -1.0)];
        for (place, (triangle, barycentric, sign)) in pair.places.into_iter().zip(sides) {
            let mesh = &meshes[place];
            let (swept, corners) = (mesh.swept(particles), mesh.topology.welded_triangles()[triangle as usize]);
            let body = answers.gatherer.rigid_body(mesh.name.entity);
            if mesh.first.is_none() {
                let ends = corners.iter().zip(barycentric).map(|(&corner, weight)| swept.end[corner as usize] * weight);
                struck = answers.at(mesh.name.entity, ends.sum(), sign).or(struck);
            }
            for (corner, weight) in corners.into_iter().zip(barycentric).filter(|&(_, weight)| weight != 0.0) {
                let weight = sign * weight;
                let corner = corner as usize;
                let particle = mesh.first.map(|first| first + corner);
                if let Some(particle) = particle.filter(|&particle| particles.inverse_mass[particle] > 0.0) {
                    entries.push((particle as u32, weight));
                    continue;
                }
                let (start, end) = (swept.start[corner], swept.end[corner]);
                ahead += end * weight;
                let on_path = body.map_or(end, |body| answers.bodies.on_path(body, end));
                moved += (on_path - start) * weight;
                fastest = fastest.max(start.distance(end));
            }
        }
        let mobility = mobility(particles, &entries);
        if mobility > 0.0 {
            let kept = pair.separation - pair.radius;
            let own = entries.iter().map(|&(particle, _)| {
                let particle = particle as usize;
                solved[particle].distance(particles.start[particle])
            });
            self.longest_way = own.fold(self.longest_way.max(fastest), f64::max);
            self.widest = self.widest.max(kept);
            self.all.push(Plane {
                entries,
                normal,
                least: pair.separation + 2.0 * GOOD * kept - normal.dot(ahead),
                least_velocity: -normal.dot(moved) / duration,
                driven_speed: fastest / duration,
                mobility,
                struck,
                tolerance: GOOD * kept,
                multiplier: 0.0,
            });
        }
    }

    /// Moves particles beyond all planes, as far as there is room, and marks the particles that have moved. None ends
    /// up farther from its start than anything in the impacts would have moved by itself. Otherwise a wedge that closes,
    /// or two objects with the cloth between them, would squeeze vertices out to any distance.
    pub(super) fn project(&mut self, particles: &mut Particles, changed: &mut [bool]) {
        let longest = self.longest_way + self.widest;
        let Particles { position, inverse_mass, start, .. } = particles;
        for _ in 0..MOST_SWEEPS {
            let mut is_good = true;
            for plane in &mut self.all {
                let missing = plane.least - plane.sum(position);
                let before = plane.multiplier;
                plane.multiplier = (before + missing / plane.mobility).max(0.0);
                let change = plane.multiplier - before;
                if change != 0.0 {
                    is_good &= missing <= plane.tolerance;
                    plane.push(position, inverse_mass, change);
                    plane.entries.iter().for_each(|&(particle, _)| changed[particle as usize] = true);
                }
            }
            if is_good {
                break;
            }
        }
        for &(particle, _) in self.all.iter().flat_map(|plane| &plane.entries) {
            let particle = particle as usize;
            position[particle] = start[particle] + (position[particle] - start[particle]).clamp_length_max(longest);
        }
    }

    /// Removes the velocity with which particles would continue through the planes that have pushed them, and gives it to what
    /// they belong to, if that has a mass or wants its reaction. No particle
    /// ends up faster than the fastest one in any impact. Otherwise a closing wedge would squeeze vertices out at any
    /// speed.
    pub(super) fn settle_velocities(
        &self,
        particles: &mut Particles,
        bodies: &mut RigidBodies,
        reactions: &mut Reactions,
    ) {
        let Particles { velocity, inverse_mass, .. } = particles;
        let pressing: Vec<&Plane> = self.all.iter().filter(|plane| plane.multiplier > 0.0).collect();
        let speeds = |plane: &&Plane| {
            let own = plane.entries.iter().map(|&(particle, _)| velocity[particle as usize].length());
            own.fold(plane.driven_speed, f64::max)
        };
        let fastest = pressing.iter().map(speeds).fold(0.0, f64::max);
        let missing = |plane: &Plane, velocity: &[DVec3], bodies: &RigidBodies| {
            let of_body = plane.struck.map_or(0.0, |struck| struck.speed(bodies, plane.normal));
            plane.least_velocity - plane.sum(velocity) - of_body
        };
        let most = pressing.iter().map(|plane| missing(plane, velocity, bodies)).fold(0.0, f64::max);
        let mut multipliers = vec![0.0; pressing.len()];
        for _ in 0..MOST_SWEEPS {
            let mut is_good = true;
            for (plane, multiplier) in pressing.iter().zip(&mut multipliers) {
                let missing = missing(plane, velocity, bodies);
                let before = *multiplier;
                let of_body = plane.struck.map_or(0.0, |struck| struck.mobility(bodies, plane.normal));
                *multiplier = (before + missing / (plane.mobility + of_body)).max(0.0);
                is_good &= missing <= GOOD_SPEED * most;
                plane.push(velocity, inverse_mass, *multiplier - before);
                if let Some(struck) = plane.struck {
                    struck.strike(bodies, plane.normal * (*multiplier - before));
                }
            }
            if is_good {
                break;
            }
        }
        for (plane, multiplier) in pressing.iter().zip(multipliers) {
            if let Some(Struck { entity, point, sign, .. }) = plane.struck {
                reactions.add_at(entity, point, plane.normal * (sign * multiplier));
            }
        }
        for &(particle, _) in pressing.iter().flat_map(|plane| &plane.entries) {
            let velocity = &mut velocity[particle as usize];
            *velocity = velocity.clamp_length_max(fastest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Particles with inverse masses that start at the origin, with their solved ends.
    fn particles(ends: &[(DVec3, f64)]) -> Particles {
        let mut particles = Particles::default();
        for &(end, inverse_mass) in ends {
            particles.push_moved(DVec3::ZERO, end, inverse_mass);
            *particles.position.last_mut().unwrap() = end;
        }
        particles
    }

    /// The plane `normal · Σ weight position ≥ least`.
    fn plane(particles: &Particles, entries: &[(u32, f64)], normal: DVec3, least: f64) -> Plane {
        Plane {
            entries: entries.iter().copied().collect(),
            normal,
            least,
            least_velocity: least,
            driven_speed: least.abs(),
            mobility: mobility(particles, entries),
            struck: None,
            tolerance: 1.0e-12,
            multiplier: 0.0,
        }
    }

    fn projected(mut particles: Particles, planes: Vec<Plane>) -> Particles {
        let ways = planes.iter().flat_map(|plane| {
            let own = plane.entries.iter().map(|&(particle, _)| particles.position[particle as usize].length());
            own.chain([plane.least.abs()])
        });
        let mut planes = Planes { longest_way: ways.fold(0.0, f64::max), all: planes, ..Planes::default() };
        let mut changed = vec![false; particles.len()];
        let before = particles.position.clone();
        planes.project(&mut particles, &mut changed);
        planes.settle_velocities(&mut particles, &mut RigidBodies::default(), &mut Reactions::default());
        for (place, is_changed) in changed.into_iter().enumerate() {
            assert!(is_changed || particles.position[place] == before[place], "{place}");
        }
        particles
    }

    #[test]
    fn what_is_beyond_all_planes_stays_where_it_is() {
        let start = particles(&[(DVec3::new(0.3, 2.0, -1.0), 1.0)]);
        let floor = plane(&start, &[(0, 1.0)], DVec3::Y, 1.5);
        let end = projected(start.clone(), vec![floor]);
        assert_eq!((end.position, end.velocity), (start.position, start.velocity));
    }

    #[test]
    fn in_a_corner_the_nearest_point_beyond_both_planes_is_found() {
        // A right angle, and a wedge of 60 degrees whose edge is the closest point.
        for (angle, end) in [(90.0_f64, DVec3::new(-1.0, -2.0, 0.7)), (120.0, DVec3::new(-0.1, -2.0, 0.7))] {
            let start = particles(&[(end, 0.25)]);
            let (sine, cosine) = angle.to_radians().sin_cos();
            let normals = [DVec3::Y, DVec3::new(sine, cosine, 0.0)];
            let planes = normals.map(|normal| plane(&start, &[(0, 1.0)], normal, 0.0));
            let found = projected(start, planes.into());
            assert!(found.position[0].distance(DVec3::new(0.0, 0.0, 0.7)) < 1e-9, "{angle}: {}", found.position[0]);
            assert!(found.velocity[0].distance(DVec3::new(0.0, 0.0, 0.7)) < 1e-2, "{angle}: {}", found.velocity[0]);
        }
    }

    #[test]
    fn two_that_meet_keep_their_momentum() {
        let [mass, other_mass] = [2.0, 5.0];
        let start =
            particles(&[(DVec3::new(0.0, -1.0, 0.5), 1.0 / mass), (DVec3::new(0.3, 1.0, 0.0), 1.0 / other_mass)]);
        let momentum = |values: &[DVec3]| values[0] * mass + values[1] * other_mass;
        let apart = plane(&start, &[(0, 1.0), (1, -1.0)], DVec3::Y, 0.25);
        let end = projected(start.clone(), vec![apart]);
        assert!((end.position[0].y - end.position[1].y - 0.25).abs() < 1e-12);
        assert!(momentum(&end.position).distance(momentum(&start.position)) < 1e-12);
        assert!(momentum(&end.velocity).distance(momentum(&start.velocity)) < 1e-12);
    }

    #[test]
    fn where_there_is_no_room_nothing_is_thrown_away() {
        let start = particles(&[(DVec3::new(0.4, 0.0, 0.0), 1.0)]);
        let planes = [1.0, -1.0].map(|side| plane(&start, &[(0, 1.0)], DVec3::Y * side, 0.1));
        let end = projected(start, planes.into());
        assert!(end.position[0].distance(DVec3::new(0.4, 0.0, 0.0)) <= 0.2, "{}", end.position[0]);
    }

    #[test]
    fn what_a_wedge_squeezes_out_is_no_faster_than_the_wedge() {
        let start = particles(&[(DVec3::ZERO, 1.0)]);
        // Both sides close in at 3 m/s, at a slope of 1 in 100.
        let planes = [1.0, -1.0].map(|side| {
            let normal = DVec3::new(0.01, side, 0.0).normalize();
            plane(&start, &[(0, 1.0)], normal, 3.0)
        });
        let end = projected(start, planes.into());
        assert!(end.velocity[0].length() <= 3.0 + 1e-9, "{}", end.velocity[0]);
        assert!(end.velocity[0].x > 0.1, "to the side: {}", end.velocity[0]);
    }
}
