//! Drag and lift of triangles in a wind.
//!
//! On a triangle of area `A` with the unit normal `n` turned toward the relative wind `v`, air of density `ρ` acts with
//! the force `½ρA [(C_D − C_L)(v·n) v + C_L |v|² n]` (Wilson et al. 2014, "Simulating Wind Effects on
//! Cloth and Hair in Disney's Frozen").

use glam::{DVec3, Vec3};

use super::rows::{ParticleRows, row_of};

/// What the air does to a body.
#[derive(Clone, Copy, Debug)]
pub struct Air {
    /// Velocity of the wind in world units per second.
    pub velocity: Vec3,
    /// Density in kilograms per cubic world unit.
    pub density: f32,
    /// Drag and lift coefficients.
    pub coefficients: [f32; 2],
}

/// A triangle in the wind.
#[derive(Debug)]
struct Sail {
    corners: [u32; 3],
    /// From the first corner to the others at the beginning of the tick.
    edges: [Vec3; 2],
    /// The area at rest. Cloth that stretches catches no more wind.
    area: f32,
}

/// The bodies that are in a wind, in a tick.
#[derive(Debug, Default)]
pub struct Winds {
    sails: Vec<Sail>,
    bodies: Vec<(Air, usize)>,
}

impl Winds {
    pub fn clear(&mut self) {
        self.sails.clear();
        self.bodies.clear();
    }

    /// Adds the triangles of a body whose particles begin with `first`, with their areas at rest.
    pub fn add<'a>(
        &mut self,
        air: Air,
        triangles: impl Iterator<Item = (&'a [u32; 3], f32)>,
        first: usize,
        start: &[DVec3],
    ) {
        self.sails.extend(triangles.map(|(triangle, area)| {
            let [a, b, c] = triangle.map(|vertex| first + vertex as usize);
            let edges = [b, c].map(|corner| (start[corner] - start[a]).as_vec3());
            Sail { corners: [a, b, c].map(row_of), edges, area }
        }));
        self.bodies.push((air, self.sails.len()));
    }

    /// Changes velocities by the force of the wind over a substep of `step` seconds. No triangle is faster relative to the air
    /// afterwards than before: drag takes it at most along, and lift turns its way, where the force at the beginning of a
    /// long step would add speed.
    pub fn blow(&self, particles: &mut ParticleRows, step: f32) {
        let mut first = 0;
        for &(Air { velocity, density, coefficients: [drag, lift] }, end) in &self.bodies {
            for Sail { corners, edges, area } in &self.sails[first..end] {
                let [a, b, c] = corners.map(|corner| corner as usize);
                let moved = |corner: usize| particles.displacement[corner].vector();
                let origin = moved(a);
                let (along, across) = (edges[0] + moved(b) - origin, edges[1] + moved(c) - origin);
                let twice = along.cross(across);
                let length = twice.length();
                let speeds = [a, b, c].map(|corner| particles.velocity[corner].vector());
                let wind = velocity - (speeds[0] + speeds[1] + speeds[2]) / 3.0;
                if length <= 0.0 || wind == Vec3::ZERO {
                    continue;
                }
                let normal = twice / length;
                let normal = if normal.dot(wind) < 0.0 { -normal } else { normal };
                let force = ((drag - lift) * normal.dot(wind)) * wind + (lift * wind.length_squared()) * normal;
                let push = force * (density * length.min(2.0 * area) * step / 12.0);
                // A third acts on each corner.
                let mobility: f32 = [a, b, c].iter().map(|&corner| particles.velocity[corner].0[3]).sum::<f32>() / 3.0;
                if mobility <= 0.0 {
                    continue;
                }
                let change = push * mobility;
                let (along, most) = (change.dot(wind), wind.length_squared());
                let change = if along > most { change * (most / along) } else { change };
                let after = wind - change;
                let is_faster = after.length_squared() > most;
                let change = if is_faster { wind - after.clamp_length_max(most.sqrt()) } else { change };
                for corner in [a, b, c] {
                    let row = &mut particles.velocity[corner];
                    row.set(row.vector() + change * (row.0[3] / mobility));
                }
            }
            first = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::xpbd::Placed;

    /// The velocity change of a triangle of area 2 and mass 3 after one substep, with the wind's velocity.
    fn change(velocity: Vec3, coefficients: [f32; 2], step: f32) -> DVec3 {
        let start = [DVec3::ZERO, DVec3::X * 2.0, DVec3::Z * 2.0];
        let mut rows = ParticleRows::default();
        let still = Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: 1.0 };
        rows.begin([still; 3].into_iter());
        let mut winds = Winds::default();
        winds.add(Air { velocity, density: 1.2, coefficients }, [(&[0, 1, 2], 2.0)].into_iter(), 0, &start);
        winds.blow(&mut rows, step);
        let changes = [0, 1, 2].map(|particle| rows.state(particle)[1]);
        assert!(changes.iter().all(|change| *change == changes[0]));
        changes[0]
    }

    #[test]
    fn the_force_is_that_of_the_formula_and_no_stronger_than_the_wind() {
        let step = 0.001;
        let close = |found: DVec3, force: DVec3| {
            let expected = force * f64::from(step) / 3.0;
            assert!(found.distance(expected) < 1e-6 * expected.length().max(1e-3), "{found} {expected}");
        };
        // Head-on: ½ρA C_D v² along the wind, whatever the lift.
        for lift in [0.0, 0.5] {
            close(change(Vec3::Y * 5.0, [1.0, lift], step), DVec3::Y * (0.5 * 1.2 * 2.0 * 25.0));
        }
        // Along the triangle: only lift would act, and only across.
        close(change(Vec3::X * 5.0, [1.0, 0.0], step), DVec3::ZERO);
        // At 45°: the drag is along the wind, and the lift across adds on the lee side.
        let wind = Vec3::new(3.0, 3.0, 0.0);
        let expected = wind.as_dvec3() * (0.6 * 3.0) + DVec3::Y * (0.4 * 18.0);
        close(change(wind, [1.0, 0.4], step), expected * (0.5 * 1.2 * 2.0));
        // Lift alone turns the way of the triangle through the air.
        for step in [0.001, 0.1, 10.0] {
            let end = change(wind, [0.0, 0.5], step);
            assert!((wind.as_dvec3() - end).length() < wind.as_dvec3().length() * (1.0 + 1e-6), "{step}: {end}");
        }
        // A gale over a long step ends at the speed of the wind.
        let end = change(Vec3::Y * 100.0, [1.0, 0.0], 10.0);
        assert!(end.distance(DVec3::Y * 100.0) < 1e-3, "{end}");
    }
}
