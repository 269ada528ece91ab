//! Conservative rejection of triangle pairs, eight at a time, by a slab that separates them.
//!
//! Two triangles whose projections on any direction are farther apart than a distance are themselves farther apart, so
//! every direction gives a proof, however it was found and rounded: the triangles' normals, or one that a method has
//! already. What no direction rejects goes on to the next test; what lies within range is never rejected. Of candidates
//! that no traversal has tested in its leaves already, see `leaf_triangles`, and before caps.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use std::cmp::Ordering;

use glam::Vec3;

use crate::kernel::lanes::{Lanes, PairLanes, VectorLanes, WIDTH, normal, project};

/// Gaps must exceed the range by this factor, and by [`ROUNDING`] times the pair's extent, before a pair is rejected:
/// the projections' own rounding is a few units in the last place of the extent (6e-8 each).
pub(in crate::kernel) const RANGE_SLACK: f32 = 1.0 + 1.0e-5;
pub(in crate::kernel) const ROUNDING: f32 = 2.0e-6;

/// A squared direction below this is too close to the smallest f32 to be relied on.
pub(in crate::kernel) const LEAST_SQUARED: f32 = 1.0e-30;

impl PairLanes {
    /// By how much the gap along `direction` exceeds the one that proves a pair apart, in units of the direction's
    /// length: more than 0 where it does.
    #[inline(always)]
    pub(in crate::kernel) fn excess_along(&self, direction: VectorLanes, range: Lanes) -> Lanes {
        let (low_a, high_a) = project(&self.a, direction);
        let (low_b, high_b) = project(&self.b, direction);
        let gap = (low_b - high_a).max(low_a - high_b);
        let squared = direction.dot(direction);
        let needed = squared.sqrt() * (range * Lanes::splat(RANGE_SLACK) + self.extent * Lanes::splat(ROUNDING));
        let reliable = squared.greater_than(Lanes::splat(LEAST_SQUARED));
        Lanes::select(reliable, gap - needed, Lanes::splat(f32::NEG_INFINITY))
    }

    #[inline(always)]
    pub(in crate::kernel) fn excess_along_normals(&self, range: Lanes) -> Lanes {
        self.excess_along(normal(&self.a), range).max(self.excess_along(normal(&self.b), range))
    }
}

/// Appends the pairs that their planes do not separate by more than `range` (in the unit of the positions, 0 or more).
/// `positions` and `triangles` are those of the first and the second surface.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
pub fn cull_by_planes(
    positions: [&[Vec3]; 2],
    triangles: [&[[u32; 3]]; 2],
    pairs: &[[u32; 2]],
    range: f32,
    kept: &mut Vec<[u32; 2]>,
) {
    let mut lanes = PairLanes::EMPTY;
    for pairs in pairs.chunks(WIDTH) {
        lanes.gather(positions, triangles, pairs);
        keep(pairs, &lanes.excess_along_normals(Lanes::splat(range)), kept);
    }
}

/// Appends the pairs without excess. Kept apart like the gathering: numbers that are stored side by side are computed
/// side by side.
#[inline(never)]
fn keep(pairs: &[[u32; 2]], excess: &Lanes, kept: &mut Vec<[u32; 2]>) {
    kept.extend(pairs.iter().zip(excess.0).filter(|&(_, excess)| !proves_apart(excess)).map(|(&pair, _)| pair));
}

/// Whether an excess proves a pair apart. One that is not a number, of coordinates near the end of f32, proves nothing.
pub(in crate::kernel) fn proves_apart(excess: f32) -> bool {
    excess.partial_cmp(&0.0) == Some(Ordering::Greater)
}
