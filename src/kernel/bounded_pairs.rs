//! Pairs of triangles that may come within range, each with a lower bound of its distance, kept while their meshes move.
//!
//! Two triangles that were a distance apart are at least that less by what their meshes have moved since. So a bound is
//! stored as if it had been found when the list was made, by adding the motion from then on, and a pair need not be looked
//! at before the motion uses up what its bound has beyond the range. What is looked at is given a new bound.

/// A list of pairs and bounds. All lengths are in the unit of the pairs' frame; the motion is that since the list was
/// made.
#[derive(Clone, Debug, Default)]
pub struct BoundedPairs {
    firsts: Vec<u32>,
    seconds: Vec<u32>,
    /// Of the distance, plus the motion at which it was found.
    bounds: Vec<f32>,
}

impl BoundedPairs {
    /// Empties the list and keeps its memory.
    pub fn clear(&mut self) {
        self.firsts.clear();
        self.seconds.clear();
        self.bounds.clear();
    }

    /// How many pairs there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bounds.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bounds.is_empty()
    }

    /// The pairs.
    pub fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        self.firsts.iter().zip(&self.seconds).map(|(&first, &second)| [first, second])
    }

    /// Appends pairs with lower bounds of their distances, before there is any motion.
    pub fn extend_from_slices(&mut self, firsts: &[u32], seconds: &[u32], bounds: &[f32]) {
        self.firsts.extend_from_slice(firsts);
        self.seconds.extend_from_slice(seconds);
        self.bounds.extend_from_slice(bounds);
    }

    /// Appends what a later part of a traversal has found.
    pub fn append(&mut self, later: &mut Self) {
        self.firsts.append(&mut later.firsts);
        self.seconds.append(&mut later.seconds);
        self.bounds.append(&mut later.bounds);
    }

    /// Names the second triangle of every pair first.
    pub fn reverse(&mut self) {
        std::mem::swap(&mut self.firsts, &mut self.seconds);
    }

    /// Sorts the pairs by their triangles, of which either surface has no more than `triangles`: so what is found of them is
    /// sorted, too.
    pub fn sort(&mut self, triangles: usize) {
        let numbers = self.firsts.iter().zip(&self.seconds).zip(&self.bounds);
        let mut records: Vec<(u32, u32, f32)> =
            numbers.map(|((&first, &second), &bound)| (first, second, bound)).collect();
        let (mut between, mut counts) = (records.clone(), Vec::new());
        scatter(&records, &mut between, &mut counts, triangles, |(_, second, _)| second as usize);
        scatter(&between, &mut records, &mut counts, triangles, |(first, ..)| first as usize);
        for (place, (first, second, bound)) in records.into_iter().enumerate() {
            (self.firsts[place], self.seconds[place], self.bounds[place]) = (first, second, bound);
        }
    }

    /// Appends the pairs whose bounds do not exceed `limit`: the range, plus the motion. A bound that is no number exceeds
    /// nothing.
    pub fn append_near(&self, limit: f32, near: &mut Vec<[u32; 2]>) {
        /// Which pairs are near is hard to foresee: so all are written, and the next ones over those that are not.
        const ROOM: usize = 512;
        let mut recent = [[0; 2]; ROOM];
        let chunks = self.firsts.chunks(ROOM).zip(self.seconds.chunks(ROOM)).zip(self.bounds.chunks(ROOM));
        for ((firsts, seconds), bounds) in chunks {
            let mut count = 0;
            for ((&first, &second), &bound) in firsts.iter().zip(seconds).zip(bounds) {
                recent[count % ROOM] = [first, second];
                count += usize::from(is_near(bound, limit));
            }
            near.extend_from_slice(&recent[..count]);
        }
    }

    /// Gives the pairs that [`append_near`](Self::append_near) gave for the same `limit` the lower bounds that have been
    /// found of their distances, in the same order, after `motion`. Where there are more or fewer, nothing is learned.
    pub fn learn(&mut self, limit: f32, motion: f32, found: &[f32]) {
        let near = self.bounds.iter().filter(|&&bound| is_near(bound, limit)).count();
        if near != found.len() {
            return;
        }
        let Some(&last) = found.last() else { return };
        let mut next = 0;
        for bound in &mut self.bounds {
            let learned = found.get(next).copied().unwrap_or(last) + motion;
            let is_near = is_near(*bound, limit);
            *bound = if is_near { learned } else { *bound };
            next += usize::from(is_near);
        }
    }
}

/// Copies records into the order of their numbers, which are less than `count`; those with the same number stay in their
/// order.
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

fn is_near(bound: f32, limit: f32) -> bool {
    bound <= limit || bound.is_nan()
}
