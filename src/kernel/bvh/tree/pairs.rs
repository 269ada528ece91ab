//! Traversal for pairs of items whose boxes overlap.

use std::ops::Range;

use fearless_simd::{mask32x8, prelude::*, u32x8};

use super::{BoxTree, LEAF_WIDTH, search::NearbyLeaves};
use crate::kernel::{
    bvh::leaf_triangles::{ClosePairs, Groups, LanePairs, Neighbors, PairCull},
    simd::{lanes::SetLanes, prefetch::prefetch},
};

impl BoxTree {
    /// Appends every pair of items whose boxes overlap, lower item first, in tree order.
    pub fn self_pairs(&self, pairs: &mut Vec<[u32; 2]>) {
        self.self_pairs_of(0..self.leaf_count(), None, pairs);
    }

    /// Like [`self_pairs`](Self::self_pairs), for pairs with one item in `leaves` and the other in the same leaf or a
    /// later one, without the pairs that `cull` drops. Returns the number of pairs before slabs drop any.
    pub fn self_pairs_of(&self, leaves: Range<usize>, cull: Option<&PairCull<'_>>, pairs: &mut Vec<[u32; 2]>) -> usize {
        dispatch!(simd => self.pairs_in_lanes::<true, _>(simd, leaves, self, cull, pairs))
    }

    /// Appends every pair of an item in `leaves` of this tree and an item of `other` whose boxes overlap, in tree
    /// order, without the pairs that `cull` drops. Returns the number of pairs before slabs drop any.
    pub fn pairs_of(
        &self,
        leaves: Range<usize>,
        other: &Self,
        cull: Option<&PairCull<'_>>,
        pairs: &mut Vec<[u32; 2]>,
    ) -> usize {
        dispatch!(simd => self.pairs_in_lanes::<false, _>(simd, leaves, other, cull, pairs))
    }

    /// For a tree against itself (`SELF`), only later leaves and lanes are tested, and the lower item comes first.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn pairs_in_lanes<const SELF: bool, S: Simd>(
        &self,
        simd: S,
        leaves: Range<usize>,
        other_tree: &Self,
        cull: Option<&PairCull<'_>>,
        pairs: &mut Vec<[u32; 2]>,
    ) -> usize {
        let mut count = 0;
        let (mut hits, mut close, mut recent) = (LaneHits::new(), ClosePairs::new(), Recent::new());
        let looks_closer = cull.is_some_and(|cull| !cull.planes_only);
        let mut search = NearbyLeaves::new();
        let own = &self.leaves[leaves.clone()];
        for (passed, leaf) in own.iter().enumerate() {
            let place = leaves.start + passed;
            let first = if SELF { place as u32 } else { 0 };
            search.begin(simd, other_tree, own, passed, 0.0, first);
            let first = if SELF { cull.map_or(first, |cull| cull.search_from(place)) } else { 0 };
            while search.go_on(simd, other_tree, &leaf.bounds, first) {
                for &other_place in search.found() {
                    let other_place = other_place as usize;
                    let other = &other_tree.leaves[other_place];
                    let neighbors = match cull {
                        Some(cull) => cull.neighbors_between([place, other_place]),
                        None => Neighbors::NONE,
                    };
                    hits.count = 0;
                    for lane in SetLanes(leaf.boxes.overlapping(simd, &other.bounds)) {
                        let later = if SELF && place == other_place { !0u32 << (lane + 1) } else { !0 };
                        let lanes = other.boxes.overlapping(simd, &leaf.boxes.get(lane)) & later;
                        hits.push(simd, lane, lanes & !neighbors.of_lane(simd, lane));
                    }
                    if hits.count == 0 {
                        continue;
                    }
                    count += hits.count;
                    let separation = match cull {
                        Some(cull) if cull.has_slabs() => Some(cull.between([place, other_place])),
                        _ => None,
                    };
                    for (pairs_of_lanes, mut kept) in hits.groups() {
                        let lane_pairs = LanePairs::new(simd, pairs_of_lanes);
                        let [items, others] = lane_pairs.items(simd, &leaf.items, &other.items);
                        let (firsts, seconds) =
                            if SELF { (items.min(others), items.max(others)) } else { (items, others) };
                        if let Some(separation) = &separation {
                            let corners = separation.corners(simd, &lane_pairs);
                            kept &= !separation.separated(simd, &lane_pairs, &corners);
                            if looks_closer {
                                if close.push(simd, separation, &corners, [firsts, seconds], kept) {
                                    recent.take(&mut close, Groups::Complete, pairs);
                                }
                                continue;
                            }
                        }
                        recent.push(simd, firsts, seconds, kept, pairs);
                    }
                }
            }
        }
        recent.take(&mut close, Groups::All, pairs);
        recent.flush(pairs);
        count
    }
}

/// Pairs of lanes of two leaves whose boxes overlap, packed so that slabs can test eight at a time.
pub(super) struct LaneHits {
    /// Eight times the lane of the first leaf, plus the lane of the second.
    pub(super) pairs: [[u32; LEAF_WIDTH]; LEAF_WIDTH + 1],
    pub(super) count: usize,
}

impl LaneHits {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn new() -> Self {
        Self { pairs: [[0; LEAF_WIDTH]; LEAF_WIDTH + 1], count: 0 }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn push<S: Simd>(&mut self, simd: S, lane: usize, lanes: u32) {
        const LANES: [u32; LEAF_WIDTH] = [0, 1, 2, 3, 4, 5, 6, 7];
        let mask = mask32x8::from_bitmask(simd, u64::from(lanes));
        let pairs = (u32x8::from_slice(simd, &LANES) + (LEAF_WIDTH * lane) as u32).compress(mask);
        pairs.store_slice(&mut self.pairs.as_flattened_mut()[self.count..][..LEAF_WIDTH]);
        self.count += lanes.count_ones() as usize;
    }

    /// Groups of eight pairs, with a bit for each pair that exists.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn groups(&self) -> impl Iterator<Item = (&[u32; LEAF_WIDTH], u32)> {
        let groups = self.pairs[..self.count.div_ceil(LEAF_WIDTH)].iter().enumerate();
        groups.map(|(group, pairs)| {
            let left = self.count - group * LEAF_WIDTH;
            (pairs, if left < LEAF_WIDTH { (1 << left) - 1 } else { 0xff })
        })
    }
}

/// A buffer of pairs on their way to a list. Which of eight pairs are kept is unpredictable, so all are written, the
/// kept ones first, and the next ones overwrite the rest.
struct Recent {
    items: [u32; 2 * Self::ROOM],
    count: usize,
}

impl Recent {
    const ROOM: usize = 256;

    fn new() -> Self {
        Self { items: [0; 2 * Self::ROOM], count: 0 }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn push<S: Simd>(&mut self, simd: S, firsts: u32x8<S>, seconds: u32x8<S>, kept: u32, list: &mut Vec<[u32; 2]>) {
        if self.count > Self::ROOM - LEAF_WIDTH {
            self.flush(list);
        }
        let mask = mask32x8::from_bitmask(simd, u64::from(kept));
        let (low, high) = firsts.compress(mask).interleave(seconds.compress(mask));
        let room = &mut self.items[2 * self.count..][..2 * LEAF_WIDTH];
        low.store_slice(&mut room[..LEAF_WIDTH]);
        high.store_slice(&mut room[LEAF_WIDTH..]);
        self.count += kept.count_ones() as usize;
    }

    /// Takes the pairs that no gap separates, of complete groups or of all.
    #[inline(never)]
    fn take(&mut self, close: &mut ClosePairs, groups: Groups, list: &mut Vec<[u32; 2]>) {
        dispatch!(simd => {
            for group in 0..close.count_of(groups) {
                let ([firsts, seconds], kept) = close.group(simd, group);
                self.push(simd, firsts, seconds, kept, list);
            }
        });
        close.forget(groups);
    }

    #[inline(never)]
    fn flush(&mut self, list: &mut Vec<[u32; 2]>) {
        list.extend_from_slice(self.items[..2 * self.count].as_chunks().0);
        self.count = 0;
        let room = list.spare_capacity_mut();
        for place in (0..Self::ROOM as u32).step_by(8) {
            prefetch(room, place);
        }
    }
}
