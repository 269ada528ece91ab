//! How remaining impacts are resolved: vertices stop, or are carried along by kinematic objects.

use glam::{DMat3, DVec3};

use super::mesh::{Mesh, Obstacle};
use crate::{
    kernel::{ccd::PairImpact, pose::Pose},
    response::particles::Particles,
};

/// Rounds after which a zone between kinematic objects is no longer carried along.
pub(super) const MOST_ROUNDS: usize = 8;

/// The rigid motion by which a kinematic object carries along what it hits: a rotation about a point, and the motion of
/// that point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Carry {
    pub(super) from: DVec3,
    pub(super) to: DVec3,
    pub(super) turn: DMat3,
}

impl Carry {
    /// Displacement of a point that begins at `start`.
    pub(super) fn way(&self, start: DVec3) -> DVec3 {
        self.turn * (start - self.from) + self.to - start
    }

    /// The one of two motions that displaces a point farther.
    pub(super) fn longer(one: Option<Self>, other: Option<Self>, start: DVec3) -> Option<Self> {
        let length = |carry: &Option<Self>| carry.map_or(0.0, |carry| carry.way(start).length_squared());
        if length(&other) > length(&one) { other } else { one }
    }
}

/// Displacement of a point that something carries along; zero if nothing does.
pub(super) fn way_of(carry: Option<Carry>, start: DVec3) -> DVec3 {
    carry.map_or(DVec3::ZERO, |carry| carry.way(start))
}

/// The rotation, with the change of scale, from one pose to another. `None` if they are equal.
pub(super) fn turn_between([from, to]: [&Pose; 2]) -> Option<DMat3> {
    (!from.has_bits_of(to)).then(|| to.to_affine().matrix3 * from.to_affine().matrix3.inverse())
}

/// The rotation of a triangle from its start to its end; the identity if it has no area.
pub(super) fn turn_of(start: [DVec3; 3], end: [DVec3; 3]) -> DMat3 {
    let frame = |[a, b, c]: [DVec3; 3]| {
        let along = (b - a).try_normalize()?;
        let normal = along.cross(c - a).try_normalize()?;
        Some(DMat3::from_cols(along, normal, along.cross(normal)))
    };
    let (Some(start), Some(end)) = (frame(start), frame(end)) else { return DMat3::IDENTITY };
    end * start.transpose()
}

/// The particles that are stopped, and what carries them along.
pub(super) struct Ways<'a> {
    pub(super) particles: &'a Particles,
    pub(super) stopped: &'a mut [bool],
    pub(super) carried: &'a mut [Option<Carry>],
    pub(super) changed: &'a mut [bool],
    pub(super) zones: &'a mut [u32],
}

impl Ways<'_> {
    /// The representative particle of an impact zone.
    pub(super) fn zone(&mut self, mut particle: u32) -> u32 {
        while self.zones[particle as usize] != particle {
            let above = self.zones[self.zones[particle as usize] as usize];
            self.zones[particle as usize] = above;
            particle = above;
        }
        particle
    }

    pub(super) fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.zone(one), self.zone(other));
        self.zones[one.max(other) as usize] = one.min(other);
    }

    /// Makes all particles of a zone follow the motion that displaces one of them farthest. At their current relative
    /// positions they do not collide with each other.
    pub(super) fn go_by_zones(&mut self) {
        for particle in 0..self.zones.len() as u32 {
            let zone = self.zone(particle);
            if zone != particle {
                let start = self.particles.start[zone as usize];
                let longest = Carry::longer(self.carried[zone as usize], self.carried[particle as usize], start);
                self.carried[zone as usize] = longest;
            }
        }
        for particle in 0..self.zones.len() as u32 {
            let zone = self.zone(particle) as usize;
            let particle = particle as usize;
            if zone == particle && !self.stopped[particle] || self.particles.inverse_mass[particle] <= 0.0 {
                continue;
            }
            if self.carried[particle] != self.carried[zone] || !self.stopped[particle] {
                self.carried[particle] = self.carried[zone];
                self.stopped[particle] = true;
                self.changed[particle] = true;
            }
        }
    }

    /// How one side of an impact carries along what it hits. `None` if it is static, or a body that nothing carries.
    pub(super) fn carry(&self, mesh: &Mesh, triangle: u32, barycentric: &[f64; 3]) -> Option<Carry> {
        let corners = mesh.topology.welded_triangles()[triangle as usize];
        let at = |points: [DVec3; 3]| -> DVec3 {
            points.iter().zip(barycentric).map(|(&point, weight)| point * *weight).sum()
        };
        let carry = |start: [DVec3; 3], end: [DVec3; 3], turn: Option<DMat3>| {
            let turn = turn.unwrap_or_else(|| turn_of(start, end));
            (start != end).then(|| Carry { from: at(start), to: at(end), turn })
        };
        let Some(first) = mesh.first else {
            let Obstacle { start, end, turn, .. } = &mesh.obstacle;
            let of = |points: &[DVec3]| corners.map(|corner| points[corner as usize]);
            return carry(of(start), of(end), *turn);
        };
        let places = corners.map(|corner| first + corner as usize);
        let point = at(places.map(|place| self.particles.start[place]));
        let own = places.map(|place| {
            let (start, end) = (self.particles.start[place], self.particles.end[place]);
            if self.particles.inverse_mass[place] > 0.0 || start == end {
                return self.carried[place];
            }
            Some(Carry { from: start, to: end, turn: DMat3::IDENTITY })
        });
        own.into_iter().fold(None, |longest, carry| Carry::longer(longest, carry, point))
    }
}

/// Stops both sides of an impact. If one of them is kinematic, or is a body that such an object pushes, the other side
/// is carried along. Returns `false` if nothing on either side can be held any more.
pub(super) fn hold(mesh_a: &Mesh, mesh_b: &Mesh, ways: &mut Ways<'_>, found: &PairImpact, round: usize) -> bool {
    if mesh_a.first.is_none() && mesh_b.first.is_none() {
        return false;
    }
    let carry_a = ways.carry(mesh_a, found.triangle_a, &found.impact.barycentric_a);
    let carry_b = ways.carry(mesh_b, found.triangle_b, &found.impact.barycentric_b);
    let is_between_bodies = mesh_a.first.is_some() && mesh_b.first.is_some();
    let is_carried = carry_a.is_some() || carry_b.is_some();
    if round >= MOST_ROUNDS && is_between_bodies && is_carried {
        // Bodies crossing each other is better than bodies crossing what pushes them.
        return false;
    }
    let mut is_held = false;
    let mut zone = None;
    for (mesh, triangle) in [(mesh_a, found.triangle_a), (mesh_b, found.triangle_b)] {
        let Some(first) = mesh.first else { continue };
        let mut stop = |particle: usize| {
            if ways.particles.inverse_mass[particle] <= 0.0 {
                return;
            }
            // A vertex squeezed between two moving objects follows the one that displaces it farther.
            let start = ways.particles.start[particle];
            let own = ways.carried[particle];
            let carry = Carry::longer(Carry::longer(own, carry_a, start), carry_b, start);
            if carry != own || !ways.stopped[particle] {
                ways.carried[particle] = carry;
                ways.stopped[particle] = true;
                ways.changed[particle] = true;
                is_held = true;
            }
        };
        if round >= MOST_ROUNDS && !is_carried {
            (first..first + mesh.topology.vertex_count()).for_each(stop);
            continue;
        }
        let corners = mesh.topology.welded_triangles()[triangle as usize];
        for corner in corners {
            stop(first + corner as usize);
        }
        if round < MOST_ROUNDS {
            for corner in corners {
                let particle = first as u32 + corner;
                if ways.particles.inverse_mass[particle as usize] > 0.0 {
                    ways.join(*zone.get_or_insert(particle), particle);
                }
            }
        }
    }
    is_held
}
