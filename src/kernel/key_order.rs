//! The order of a list by keys of two numbers, found in tasks that may be shared among threads.
//!
//! Keys are dealt out, chunk by chunk, to buckets of neighboring first numbers; each bucket is collected from all chunks
//! and sorted digit by digit in the nearest caches. What is moved is eight bytes: what the bucket leaves open of the first
//! number, the second, and the place in the list.

use super::share::Share;

/// Keys listed and dealt out by one task.
const CHUNK: usize = 8192;

/// Fewer records than these are not worth another thread: to wake it takes as long as to sort them.
pub(super) const RECORDS_OF_ONE: usize = 32_768;

/// Keys of a bucket, where first numbers are evenly spread: up to twice as many fit into the nearest cache.
const OF_BUCKET: usize = 1024;

/// Buckets that one task sorts.
const BUCKETS_AT_ONCE: usize = 16;

/// A bucket shorter than this is sorted by comparison.
const FEWEST_COUNTED: usize = 64;

/// The most bits of a key that are sorted by at a time.
const DIGIT_BITS: u32 = 10;

/// First numbers with the same highest four bits are of one kind: between kinds there may be gaps.
const KINDS: usize = 16;
const KIND_BITS: u32 = KINDS.ilog2();

/// What a list is sorted by: the first number in the higher half, the second in the lower.
#[must_use]
#[inline]
pub const fn joined(first: u32, second: u32) -> u64 {
    (first as u64) << u32::BITS | second as u64
}

fn first(key: u64) -> u32 {
    (key >> u32::BITS) as u32
}

fn kind(first: u32) -> usize {
    (first >> (u32::BITS - KIND_BITS)) as usize
}

/// The lowest and the highest of some numbers; the other way round where there are none.
#[derive(Clone, Copy, Debug)]
struct Range {
    low: u32,
    high: u32,
}

impl Range {
    const EMPTY: Self = Self { low: u32::MAX, high: 0 };

    fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    fn count(self) -> u64 {
        if self.low <= self.high { u64::from(self.high - self.low) + 1 } else { 0 }
    }
}

/// The numbers in use: first ones by kind, and second ones.
#[derive(Clone, Copy, Debug)]
struct Ranges {
    first: [Range; KINDS],
    second: Range,
}

impl Ranges {
    const EMPTY: Self = Self { first: [Range::EMPTY; KINDS], second: Range::EMPTY };

    fn of(keys: &[u64]) -> Self {
        let mut ranges = Self::EMPTY;
        // Neighbors in a list are mostly of one kind, whose range stays in registers.
        let (mut current, mut range) = (0, Range::EMPTY);
        for &key in keys {
            let (first, second) = (first(key), key as u32);
            if kind(first) != current {
                ranges.first[current] = ranges.first[current].union(range);
                (current, range) = (kind(first), Range::EMPTY);
            }
            range = range.union(Range { low: first, high: first });
            ranges.second = ranges.second.union(Range { low: second, high: second });
        }
        ranges.first[current] = ranges.first[current].union(range);
        ranges
    }

    fn union(&self, other: &Self) -> Self {
        Self {
            first: std::array::from_fn(|kind| self.first[kind].union(other.first[kind])),
            second: self.second.union(other.second),
        }
    }
}

/// How keys are packed, and which bucket they belong to.
#[derive(Clone, Copy, Debug)]
struct Packing {
    /// What to add to a first number of each kind, wrapping round, for its place among those in use.
    offsets: [u32; KINDS],
    second_low: u32,
    /// Two to this are the first numbers of a bucket.
    width_bits: u32,
    second_bits: u32,
    place_bits: u32,
    bucket_count: usize,
}

impl Packing {
    /// `None` where a packed key would not fit.
    fn of(ranges: &Ranges, records: usize) -> Option<Self> {
        let mut used = 0_u64;
        let offsets = ranges.first.map(|range| {
            let offset = (used as u32).wrapping_sub(range.low);
            used += range.count();
            offset
        });
        let wanted = (records / OF_BUCKET).max(1) as u64;
        let bits = |count: u64| count.next_power_of_two().ilog2();
        let width_bits = bits(used.div_ceil(wanted));
        let (second_bits, place_bits) = (bits(ranges.second.count()), bits(records as u64));
        let bucket_count = used.div_ceil(1 << width_bits) as usize;
        let fits = width_bits + second_bits + place_bits <= u64::BITS;
        let second_low = ranges.second.low;
        fits.then_some(Self { offsets, second_low, width_bits, second_bits, place_bits, bucket_count })
    }

    #[inline]
    fn place(&self, key: u64) -> u64 {
        let first = first(key);
        first.wrapping_add(self.offsets[kind(first)]).into()
    }

    #[inline]
    fn bucket(&self, key: u64) -> usize {
        (self.place(key) >> self.width_bits) as usize
    }

    #[inline]
    fn pack(&self, key: u64, place: usize) -> u64 {
        let first = self.place(key) & ((1 << self.width_bits) - 1);
        let second = u64::from(key as u32 - self.second_low);
        ((first << self.second_bits | second) << self.place_bits) | place as u64
    }

    /// Brings a chunk into the order of the buckets; of each bucket writes where it ends.
    fn deal(&self, keys: &[u64], start: usize, dealt: &mut [u64], ends: &mut [u32]) {
        ends.fill(0);
        for &key in keys {
            ends[self.bucket(key)] += 1;
        }
        starts_of_counts(ends);
        for (place, &key) in (start..).zip(keys) {
            let end = &mut ends[self.bucket(key)];
            dealt[*end as usize] = self.pack(key, place);
            *end += 1;
        }
    }

    /// Sorts the keys of a bucket, which come in several lists. `other` is room for as many.
    fn sort<'a>(&self, lists: impl Iterator<Item = &'a [u64]>, sorted: &mut [u64], other: &mut [u64]) {
        let bits = self.width_bits + self.second_bits;
        let digit_count = bits.div_ceil(DIGIT_BITS).max(1);
        let digit_bits = bits.div_ceil(digit_count);
        let is_short = sorted.len() < FEWEST_COUNTED;
        // Every digit brings the keys from one of the lists to the other one.
        let (mut from, mut to) =
            if is_short || digit_count.is_multiple_of(2) { (sorted, other) } else { (other, sorted) };
        let mut rest = &mut *from;
        for list in lists {
            let (own, later) = std::mem::take(&mut rest).split_at_mut(list.len());
            own.copy_from_slice(list);
            rest = later;
        }
        if is_short {
            from.sort_unstable();
            return;
        }
        let mut counts = [0; 1 << DIGIT_BITS];
        let counts = &mut counts[..1 << digit_bits];
        for place in 0..digit_count {
            let shift = self.place_bits + place * digit_bits;
            let mask = counts.len() - 1;
            counts.fill(0);
            for &key in &*from {
                counts[(key >> shift) as usize & mask] += 1;
            }
            starts_of_counts(counts);
            for &key in &*from {
                let end = &mut counts[(key >> shift) as usize & mask];
                to[*end as usize] = key;
                *end += 1;
            }
            (from, to) = (to, from);
        }
    }
}

/// Turns how many there are of each into where each starts.
fn starts_of_counts(counts: &mut [u32]) {
    let mut start = 0;
    for count in counts {
        start += std::mem::replace(count, start);
    }
}

/// Consecutive places of a list in its order.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a> {
    keys: &'a [u64],
    place_bits: u32,
}

impl<'a> Places<'a> {
    /// How many there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// One after the other.
    pub fn iter(&self) -> impl Iterator<Item = usize> + use<'a> {
        let mask = (1 << self.place_bits) - 1;
        self.keys.iter().map(move |key| (key & mask) as usize)
    }
}

/// How long a part of the sorted list is, and how many of it stay.
#[derive(Clone, Copy, Debug, Default)]
struct Part {
    length: usize,
    kept: usize,
}

/// The order of a list. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct KeyOrder {
    listed: Vec<u64>,
    ranges: Vec<Ranges>,
    dealt: Vec<u64>,
    /// Of each chunk, where its part of each bucket ends.
    ends: Vec<u32>,
    /// Where each bucket begins in the sorted list, and where the last one ends.
    starts: Vec<usize>,
    sorted: Vec<u64>,
    parts: Vec<Part>,
    place_bits: u32,
}

impl KeyOrder {
    /// Room for the keys of as many records, to be written before they are arranged.
    pub fn keys(&mut self, count: usize) -> &mut [u64] {
        self.listed.resize(count, 0);
        &mut self.listed
    }

    /// Arranges the listed keys, which are lost by that: by key, those with the same key by place. Each key stays once
    /// where there is `replaces`, which is asked whether a later place is to stay instead of an earlier one.
    pub fn arrange(&mut self, share: &impl Share, replaces: Option<&(dyn Fn(usize, usize) -> bool + Sync)>) {
        let count = self.listed.len();
        self.parts.clear();
        self.sorted.resize(count, 0);
        let chunk_count = count.div_ceil(CHUNK);
        self.ranges.resize(chunk_count, Ranges::EMPTY);
        share.hand_out(self.listed.chunks(CHUNK).zip(&mut self.ranges), count / RECORDS_OF_ONE, |(keys, ranges)| {
            *ranges = Ranges::of(keys);
        });
        let ranges = self.ranges.iter().fold(Ranges::EMPTY, |all, ranges| all.union(ranges));
        match Packing::of(&ranges, count) {
            Some(packing) if count > 0 => {
                self.deal(&packing, share);
                self.sort(&packing, share, replaces);
            }
            _ => self.arrange_by_comparison(replaces),
        }
    }

    fn deal(&mut self, packing: &Packing, share: &impl Share) {
        let Self { listed, dealt, ends, starts, .. } = self;
        let most_threads = listed.len() / RECORDS_OF_ONE;
        let chunk_count = listed.len().div_ceil(CHUNK);
        dealt.resize(listed.len(), 0);
        ends.resize(chunk_count * packing.bucket_count, 0);
        let dealt = dealt.chunks_mut(CHUNK).zip(ends.chunks_mut(packing.bucket_count));
        share.hand_out(listed.chunks(CHUNK).zip(dealt).enumerate(), most_threads, |(chunk, (keys, (dealt, ends)))| {
            packing.deal(keys, chunk * CHUNK, dealt, ends);
        });
        starts.clear();
        starts.resize(packing.bucket_count + 1, 0);
        for ends in ends.chunks(packing.bucket_count) {
            // Where a bucket ends in each of the chunks amounts to where it ends in all.
            for (start, &end) in starts[1..].iter_mut().zip(ends) {
                *start += end as usize;
            }
        }
    }

    fn sort(
        &mut self,
        packing: &Packing,
        share: &impl Share,
        replaces: Option<&(dyn Fn(usize, usize) -> bool + Sync)>,
    ) {
        let Self { listed, dealt, ends, starts, sorted, parts, .. } = self;
        let most_threads = listed.len() / RECORDS_OF_ONE;
        self.place_bits = packing.place_bits;
        let lists_of = |bucket: usize| {
            dealt.chunks(CHUNK).zip(ends.chunks(packing.bucket_count)).map(move |(dealt, ends)| {
                let start = bucket.checked_sub(1).map_or(0, |before| ends[before]);
                &dealt[start as usize..ends[bucket] as usize]
            })
        };
        let part_count = packing.bucket_count.div_ceil(BUCKETS_AT_ONCE);
        parts.resize(part_count, Part::default());
        let mut rest = (&mut sorted[..], &mut listed[..]);
        let tasks = parts.iter_mut().enumerate().map(|(number, part)| {
            let first = number * BUCKETS_AT_ONCE;
            let last = (first + BUCKETS_AT_ONCE).min(packing.bucket_count);
            part.length = starts[last] - starts[first];
            let (sorted, other) = std::mem::take(&mut rest);
            let ((sorted, later), (other, other_later)) =
                (sorted.split_at_mut(part.length), other.split_at_mut(part.length));
            rest = (later, other_later);
            (first..last, sorted, other, part)
        });
        share.hand_out(tasks, most_threads, |(buckets, sorted, other, part)| {
            let start = starts[buckets.start];
            part.kept = 0;
            for bucket in buckets {
                let own = starts[bucket] - start..starts[bucket + 1] - start;
                packing.sort(lists_of(bucket), &mut sorted[own.clone()], &mut other[own.clone()]);
                let mask = (1 << packing.place_bits) - 1;
                // Packed keys are those of their bucket.
                part.kept = keep_some(sorted, part.kept, own, replaces, mask, |one, other| (one ^ other) <= mask);
            }
        });
    }

    /// For keys of which no packed form has room.
    fn arrange_by_comparison(&mut self, replaces: Option<&(dyn Fn(usize, usize) -> bool + Sync)>) {
        let Self { listed, sorted, .. } = self;
        for (place, sorted) in (0..).zip(&mut *sorted) {
            *sorted = place;
        }
        sorted.sort_unstable_by_key(|&place| (listed[place as usize], place));
        let is_same = |one: u64, other: u64| listed[one as usize] == listed[other as usize];
        let length = sorted.len();
        let kept = keep_some(sorted, 0, 0..length, replaces, u64::MAX, is_same);
        self.place_bits = u32::BITS;
        self.parts.push(Part { length, kept });
    }

    /// How many stay.
    #[must_use]
    pub fn count(&self) -> usize {
        self.parts.iter().map(|part| part.kept).sum()
    }

    /// The places of what stays, in their order, in parts that are not empty.
    pub fn parts(&self) -> impl Iterator<Item = Places<'_>> {
        let mut rest = &self.sorted[..];
        let parts = self.parts.iter().map(move |part| {
            let (own, later) = rest.split_at(part.length);
            rest = later;
            Places { keys: &own[..part.kept], place_bits: self.place_bits }
        });
        parts.filter(|part| !part.is_empty())
    }
}

/// Moves what stays of the sorted keys `from` behind the first `kept`. Returns how many stay with these.
fn keep_some(
    sorted: &mut [u64],
    mut kept: usize,
    from: std::ops::Range<usize>,
    replaces: Option<&(dyn Fn(usize, usize) -> bool + Sync)>,
    mask: u64,
    is_same: impl Fn(u64, u64) -> bool,
) -> usize {
    let first = kept;
    for place in from {
        let entry = sorted[place];
        match replaces {
            Some(replaces) if kept > first && is_same(entry, sorted[kept - 1]) => {
                if replaces((entry & mask) as usize, (sorted[kept - 1] & mask) as usize) {
                    sorted[kept - 1] = entry;
                }
            }
            _ => {
                sorted[kept] = entry;
                kept += 1;
            }
        }
    }
    kept
}
