//! Tethers: keep a particle within a distance of a place that moves, and in front of a plane through it.

use glam::{DVec3, Vec3};

use super::rows::{ParticleRows, row_of};

/// A tether in a tick. Vectors are in world units.
#[derive(Clone, Copy, Debug)]
pub struct Tethered {
    /// The particle.
    pub particle: u32,
    /// Where the target is at the beginning and at the end of the tick.
    pub places: [DVec3; 2],
    /// Unit vectors away from what is behind the target, at the beginning and at the end of the tick. Zero if there is
    /// nothing behind.
    pub normals: [DVec3; 2],
    /// Longest distance from the target, 0 or more; may be infinite.
    pub longest: f64,
    /// Longest distance behind the target; may be negative or infinite.
    pub backstop: f64,
}

/// The same in f32, and relative to where the particle begins.
#[derive(Clone, Copy, Debug)]
struct Tether {
    row: u32,
    target: Vec3,
    way: Vec3,
    normals: [Vec3; 2],
    longest: f32,
    backstop: f32,
}

/// The tethers of all bodies in a tick.
#[derive(Debug, Default)]
pub struct Tethers {
    tethers: Vec<Tether>,
}

impl Tethers {
    pub fn clear(&mut self) {
        self.tethers.clear();
    }

    /// Adds the tether of a particle that begins at `start`.
    pub fn push(&mut self, tethered: &Tethered, start: DVec3) {
        let &Tethered { particle, places: [from, to], normals, longest, backstop } = tethered;
        self.tethers.push(Tether {
            row: row_of(particle as usize),
            target: (from - start).as_vec3(),
            way: (to - from).as_vec3(),
            normals: normals.map(DVec3::as_vec3),
            longest: longest as f32,
            backstop: backstop as f32,
        });
    }

    /// Moves every tethered particle to the nearest place that its tether allows: in front of the plane, and then within
    /// the longest distance. `share` is the share of the tick that has passed.
    pub fn solve(&self, particles: &mut ParticleRows, share: f32) {
        for &Tether { row, target, way, normals: [first, last], longest, backstop } in &self.tethers {
            let row = &mut particles.displacement[row as usize];
            if row.0[3] <= 0.0 {
                continue;
            }
            let target = target + way * share;
            let mut offset = row.vector() - target;
            let before = offset;
            let normal = first.lerp(last, share).normalize_or_zero();
            let behind = -normal.dot(offset) - backstop;
            if behind > 0.0 && normal != Vec3::ZERO {
                offset += normal * behind;
            }
            offset = offset.clamp_length_max(longest);
            if offset != before {
                row.set(target + offset);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::xpbd::Placed;

    /// Where a particle is after its tether has been solved at the end of the tick.
    fn held(displacement: DVec3, tethered: Tethered) -> DVec3 {
        let mut rows = ParticleRows::default();
        let placed = Placed { way: DVec3::ZERO, velocity: displacement, inverse_mass: 2.0 };
        rows.begin([placed].into_iter());
        rows.predict(1.0, Vec3::ZERO, 1.0);
        let mut tethers = Tethers::default();
        tethers.push(&tethered, DVec3::ZERO);
        tethers.solve(&mut rows, 1.0);
        rows.state(0)[0]
    }

    #[test]
    fn a_particle_is_within_its_distance_and_in_front_of_its_backstop() {
        let tethered = Tethered {
            particle: 0,
            places: [DVec3::X, DVec3::X + DVec3::Y],
            normals: [DVec3::Z, DVec3::Z],
            longest: 0.5,
            backstop: 0.1,
        };
        let target = DVec3::new(1.0, 1.0, 0.0);
        let cases = [
            // Offset from the target, and what is left of it.
            (DVec3::new(0.2, 0.1, 0.3), DVec3::new(0.2, 0.1, 0.3)),
            (DVec3::new(0.0, 0.0, 2.0), DVec3::new(0.0, 0.0, 0.5)),
            (DVec3::new(3.0, 4.0, 0.0), DVec3::new(0.3, 0.4, 0.0)),
            (DVec3::new(0.2, 0.0, -0.4), DVec3::new(0.2, 0.0, -0.1)),
        ];
        for (offset, expected) in cases {
            let found = held(target + offset, tethered) - target;
            assert!(found.distance(expected) < 1e-6, "{offset}: {found}");
        }
        let free = Tethered { longest: f64::INFINITY, normals: [DVec3::ZERO; 2], ..tethered };
        assert!(held(DVec3::splat(9.0), free).distance(DVec3::splat(9.0)) < 1e-6);
    }
}
