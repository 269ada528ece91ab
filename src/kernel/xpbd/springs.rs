//! Stretch constraints: the distance of two particles.

use fearless_simd::{f32x8, prelude::*};

use super::{
    coloring::{Rests, in_order, lanes_of},
    rows::{MovingRows, NOBODY, Places, Starts, gather, scatter_free, set_lane},
};
use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH};

/// Highest rate at which an edge recovers its rest length, in rest lengths per second. A stiff edge would recover
/// within one substep, and an edge stretched to several lengths would be thrown about faster than contacts can follow.
const RECOVERY: f32 = 100.0;

/// The springs of a body at rest: the particles at their ends, and their lengths.
pub type SpringRests = Rests<2>;

/// Eight springs that have no particle in common.
#[derive(Debug)]
#[repr(C, align(32))]
struct SpringBlock {
    ends: [Places; 2],
    /// From the second end to the first at the beginning of the tick.
    start: VectorRows,
    length: [f32; WIDTH],
    multiplier: [f32; WIDTH],
}

/// Springs in a tick, of a body in one slab, or between slabs.
#[derive(Debug, Default)]
pub struct Springs {
    blocks: Vec<SpringBlock>,
}

impl Springs {
    pub fn clear(&mut self) {
        self.blocks.clear();
    }

    /// Adds the springs of a slab of a body whose particles begin with `first`, or those between slabs. `scale` is the
    /// world length of a unit of the rest lengths.
    pub fn add(&mut self, (rests, slab): (&SpringRests, usize), first: usize, scale: f64, start: Starts<'_>) {
        self.blocks.extend(rests.part(slab).iter().map(|numbers| {
            let mut block = SpringBlock {
                ends: [[NOBODY; WIDTH]; 2],
                start: VectorRows::ZERO,
                length: [0.0; WIDTH],
                multiplier: [0.0; WIDTH],
            };
            for (lane, spring) in lanes_of(numbers) {
                let [a, b] = rests.particles[spring].map(|end| first + end as usize);
                (block.ends[0][lane], block.ends[1][lane]) = (start.row(a), start.row(b));
                set_lane(&mut block.start, lane, start.offset(b, a));
                block.length[lane] = (rests.values[spring] * scale) as f32;
            }
            block
        }));
    }

    /// Forgets the Lagrange multipliers of the last substep.
    pub fn begin_step(&mut self) {
        self.blocks.iter_mut().for_each(|block| block.multiplier = [0.0; WIDTH]);
    }

    /// Moves both ends of every spring toward its rest length, color after color, in order or backward. `compliance` is scaled to the substep (`α / h²`), and `step` is its duration in seconds. The error that existed
    /// at the beginning of the substep is removed at [`RECOVERY`].
    pub fn solve(&mut self, rows: MovingRows<'_>, compliance: f32, step: f32, is_backward: bool) {
        let blocks = &mut self.blocks;
        dispatch!(simd => {
            for place in in_order(blocks.len(), is_backward) {
                blocks[place].solve(simd, rows, compliance, step);
            }
        });
    }

    /// Removes a share of the relative velocity along the springs. Momentum is preserved.
    pub fn damp(&self, rows: MovingRows<'_>, share: f32) {
        let blocks = &self.blocks;
        dispatch!(simd => {
            for block in blocks {
                block.damp(simd, rows, share);
            }
        });
    }
}

impl SpringBlock {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn solve<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>, compliance: f32, step: f32) {
        let zero = f32x8::splat(simd, 0.0);
        let MovingRows { displacement, previous, .. } = rows;
        let [a, b] = [gather(simd, &displacement, &self.ends[0]), gather(simd, &displacement, &self.ends[1])];
        let start = VectorLanes::load(simd, &self.start);
        let rest = f32x8::from_slice(simd, &self.length);
        let multiplier = f32x8::from_slice(simd, &self.multiplier);
        let between = start.plus(a.vector - b.vector);
        let length = between.dot(between).sqrt();
        let weight = a.inverse_mass + b.inverse_mass;
        // Coincident ends have no direction to separate in. Another constraint will move them.
        let is_solved = length.simd_gt(zero) & weight.simd_gt(zero);
        let missing = rest - length;
        let mut change = (missing - multiplier * compliance) / (weight + compliance);
        let pace = rest * (RECOVERY * step);
        let is_far = missing.abs().simd_gt(pace) & is_solved;
        if is_far.any_true() {
            let [before_a, before_b] = [gather(simd, previous, &self.ends[0]), gather(simd, previous, &self.ends[1])];
            let before = start.plus(before_a.vector - before_b.vector);
            let before = rest - before.dot(before).sqrt();
            let is_old = (before * missing).simd_gt(zero);
            let left = is_old.select((before.abs() - pace).max(zero), zero);
            let most = (missing.abs() - left).max(zero) / weight;
            change = is_far.select(change.min(most).max(-most), change);
        }
        let change = is_solved.select(change, zero);
        (multiplier + change).store_slice(&mut self.multiplier);
        let push = between.scaled(is_solved.select(change / length, zero));
        scatter_free(a.pushed(push), displacement, &self.ends[0]);
        scatter_free(b.pushed(push.negated()), displacement, &self.ends[1]);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn damp<S: Simd>(&self, simd: S, rows: MovingRows<'_>, share: f32) {
        let zero = f32x8::splat(simd, 0.0);
        let MovingRows { displacement, velocity, .. } = rows;
        let [a, b] = [gather(simd, &displacement, &self.ends[0]), gather(simd, &displacement, &self.ends[1])];
        let between = VectorLanes::load(simd, &self.start).plus(a.vector - b.vector);
        let [a, b] = [gather(simd, &velocity, &self.ends[0]), gather(simd, &velocity, &self.ends[1])];
        let squared = between.dot(between);
        let divisor = squared * (a.inverse_mass + b.inverse_mass);
        let opening = between.dot(a.vector - b.vector);
        let change = divisor.simd_gt(zero).select(opening * -share / divisor, zero);
        let push = between.scaled(change);
        scatter_free(a.pushed(push), velocity, &self.ends[0]);
        scatter_free(b.pushed(push.negated()), velocity, &self.ends[1]);
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::kernel::{
        simd::parallel::Sequential,
        xpbd::{ParticleRows, Placed, slabs::Slabs},
    };

    #[test]
    fn a_spring_makes_up_for_its_step_at_once_and_for_what_was_before_at_a_pace() {
        let (step, length) = (1.0 / 1200.0, 0.1);
        let after = |before: f64, added: f64| {
            let mut particles = ParticleRows::default();
            let placed =
                |speed: f64, inverse_mass| Placed { way: DVec3::ZERO, velocity: DVec3::X * speed, inverse_mass };
            particles.begin([placed(0.0, 1.0), placed(added / step, 3.0)].into_iter());
            particles.predict(&Sequential, step as f32, glam::Vec3::ZERO, 1.0);
            let start = [DVec3::ZERO, DVec3::X * before];
            let mut springs = Springs::default();
            let mut slabs = Slabs::default();
            slabs.split(&start);
            let rests = SpringRests::new(2, &slabs, [([0, 1], length)].into_iter());
            springs.add((&rests, 0), 0, 1.0, particles.starts(&start));
            // Only one way: on the way back, nothing is missing, or the pace has been used up.
            springs.solve(particles.moving(), 0.0, step as f32, false);
            let [a, b] = [0, 1].map(|particle| start[particle] + particles.state(particle)[0]);
            // The center of mass stays in place, with masses of 1 and 1/3.
            let expected = (start[1] + DVec3::X * added) / 3.0;
            assert!((a + b / 3.0 - expected).length() < 1e-7, "{a} {b}");
            a.distance(b)
        };
        // 100 rest lengths per second.
        let pace = 100.0 * step * length;
        let cases = [
            // Length before the substep, change in the substep, length after the solve.
            (0.1, 0.05, 0.1),
            (0.1, -0.05, 0.1),
            (0.105, 0.0, 0.1),
            (0.4, 0.0, 0.4 - pace),
            (0.4, 0.2, 0.4 - pace),
            (0.02, 0.0, 0.02 + pace),
            (0.4, -0.35, 0.1),
            (0.4, -0.1, 0.3),
        ];
        for (before, added, expected) in cases {
            let left = after(before, added);
            assert!((left - expected).abs() < 1e-7, "{before} {added}: {left} instead of {expected}");
        }
    }
}
