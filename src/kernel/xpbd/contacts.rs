//! Contact constraints: keep the contact distance, with friction along the surface.
//!
//! A contact names the features that were close when the tick began. In every substep they are evaluated at their
//! current positions, on the side where they were, which gives a constraint `C = n·(Σ a p − Σ b p) − d ≥ 0` with a
//! Lagrange multiplier of at least 0. Friction is a constraint of its own with a bounded multiplier. It sticks up to
//! the static share of the normal multiplier and slides with the dynamic share (Macklin et al. 2014, "Unified Particle
//! Physics"), without a jump in between.

mod blocks;

use std::ops::Range;

use fearless_simd::prelude::*;
use glam::DVec3;

pub(super) use self::blocks::{FeatureBlock, PlaneBlock};
use super::{
    acting::{ActingBlock, Common, Evaluation, SlidingBlock},
    coloring::{Block, Coloring, NONE, in_order, lanes_of},
    rows::{MovingRows, Starts},
};
use crate::kernel::simd::lanes::WIDTH;

/// A contact that the solver watches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact<P> {
    /// What it is between.
    pub parts: P,
    /// Unit vector from the second side to the first at the beginning of the tick.
    pub normal: DVec3,
    /// The contact distance to keep, in world units.
    pub distance: f64,
    /// Static and dynamic friction coefficients.
    pub friction: [f64; 2],
    /// The caller's number, if it asks for the impulse of the contact; [`NONE`] otherwise.
    pub reaction: u32,
    /// Whether it leads back through something, at a pace of its own.
    pub recovers: bool,
}

/// The particles of a feature pair.
pub type FeatureParticles = [u32; 4];

/// Free particles with signed weights, and one normal for the whole tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane<const N: usize> {
    /// The particles; [`NONE`] where there are fewer.
    pub particles: [u32; N],
    /// Their weights.
    pub weights: [f64; N],
    /// How far the kinematic particles move in the tick: the sum, with their weights.
    pub drive: DVec3,
    /// Separation along the normal at the beginning of the tick.
    pub separation: f64,
}

impl<P> Contact<P> {
    /// The same between something else.
    pub(crate) const fn between<Q>(&self, parts: Q) -> Contact<Q> {
        let &Self { normal, distance, friction, reaction, recovers, .. } = self;
        Contact { parts, normal, distance, friction, reaction, recovers }
    }
}

impl Contact<Plane<6>> {
    /// The same with fewer particles, if that is all it has.
    pub(super) fn narrowed<const N: usize>(&self) -> Option<Contact<Plane<N>>> {
        let Plane { particles, weights, drive, separation } = &self.parts;
        let (particles, rest) = particles.split_first_chunk()?;
        let (weights, _) = weights.split_first_chunk()?;
        let parts = Plane { particles: *particles, weights: *weights, drive: *drive, separation: *separation };
        rest.iter().all(|&particle| particle == NONE).then(|| self.between(parts))
    }
}

/// What is between the sides of eight contacts that have no particle in common, of up to `N` particles each. What all kinds
/// of contacts know is passed beside it.
pub(super) trait ContactBlock<const N: usize>: Sized {
    /// What a contact is between.
    type Parts: Copy;

    /// The particles of a contact; [`NONE`] where there are fewer.
    fn particles(parts: &Self::Parts) -> [u32; N];

    /// The contacts with these numbers. Particles are at `start`.
    fn new(numbers: &Block, contacts: &[Contact<Self::Parts>], start: Starts<'_>) -> Self;

    /// Evaluates the contacts where their particles are, when `share` of the tick has passed.
    fn begin<S: Simd>(&self, simd: S, common: &mut Common, rows: MovingRows<'_>, share: f32);

    /// Evaluates the contacts of the block with a number at the unconstrained positions of a substep. `None` if none of them
    /// may act.
    fn begin_step<S: Simd>(
        &self,
        simd: S,
        from: (u32, &mut Common),
        rows: MovingRows<'_>,
        evaluation: Evaluation,
    ) -> Option<(ActingBlock<N>, SlidingBlock)>;
}

/// Where particles are when contacts are taken over.
pub struct At<'a> {
    /// Positions at the beginning of the tick.
    pub start: Starts<'a>,
    /// Displacements since then.
    pub rows: MovingRows<'a>,
    /// Share of the tick that has passed.
    pub share: f32,
}

/// A list of contacts of any kind.
pub(super) trait ContactList {
    /// Forgets all contacts.
    fn clear(&mut self);

    /// Evaluates the contacts at the unconstrained positions of a substep.
    fn begin_step(&mut self, rows: MovingRows<'_>, evaluation: Evaluation);

    /// Pushes by a share of the last substep's push.
    fn push_again(&mut self, rows: MovingRows<'_>);

    /// Pushes the sides of the contacts of a batch apart, in order or backward.
    fn separate(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool);

    /// Applies the friction of a batch, in order or backward.
    fn rub(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool);

    /// Pushes deep contacts of a batch apart once more, in order or backward.
    fn recover(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool);

    /// Ends a substep, after velocities have been derived: keeps what is left, and removes bounce.
    fn end_step(&mut self, rows: MovingRows<'_>);

    /// The number of contacts that may act in this substep, and of those that press.
    fn counts(&self) -> [usize; 2];

    /// Calls `visit` with the number and the normal of every contact that may act and asks for its impulse. Adds what that
    /// returns, if anything, to the contact's sums of inverse masses, along the normal and across.
    fn soften(&mut self, visit: &mut dyn FnMut(u32, DVec3) -> Option<[f64; 2]>);

    /// Calls `add` with the number of every contact that asks for its impulse, and with what it pushes in this substep.
    /// `is_over` says whether the substep has ended.
    fn pushes(&self, is_over: bool, add: &mut dyn FnMut(u32, DVec3));

    /// Calls `add` with the number of every contact that asks for its impulse, and with the sum of its multipliers.
    fn reactions(&mut self, add: &mut dyn FnMut(u32, DVec3));
}

/// Contacts of one kind, colored batch by batch.
#[derive(Debug)]
pub(super) struct ContactBlocks<B, const N: usize> {
    blocks: Vec<(B, Common)>,
    /// The end of each batch among the blocks.
    batches: Vec<usize>,
    acting: Vec<ActingBlock<N>>,
    /// One for each acting block.
    sliding: Vec<SlidingBlock>,
    /// The end of each batch among the acting blocks.
    acting_batches: Vec<usize>,
    /// Those acting blocks in which a contact asks for its impulse.
    asking: Vec<u32>,
    numbers: Vec<Block>,
}

impl<B, const N: usize> Default for ContactBlocks<B, N> {
    fn default() -> Self {
        Self {
            blocks: Vec::new(),
            batches: Vec::new(),
            acting: Vec::new(),
            sliding: Vec::new(),
            acting_batches: Vec::new(),
            asking: Vec::new(),
            numbers: Vec::new(),
        }
    }
}

impl<B: ContactBlock<N>, const N: usize> ContactBlocks<B, N> {
    /// Takes over contacts, batch by batch. Constraints move those particles that `is_free` says.
    pub(super) fn extend(
        &mut self,
        contacts: &[Contact<B::Parts>],
        new: impl Iterator<Item = Range<usize>>,
        is_free: &impl Fn(u32) -> bool,
        coloring: &mut Coloring,
        &At { start, rows, share }: &At<'_>,
    ) {
        let Self { blocks, batches, numbers, .. } = self;
        let moved = |particle: u32| if particle != NONE && is_free(particle) { particle } else { NONE };
        let before = blocks.len();
        for batch in new {
            let contacts = &contacts[batch];
            numbers.clear();
            let particles_of = |contact: u32| B::particles(&contacts[contact as usize].parts).map(moved);
            coloring.blocks(start.len(), contacts.len(), particles_of, numbers);
            blocks.extend(numbers.iter().map(|numbers| {
                let mut common = Common::EMPTY;
                lanes_of(numbers).for_each(|(lane, number)| common.set(lane, &contacts[number]));
                (B::new(numbers, contacts, start), common)
            }));
            batches.push(blocks.len());
        }
        dispatch!(simd => {
            for (block, common) in &mut blocks[before..] {
                block.begin(simd, common, rows, share);
            }
        });
    }

    /// The places of a batch's acting blocks.
    fn of_batch(&self, batch: usize) -> Range<usize> {
        let end = self.acting_batches.get(batch).copied().unwrap_or_default();
        let first = if batch > 0 { self.acting_batches.get(batch - 1).copied().unwrap_or_default() } else { 0 };
        first..end
    }
}

impl<B: ContactBlock<N>, const N: usize> ContactList for ContactBlocks<B, N> {
    fn clear(&mut self) {
        let Self { blocks, batches, acting, sliding, acting_batches, asking, .. } = self;
        acting.clear();
        sliding.clear();
        acting_batches.clear();
        asking.clear();
        blocks.clear();
        batches.clear();
    }

    fn begin_step(&mut self, rows: MovingRows<'_>, evaluation: Evaluation) {
        let Self { blocks, batches, acting, sliding, acting_batches, asking, .. } = self;
        acting.clear();
        sliding.clear();
        acting_batches.clear();
        asking.clear();
        dispatch!(simd => {
            let mut first = 0;
            for &end in &*batches {
                for source in first..end {
                    let (block, common) = &mut blocks[source];
                    if let Some((found, its_sliding)) = block.begin_step(simd, (source as u32, common), rows, evaluation) {
                        if common.reaction != [NONE; WIDTH] {
                            asking.push(acting.len() as u32);
                        }
                        acting.push(found);
                        sliding.push(its_sliding);
                    }
                }
                acting_batches.push(acting.len());
                first = end;
            }
        });
    }

    fn push_again(&mut self, rows: MovingRows<'_>) {
        let Self { acting, .. } = self;
        dispatch!(simd => {
            for block in &*acting {
                block.push_again(simd, rows);
            }
        });
    }

    fn separate(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool) {
        let range = self.of_batch(batch);
        let acting = &mut self.acting[range];
        dispatch!(simd => {
            for place in in_order(acting.len(), is_backward) {
                acting[place].separate(simd, rows);
            }
        });
    }

    fn rub(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool) {
        let range = self.of_batch(batch);
        let (acting, sliding) = (&self.acting[range.clone()], &mut self.sliding[range]);
        dispatch!(simd => {
            for place in in_order(acting.len(), is_backward) {
                acting[place].rub(simd, rows, &mut sliding[place]);
            }
        });
    }

    fn recover(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool) {
        let range = self.of_batch(batch);
        let acting = &mut self.acting[range];
        dispatch!(simd => {
            for place in in_order(acting.len(), is_backward) {
                acting[place].recover(simd, rows);
            }
        });
    }

    fn end_step(&mut self, rows: MovingRows<'_>) {
        let Self { blocks, acting, sliding, .. } = self;
        dispatch!(simd => {
            for (block, sliding) in acting.iter().zip(sliding) {
                block.end_step(simd, rows, sliding, &mut blocks[sliding.source as usize].1);
            }
        });
    }

    fn counts(&self) -> [usize; 2] {
        self.acting.iter().fold([0; 2], |[acting, pressing], block| {
            let [a, p] = block.counts();
            [acting + a, pressing + p]
        })
    }

    fn soften(&mut self, visit: &mut dyn FnMut(u32, DVec3) -> Option<[f64; 2]>) {
        let Self { blocks, acting, sliding, asking, .. } = self;
        for &place in &*asking {
            let (block, sliding) = (&mut acting[place as usize], &mut sliding[place as usize]);
            let numbers = &blocks[sliding.source as usize].1.reaction;
            for lane in (0..WIDTH).filter(|&lane| numbers[lane] != NONE) {
                if let Some(normal) = block.normal(lane)
                    && let Some(by) = visit(numbers[lane], normal.as_dvec3())
                {
                    block.soften(lane, sliding, by.map(|by| by as f32));
                }
            }
        }
    }

    fn pushes(&self, is_over: bool, add: &mut dyn FnMut(u32, DVec3)) {
        for &place in &self.asking {
            let (block, sliding) = (&self.acting[place as usize], &self.sliding[place as usize]);
            let numbers = &self.blocks[sliding.source as usize].1.reaction;
            for lane in (0..WIDTH).filter(|&lane| numbers[lane] != NONE) {
                add(numbers[lane], block.pushed(lane, sliding, is_over).as_dvec3());
            }
        }
    }

    fn reactions(&mut self, add: &mut dyn FnMut(u32, DVec3)) {
        for (_, common) in &self.blocks {
            for (lane, &number) in common.reaction.iter().enumerate().filter(|&(_, &number)| number != NONE) {
                add(number, common.pushes.get(lane).as_dvec3());
            }
        }
    }
}
