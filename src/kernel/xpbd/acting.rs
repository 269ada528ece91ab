//! Contacts in a substep: their normals and weights are fixed, and they push, rub, and lose their bounce.

use fearless_simd::{f32x8, prelude::*};
use glam::Vec3;

use super::{
    coloring::NONE,
    contacts::Contact,
    rows::{Gathered, MovingRows, Places, SharedRows, gather, scatter_free, set_lane},
};
use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH, stored};

/// Share of the slip by which friction weakens, until only the dynamic share is left. With a jump from static to
/// dynamic friction, anything at rest near the limit would alternate between stick and slip forever. With this ramp, an
/// object held by its weight reaches dynamic friction at a speed of `(μ_s − μ_d) / 0.05` times the speed that gravity
/// adds in a substep: 3 centimeters per second by default.
const WEAKENING: f32 = 0.05;

/// A contact may act in a substep if it begins with a push, or if it is no farther from it than its fastest particle moves in
/// this many.
const REACH: f32 = 2.0;

/// Share of the last substep's push with which a contact begins. All of it makes stacks tremble, and none of it leaves
/// twice as much to the sweeps.
const WARMTH: f32 = 0.5;

/// Depth in contact distances at which a contact of features begins without a push, and up to which that share falls.
/// Among features that cross, pushes disagree.
pub(super) const SHALLOW: f32 = 0.1;

/// Depth in contact distances at which a contact has no friction left. It falls from one less on: friction would hold what
/// is wedged between two shapes.
const GRIP: f32 = 2.0;

/// Contact distances by which contacts may be too near after friction. With less, elastic bodies at rest tremble.
const TOLERANCE: f32 = 0.05;

/// Largest ratio of how far a contact moves a particle to how far it is from where it should be. A contact right beside
/// a pinned vertex has hardly any weight on the others, and would otherwise throw them away.
pub const MOST_LEVER: f32 = 8.0;

/// A substep, for contacts.
#[derive(Clone, Copy, Debug)]
pub struct Evaluation {
    /// Duration of the substep in seconds.
    pub step: f32,
    /// By how much an overlap that existed before may shrink in the substep, in contact distances.
    pub push_out: f32,
    /// Share of the tick that has passed at its end.
    pub share: f32,
    /// One over the duration of the tick.
    pub rate: f32,
}

/// The free particles of eight contacts in a substep, with their weights.
pub(super) struct Free<const N: usize, S: Simd> {
    pub(super) moved: [Gathered<S>; N],
    pub(super) speeds: [Gathered<S>; N],
    pub(super) weights: [f32x8<S>; N],
}

/// The kinematic particles of eight contacts in a substep: weighted sums over them.
pub(super) struct Driven<S: Simd> {
    pub(super) moved: VectorLanes<S>,
    pub(super) speed: VectorLanes<S>,
    /// Square of the speed of the fastest.
    pub(super) fastest: f32x8<S>,
}

/// What all blocks of contacts know of theirs.
#[derive(Debug)]
#[repr(C, align(32))]
pub(super) struct Common {
    pub(super) normal: VectorRows,
    pub(super) distance: [f32; WIDTH],
    friction: [[f32; WIDTH]; 2],
    /// Separation at the end of the last substep, or when the contact was found.
    pub(super) left: [f32; WIDTH],
    /// Normal multiplier in the last substep.
    pub(super) pressed: [f32; WIDTH],
    /// The sum of multipliers, of the normal and of friction, in all substeps, less the bounce that was removed.
    pub(super) pushes: VectorRows,
    pub(super) reaction: [u32; WIDTH],
    /// Share of the last push with which a substep begins.
    warmth: [f32; WIDTH],
}

impl Common {
    pub(super) const EMPTY: Self = Self {
        normal: VectorRows::ZERO,
        distance: [0.0; WIDTH],
        friction: [[0.0; WIDTH]; 2],
        left: [0.0; WIDTH],
        pressed: [0.0; WIDTH],
        pushes: VectorRows::ZERO,
        reaction: [NONE; WIDTH],
        warmth: [0.0; WIDTH],
    };

    pub(super) fn set<P>(&mut self, lane: usize, contact: &Contact<P>) {
        set_lane(&mut self.normal, lane, contact.normal);
        self.distance[lane] = contact.distance as f32;
        self.reaction[lane] = contact.reaction;
        self.warmth[lane] = if contact.recovers { 0.0 } else { WARMTH };
        for kind in 0..2 {
            self.friction[kind][lane] = contact.friction[kind] as f32;
        }
    }
}

/// Up to eight contacts that may act in a substep, with their weights and normals there. Only free particles are in it.
/// What the others do is known, and is part of the offsets. What only friction needs is in a [`SlidingBlock`]: the sweeps
/// that push apart read as little as possible.
#[derive(Debug)]
#[repr(C, align(32))]
pub(super) struct ActingBlock<const N: usize> {
    places: [Places; N],
    weights: [[f32; WIDTH]; N],
    normal: VectorRows,
    /// Added to the weighted sum of displacements along the normal to get the separation.
    offset: [f32; WIDTH],
    /// The separation to reach: 0, or less if the sides overlapped before the substep.
    target: [f32; WIDTH],
    /// `1 / Σ w a²`, limited by [`MOST_LEVER`]; 0 if the contact cannot act.
    inverse: [f32; WIDTH],
    multiplier: [f32; WIDTH],
    /// The least separation that may be left.
    allowed: [f32; WIDTH],
}

/// What friction and the end of a substep need of the contacts of an [`ActingBlock`].
#[derive(Debug)]
#[repr(C, align(32))]
pub(super) struct SlidingBlock {
    /// As `inverse`, across the normal. It differs if a rigid body gives way.
    inverse_across: [f32; WIDTH],
    /// Weighted sum of the displacements of free particles at which nothing has slid in the substep.
    before: VectorRows,
    friction: [[f32; WIDTH]; 2],
    /// The multiplier of friction. When the substep ends, all that the contact has pushed.
    sliding: VectorRows,
    /// Largest speed of the free particles along the normal that is not bounce.
    most_opening: [f32; WIDTH],
    /// The block that they were evaluated from.
    pub(super) source: u32,
    /// Duration of the substep in seconds.
    step: f32,
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn zero<S: Simd>(simd: S) -> VectorLanes<S> {
    VectorLanes::splat(simd, Vec3::ZERO)
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn weighted_sum<const N: usize, S: Simd>(
    simd: S,
    vectors: &[Gathered<S>; N],
    weights: &[f32x8<S>; N],
) -> VectorLanes<S> {
    let mut sum = zero(simd);
    for place in 0..N {
        sum = sum.plus(vectors[place].vector.scaled(weights[place]));
    }
    sum
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn gather_all<const N: usize, S: Simd>(
    simd: S,
    table: SharedRows<'_>,
    places: &[Places; N],
) -> [Gathered<S>; N] {
    let mut all = [Gathered { vector: zero(simd), inverse_mass: f32x8::splat(simd, 0.0) }; N];
    for place in 0..N {
        all[place] = gather(simd, &table, &places[place]);
    }
    all
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn load_all<const N: usize, S: Simd>(simd: S, rows: &[[f32; WIDTH]; N]) -> [f32x8<S>; N] {
    let mut all = [f32x8::splat(simd, 0.0); N];
    for place in 0..N {
        all[place] = f32x8::from_slice(simd, &rows[place]);
    }
    all
}

impl Common {
    /// The contacts in a substep. `None` if all are too far apart to act, or nothing in them can move.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn act<const N: usize, S: Simd>(
        &mut self,
        simd: S,
        (source, places): (u32, &[Places; N]),
        free: &Free<N, S>,
        driven: &Driven<S>,
        (normal, offset, shallow): (VectorLanes<S>, f32x8<S>, f32),
        evaluation: Evaluation,
    ) -> Option<(ActingBlock<N>, SlidingBlock)> {
        let zeros = f32x8::splat(simd, 0.0);
        let Free { moved, speeds, weights } = free;
        let Evaluation { step, push_out, .. } = evaluation;
        let sum = weighted_sum(simd, moved, weights);
        let offset = offset + normal.dot(driven.moved);
        let separation = normal.dot(sum) + offset;
        let (mut fastest, mut mobility, mut lightest) = (driven.fastest, zeros, zeros);
        for place in 0..N {
            let is_absent = weights[place].simd_eq(zeros);
            let squared = speeds[place].vector.dot(speeds[place].vector);
            fastest = fastest.max(is_absent.select(zeros, squared));
            lightest = lightest.max(is_absent.select(zeros, moved[place].inverse_mass));
            mobility += weights[place] * weights[place] * moved[place].inverse_mass;
        }
        let mobility = mobility.max(lightest * MOST_LEVER.powi(-2));
        let speed = weighted_sum(simd, speeds, weights).plus(driven.speed);
        // Constraints may move the particles as far again, and what a contact held they move however slow it is.
        let reach = fastest.sqrt() * (REACH * step);
        let left = f32x8::from_slice(simd, &self.left);
        let distance = f32x8::from_slice(simd, &self.distance);
        let depth = left.min(zeros) / (distance * shallow);
        let warmth = (depth + 1.0).max(zeros) * f32x8::from_slice(simd, &self.warmth);
        let push = f32x8::from_slice(simd, &self.pressed) * warmth;
        let is_near = (separation.simd_le(reach) | push.simd_gt(zeros)) & mobility.simd_gt(zeros);
        let target = (left + distance * push_out).min(zeros);
        let grip = (left + distance * GRIP).max(zeros).min(distance) / distance;
        let grip = distance.simd_gt(zeros).select(grip, f32x8::splat(simd, 1.0));
        let [most_held, least_held] = load_all(simd, &self.friction);
        is_near.select(left, separation).store_slice(&mut self.left);
        self.pressed = [0.0; WIDTH];
        if !is_near.any_true() {
            return None;
        }
        let inverse = stored(is_near.select(f32x8::splat(simd, 1.0) / mobility, zeros));
        let mut block = ActingBlock {
            places: *places,
            weights: [[0.0; WIDTH]; N],
            normal: normal.stored(),
            offset: stored(offset),
            target: stored(target),
            allowed: stored(target - distance * TOLERANCE),
            inverse,
            multiplier: stored(is_near.select(push, zeros)),
        };
        for place in 0..N {
            weights[place].store_slice(&mut block.weights[place]);
        }
        let sliding = SlidingBlock {
            source,
            inverse_across: inverse,
            most_opening: stored(normal.dot(speed).max(zeros) - normal.dot(driven.speed)),
            before: (sum - speed.scaled(f32x8::splat(simd, step))).stored(),
            friction: [stored(grip * most_held), stored(grip * least_held)],
            sliding: VectorRows::ZERO,
            step,
        };
        Some((block, sliding))
    }
}

impl<const N: usize> ActingBlock<N> {
    /// Pushes by a share of the last substep's push. At rest, all of it will be needed again.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn push_again<S: Simd>(&self, simd: S, rows: MovingRows<'_>) {
        let multiplier = f32x8::from_slice(simd, &self.multiplier);
        if !multiplier.simd_gt(0.0).any_true() {
            return;
        }
        let moved = gather_all(simd, rows.displacement, &self.places);
        let weights = load_all(simd, &self.weights);
        let push = VectorLanes::load(simd, &self.normal).scaled(multiplier);
        self.push(rows.displacement, &moved, &weights, push);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn separate<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>) {
        let zeros = f32x8::splat(simd, 0.0);
        let moved = gather_all(simd, rows.displacement, &self.places);
        let weights = load_all(simd, &self.weights);
        let normal = VectorLanes::load(simd, &self.normal);
        let separation = self.separation(simd, &moved, &weights, normal);
        let missing = f32x8::from_slice(simd, &self.target) - separation;
        let before = f32x8::from_slice(simd, &self.multiplier);
        let inverse = f32x8::from_slice(simd, &self.inverse);
        let after = inverse.simd_gt(zeros).select((before + missing * inverse).max(zeros), zeros);
        let change = after - before;
        if change.simd_eq(zeros).all_true() {
            return;
        }
        after.store_slice(&mut self.multiplier);
        self.push(rows.displacement, &moved, &weights, normal.scaled(change));
    }

    /// Pushes the sides of contacts apart once more that are still too near after friction: the friction of their neighbors
    /// would hold them where they are. Only adds to pushes, so that nothing is released that friction holds.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn recover<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>) {
        let zeros = f32x8::splat(simd, 0.0);
        if !f32x8::from_slice(simd, &self.multiplier).simd_gt(zeros).any_true() {
            return;
        }
        let moved = gather_all(simd, rows.displacement, &self.places);
        let weights = load_all(simd, &self.weights);
        let normal = VectorLanes::load(simd, &self.normal);
        let separation = self.separation(simd, &moved, &weights, normal);
        let missing = (f32x8::from_slice(simd, &self.allowed) - separation).max(zeros);
        let change = missing * f32x8::from_slice(simd, &self.inverse);
        if change.simd_eq(zeros).all_true() {
            return;
        }
        (f32x8::from_slice(simd, &self.multiplier) + change).store_slice(&mut self.multiplier);
        self.push(rows.displacement, &moved, &weights, normal.scaled(change));
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn rub<S: Simd>(&self, simd: S, rows: MovingRows<'_>, friction: &mut SlidingBlock) {
        let zeros = f32x8::splat(simd, 0.0);
        let multiplier = f32x8::from_slice(simd, &self.multiplier);
        let SlidingBlock { friction: shares, sliding: held, before, inverse_across, .. } = friction;
        let [most_held, least_held] = load_all(simd, shares);
        let held_before = VectorLanes::load(simd, held);
        let is_held = held_before.dot(held_before).simd_gt(zeros);
        let acts = (multiplier.simd_gt(zeros) | is_held) & most_held.simd_gt(zeros);
        if !acts.any_true() {
            return;
        }
        let moved = gather_all(simd, rows.displacement, &self.places);
        let weights = load_all(simd, &self.weights);
        let normal = VectorLanes::load(simd, &self.normal);
        let slid = weighted_sum(simd, &moved, &weights) - VectorLanes::load(simd, before);
        let slid = slid - normal.scaled(normal.dot(slid));
        let wanted = held_before - slid.scaled(f32x8::from_slice(simd, inverse_across));
        let (holding, sliding) = (most_held * multiplier, least_held * multiplier);
        let length = wanted.dot(wanted).sqrt();
        // With `held = holding − WEAKENING (length − held)`.
        let slipping = (holding - length * WEAKENING) * (1.0 / (1.0 - WEAKENING));
        let share = slipping.max(sliding) / length;
        let share = length.simd_le(holding).select(f32x8::splat(simd, 1.0), share);
        let held_now = VectorLanes::select(acts, wanted.scaled(share), held_before);
        held_now.store(held);
        self.push(rows.displacement, &moved, &weights, held_now - held_before);
    }

    /// Keeps the separation that is left and the push, and removes the separating velocity that a push has added:
    /// contacts do not bounce.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn end_step<S: Simd>(
        &self,
        simd: S,
        rows: MovingRows<'_>,
        SlidingBlock { sliding, most_opening, step, .. }: &mut SlidingBlock,
        common: &mut Common,
    ) {
        let zeros = f32x8::splat(simd, 0.0);
        let weights = load_all(simd, &self.weights);
        let normal = VectorLanes::load(simd, &self.normal);
        let inverse = f32x8::from_slice(simd, &self.inverse);
        let moved = gather_all(simd, rows.displacement, &self.places);
        let separation = self.separation(simd, &moved, &weights, normal);
        let left = &mut common.left;
        inverse.simd_gt(zeros).select(separation, f32x8::from_slice(simd, left)).store_slice(left);
        common.pressed = self.multiplier;
        let push = normal.scaled(f32x8::from_slice(simd, &self.multiplier)).plus(VectorLanes::load(simd, sliding));
        push.store(sliding);
        VectorLanes::load(simd, &common.pushes).plus(push).store(&mut common.pushes);
        let presses = f32x8::from_slice(simd, &self.multiplier).simd_gt(zeros);
        if !presses.any_true() {
            return;
        }
        let speeds = gather_all(simd, rows.velocity, &self.places);
        let opening = normal.dot(weighted_sum(simd, &speeds, &weights));
        let surplus = (opening - f32x8::from_slice(simd, most_opening)).max(zeros);
        let change = presses.select(-surplus * inverse, zeros);
        if !change.simd_lt(zeros).any_true() {
            return;
        }
        let change = normal.scaled(change);
        self.push(rows.velocity, &speeds, &weights, change);
        let change = change.scaled(f32x8::splat(simd, *step));
        push.plus(change).store(sliding);
        VectorLanes::load(simd, &common.pushes).plus(change).store(&mut common.pushes);
    }

    /// The normal of a contact, if it may act.
    pub(super) fn normal(&self, lane: usize) -> Option<Vec3> {
        (self.inverse[lane] > 0.0).then(|| self.normal.get(lane))
    }

    /// Adds to the sums of inverse masses of a contact, along its normal and across.
    pub(super) fn soften(&mut self, lane: usize, friction: &mut SlidingBlock, [along, across]: [f32; 2]) {
        for (inverse, by) in [(&mut self.inverse, along), (&mut friction.inverse_across, across)] {
            inverse[lane] /= 1.0 + by * inverse[lane];
        }
    }

    /// What a contact pushes in this substep. `is_over` says whether the substep has ended.
    pub(super) fn pushed(&self, lane: usize, friction: &SlidingBlock, is_over: bool) -> Vec3 {
        let sliding = friction.sliding.get(lane);
        if is_over { sliding } else { sliding + self.normal.get(lane) * self.multiplier[lane] }
    }

    /// How far the sides are apart, less the contact distance, where the free particles are now.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn separation<S: Simd>(
        &self,
        simd: S,
        moved: &[Gathered<S>; N],
        weights: &[f32x8<S>; N],
        normal: VectorLanes<S>,
    ) -> f32x8<S> {
        normal.dot(weighted_sum(simd, moved, weights)) + f32x8::from_slice(simd, &self.offset)
    }

    /// The number of contacts that may act, and of those that press.
    pub(super) fn counts(&self) -> [usize; 2] {
        [&self.inverse, &self.multiplier].map(|lanes| lanes.iter().filter(|&&number| number > 0.0).count())
    }

    /// Adds a vector to all particles, times their weights and inverse masses.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn push<S: Simd>(
        &self,
        table: SharedRows<'_>,
        vectors: &[Gathered<S>; N],
        weights: &[f32x8<S>; N],
        push: VectorLanes<S>,
    ) {
        for place in 0..N {
            scatter_free(vectors[place].pushed(push.scaled(weights[place])), table, &self.places[place]);
        }
    }
}
