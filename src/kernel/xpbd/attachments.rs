//! Long-range attachments: keep a particle no farther from a kinematic one than the cloth between them is long.
//!
//! Springs pass a pull on from edge to edge, a few edges per substep, so a hanging cloth stretches the more the finer it
//! is. The distance along the edges is a bound that every vertex knows by itself (Kim, Chentanez and Müller-Fischer
//! 2012, "Long Range Attachments").

use fearless_simd::{f32x8, prelude::*};

use super::rows::{Gathered, MovingRows, NOBODY, Places, Starts, gather, scatter_free, set_lane};
use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH};

/// How fast a particle comes back that begins a tick too far away, in longest distances per second. Faster, it would be
/// thrown: what it moves in a substep becomes its velocity. Springs bring it back faster than that where they can.
const RETURN_RATE: f32 = 10.0;

/// Eight attachments.
#[derive(Clone, Debug)]
struct Block {
    particles: Places,
    /// The kinematic particles.
    anchors: Places,
    /// From the anchor to the particle, at the beginning of the tick.
    start: VectorRows,
    longest: [f32; WIDTH],
    /// The distance at the beginning of the tick.
    first: [f32; WIDTH],
}

impl Block {
    const EMPTY: Self = Self {
        particles: [NOBODY; WIDTH],
        anchors: [NOBODY; WIDTH],
        start: VectorRows::ZERO,
        longest: [f32::INFINITY; WIDTH],
        first: [0.0; WIDTH],
    };
}

/// The attachments of all bodies in a tick.
#[derive(Debug, Default)]
pub struct Attachments {
    attached: Vec<([usize; 2], f64)>,
    blocks: Vec<Block>,
}

impl Attachments {
    pub fn clear(&mut self) {
        self.attached.clear();
    }

    /// Attaches particles to kinematic ones: a particle, its anchor, and the longest distance between them in world units.
    /// Every call names particles in ascending order. Another call may attach the same ones to another anchor.
    pub fn add(&mut self, attached: impl Iterator<Item = ([usize; 2], f64)>) {
        self.attached.extend(attached);
    }

    /// Begins a tick whose rows are in order.
    pub fn begin(&mut self, start: Starts<'_>) {
        let Self { attached, blocks } = self;
        blocks.clear();
        // No block has a particle twice: what is attached again comes after a higher one.
        let ascending = attached.chunk_by(|one, next| one.0[0] < next.0[0]);
        blocks.extend(ascending.flat_map(|attached| attached.chunks(WIDTH)).map(|attached| {
            let mut block = Block::EMPTY;
            for (lane, &([particle, anchor], longest)) in attached.iter().enumerate() {
                block.particles[lane] = start.row(particle);
                block.anchors[lane] = start.row(anchor);
                let offset = start.offset(anchor, particle);
                set_lane(&mut block.start, lane, offset);
                block.longest[lane] = longest as f32;
                block.first[lane] = offset.length() as f32;
            }
            block
        }));
    }

    /// Moves every particle that is too far away straight to the longest distance. One that began the tick too far away
    /// comes back to it gradually, and gets no farther. `passed` is the time since then, in seconds.
    pub fn solve(&self, rows: MovingRows<'_>, passed: f32) {
        dispatch!(simd => self.solve_in_lanes(simd, rows, passed));
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn solve_in_lanes<S: Simd>(&self, simd: S, rows: MovingRows<'_>, passed: f32) {
        for Block { particles, anchors, start, longest, first } in &self.blocks {
            let particle = gather(simd, &rows.displacement, particles);
            let anchor = gather(simd, &rows.displacement, anchors);
            let offset = VectorLanes::load(simd, start).plus(particle.vector - anchor.vector);
            let (squared, longest) = (offset.dot(offset), f32x8::from_slice(simd, longest));
            let longest = longest.max(f32x8::from_slice(simd, first) - longest * (RETURN_RATE * passed));
            let is_far = squared.simd_gt(longest * longest);
            if !is_far.any_true() {
                continue;
            }
            let excess = is_far.select(longest / squared.sqrt() - 1.0, f32x8::splat(simd, 0.0));
            let vector = particle.vector.plus(offset.scaled(excess));
            scatter_free(Gathered { vector, ..particle }, rows.displacement, particles);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::kernel::{
        simd::parallel::Sequential,
        xpbd::{ParticleRows, Placed},
    };

    #[test]
    fn particles_come_back_to_their_longest_distance_from_an_anchor_that_moves() {
        let mut rows = ParticleRows::default();
        // Eleven particles that fly apart, and an anchor that moves by one.
        let away = |number: usize| DVec3::new(0.3 * number as f64, 0.1, -0.2 * number as f64);
        let flying = (0..11).map(|number| Placed { way: DVec3::ZERO, velocity: away(number), inverse_mass: 3.0 });
        let anchor = Placed { way: DVec3::Y, velocity: DVec3::ZERO, inverse_mass: 0.0 };
        rows.begin(flying.chain([anchor]));
        let mut attachments = Attachments::default();
        let mut start = [DVec3::X; 12];
        start[11] = DVec3::ZERO;
        attachments.add((0..11).map(|number| ([number, 11], 1.5)));
        attachments.begin(rows.starts(&start));
        rows.predict(&Sequential, 1.0, Vec3::ZERO, 1.0);
        attachments.solve(rows.moving(), 1.0);
        let mut held = 0;
        for number in 0..11 {
            let free = DVec3::X + away(number) - DVec3::Y;
            let is_far = free.length() > 1.5;
            let expected = if is_far { free * (1.5 / free.length()) } else { free };
            let found = DVec3::X + rows.state(number)[0] - rows.state(11)[0];
            assert!(found.distance(expected) < 1e-6, "{number}: {found} instead of {expected}");
            held += usize::from(is_far);
        }
        assert!(held > 3 && held < 11, "{held} were too far away");
        assert_eq!(rows.state(11)[0], DVec3::Y);
    }

    #[test]
    fn particles_that_are_attached_to_two_anchors_are_held_by_both() {
        let mut rows = ParticleRows::default();
        let placed = |inverse_mass| Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass };
        rows.begin([1.0, 1.0, 1.0, 0.0, 0.0].map(placed).into_iter());
        // Each within 2 m of two anchors that are 3 m apart, and 1 m too far from one of them.
        let start = [DVec3::X * 3.0, DVec3::ZERO, DVec3::X * 2.0, DVec3::ZERO, DVec3::X * 3.0];
        let mut attachments = Attachments::default();
        for anchor in [3, 4] {
            attachments.add((0..3).map(|number| ([number, anchor], 2.0)));
        }
        attachments.begin(rows.starts(&start));
        attachments.solve(rows.moving(), 1.0);
        for (number, expected) in [2.0, 1.0, 2.0].into_iter().enumerate() {
            let found = start[number] + rows.state(number)[0];
            assert!(found.distance(DVec3::X * expected) < 1e-6, "{number}: {found}");
        }
    }

    #[test]
    fn a_particle_that_begins_too_far_away_comes_back_gradually() {
        // At rest, 3 m from an anchor that holds it within 2 m; and driven away.
        for (velocity, passed, expected) in
            [(DVec3::ZERO, 0.0, 3.0), (DVec3::ZERO, 0.01, 2.8), (DVec3::ZERO, 0.07, 2.0), (DVec3::X, 0.01, 2.8)]
        {
            let mut rows = ParticleRows::default();
            let particle = Placed { way: DVec3::ZERO, velocity, inverse_mass: 1.0 };
            rows.begin([particle, Placed { velocity: DVec3::ZERO, inverse_mass: 0.0, ..particle }].into_iter());
            let start = [DVec3::new(4.0, 1.0, 0.0), DVec3::new(1.0, 1.0, 0.0)];
            let mut attachments = Attachments::default();
            attachments.add([([0, 1], 2.0)].into_iter());
            attachments.begin(rows.starts(&start));
            rows.predict(&Sequential, 1.0, Vec3::ZERO, 1.0);
            attachments.solve(rows.moving(), passed);
            let distance = (start[0] + rows.state(0)[0]).distance(start[1]);
            assert!((distance - expected).abs() < 1e-6, "{velocity} after {passed} s: {distance}");
        }
    }
}
