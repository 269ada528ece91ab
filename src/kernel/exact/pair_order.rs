//! Sorts pairs of triangles into the order of the contacts that they may give.
//!
//! This moves eight bytes per pair rather than whole contacts: the exact stage sorts its candidates, the writer of
//! sphere contacts sorts its pairs, and contacts are made in order. Pairs are distributed, chunk by chunk, to buckets
//! of consecutive numbers, where they take half the memory: only those bits of both triangles that the bucket does not
//! determine. Each bucket is collected from all chunks and radix-sorted, both in the nearest caches. The whole list is
//! thus read twice and written once, in tasks that can be distributed among threads.

use fearless_simd::prelude::*;

use crate::kernel::simd::{lanes::WIDTH, parallel::Parallel};

/// Pairs that one task measures or distributes.
const CHUNK: usize = 8192;

/// With fewer pairs than this another thread does not pay off: waking it takes as long as sorting them.
const PAIRS_OF_ONE: usize = 32_768;

/// Pairs per bucket if they are evenly spread: few enough for the nearest cache, and enough to be worth the counts of
/// wide digits.
const OF_BUCKET: usize = 4096;

/// There may be more buckets than the number of pairs calls for, up to this many, if the rest of a pair then fits into
/// 32 bits.
const MOST_SMALL_BUCKETS: usize = 8192;

/// Buckets that one task sorts.
const BUCKETS_AT_ONCE: usize = 4;

/// Shorter lists and buckets are sorted by comparison.
const SHORT: usize = 64;

/// The smallest and the largest number of bits per digit. Between these, a digit has as many values as there are
/// numbers.
const LEAST_DIGIT: u32 = 8;
const MOST_DIGIT: u32 = 13;

/// What must be known about pairs before they are distributed.
#[derive(Clone, Copy, Debug)]
struct Extent {
    low: [u32; 2],
    high: [u32; 2],
    /// Whether a second triangle is lower than the first one.
    crosses: bool,
}

impl Extent {
    const EMPTY: Self = Self { low: [u32::MAX; 2], high: [0; 2], crosses: false };

    fn of(pairs: &[[u32; 2]]) -> Self {
        dispatch!(simd => measure(simd, pairs))
    }

    fn union(&self, other: &Self) -> Self {
        let ([low, high], [other_low, other_high]) = ([self.low, self.high], [other.low, other.high]);
        Self {
            low: [low[0].min(other_low[0]), low[1].min(other_low[1])],
            high: [high[0].max(other_high[0]), high[1].max(other_high[1])],
            crosses: self.crosses | other.crosses,
        }
    }
}

/// Measures eight pairs at a time.
#[cfg_attr(not(unoptimized), inline(always))]
fn measure<S: Simd>(_: S, pairs: &[[u32; 2]]) -> Extent {
    let (blocks, rest) = pairs.as_chunks::<WIDTH>();
    let (mut low, mut high) = ([[u32::MAX; 2]; WIDTH], [[0; 2]; WIDTH]);
    let mut crosses = [false; WIDTH];
    for block in blocks {
        for lane in 0..WIDTH {
            let [first, second] = block[lane];
            low[lane] = [low[lane][0].min(first), low[lane][1].min(second)];
            high[lane] = [high[lane][0].max(first), high[lane][1].max(second)];
            crosses[lane] |= second < first;
        }
    }
    let lanes = low.into_iter().zip(high).zip(crosses);
    let lanes = lanes.map(|((low, high), crosses)| Extent { low, high, crosses });
    let rest = rest.iter().map(|&pair| Extent { low: pair, high: pair, crosses: pair[1] < pair[0] });
    lanes.chain(rest).fold(Extent::EMPTY, |all, other| all.union(&other))
}

/// Which bucket a pair belongs to, and the rest of its bits, by which it is sorted there. Both are parts of one number:
/// the second triangle in the lower bits and the first one above, each relative to the lowest.
#[derive(Clone, Copy, Debug)]
struct Packing {
    low: [u32; 2],
    second_bits: u32,
    /// The lower bits of a number, which a bucket does not determine.
    open_bits: u32,
    bucket_count: usize,
}

impl Packing {
    /// For a list that is not empty.
    fn of(extent: &Extent, pairs: usize) -> Self {
        let bits = |number: u64| u64::BITS - number.leading_zeros();
        let [first_range, second_range] = [0, 1].map(|side| u64::from(extent.high[side] - extent.low[side]));
        let second_bits = bits(second_range);
        let highest = first_range << second_bits | second_range;
        let wanted = (pairs / OF_BUCKET).max(1) as u64;
        // A number cannot be shifted by all of its bits.
        let mut open_bits = bits(highest / wanted).min(u64::BITS - 1);
        if open_bits > u32::BITS && (highest >> u32::BITS) < MOST_SMALL_BUCKETS as u64 {
            open_bits = u32::BITS;
        }
        let bucket_count = (highest >> open_bits) as usize + 1;
        Self { low: extent.low, second_bits, open_bits, bucket_count }
    }

    /// Whether the rest fits into 32 bits.
    fn is_small(&self) -> bool {
        self.open_bits <= u32::BITS
    }

    #[inline]
    fn number(&self, [first, second]: [u32; 2]) -> u64 {
        u64::from(first - self.low[0]) << self.second_bits | u64::from(second - self.low[1])
    }

    #[inline]
    fn pair(&self, number: u64) -> [u32; 2] {
        let second = number & ((1 << self.second_bits) - 1);
        [(number >> self.second_bits) as u32 + self.low[0], second as u32 + self.low[1]]
    }

    #[inline]
    fn bucket(&self, number: u64) -> usize {
        (number >> self.open_bits) as usize
    }

    /// Writes a chunk in the order of the buckets, as `rest` converts each pair and its number, and writes the end of
    /// each bucket.
    fn deal<T>(&self, pairs: &[[u32; 2]], dealt: &mut [T], ends: &mut [u32], rest: impl Fn([u32; 2], u64) -> T) {
        ends.fill(0);
        for &pair in pairs {
            ends[self.bucket(self.number(pair))] += 1;
        }
        starts_of_counts(ends);
        for &pair in pairs {
            let number = self.number(pair);
            let end = &mut ends[self.bucket(number)];
            dealt[*end as usize] = rest(pair, number);
            *end += 1;
        }
    }

    /// Writes the pairs of a bucket in order. Their rests come in several lists.
    fn sort_small<'a>(
        &self,
        bucket: usize,
        lists: impl Iterator<Item = &'a [u32]>,
        sorted: &mut [[u32; 2]],
        counts: &mut Counts,
    ) {
        // The output holds each rest twice: in its first half, and in its second half, where it must be at the end.
        let count = sorted.len();
        let most_bits = (usize::BITS - count.leading_zeros()).clamp(LEAST_DIGIT, MOST_DIGIT);
        let digits = if count < SHORT { 0 } else { self.open_bits.div_ceil(most_bits) };
        let (one, other) = sorted.as_flattened_mut().split_at_mut(count);
        let (mut from, mut to) = if digits % 2 == 0 { (other, one) } else { (one, other) };
        collect(lists, from);
        if digits == 0 {
            from.sort_unstable();
        }
        let mut shift = 0;
        for digit in 0..digits {
            let width = (self.open_bits - shift).div_ceil(digits - digit);
            sort_by_digit(from, to, shift, &mut counts[..1 << width]);
            (from, to) = (to, from);
            shift += width;
        }
        let base = (bucket as u64) << self.open_bits;
        for place in 0..count {
            // No rest is overwritten before it is read: it is behind both numbers of its pair, or in the place of the
            // second.
            let rest = sorted.as_flattened()[count + place];
            sorted[place] = self.pair(base | u64::from(rest));
        }
    }
}

fn collect<'a, T: Copy + 'a>(lists: impl Iterator<Item = &'a [T]>, mut to: &mut [T]) {
    for list in lists {
        let (own, later) = to.split_at_mut(list.len());
        own.copy_from_slice(list);
        to = later;
    }
}

/// How often each value of a digit occurs.
type Counts = [u32; 1 << MOST_DIGIT];

/// Sorts numbers stably by a digit, and writes them. The digit starts at bit `shift`, and has as many values as there
/// are counts.
fn sort_by_digit(from: &[u32], to: &mut [u32], shift: u32, counts: &mut [u32]) {
    let mask = counts.len() - 1;
    counts.fill(0);
    for &number in from {
        counts[(number >> shift) as usize & mask] += 1;
    }
    starts_of_counts(counts);
    for &number in from {
        let place = &mut counts[(number >> shift) as usize & mask];
        to[*place as usize] = number;
        *place += 1;
    }
}

/// Turns the count of each value into where its entries start.
fn starts_of_counts(counts: &mut [u32]) {
    let mut start = 0;
    for count in counts {
        start += std::mem::replace(count, start);
    }
}

/// Sorts pairs. Keeps its buffers from list to list.
#[derive(Clone, Debug, Default)]
pub struct PairSorter {
    extents: Vec<Extent>,
    /// The rests of pairs in their buckets, if these fit into 32 bits.
    small: Vec<u32>,
    /// Whole pairs, if they do not.
    large: Vec<[u32; 2]>,
    /// For each chunk, where its part of each bucket ends.
    ends: Vec<u32>,
    /// Where each bucket begins in the sorted list, and where the last one ends.
    starts: Vec<usize>,
    sorted: Vec<[u32; 2]>,
}

impl PairSorter {
    /// Sorts `pairs` by the [keys](crate::kernel::contact::ContactKey) of their contacts: by the first triangle, then
    /// by the second. In a self-collision (`same_surface`), by the lower one, then by the higher.
    pub fn sort(&mut self, pairs: &mut Vec<[u32; 2]>, same_surface: bool, parallel: &impl Parallel) {
        if self.sort_from(pairs, same_surface, parallel) {
            std::mem::swap(pairs, &mut self.sorted);
        }
    }

    /// The sorted pairs in a separate list, each pair once, and in a self-collision with the lower triangle first.
    /// Returns `pairs` itself if it is in order.
    pub fn unique<'a>(
        &'a mut self,
        pairs: &'a [[u32; 2]],
        same_surface: bool,
        parallel: &impl Parallel,
    ) -> &'a [[u32; 2]] {
        let is_turned = |&[first, second]: &[u32; 2]| same_surface & (second < first);
        let are_in_order = |one: &[u32; 2], other: &[u32; 2]| (one < other) & !is_turned(one);
        if pairs.is_sorted_by(are_in_order) && !pairs.last().is_some_and(is_turned) {
            return pairs;
        }
        if !self.sort_from(pairs, same_surface, parallel) {
            self.sorted.clear();
            self.sorted.extend_from_slice(pairs);
        }
        // These are sorted by the lower triangle, whichever comes first.
        for [first, second] in self.sorted.iter_mut().filter(|pair| is_turned(pair)) {
            std::mem::swap(first, second);
        }
        self.sorted.dedup();
        &self.sorted
    }

    /// Writes the pairs in order. Returns whether sorting was necessary.
    fn sort_from(&mut self, pairs: &[[u32; 2]], same_surface: bool, parallel: &impl Parallel) -> bool {
        let is_sorted = pairs.is_sorted();
        if is_sorted && !same_surface {
            return false;
        }
        let extent = self.measure(pairs, parallel);
        if same_surface && extent.crosses {
            self.sorted.clear();
            self.sorted.extend_from_slice(pairs);
            self.sorted.sort_unstable_by_key(|&[a, b]| (a.min(b), a.max(b), a));
            return true;
        }
        if is_sorted {
            return false;
        }
        self.sorted.resize(pairs.len(), [0; 2]);
        if pairs.len() < SHORT {
            self.sorted.copy_from_slice(pairs);
            self.sorted.sort_unstable();
            return true;
        }
        let Self { small, large, ends, starts, sorted, .. } = self;
        let packing = Packing::of(&extent, pairs.len());
        if packing.is_small() {
            let mask = (1 << packing.open_bits) - 1;
            deal(&packing, pairs, small, ends, starts, parallel, |_, number| (number & mask) as u32);
            sort_buckets(&packing, small, ends, starts, sorted, parallel, |bucket, lists, sorted, counts| {
                packing.sort_small(bucket, lists, sorted, counts);
            });
        } else {
            deal(&packing, pairs, large, ends, starts, parallel, |pair, _| pair);
            sort_buckets(&packing, large, ends, starts, sorted, parallel, |_, lists, sorted, _| {
                collect(lists, sorted);
                sorted.sort_unstable();
            });
        }
        true
    }

    fn measure(&mut self, pairs: &[[u32; 2]], parallel: &impl Parallel) -> Extent {
        self.extents.resize(pairs.len().div_ceil(CHUNK), Extent::EMPTY);
        let chunks = pairs.chunks(CHUNK).zip(&mut self.extents);
        parallel.run_tasks(chunks, pairs.len() / PAIRS_OF_ONE, |(pairs, extent)| *extent = Extent::of(pairs));
        self.extents.iter().fold(Extent::EMPTY, |all, extent| all.union(extent))
    }
}

/// Distributes pairs to the buckets, as `rest` converts them.
fn deal<T: Copy + Default + Send>(
    packing: &Packing,
    pairs: &[[u32; 2]],
    dealt: &mut Vec<T>,
    ends: &mut Vec<u32>,
    starts: &mut Vec<usize>,
    parallel: &impl Parallel,
    rest: impl Fn([u32; 2], u64) -> T + Sync,
) {
    dealt.resize(pairs.len(), T::default());
    ends.resize(pairs.len().div_ceil(CHUNK) * packing.bucket_count, 0);
    let chunks = pairs.chunks(CHUNK).zip(dealt.chunks_mut(CHUNK)).zip(ends.chunks_mut(packing.bucket_count));
    parallel.run_tasks(chunks, pairs.len() / PAIRS_OF_ONE, |((pairs, dealt), ends)| {
        packing.deal(pairs, dealt, ends, &rest);
    });
    starts.clear();
    starts.resize(packing.bucket_count + 1, 0);
    for ends in ends.chunks(packing.bucket_count) {
        // The ends of a bucket in all chunks add up to its end in the whole list.
        for (start, &end) in starts[1..].iter_mut().zip(ends) {
            *start += end as usize;
        }
    }
}

/// Calls `sort` with the index of each bucket, its part of each chunk, and its part of the sorted list to write.
fn sort_buckets<T: Sync>(
    packing: &Packing,
    dealt: &[T],
    ends: &[u32],
    starts: &[usize],
    mut sorted: &mut [[u32; 2]],
    parallel: &impl Parallel,
    sort: impl Fn(usize, BucketLists<'_, T>, &mut [[u32; 2]], &mut Counts) + Sync,
) {
    let most_threads = dealt.len() / PAIRS_OF_ONE;
    let tasks = (0..packing.bucket_count).step_by(BUCKETS_AT_ONCE).map(|first| {
        let last = (first + BUCKETS_AT_ONCE).min(packing.bucket_count);
        let (own, later) = std::mem::take(&mut sorted).split_at_mut(starts[last] - starts[first]);
        sorted = later;
        (first..last, own)
    });
    parallel.run_tasks(tasks, most_threads, |(buckets, mut sorted)| {
        #[expect(clippy::large_stack_arrays, reason = "32 KiB, which fits on every thread's stack")]
        let mut counts = [0; 1 << MOST_DIGIT];
        for bucket in buckets {
            let (own, later) = std::mem::take(&mut sorted).split_at_mut(starts[bucket + 1] - starts[bucket]);
            sorted = later;
            let chunks = dealt.chunks(CHUNK).zip(ends.chunks(packing.bucket_count));
            sort(bucket, BucketLists { chunks, bucket }, own, &mut counts);
        }
    });
}

/// The parts of a bucket, chunk by chunk.
struct BucketLists<'a, T> {
    chunks: std::iter::Zip<std::slice::Chunks<'a, T>, std::slice::Chunks<'a, u32>>,
    bucket: usize,
}

impl<'a, T> Iterator for BucketLists<'a, T> {
    type Item = &'a [T];

    fn next(&mut self) -> Option<&'a [T]> {
        let (dealt, ends) = self.chunks.next()?;
        let start = self.bucket.checked_sub(1).map_or(0, |before| ends[before]);
        Some(&dealt[start as usize..ends[self.bucket] as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::simd::parallel::{OnTwoThreads, Sequential};

    /// Pseudo-random numbers below `end`.
    fn numbers(count: usize, end: u32) -> impl Iterator<Item = u32> {
        (0..count as u64)
            .map(move |place| ((place * 2_654_435_761 + place * place * 40_503) % 4_294_967_291) as u32 % end)
    }

    fn pairs(count: usize, [end_a, end_b]: [u32; 2]) -> Vec<[u32; 2]> {
        let second = numbers(2 * count, end_b).skip(count);
        numbers(count, end_a).zip(second).map(<[u32; 2]>::from).collect()
    }

    /// Sorts in all possible ways.
    fn assert_sorts(sorter: &mut PairSorter, pairs: &[[u32; 2]], same_surface: bool, expected: &[[u32; 2]]) {
        let name = format!("{} pairs up to {:?}", pairs.len(), pairs.iter().max());
        let mut sorted = pairs.to_vec();
        sorter.sort(&mut sorted, same_surface, &Sequential);
        assert!(sorted == expected, "{name}");
        sorted = pairs.to_vec();
        sorter.sort(&mut sorted, same_surface, &OnTwoThreads);
        assert!(sorted == expected, "{name} on two threads");
        for pair in sorted.iter_mut().filter(|_| same_surface) {
            pair.sort_unstable();
        }
        sorted.dedup();
        assert!(sorter.unique(pairs, same_surface, &Sequential) == sorted, "{name}");
        assert!(sorter.unique(pairs, same_surface, &OnTwoThreads) == sorted, "{name} on two threads");
        let again = sorter.unique(&sorted, same_surface, &Sequential);
        assert!(again == sorted, "{name} again");
        assert_eq!(again.as_ptr(), sorted.as_ptr(), "{name}: what is in order is not copied");
    }

    #[test]
    fn pairs_come_out_as_a_comparison_sorts_them() {
        let mut sorter = PairSorter::default();
        for count in [0, 1, 2, SHORT - 1, SHORT, 5_000, 100_000] {
            for end in [1, 2, 300, 92_230, 1 << 28] {
                for same_surface in [false, true] {
                    let pairs = pairs(count, [end; 2]);
                    let mut expected = pairs.clone();
                    if same_surface {
                        expected.sort_by_key(|&[a, b]| (a.min(b), a.max(b), a));
                    } else {
                        expected.sort_unstable();
                    }
                    assert!(count < SHORT || end < 300 || pairs != expected, "there is something to sort");
                    assert_sorts(&mut sorter, &pairs, same_surface, &expected);
                    // Lower triangle first, as broad phases list them: not sorted by comparison.
                    let ordered: Vec<[u32; 2]> = expected.iter().rev().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
                    let mut expected = ordered.clone();
                    expected.sort_unstable();
                    assert_sorts(&mut sorter, &ordered, same_surface, &expected);
                }
            }
        }
    }

    #[test]
    fn uneven_lists_are_sorted_as_well() {
        let mut sorter = PairSorter::default();
        let ends = [[1, 92_230], [4, 92_230], [4, 1 << 28], [92_230, 1], [92_230, 1 << 28], [u32::MAX; 2]];
        for end in ends {
            for count in [1_000, 50_000] {
                let mut even = pairs(count, end);
                // Nine in ten belong to one triangle, and some numbers are far from all others.
                let mut uneven = even.clone();
                for (place, pair) in uneven.iter_mut().enumerate() {
                    pair[0] = if place % 10 == 0 { pair[0] } else { end[0] / 2 };
                }
                uneven[count / 2] = [u32::MAX, 0];
                uneven[count / 3] = [0, u32::MAX];
                for list in [&mut even, &mut uneven] {
                    let mut expected = list.clone();
                    expected.sort_unstable();
                    assert!(*list != expected, "there is something to sort");
                    assert_sorts(&mut sorter, list, false, &expected);
                }
            }
        }
    }
}
