//! Brings what was found of a pair of surfaces into the order of the store: contacts by key, each key once, and touching
//! triangles by their numbers.
//!
//! Reads the records where they were found and moves each of those that stay once, to where it belongs; what is sorted is
//! small. Where there are many, by counting how many start with the same feature, else by comparison.

use super::contact::{CompactContact, FEATURE_BITS, TouchingPair};

/// Counting visits every number between the lowest and the highest once: it pays up to this many of them a record.
const COUNTS_PER_RECORD: usize = 4;

/// Fewer records than these are sorted by comparison.
const FEWEST_COUNTED: usize = 64;

/// Longer runs of records with the same first feature are left to a sort that does not mind how long they are.
const LONGEST_INSERTION: usize = 24;

/// A contact's name and place: what is sorted instead of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entry {
    key: u64,
    triangle_a: u32,
    place: u32,
}

impl Entry {
    /// Kind and first feature.
    fn first(self) -> u64 {
        self.key >> FEATURE_BITS
    }
}

/// The order of a pair's contacts, in three steps: [`list`](Self::list), [`arrange`](Self::arrange), and for each
/// [part](Self::parts) [`finish`](Self::finish). The first and the last may be split among threads. Keeps its memory.
#[derive(Clone, Debug, Default)]
pub struct ContactOrder {
    entries: Vec<Entry>,
    listed: Vec<Entry>,
    counts: Vec<u32>,
}

impl ContactOrder {
    /// Room for the entries of as many contacts.
    pub fn listed(&mut self, count: usize) -> &mut [Entry] {
        self.listed.resize(count, Entry::default());
        &mut self.listed
    }

    /// Writes the entries of contacts, of which the first is at `start` in its list.
    pub fn list(contacts: &[CompactContact], start: usize, entries: &mut [Entry]) {
        for ((place, contact), entry) in (start as u32..).zip(contacts).zip(entries) {
            *entry = Entry { key: contact.key.0, triangle_a: contact.triangle_a, place };
        }
    }

    /// Brings the listed entries into the order of their first features, or into their last order straight away.
    pub fn arrange(&mut self) {
        let Self { entries, listed, counts } = self;
        let ranges = FirstFeatures::of(listed);
        if listed.len() < FEWEST_COUNTED || ranges.count > COUNTS_PER_RECORD * listed.len() {
            std::mem::swap(entries, listed);
            entries.sort_unstable_by_key(|entry| (entry.key, entry.place));
        } else {
            entries.resize(listed.len(), Entry::default());
            scatter(listed, entries, counts, ranges.count, |entry| ranges.number(entry.first()));
        }
    }

    /// The arranged entries in parts of about `length`, each of which can be finished without the others.
    pub fn parts(&mut self, length: usize) -> impl Iterator<Item = &mut [Entry]> {
        let mut rest = &mut *self.entries;
        std::iter::from_fn(move || {
            let mut end = length.min(rest.len());
            while end > 0 && end < rest.len() && rest[end].first() == rest[end - 1].first() {
                end += 1;
            }
            let (part, later) = std::mem::take(&mut rest).split_at_mut(end);
            rest = later;
            (!part.is_empty()).then_some(part)
        })
    }

    /// The entries as they are by now.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Sorts a part by key and moves to its front, of every key, the contact of the lowest triangles; of those with the
    /// same triangles the first that was found. Returns how many there are.
    pub fn finish(part: &mut [Entry], contacts: &[CompactContact]) -> usize {
        let mut start = 0;
        while start < part.len() {
            let first = part[start].first();
            let length = part[start..].iter().take_while(|entry| entry.first() == first).count();
            sort_run(&mut part[start..start + length], |entry| entry.key, |entry| (entry.key, entry.place));
            start += length;
        }
        let rank = |entry: Entry| (entry.triangle_a, contacts[entry.place as usize].triangle_b);
        let mut kept = 0;
        for place in 0..part.len() {
            let entry = part[place];
            match kept {
                0 => kept = 1,
                _ if part[kept - 1].key != entry.key => {
                    part[kept] = entry;
                    kept += 1;
                }
                _ if entry.triangle_a > part[kept - 1].triangle_a => {}
                _ if rank(entry) < rank(part[kept - 1]) => part[kept - 1] = entry,
                _ => {}
            }
        }
        kept
    }

    /// Copies the contacts of finished entries.
    pub fn copy(entries: &[Entry], contacts: &[CompactContact], sorted: &mut [CompactContact]) {
        for (entry, sorted) in entries.iter().zip(sorted) {
            *sorted = contacts[entry.place as usize];
        }
    }
}

/// Numbers kinds and first features without a gap between the kinds, in their order.
struct FirstFeatures {
    /// What to add to a feature of each kind, wrapping round.
    offsets: [u64; KINDS],
    count: usize,
}

/// Room for every number that a key has left for the kinds; there are nine.
const KINDS: usize = 16;

impl FirstFeatures {
    fn of(entries: &[Entry]) -> Self {
        let mut ranges = [(u64::MAX, 0); KINDS];
        for entry in entries {
            let first = entry.first();
            let range = &mut ranges[(first >> FEATURE_BITS) as usize];
            *range = (range.0.min(first), range.1.max(first));
        }
        let mut count = 0;
        let offsets = ranges.map(|(low, high)| {
            let offset = (count as u64).wrapping_sub(low);
            count += if low <= high { (high - low + 1) as usize } else { 0 };
            offset
        });
        Self { offsets, count }
    }

    fn number(&self, first: u64) -> usize {
        first.wrapping_add(self.offsets[(first >> FEATURE_BITS) as usize]) as usize
    }
}

/// Copies records into the order of their numbers, which are less than `count`; those with the same number stay in their
/// order.
#[inline]
fn scatter<T: Copy>(
    records: &[T],
    ordered: &mut [T],
    counts: &mut Vec<u32>,
    count: usize,
    number: impl Fn(T) -> usize,
) {
    counts.clear();
    counts.resize(count, 0);
    for &record in records {
        counts[number(record)] += 1;
    }
    let mut start = 0;
    for count in counts.iter_mut() {
        start += std::mem::replace(count, start);
    }
    for &record in records {
        let place = &mut counts[number(record)];
        ordered[*place as usize] = record;
        *place += 1;
    }
}

/// Sorts a run by key; records with the same key stay in the order that they have, which `whole` sorts by too.
#[inline]
fn sort_run<T: Copy, K: Ord, W: Ord>(run: &mut [T], key: impl Fn(&T) -> K, whole: impl Fn(&T) -> W) {
    if run.len() > LONGEST_INSERTION {
        run.sort_unstable_by_key(whole);
        return;
    }
    for place in 1..run.len() {
        let record = run[place];
        let mut to = place;
        while to > 0 && key(&run[to - 1]) > key(&record) {
            run[to] = run[to - 1];
            to -= 1;
        }
        run[to] = record;
    }
}

/// Copies touching pairs into the order of their triangles. `counts` is kept for its memory.
pub fn sort_touching(touching: &[TouchingPair], sorted: &mut [TouchingPair], counts: &mut Vec<u32>) {
    let (low, high) =
        touching.iter().fold((u32::MAX, 0), |(low, high), pair| (low.min(pair.triangle_a), high.max(pair.triangle_a)));
    let count = (high as usize + 1).saturating_sub(low as usize);
    let order = |pair: &TouchingPair| (pair.triangle_a, pair.triangle_b);
    if touching.len() < FEWEST_COUNTED || count > COUNTS_PER_RECORD * touching.len() {
        sorted.copy_from_slice(touching);
        sorted.sort_unstable_by_key(order);
        return;
    }
    scatter(touching, sorted, counts, count, |pair| (pair.triangle_a - low) as usize);
    let mut start = 0;
    while start < sorted.len() {
        let first = sorted[start].triangle_a;
        let length = sorted[start..].iter().take_while(|pair| pair.triangle_a == first).count();
        sort_run(&mut sorted[start..start + length], |pair| pair.triangle_b, |pair| pair.triangle_b);
        start += length;
    }
}
