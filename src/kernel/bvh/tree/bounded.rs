//! Traversal for the list of near pairs: pairs within a larger distance, each with a lower bound of its distance.

use std::ops::Range;

use fearless_simd::{f32x8, mask32x8, prelude::*, u32x8};

use super::{Aabb, BoxTree, Boxes, LEAF_WIDTH, SetLanes, pairs::LaneHits, search::NearbyLeaves};
use crate::kernel::bvh::{
    leaf_triangles::{ClosePairs, Groups, LanePairs, PairCull},
    near_pairs::BoundedPairs,
};

impl BoxTree {
    /// Appends the pairs with one item in `leaves` and the other in the same leaf or a later one whose boxes are no
    /// farther apart than `skin`, lower item first, without the pairs that `cull` drops. Any two boxes are grown by
    /// `range` or more together, so their contents are farther apart by that. Slabs along any direction count, even if
    /// `cull` is limited to planes. Returns the number of pairs before slabs drop any.
    pub fn bounded_self_pairs_of(
        &self,
        leaves: Range<usize>,
        range: f32,
        skin: f32,
        cull: &PairCull<'_>,
        pairs: &mut BoundedPairs,
    ) -> usize {
        dispatch!(simd => self.bounded_in_lanes::<true, _>(simd, leaves, self, [range, skin], cull, pairs))
    }

    /// Like [`bounded_self_pairs_of`](Self::bounded_self_pairs_of), for the items in `leaves` of this tree and all
    /// items of another one.
    pub fn bounded_pairs_of(
        &self,
        leaves: Range<usize>,
        other: &Self,
        range: f32,
        skin: f32,
        cull: &PairCull<'_>,
        pairs: &mut BoundedPairs,
    ) -> usize {
        dispatch!(simd => self.bounded_in_lanes::<false, _>(simd, leaves, other, [range, skin], cull, pairs))
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn bounded_in_lanes<const SELF: bool, S: Simd>(
        &self,
        simd: S,
        leaves: Range<usize>,
        other_tree: &Self,
        [range, skin]: [f32; 2],
        cull: &PairCull<'_>,
        pairs: &mut BoundedPairs,
    ) -> usize {
        let mut count = 0;
        let (mut hits, mut close, mut recent) = (LaneHits::new(), ClosePairs::new(), Recent::new());
        let mut all_gaps = [0.0; (LEAF_WIDTH + 1) * LEAF_WIDTH];
        let mut search = NearbyLeaves::new();
        let own = &self.leaves[leaves.clone()];
        for (passed, leaf) in own.iter().enumerate() {
            let place = leaves.start + passed;
            let first = if SELF { place as u32 } else { 0 };
            search.begin(simd, other_tree, own, passed, skin, first);
            let first = if SELF { cull.search_from(place) } else { 0 };
            while search.go_on(simd, other_tree, &leaf.bounds.grown(skin), first) {
                for &other_place in search.found() {
                    let other_place = other_place as usize;
                    let other = &other_tree.leaves[other_place];
                    let neighbors = cull.neighbors_between([place, other_place]);
                    hits.count = 0;
                    for lane in SetLanes(leaf.boxes.overlapping(simd, &other.bounds.grown(skin))) {
                        let later = if SELF && place == other_place { !0u32 << (lane + 1) } else { !0 };
                        let gaps = other.boxes.gaps(simd, &leaf.boxes.get(lane));
                        let mut lanes = gaps.simd_le(skin).to_bitmask() as u32 & later;
                        if lanes != 0 {
                            lanes &= !neighbors.of_lane(simd, lane);
                        }
                        let mask = mask32x8::from_bitmask(simd, u64::from(lanes));
                        gaps.compress(mask).store_slice(&mut all_gaps[hits.count..][..LEAF_WIDTH]);
                        hits.push(simd, lane, lanes);
                    }
                    if hits.count == 0 {
                        continue;
                    }
                    count += hits.count;
                    let separation = if cull.has_slabs() { Some(cull.between([place, other_place])) } else { None };
                    for ((pairs_of_lanes, requested), gaps) in hits.groups().zip(all_gaps.chunks(LEAF_WIDTH)) {
                        let lane_pairs = LanePairs::new(simd, pairs_of_lanes);
                        // The boxes include their growth, so their contents are farther apart by that.
                        let gaps = f32x8::from_slice(simd, gaps);
                        let by_boxes = gaps.simd_gt(0.0).select(gaps + range, f32x8::splat(simd, 0.0));
                        let [items, others] = lane_pairs.items(simd, &leaf.items, &other.items);
                        let items = if SELF { [items.min(others), items.max(others)] } else { [items, others] };
                        let Some(separation) = &separation else {
                            recent.push(simd, items, by_boxes, requested, pairs);
                            continue;
                        };
                        let corners = separation.corners(simd, &lane_pairs);
                        let (kept, by_slabs) = separation.lower_bounds(simd, &lane_pairs, &corners, requested);
                        let bounds = by_slabs.max(by_boxes);
                        if close.push_bounded(simd, separation, &corners, items, bounds, kept) {
                            recent.take(&mut close, Groups::Complete, pairs);
                        }
                    }
                }
            }
        }
        recent.take(&mut close, Groups::All, pairs);
        recent.flush(pairs);
        count
    }
}

impl Boxes {
    /// The gap between each box and another one along the axis that separates them most. Negative if they overlap, NaN
    /// if there is no box.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn gaps<S: Simd>(&self, simd: S, bounds: &Aabb) -> f32x8<S> {
        let [mut gaps, zero] = [f32x8::splat(simd, f32::NEG_INFINITY), f32x8::splat(simd, 0.0)];
        for axis in 0..3 {
            let (min, max) = (f32x8::from_slice(simd, &self.min[axis]), f32x8::from_slice(simd, &self.max[axis]));
            let (low, high) = (zero + bounds.min[axis], zero + bounds.max[axis]);
            gaps = gaps.max((min - high).max(low - max));
        }
        // A maximum with NaN may be a number.
        let is_number = f32x8::from_slice(simd, &self.min[0]).simd_le(f32::MAX);
        is_number.select(gaps, f32x8::splat(simd, f32::NAN))
    }
}

/// A buffer of pairs on their way to the list, as in the traversal without bounds.
struct Recent {
    firsts: [u32; Self::ROOM],
    seconds: [u32; Self::ROOM],
    bounds: [f32; Self::ROOM],
    count: usize,
}

impl Recent {
    const ROOM: usize = 256;

    fn new() -> Self {
        Self { firsts: [0; Self::ROOM], seconds: [0; Self::ROOM], bounds: [0.0; Self::ROOM], count: 0 }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn push<S: Simd>(
        &mut self,
        simd: S,
        [firsts, seconds]: [u32x8<S>; 2],
        bounds: f32x8<S>,
        kept: u32,
        pairs: &mut BoundedPairs,
    ) {
        if self.count > Self::ROOM - LEAF_WIDTH {
            self.flush(pairs);
        }
        let mask = mask32x8::from_bitmask(simd, u64::from(kept));
        let room = self.count..self.count + LEAF_WIDTH;
        firsts.compress(mask).store_slice(&mut self.firsts[room.clone()]);
        seconds.compress(mask).store_slice(&mut self.seconds[room.clone()]);
        bounds.compress(mask).store_slice(&mut self.bounds[room]);
        self.count += kept.count_ones() as usize;
    }

    /// Takes the pairs that no gap separates, of complete groups or of all.
    #[inline(never)]
    fn take(&mut self, close: &mut ClosePairs, groups: Groups, pairs: &mut BoundedPairs) {
        dispatch!(simd => {
            for group in 0..close.count_of(groups) {
                let (items, bounds, kept) = close.bounded_group(simd, group);
                self.push(simd, items, bounds, kept, pairs);
            }
        });
        close.forget(groups);
    }

    #[inline(never)]
    fn flush(&mut self, pairs: &mut BoundedPairs) {
        let count = std::mem::take(&mut self.count);
        pairs.extend_from_slices(&self.firsts[..count], &self.seconds[..count], &self.bounds[..count]);
    }
}
