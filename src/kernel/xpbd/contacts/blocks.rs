//! Blocks of eight contacts: between features, which are evaluated in every substep, and with fixed planes.

use fearless_simd::{f32x8, prelude::*};

use super::{Contact, ContactBlock, FeatureParticles, Plane};
use crate::kernel::{
    simd::lanes::{VectorLanes, VectorRows, WIDTH},
    xpbd::{
        acting::{
            ActingBlock, Common, Driven, Evaluation, Free, SHALLOW, SlidingBlock, gather_all, load_all, weighted_sum,
            zero,
        },
        coloring::{Block, NONE, lanes_of},
        features::{FeatureKind, Meeting, edge_edge, vertex_face},
        rows::{MovingRows, NOBODY, Places, Starts, set_lane},
    },
};

/// Eight contacts between two edges, or between a vertex and a face. Constraints move `N` of their particles: the vertex,
/// the face, the first edge, or any of all four.
#[derive(Debug)]
#[repr(C, align(32))]
pub(in crate::kernel::xpbd) struct FeatureBlock<const ARE_EDGES: bool, const N: usize> {
    places: [Places; 4],
    /// From one particle to each of the others, at the beginning of the tick.
    start: [VectorRows; 3],
}

impl<const ARE_EDGES: bool, const N: usize> FeatureBlock<ARE_EDGES, N> {
    const KIND: FeatureKind = if ARE_EDGES { FeatureKind::EdgeEdge } else { FeatureKind::VertexFace };

    /// The first particle that constraints move. The others follow.
    const FIRST: usize = if N == 3 { 1 } else { 0 };

    /// The features at displacements of their particles.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn meet<S: Simd>(&self, simd: S, common: &Common, moved: &[VectorLanes<S>; 4]) -> Meeting<S> {
        let mut positions = [zero(simd); 3];
        let others = Self::KIND.others();
        for place in 0..3 {
            let relative = moved[others[place]] - moved[Self::KIND.base()];
            positions[place] = VectorLanes::load(simd, &self.start[place]).plus(relative);
        }
        let before = VectorLanes::load(simd, &common.normal);
        match Self::KIND {
            FeatureKind::VertexFace => vertex_face(simd, positions, before),
            FeatureKind::EdgeEdge => edge_edge(simd, positions, before),
        }
    }

    /// The separation at the beginning of the tick for the weights and the normal of a meeting.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn offset<S: Simd>(&self, simd: S, common: &Common, meeting: &Meeting<S>) -> f32x8<S> {
        let mut sum = zero(simd);
        let others = Self::KIND.others();
        for place in 0..3 {
            sum = sum.plus(VectorLanes::load(simd, &self.start[place]).scaled(meeting.weights[others[place]]));
        }
        meeting.normal.dot(sum) - f32x8::from_slice(simd, &common.distance)
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

    fn new(numbers: &Block, contacts: &[Contact<FeatureParticles>], start: Starts<'_>) -> Self {
        let mut block = Self { places: [[NOBODY; WIDTH]; 4], start: [VectorRows::ZERO; 3] };
        for (lane, number) in lanes_of(numbers) {
            let contact = &contacts[number];
            let particles = contact.parts.map(|particle| particle as usize);
            for (places, particle) in block.places.iter_mut().zip(particles) {
                places[lane] = start.row(particle);
            }
            let base = particles[Self::KIND.base()];
            for (rows, other) in block.start.iter_mut().zip(Self::KIND.others()) {
                set_lane(rows, lane, start.offset(base, particles[other]));
            }
        }
        block
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin<S: Simd>(&self, simd: S, common: &mut Common, rows: MovingRows<'_>, _: f32) {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let vectors = [moved[0].vector, moved[1].vector, moved[2].vector, moved[3].vector];
        let meeting = self.meet(simd, common, &vectors);
        let way = weighted_sum(simd, &moved, &meeting.weights);
        (self.offset(simd, common, &meeting) + meeting.normal.dot(way)).store_slice(&mut common.left);
        meeting.normal.store(&mut common.normal);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin_step<S: Simd>(
        &self,
        simd: S,
        (source, common): (u32, &mut Common),
        rows: MovingRows<'_>,
        evaluation: Evaluation,
    ) -> Option<(ActingBlock<N>, SlidingBlock)> {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let speeds = gather_all(simd, rows.velocity, &self.places);
        let vectors = [moved[0].vector, moved[1].vector, moved[2].vector, moved[3].vector];
        let meeting = self.meet(simd, common, &vectors);
        let offset = self.offset(simd, common, &meeting);
        meeting.normal.store(&mut common.normal);
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
        common.act(simd, (source, &places), &free, &driven, (normal, offset, SHALLOW), evaluation)
    }
}

/// Eight contacts with fixed planes.
#[derive(Debug)]
#[repr(C, align(32))]
pub(in crate::kernel::xpbd) struct PlaneBlock<const N: usize> {
    places: [Places; N],
    weights: [[f32; WIDTH]; N],
    drive: VectorRows,
    offset: [f32; WIDTH],
}

impl<const N: usize> ContactBlock<N> for PlaneBlock<N> {
    type Parts = Plane<N>;

    fn particles(parts: &Plane<N>) -> [u32; N] {
        parts.particles
    }

    fn new(numbers: &Block, contacts: &[Contact<Plane<N>>], start: Starts<'_>) -> Self {
        let mut block = Self {
            places: [[NOBODY; WIDTH]; N],
            weights: [[0.0; WIDTH]; N],
            drive: VectorRows::ZERO,
            offset: [0.0; WIDTH],
        };
        for (lane, number) in lanes_of(numbers) {
            let contact = &contacts[number];
            for place in (0..N).filter(|&place| contact.parts.particles[place] != NONE) {
                block.places[place][lane] = start.row(contact.parts.particles[place] as usize);
                block.weights[place][lane] = contact.parts.weights[place] as f32;
            }
            set_lane(&mut block.drive, lane, contact.parts.drive);
            block.offset[lane] = contact.parts.separation as f32;
        }
        block
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin<S: Simd>(&self, simd: S, common: &mut Common, rows: MovingRows<'_>, share: f32) {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let way = weighted_sum(simd, &moved, &load_all(simd, &self.weights));
        let way = way.plus(VectorLanes::load(simd, &self.drive).scaled(f32x8::splat(simd, share)));
        let along = VectorLanes::load(simd, &common.normal).dot(way);
        (f32x8::from_slice(simd, &self.offset) + along).store_slice(&mut common.left);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn begin_step<S: Simd>(
        &self,
        simd: S,
        (source, common): (u32, &mut Common),
        rows: MovingRows<'_>,
        evaluation: Evaluation,
    ) -> Option<(ActingBlock<N>, SlidingBlock)> {
        let moved = gather_all(simd, rows.displacement, &self.places);
        let speeds = gather_all(simd, rows.velocity, &self.places);
        let weights = load_all(simd, &self.weights);
        let normal = VectorLanes::load(simd, &common.normal);
        let offset = f32x8::from_slice(simd, &self.offset);
        let drive = VectorLanes::load(simd, &self.drive);
        let speed = drive.scaled(f32x8::splat(simd, evaluation.rate));
        let driven =
            Driven { moved: drive.scaled(f32x8::splat(simd, evaluation.share)), speed, fastest: speed.dot(speed) };
        let free = Free { moved, speeds, weights };
        common.act(simd, (source, &self.places), &free, &driven, (normal, offset, f32::INFINITY), evaluation)
    }
}
