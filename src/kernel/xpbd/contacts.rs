//! Contact constraints: keep the contact distance, with friction along the surface.
//!
//! A contact names the features that were close when the tick began. In every substep they are evaluated at their
//! current positions, on the side where they were, which gives a constraint `C = n·(Σ a p − Σ b p) − d ≥ 0` with a
//! Lagrange multiplier of at least 0. Friction is a constraint of its own with a bounded multiplier. It sticks up to
//! the static share of the normal multiplier and slides with the dynamic share (Macklin et al. 2014, "Unified Particle
//! Physics"), without a jump in between.

use std::ops::Range;

use fearless_simd::{f32x8, prelude::*};
use glam::DVec3;

use super::{
    acting::{ActingBlock, Common, Driven, Evaluation, Free, SHALLOW, gather_all, load_all, weighted_sum, zero},
    coloring::{Block, Coloring, NONE, in_order, lanes_of},
    features::{FeatureKind, Meeting, edge_edge, vertex_face},
    rows::{MovingRows, NOBODY, Places, row_of, set_lane},
};
use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH};

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

/// Eight contacts that have no particle in common, of up to `N` particles each.
pub(super) trait ContactBlock<const N: usize>: Sized {
    /// What a contact is between.
    type Parts: Copy;

    /// The particles of a contact; [`NONE`] where there are fewer.
    fn particles(parts: &Self::Parts) -> [u32; N];

    /// The contacts with these numbers. Particles are at `start`.
    fn new(numbers: &Block, contacts: &[Contact<Self::Parts>], start: &[DVec3]) -> Self;

    fn common(&mut self) -> &mut Common;

    /// Evaluates the contacts where their particles are, when `share` of the tick has passed.
    fn begin<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>, share: f32);

    /// Evaluates the contacts at the unconstrained positions of a substep. `None` if none of them may act.
    fn begin_step<S: Simd>(
        &mut self,
        simd: S,
        source: u32,
        rows: MovingRows<'_>,
        evaluation: Evaluation,
    ) -> Option<ActingBlock<N>>;
}

/// Where particles are when contacts are taken over.
pub struct At<'a> {
    /// Positions at the beginning of the tick.
    pub start: &'a [DVec3],
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

    /// Calls `add` with the number of every contact that asks for its impulse, and with the sum of its multipliers.
    fn reactions(&mut self, add: &mut dyn FnMut(u32, DVec3));
}

/// Contacts of one kind, colored batch by batch.
#[derive(Debug)]
pub(super) struct ContactBlocks<B, const N: usize> {
    blocks: Vec<B>,
    /// The end of each batch among the blocks.
    batches: Vec<usize>,
    acting: Vec<ActingBlock<N>>,
    /// The end of each batch among the acting blocks.
    acting_batches: Vec<usize>,
    numbers: Vec<Block>,
}

impl<B, const N: usize> Default for ContactBlocks<B, N> {
    fn default() -> Self {
        Self {
            blocks: Vec::new(),
            batches: Vec::new(),
            acting: Vec::new(),
            acting_batches: Vec::new(),
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
            blocks.extend(numbers.iter().map(|numbers| B::new(numbers, contacts, start)));
            batches.push(blocks.len());
        }
        dispatch!(simd => {
            for block in &mut blocks[before..] {
                block.begin(simd, rows, share);
            }
        });
    }

    /// The acting contacts of a batch.
    fn of_batch(&mut self, batch: usize) -> &mut [ActingBlock<N>] {
        let end = self.acting_batches.get(batch).copied().unwrap_or_default();
        let first = if batch > 0 { self.acting_batches.get(batch - 1).copied().unwrap_or_default() } else { 0 };
        &mut self.acting[first..end]
    }
}

impl<B: ContactBlock<N>, const N: usize> ContactList for ContactBlocks<B, N> {
    fn clear(&mut self) {
        let Self { blocks, batches, acting, acting_batches, .. } = self;
        acting.clear();
        acting_batches.clear();
        blocks.clear();
        batches.clear();
    }

    fn begin_step(&mut self, rows: MovingRows<'_>, evaluation: Evaluation) {
        let Self { blocks, batches, acting, acting_batches, .. } = self;
        acting.clear();
        acting_batches.clear();
        dispatch!(simd => {
            let mut first = 0;
            for &end in &*batches {
                for source in first..end {
                    if let Some(found) = blocks[source].begin_step(simd, source as u32, rows, evaluation) {
                        acting.push(found);
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
        let acting = self.of_batch(batch);
        dispatch!(simd => {
            for place in in_order(acting.len(), is_backward) {
                acting[place].separate(simd, rows);
            }
        });
    }

    fn rub(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool) {
        let acting = self.of_batch(batch);
        dispatch!(simd => {
            for place in in_order(acting.len(), is_backward) {
                acting[place].rub(simd, rows);
            }
        });
    }

    fn recover(&mut self, batch: usize, rows: MovingRows<'_>, is_backward: bool) {
        let acting = self.of_batch(batch);
        dispatch!(simd => {
            for place in in_order(acting.len(), is_backward) {
                acting[place].recover(simd, rows);
            }
        });
    }

    fn end_step(&mut self, rows: MovingRows<'_>) {
        let Self { blocks, acting, .. } = self;
        dispatch!(simd => {
            for block in acting {
                block.end_step(simd, rows, blocks[block.source as usize].common());
            }
        });
    }

    fn counts(&self) -> [usize; 2] {
        self.acting.iter().fold([0; 2], |[acting, pressing], block| {
            let [a, p] = block.counts();
            [acting + a, pressing + p]
        })
    }

    fn reactions(&mut self, add: &mut dyn FnMut(u32, DVec3)) {
        for block in &mut self.blocks {
            let common = block.common();
            for (lane, &number) in common.reaction.iter().enumerate().filter(|&(_, &number)| number != NONE) {
                add(number, common.pushes.get(lane).as_dvec3());
            }
        }
    }
}

/// Eight contacts between two edges, or between a vertex and a face. Constraints move `N` of their particles: the vertex,
/// the face, the first edge, or any of all four.
#[derive(Debug)]
pub(super) struct FeatureBlock<const ARE_EDGES: bool, const N: usize> {
    places: [Places; 4],
    /// From one particle to each of the others, at the beginning of the tick.
    start: [VectorRows; 3],
    common: Common,
}

impl<const ARE_EDGES: bool, const N: usize> FeatureBlock<ARE_EDGES, N> {
    const KIND: FeatureKind = if ARE_EDGES { FeatureKind::EdgeEdge } else { FeatureKind::VertexFace };

    /// The first particle that constraints move. The others follow.
    const FIRST: usize = if N == 3 { 1 } else { 0 };

    /// The features at displacements of their particles.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn meet<S: Simd>(&self, simd: S, moved: &[VectorLanes<S>; 4]) -> Meeting<S> {
        let mut positions = [zero(simd); 3];
        let others = Self::KIND.others();
        for place in 0..3 {
            let relative = moved[others[place]] - moved[Self::KIND.base()];
            positions[place] = VectorLanes::load(simd, &self.start[place]).plus(relative);
        }
        let before = VectorLanes::load(simd, &self.common.normal);
        match Self::KIND {
            FeatureKind::VertexFace => vertex_face(simd, positions, before),
            FeatureKind::EdgeEdge => edge_edge(simd, positions, before),
        }
    }

    /// The separation at the beginning of the tick for the weights and the normal of a meeting.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn offset<S: Simd>(&self, simd: S, meeting: &Meeting<S>) -> f32x8<S> {
        let mut sum = zero(simd);
        let others = Self::KIND.others();
        for place in 0..3 {
            sum = sum.plus(VectorLanes::load(simd, &self.start[place]).scaled(meeting.weights[others[place]]));
        }
        meeting.normal.dot(sum) - f32x8::from_slice(simd, &self.common.distance)
    }

    /// Those that constraints move.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn free<T: Copy>(all: &[T; 4]) -> [T; N] {
        std::array::from_fn(|place| all[Self::FIRST + place])
    }
}

impl<const ARE_EDGES: bool, const N: usize> ContactBlock<N> for FeatureBlock<ARE_EDGES, N> {
    type Parts = FeatureParticles;

    fn particles(parts: &FeatureParticles) -> [u32; N] {
        Self::free(parts)
    }

    fn new(numbers: &Block, contacts: &[Contact<FeatureParticles>], start: &[DVec3]) -> Self {
        let mut block = Self { places: [[NOBODY; WIDTH]; 4], start: [VectorRows::ZERO; 3], common: Common::EMPTY };
        for (lane, number) in lanes_of(numbers) {
            let contact = &contacts[number];
            let particles = contact.parts.map(|particle| particle as usize);
            for (places, particle) in block.places.iter_mut().zip(particles) {
                places[lane] = row_of(particle);
            }
            let base = start[particles[Self::KIND.base()]];
            for (rows, other) in block.start.iter_mut().zip(Self::KIND.others()) {
                set_lane(rows, lane, start[particles[other]] - base);
            }
            block.common.set(lane, contact);
        }
        block
    }

    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>, _: f32) {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let vectors = [moved[0].vector, moved[1].vector, moved[2].vector, moved[3].vector];
        let meeting = self.meet(simd, &vectors);
        let way = weighted_sum(simd, &moved, &meeting.weights);
        (self.offset(simd, &meeting) + meeting.normal.dot(way)).store_slice(&mut self.common.left);
        meeting.normal.store(&mut self.common.normal);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin_step<S: Simd>(
        &mut self,
        simd: S,
        source: u32,
        rows: MovingRows<'_>,
        evaluation: Evaluation,
    ) -> Option<ActingBlock<N>> {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let speeds = gather_all(simd, rows.velocity, &self.places);
        let vectors = [moved[0].vector, moved[1].vector, moved[2].vector, moved[3].vector];
        let meeting = self.meet(simd, &vectors);
        let offset = self.offset(simd, &meeting);
        meeting.normal.store(&mut self.common.normal);
        let Meeting { weights, normal } = meeting;
        let zeros = f32x8::splat(simd, 0.0);
        let mut driven = Driven { moved: zero(simd), speed: zero(simd), fastest: zeros };
        for place in 0..4 {
            if (Self::FIRST..Self::FIRST + N).contains(&place) {
                continue;
            }
            let speed = speeds[place].vector;
            driven.moved = driven.moved.plus(moved[place].vector.scaled(weights[place]));
            driven.speed = driven.speed.plus(speed.scaled(weights[place]));
            let squared = weights[place].simd_eq(zeros).select(zeros, speed.dot(speed));
            driven.fastest = driven.fastest.max(squared);
        }
        let free = Free { moved: Self::free(&moved), speeds: Self::free(&speeds), weights: Self::free(&weights) };
        let places = Self::free(&self.places);
        self.common.act(simd, (source, &places), &free, &driven, (normal, offset, SHALLOW), evaluation)
    }
}

/// Eight contacts with fixed planes.
#[derive(Debug)]
pub(super) struct PlaneBlock<const N: usize> {
    places: [Places; N],
    weights: [[f32; WIDTH]; N],
    drive: VectorRows,
    offset: [f32; WIDTH],
    common: Common,
}

impl<const N: usize> ContactBlock<N> for PlaneBlock<N> {
    type Parts = Plane<N>;

    fn particles(parts: &Plane<N>) -> [u32; N] {
        parts.particles
    }

    fn new(numbers: &Block, contacts: &[Contact<Plane<N>>], _: &[DVec3]) -> Self {
        let mut block = Self {
            places: [[NOBODY; WIDTH]; N],
            weights: [[0.0; WIDTH]; N],
            drive: VectorRows::ZERO,
            offset: [0.0; WIDTH],
            common: Common::EMPTY,
        };
        for (lane, number) in lanes_of(numbers) {
            let contact = &contacts[number];
            for place in (0..N).filter(|&place| contact.parts.particles[place] != NONE) {
                block.places[place][lane] = row_of(contact.parts.particles[place] as usize);
                block.weights[place][lane] = contact.parts.weights[place] as f32;
            }
            set_lane(&mut block.drive, lane, contact.parts.drive);
            block.common.set(lane, contact);
            block.offset[lane] = contact.parts.separation as f32;
        }
        block
    }

    fn common(&mut self) -> &mut Common {
        &mut self.common
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>, share: f32) {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let way = weighted_sum(simd, &moved, &load_all(simd, &self.weights));
        let way = way.plus(VectorLanes::load(simd, &self.drive).scaled(f32x8::splat(simd, share)));
        let along = VectorLanes::load(simd, &self.common.normal).dot(way);
        (f32x8::from_slice(simd, &self.offset) + along).store_slice(&mut self.common.left);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin_step<S: Simd>(
        &mut self,
        simd: S,
        source: u32,
        rows: MovingRows<'_>,
        evaluation: Evaluation,
    ) -> Option<ActingBlock<N>> {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let speeds = gather_all(simd, rows.velocity, &self.places);
        let weights = load_all(simd, &self.weights);
        let normal = VectorLanes::load(simd, &self.common.normal);
        let offset = f32x8::from_slice(simd, &self.offset);
        let drive = VectorLanes::load(simd, &self.drive);
        let speed = drive.scaled(f32x8::splat(simd, evaluation.rate));
        let driven =
            Driven { moved: drive.scaled(f32x8::splat(simd, evaluation.share)), speed, fastest: speed.dot(speed) };
        let free = Free { moved, speeds, weights };
        self.common.act(simd, (source, &self.places), &free, &driven, (normal, offset, f32::INFINITY), evaluation)
    }
}
