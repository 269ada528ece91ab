//! Drag and lift of triangles in a wind.
//!
//! On a triangle of area `A` with the unit normal `n` turned toward the relative wind `v`, air of density `ρ` acts with
//! the force `½ρA [(C_D − C_L)(v·n) v + C_L |v|² n]` (Wilson et al. 2014, "Simulating Wind Effects on
//! Cloth and Hair in Disney's Frozen").

use fearless_simd::{f32x8, prelude::*};
use glam::Vec3;

use super::{
    coloring::{Rests, lanes_of},
    rows::{MovingRows, NOBODY, Places, Starts, gather, place_in_lane, scatter_free},
};
use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH};

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

/// The triangles of a body at rest, with their areas. Cloth that stretches catches no more wind.
pub type SailRests = Rests<3, f32>;

/// Eight triangles in a wind that have no particle in common.
#[derive(Debug)]
#[repr(C, align(32))]
struct SailBlock {
    corners: [Places; 3],
    /// From the first corner to the others at the beginning of the tick.
    edges: [VectorRows; 2],
    /// Twice the area at rest.
    most: [f32; WIDTH],
}

/// Triangles in a wind in a tick, of a body in one slab, or between slabs.
#[derive(Debug, Default)]
pub struct Sails {
    blocks: Vec<SailBlock>,
}

impl Sails {
    pub fn clear(&mut self) {
        self.blocks.clear();
    }

    /// Adds the triangles of a slab of a body whose particles begin with `first`, or those between slabs. `scale` is the world
    /// length of a unit in the body's own frame.
    pub fn add(&mut self, (rests, slab): (&SailRests, usize), first: usize, scale: f64, start: Starts<'_>) {
        self.blocks.extend(rests.part(slab).iter().map(|numbers| {
            let (corners, edges) = ([[NOBODY; WIDTH]; 3], [VectorRows::ZERO; 2]);
            let mut block = SailBlock { corners, edges, most: [0.0; WIDTH] };
            for (lane, triangle) in lanes_of(numbers) {
                let corners = rests.particles[triangle].map(|corner| first + corner as usize);
                place_in_lane(lane, (&mut block.corners, &mut block.edges), corners, start);
                block.most[lane] = 2.0 * rests.values[triangle] * (scale * scale) as f32;
            }
            block
        }));
    }

    /// Changes velocities by the force of the wind over a substep of `step` seconds. No triangle is faster relative to the air
    /// afterwards than before: drag takes it at most along, and lift turns its way, where the force at the beginning of a
    /// long step would add speed.
    pub fn blow(&self, rows: MovingRows<'_>, air: Air, step: f32) {
        dispatch!(simd => {
            for block in &self.blocks {
                block.blow(simd, rows, air, step);
            }
        });
    }
}

impl SailBlock {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn blow<S: Simd>(&self, simd: S, rows: MovingRows<'_>, air: Air, step: f32) {
        let Air { velocity, density, coefficients: [drag, lift] } = air;
        let zero = f32x8::splat(simd, 0.0);
        let [a, b, c] = self.corners.each_ref();
        let origin = gather(simd, &rows.displacement, a).vector;
        let moved = |places: &Places| gather(simd, &rows.displacement, places).vector - origin;
        let along = VectorLanes::load(simd, &self.edges[0]).plus(moved(b));
        let across = VectorLanes::load(simd, &self.edges[1]).plus(moved(c));
        let twice = along.cross(across);
        let length = twice.dot(twice).sqrt();
        let corners =
            [gather(simd, &rows.velocity, a), gather(simd, &rows.velocity, b), gather(simd, &rows.velocity, c)];
        let third = f32x8::splat(simd, 1.0 / 3.0);
        let speed = corners[0].vector.plus(corners[1].vector).plus(corners[2].vector).scaled(third);
        // A third acts on each corner.
        let mobility = (corners[0].inverse_mass + corners[1].inverse_mass + corners[2].inverse_mass) * third;
        let wind = VectorLanes::splat(simd, velocity) - speed;
        let squared = wind.dot(wind);
        let acts = length.simd_gt(zero) & squared.simd_gt(zero) & mobility.simd_gt(zero);
        let facing = twice.dot(wind) / length;
        let normal = twice.scaled(f32x8::splat(simd, 1.0) / facing.simd_lt(zero).select(-length, length));
        let force = wind.scaled(facing.abs() * (drag - lift)).plus(normal.scaled(squared * lift));
        let most = f32x8::from_slice(simd, &self.most);
        let change = force.scaled(length.min(most) * mobility * (density * step / 12.0));
        let ahead = change.dot(wind);
        let change = change.scaled(ahead.simd_gt(squared).select(squared / ahead, f32x8::splat(simd, 1.0)));
        let after = wind - change;
        let after_squared = after.dot(after);
        let slowed = wind - after.scaled((squared / after_squared).sqrt());
        let change = VectorLanes::select(after_squared.simd_gt(squared), slowed, change);
        let none = VectorLanes { x: zero, y: zero, z: zero };
        let push = VectorLanes::select(acts, change.scaled(f32x8::splat(simd, 1.0) / mobility), none);
        for (corner, places) in corners.into_iter().zip([a, b, c]) {
            scatter_free(corner.pushed(push), rows.velocity, places);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::kernel::xpbd::{ParticleRows, Placed, Slabs};

    /// The velocity change of a triangle of area 2 and mass 3 after one substep, with the wind's velocity.
    fn change(velocity: Vec3, coefficients: [f32; 2], step: f32) -> DVec3 {
        let start = [DVec3::ZERO, DVec3::X * 2.0, DVec3::Z * 2.0];
        let mut rows = ParticleRows::default();
        let still = Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: 1.0 };
        rows.begin([still; 3].into_iter());
        let rests = SailRests::new(3, &Slabs::default(), [([0, 1, 2], 2.0)].into_iter());
        let mut sails = Sails::default();
        sails.add((&rests, 0), 0, 1.0, rows.starts(&start));
        sails.blow(rows.moving(), Air { velocity, density: 1.2, coefficients }, step);
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
