//! Tethers: keep a particle within a distance of a place that moves, and in front of a plane through it.

use std::iter::zip;

use arrayvec::ArrayVec;
use fearless_simd::{f32x8, prelude::*};
use glam::DVec3;

use super::{
    rows::{Gathered, MovingRows, NOBODY, Places, Starts, gather, scatter_free, set_lane},
    slabs::MOST_SLABS,
};
use crate::kernel::simd::{
    lanes::{VectorLanes, VectorRows, WIDTH},
    parallel::{Team, share},
};

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

/// Eight tethers in f32, of particles that are all different, relative to where these begin.
#[derive(Clone, Debug)]
struct Block {
    particles: Places,
    target: VectorRows,
    way: VectorRows,
    normals: [VectorRows; 2],
    longest: [f32; WIDTH],
    backstop: [f32; WIDTH],
}

impl Block {
    const EMPTY: Self = Self {
        particles: [NOBODY; WIDTH],
        target: VectorRows::ZERO,
        way: VectorRows::ZERO,
        normals: [VectorRows::ZERO; 2],
        longest: [f32::INFINITY; WIDTH],
        backstop: [f32::INFINITY; WIDTH],
    };

    fn set(&mut self, lane: usize, tethered: &Tethered, start: Starts<'_>) {
        let &Tethered { particle, places: [from, to], normals, longest, backstop } = tethered;
        let particle = particle as usize;
        self.particles[lane] = start.row(particle);
        set_lane(&mut self.target, lane, from - start.position(particle));
        set_lane(&mut self.way, lane, to - from);
        for (rows, normal) in zip(&mut self.normals, normals) {
            set_lane(rows, lane, normal);
        }
        (self.longest[lane], self.backstop[lane]) = (longest as f32, backstop as f32);
    }
}

/// The tethers of all bodies in a tick.
#[derive(Debug, Default)]
pub struct Tethers {
    tethered: Vec<Tethered>,
    /// The row of each, and its number. Only used while a tick begins.
    order: Vec<(u32, u32)>,
    blocks: Vec<Block>,
    /// The end of the blocks of each slab.
    ends: ArrayVec<usize, MOST_SLABS>,
}

impl Tethers {
    pub fn clear(&mut self) {
        self.tethered.clear();
    }

    /// Adds a tether.
    pub fn push(&mut self, tethered: Tethered) {
        self.tethered.push(tethered);
    }

    /// Begins a tick whose rows are in order.
    pub fn begin(&mut self, start: Starts<'_>) {
        let Self { tethered, order, blocks, ends } = self;
        order.clear();
        order.extend(zip(&*tethered, 0..).map(|(tether, number)| (start.row(tether.particle as usize), number)));
        // Those of one particle stay in their order, and follow one another.
        order.sort_unstable();
        blocks.clear();
        ends.clear();
        let mut rest = &order[..];
        for &end in start.ends() {
            let (own, others) = rest.split_at(rest.partition_point(|&(row, _)| (row as usize) < end));
            rest = others;
            let (mut lane, mut last) = (WIDTH, NOBODY);
            for &(row, number) in own {
                if lane == WIDTH || row == last {
                    blocks.push(Block::EMPTY);
                    lane = 0;
                }
                if let Some(block) = blocks.last_mut() {
                    block.set(lane, &tethered[number as usize], start);
                }
                (lane, last) = (lane + 1, row);
            }
            ends.push(blocks.len());
        }
    }

    /// Moves every tethered particle to the nearest place that its tether allows: in front of the plane, and then within
    /// the longest distance. `passed` is the share of the tick that has passed.
    pub fn solve(&self, team: &dyn Team, rows: MovingRows<'_>, passed: f32) {
        if self.blocks.is_empty() {
            return;
        }
        let mut first = 0;
        let slabs = self.ends.iter().map(|&end| {
            let own = first..end;
            first = end;
            &self.blocks[own]
        });
        let mut slabs: ArrayVec<&[Block], MOST_SLABS> = slabs.collect();
        share(team, &mut slabs, |blocks| {
            let blocks = *blocks;
            dispatch!(simd => {
                for block in blocks {
                    block.solve(simd, rows, passed);
                }
            });
        });
    }
}

impl Block {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn solve<S: Simd>(&self, simd: S, rows: MovingRows<'_>, passed: f32) {
        let zero = f32x8::splat(simd, 0.0);
        let particles = gather(simd, &rows.displacement, &self.particles);
        let passed = f32x8::splat(simd, passed);
        let target = VectorLanes::load(simd, &self.target).plus(VectorLanes::load(simd, &self.way).scaled(passed));
        let offset = particles.vector - target;
        let [first, last] = [&self.normals[0], &self.normals[1]].map(|normals| VectorLanes::load(simd, normals));
        let normal = first.scaled(1.0 - passed).plus(last.scaled(passed));
        let squared = normal.dot(normal);
        let has_plane = squared.simd_gt(zero);
        let normal = normal.scaled(has_plane.select(1.0 / squared.sqrt(), zero));
        let behind = -normal.dot(offset) - f32x8::from_slice(simd, &self.backstop);
        let is_behind = behind.simd_gt(zero) & has_plane;
        let offset = offset.plus(normal.scaled(is_behind.select(behind, zero)));
        let (squared, longest) = (offset.dot(offset), f32x8::from_slice(simd, &self.longest));
        let is_far = squared.simd_gt(longest * longest);
        let changes = is_behind | is_far;
        if !changes.any_true() {
            return;
        }
        let offset = offset.scaled(is_far.select(longest / squared.sqrt(), f32x8::splat(simd, 1.0)));
        let vector = VectorLanes::select(changes, target.plus(offset), particles.vector);
        scatter_free(Gathered { vector, ..particles }, rows.displacement, &self.particles);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

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
        tethers.push(tethered);
        tethers.begin(rows.starts(&[DVec3::ZERO]));
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

    #[test]
    fn tethers_of_one_particle_are_solved_in_their_order_and_kinematic_ones_move_nothing() {
        let placed = |particle: u32| Placed {
            way: DVec3::ZERO,
            velocity: DVec3::ZERO,
            inverse_mass: if particle == 5 { 0.0 } else { 1.0 },
        };
        let at = |particle: u32| DVec3::Z * f64::from(particle);
        let positions: Vec<DVec3> = (0..20).map(at).collect();
        let mut rows = ParticleRows::default();
        rows.begin((0..20).map(placed));
        let (first, second) = (DVec3::new(1.0, 0.0, 0.5), DVec3::new(-2.0, 3.0, 0.0));
        let mut tethers = Tethers::default();
        for offset in [first, second] {
            for particle in (0..20).rev() {
                if offset == second && particle % 3 != 0 {
                    continue;
                }
                let places = [at(particle) + offset; 2];
                tethers.push(Tethered { particle, places, normals: [DVec3::ZERO; 2], longest: 0.0, backstop: 0.0 });
            }
        }
        tethers.begin(rows.starts(&positions));
        tethers.solve(&Sequential, rows.moving(), 1.0);
        for particle in 0..20_u32 {
            let last = if particle % 3 == 0 { second } else { first };
            let expected = if particle == 5 { DVec3::ZERO } else { last };
            assert_eq!(rows.state(particle as usize)[0], expected, "{particle}");
        }
    }
}
