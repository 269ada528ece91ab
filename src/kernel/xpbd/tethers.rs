//! Tethers: keep a particle within a distance of a place that moves, and in front of a plane through it.

use arrayvec::ArrayVec;
use glam::{DVec3, Vec3};

use super::{
    rows::{MovingRows, NOBODY, Rows, Starts},
    slabs::MOST_SLABS,
};
use crate::kernel::simd::parallel::{Team, share};

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
    particle: u32,
    /// Known once the rows of a tick are in order.
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
    /// Ordered by rows.
    tethers: Vec<Tether>,
    /// The end of the tethers of each slab.
    ends: ArrayVec<usize, MOST_SLABS>,
}

impl Tethers {
    pub fn clear(&mut self) {
        self.tethers.clear();
    }

    /// Adds the tether of a particle that begins at `start`.
    pub fn push(&mut self, tethered: &Tethered, start: DVec3) {
        let &Tethered { particle, places: [from, to], normals, longest, backstop } = tethered;
        self.tethers.push(Tether {
            particle,
            row: NOBODY,
            target: (from - start).as_vec3(),
            way: (to - from).as_vec3(),
            normals: normals.map(DVec3::as_vec3),
            longest: longest as f32,
            backstop: backstop as f32,
        });
    }

    /// Begins a tick whose rows are in order.
    pub fn begin(&mut self, start: Starts<'_>) {
        let Self { tethers, ends } = self;
        tethers.iter_mut().for_each(|tether| tether.row = start.row(tether.particle as usize));
        // Those of one particle stay in their order.
        tethers.sort_by_key(|tether| tether.row);
        ends.clear();
        ends.extend(start.ends().iter().map(|&end| tethers.partition_point(|tether| tether.row < end as u32)));
    }

    /// Moves every tethered particle to the nearest place that its tether allows: in front of the plane, and then within
    /// the longest distance. `passed` is the share of the tick that has passed.
    pub fn solve(&self, team: &dyn Team, rows: MovingRows<'_>, passed: f32) {
        let mut first = 0;
        let slabs = self.ends.iter().map(|&end| {
            let own = first..end;
            first = end;
            &self.tethers[own]
        });
        let mut slabs: ArrayVec<&[Tether], MOST_SLABS> = slabs.collect();
        share(team, &mut slabs, |tethers| tethers.iter().for_each(|tether| tether.solve(rows, passed)));
    }
}

impl Tether {
    fn solve(&self, rows: MovingRows<'_>, passed: f32) {
        let &Self { row, target, way, normals: [first, last], longest, backstop, .. } = self;
        let now = rows.displacement.row(row);
        if now.0[3] <= 0.0 {
            return;
        }
        let target = target + way * passed;
        let mut offset = now.vector() - target;
        let before = offset;
        let normal = first.lerp(last, passed).normalize_or_zero();
        let behind = -normal.dot(offset) - backstop;
        if behind > 0.0 && normal != Vec3::ZERO {
            offset += normal * behind;
        }
        offset = offset.clamp_length_max(longest);
        if offset != before {
            rows.displacement.replace(row, target + offset);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{
        simd::parallel::Sequential,
        xpbd::{ParticleRows, Placed},
    };

    /// Where a particle is after its tether has been solved at the end of the tick.
    fn held(displacement: DVec3, tethered: Tethered) -> DVec3 {
        let mut rows = ParticleRows::default();
        let placed = Placed { way: DVec3::ZERO, velocity: displacement, inverse_mass: 2.0 };
        rows.begin([placed].into_iter());
        rows.predict(&Sequential, 1.0, Vec3::ZERO, 1.0);
        let mut tethers = Tethers::default();
        tethers.push(&tethered, DVec3::ZERO);
        tethers.begin(rows.starts(&[]));
        tethers.solve(&Sequential, rows.moving(), 1.0);
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
