//! Puts constraints into blocks whose constraints have no particle in common.
//!
//! Greedy: constraints are taken in their order, and each gets the first color that none of its particles has. That
//! takes one word per particle. Crates that color graphs want the graph of all conflicts, which is ten times larger than
//! the mesh, and allocate.

use super::slabs::Slabs;
use crate::kernel::simd::lanes::WIDTH;

/// Stands for no constraint in a block, and for no particle in a constraint.
pub const NONE: u32 = u32::MAX;

/// The constraints of a block, by their numbers; [`NONE`] where there are fewer.
pub type Block = [u32; WIDTH];

/// The lanes of a block that have a constraint, with its number.
pub(super) fn lanes_of(block: &Block) -> impl Iterator<Item = (usize, usize)> {
    let lanes = block.iter().enumerate().filter(|&(_, &constraint)| constraint != NONE);
    lanes.map(|(lane, &constraint)| (lane, constraint as usize))
}

/// The places of a list, from the first to the last or backward.
pub fn in_order(count: usize, is_backward: bool) -> impl Iterator<Item = usize> {
    (0..count).map(move |place| if is_backward { count - 1 - place } else { place })
}

/// The internal constraints of one kind of a body at rest, colored.
#[derive(Clone, Debug, Default)]
pub struct Rests<const N: usize, V = f64> {
    /// The particles of each, as numbers within the body.
    pub(super) particles: Vec<[u32; N]>,
    /// The value of each at rest.
    pub(super) values: Vec<V>,
    pub(super) blocks: Vec<Block>,
    /// The end of the blocks of each slab, and of those between slabs.
    ends: Vec<usize>,
}

impl<const N: usize, V> Rests<N, V> {
    /// Constraints on the given particles, out of `count`, with their values at rest.
    #[must_use]
    pub fn new(count: usize, slabs: &Slabs, constraints: impl Iterator<Item = ([u32; N], V)>) -> Self {
        let mut constraints: Vec<([u32; N], V)> = constraints.collect();
        let slab_of = |(particles, _): &([u32; N], V)| slabs.common(particles.iter().copied());
        constraints.sort_by_key(slab_of);
        let (mut blocks, mut ends, mut coloring) = (Vec::new(), Vec::new(), Coloring::default());
        for slab in 0..=slabs.count() {
            let [first, end] =
                [slab, slab + 1].map(|slab| constraints.partition_point(|constraint| slab_of(constraint) < slab));
            let particles_of = |place: u32| constraints[first + place as usize].0;
            let before = blocks.len();
            coloring.blocks(count, end - first, particles_of, &mut blocks);
            let own = blocks[before..].as_flattened_mut().iter_mut();
            own.filter(|number| **number != NONE).for_each(|number| *number += first as u32);
            ends.push(blocks.len());
        }
        let (particles, values) = constraints.into_iter().unzip();
        Self { particles, values, blocks, ends }
    }

    /// The blocks in a slab, or between slabs, which is the last.
    pub(super) fn part(&self, part: usize) -> &[Block] {
        let first = if part > 0 { self.ends[part - 1] } else { 0 };
        &self.blocks[first..self.ends[part]]
    }
}

/// The colors given out at a time. Constraints that get none of them are colored afterwards, with new colors.
const COLORS: usize = u64::BITS as usize;

/// Colors constraints. It keeps its memory.
#[derive(Debug, Default)]
pub struct Coloring {
    /// The colors of each particle, one bit each. All 0 between calls.
    used: Vec<u64>,
    /// The constraints of each color.
    colors: Vec<Vec<u32>>,
    waiting: Vec<u32>,
    refused: Vec<u32>,
}

impl Coloring {
    /// Appends the blocks of `count` constraints, given the particles of each. Particles are numbered from 0 to
    /// `particles`; [`NONE`] and particles that no constraint moves are left out.
    pub fn blocks<const N: usize>(
        &mut self,
        particles: usize,
        count: usize,
        particles_of: impl Fn(u32) -> [u32; N],
        blocks: &mut Vec<Block>,
    ) {
        let Self { used, colors, waiting, refused } = self;
        used.resize(used.len().max(particles), 0);
        colors.resize_with(COLORS, Vec::new);
        waiting.clear();
        waiting.extend(0..count as u32);
        while !waiting.is_empty() {
            refused.clear();
            for &constraint in &*waiting {
                let places = particles_of(constraint);
                let taken =
                    places.iter().filter(|&&place| place != NONE).fold(0, |all, &place| all | used[place as usize]);
                let color = taken.trailing_ones() as usize;
                if color == COLORS {
                    refused.push(constraint);
                    continue;
                }
                for place in places.into_iter().filter(|&place| place != NONE) {
                    used[place as usize] |= 1 << color;
                }
                colors[color].push(constraint);
            }
            for &constraint in &*waiting {
                for place in particles_of(constraint).into_iter().filter(|&place| place != NONE) {
                    used[place as usize] = 0;
                }
            }
            for color in &mut *colors {
                blocks.extend(color.chunks(WIDTH).map(|constraints| {
                    let mut block = [NONE; WIDTH];
                    block[..constraints.len()].copy_from_slice(constraints);
                    block
                }));
                color.clear();
            }
            std::mem::swap(waiting, refused);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use circumsphere_support::random::Random;

    use super::*;

    #[test]
    fn every_constraint_is_in_one_block_and_no_block_has_a_particle_twice() {
        let mut random = Random::new(7);
        let mut coloring = Coloring::default();
        // A star, whose middle has more constraints than there are colors, a chain, and random ones.
        let star: Vec<[u32; 2]> = (1..200).map(|other| [0, other]).collect();
        let chain: Vec<[u32; 2]> = (0..199).map(|place| [place, place + 1]).collect();
        let mut number = || random.unit().to_bits() as u32 % 100;
        let wild: Vec<[u32; 2]> = (0..500).map(|_| [number(), number()]).filter(|[a, b]| a != b).collect();
        for constraints in [star, chain, wild] {
            let mut blocks = Vec::new();
            coloring.blocks(200, constraints.len(), |place| constraints[place as usize], &mut blocks);
            let mut seen = BTreeSet::new();
            for block in &blocks {
                let mut particles = BTreeSet::new();
                for &constraint in block.iter().filter(|&&constraint| constraint != NONE) {
                    assert!(seen.insert(constraint));
                    for particle in constraints[constraint as usize] {
                        assert!(particles.insert(particle), "{particle} twice in a block");
                    }
                }
            }
            assert_eq!(seen.len(), constraints.len());
            // Nothing is left of one call in the next.
            let mut again = Vec::new();
            coloring.blocks(200, constraints.len(), |place| constraints[place as usize], &mut again);
            assert_eq!(blocks, again);
        }
    }

    #[test]
    fn what_has_no_particle_to_move_needs_no_color_of_its_own() {
        let mut blocks = Vec::new();
        Coloring::default().blocks(1, 8, |place| [if place == 0 { 0 } else { NONE }], &mut blocks);
        assert_eq!(blocks, [[0, 1, 2, 3, 4, 5, 6, 7]]);
    }
}
