//! The last test of pairs from any leaves, eight at a time, before they become candidates.

use fearless_simd::{f32x8, mask32x8, prelude::*, u32x8};

use super::{LEAF_WIDTH, LEAST_SQUARED, Separation};
use crate::kernel::simd::{
    approach::{Approach, Corners, STEPS, bounds_by},
    lanes::first_lanes,
};

/// How many pairs are collected before they are tested.
const ROOM: usize = 64;

/// Which groups of eight pairs to take.
#[derive(Clone, Copy)]
pub(in crate::kernel) enum Groups {
    /// The full groups.
    Complete,
    /// All groups, including one that is not full.
    All,
}

/// One number per pair, with space to write eight where only some are kept.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Numbers<T>([T; ROOM + LEAF_WIDTH]);

impl Numbers<f32> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn group<S: Simd>(&self, simd: S, group: usize) -> f32x8<S> {
        f32x8::from_slice(simd, &self.0[group * LEAF_WIDTH..(group + 1) * LEAF_WIDTH])
    }
}

/// Pairs of triangles that neither a normal nor the line between the centroids separates, on their way to the
/// candidates. Eight are tested together, whatever leaves they come from: two leaves have only few such pairs.
pub(in crate::kernel) struct ClosePairs {
    corners: [[[Numbers<f32>; 3]; 3]; 2],
    /// Gaps wider than this prove that the triangles are separated.
    needed: Numbers<f32>,
    /// The part of `needed` that is for rounding, and lower bounds of the distances. Only used if bounds are requested.
    rounding: Numbers<f32>,
    bounds: Numbers<f32>,
    items: [Numbers<u32>; 2],
    count: usize,
}

impl ClosePairs {
    pub(in crate::kernel) fn new() -> Self {
        Self {
            corners: [[[Numbers([0.0; ROOM + LEAF_WIDTH]); 3]; 3]; 2],
            needed: Numbers([0.0; ROOM + LEAF_WIDTH]),
            rounding: Numbers([0.0; ROOM + LEAF_WIDTH]),
            bounds: Numbers([0.0; ROOM + LEAF_WIDTH]),
            items: [Numbers([0; ROOM + LEAF_WIDTH]); 2],
            count: 0,
        }
    }

    /// Adds the pairs of lanes whose bits are set in `meant`, out of eight. Returns whether the buffer is full.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn push<S: Simd>(
        &mut self,
        simd: S,
        separation: &Separation<'_>,
        corners: &Corners<S>,
        items: [u32x8<S>; 2],
        meant: u32,
    ) -> bool {
        if meant == 0 {
            return false;
        }
        let (mask, room) = (mask32x8::from_bitmask(simd, u64::from(meant)), self.count..self.count + LEAF_WIDTH);
        for side in 0..2 {
            for corner in 0..3 {
                for axis in 0..3 {
                    let row = &mut self.corners[side][corner][axis].0[room.clone()];
                    corners[side][corner][axis].compress(mask).store_slice(row);
                }
            }
            items[side].compress(mask).store_slice(&mut self.items[side].0[room.clone()]);
        }
        self.needed.0[room].fill(separation.needed);
        self.count += meant.count_ones() as usize;
        self.count >= ROOM
    }

    /// Like [`push`](Self::push) if lower bounds of the distances are requested. `bounds` are known already.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn push_bounded<S: Simd>(
        &mut self,
        simd: S,
        separation: &Separation<'_>,
        corners: &Corners<S>,
        items: [u32x8<S>; 2],
        bounds: f32x8<S>,
        meant: u32,
    ) -> bool {
        if meant == 0 {
            return false;
        }
        let room = self.count..self.count + LEAF_WIDTH;
        let mask = mask32x8::from_bitmask(simd, u64::from(meant));
        bounds.compress(mask).store_slice(&mut self.bounds.0[room.clone()]);
        self.rounding.0[room].fill(separation.rounding());
        self.push(simd, separation, corners, items, meant)
    }

    /// The number of groups of eight.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn count_of(&self, groups: Groups) -> usize {
        match groups {
            Groups::Complete => self.count / LEAF_WIDTH,
            Groups::All => self.count.div_ceil(LEAF_WIDTH),
        }
    }

    /// The pairs of a group, and which of them no gap separates along vectors from one triangle to the other.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn group<S: Simd>(&self, simd: S, group: usize) -> ([u32x8<S>; 2], u32) {
        let (corners, zero) = (self.corners_of(simd, group), f32x8::splat(simd, 0.0));
        let needed = self.needed.group(simd, group);
        let mut approach = Approach::new(&corners);
        let mut apart = zero.simd_gt(zero);
        for _ in 0..STEPS {
            let (gap, squared) = approach.step();
            apart |= gap.simd_gt(squared.sqrt() * needed) & squared.simd_gt(LEAST_SQUARED);
        }
        (self.items_of(simd, group), self.requested(group) & !apart.to_bitmask() as u32)
    }

    /// Like [`group`](Self::group), with lower bounds of the distances from the widest gap.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn bounded_group<S: Simd>(&self, simd: S, group: usize) -> ([u32x8<S>; 2], f32x8<S>, u32) {
        let widest = Approach::new(&self.corners_of(simd, group)).widest_gap();
        let (needed, bounds) = (self.needed.group(simd, group), self.bounds.group(simd, group));
        let apart = widest.simd_gt(needed).to_bitmask() as u32;
        let by_gaps = bounds_by(widest, self.rounding.group(simd, group));
        let is_wider = by_gaps.simd_gt(bounds) & needed.simd_lt(f32::INFINITY);
        (self.items_of(simd, group), is_wider.select(by_gaps, bounds), self.requested(group) & !apart)
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn corners_of<S: Simd>(&self, simd: S, group: usize) -> Corners<S> {
        let mut corners = [[[f32x8::splat(simd, 0.0); 3]; 3]; 2];
        for side in 0..2 {
            for corner in 0..3 {
                for axis in 0..3 {
                    corners[side][corner][axis] = self.corners[side][corner][axis].group(simd, group);
                }
            }
        }
        corners
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn items_of<S: Simd>(&self, simd: S, group: usize) -> [u32x8<S>; 2] {
        let [firsts, seconds] = &self.items;
        let room = group * LEAF_WIDTH..(group + 1) * LEAF_WIDTH;
        [u32x8::from_slice(simd, &firsts.0[room.clone()]), u32x8::from_slice(simd, &seconds.0[room])]
    }

    /// One bit for each pair of a group.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn requested(&self, group: usize) -> u32 {
        first_lanes((self.count - group * LEAF_WIDTH).min(LEAF_WIDTH)) as u32
    }

    /// Removes the pairs of these groups.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn forget(&mut self, groups: Groups) {
        let first = self.count_of(groups) * LEAF_WIDTH;
        if first >= self.count {
            self.count = 0;
            return;
        }
        let rest = first..first + LEAF_WIDTH;
        for row in self.corners.as_flattened_mut().as_flattened_mut() {
            row.0.copy_within(rest.clone(), 0);
        }
        for row in [&mut self.needed, &mut self.rounding, &mut self.bounds] {
            row.0.copy_within(rest.clone(), 0);
        }
        for row in &mut self.items {
            row.0.copy_within(rest.clone(), 0);
        }
        self.count -= first;
    }
}
