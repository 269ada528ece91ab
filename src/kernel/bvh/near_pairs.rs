//! Pairs of triangles that may come within range, each with a lower bound of its distance, kept while their meshes
//! move.
//!
//! The distance of two triangles shrinks at most by the motion of their meshes. A bound is stored as if it had been
//! found when the list was made, by adding the motion from then on. A pair need not be tested before the motion uses up
//! what its bound has beyond the range. A tested pair gets a new bound, from gaps between the triangles or from an
//! exact distance.

mod closer_look;

pub use self::closer_look::ListedTriangles;
use crate::kernel::capacity;

/// A list of pairs and bounds. All lengths are in the unit of the pairs' frame. The motion is the motion since the list
/// was made.
#[derive(Clone, Debug, Default)]
pub struct BoundedPairs {
    firsts: Vec<u32>,
    seconds: Vec<u32>,
    /// Lower bound of the distance, plus the motion at which it was found.
    bounds: Vec<f32>,
}

impl BoundedPairs {
    /// Clears the list and keeps its memory.
    pub fn clear(&mut self) {
        self.firsts.clear();
        self.seconds.clear();
        self.bounds.clear();
    }

    /// Clears the list and keeps capacity for about as many pairs as it held.
    pub(crate) fn clear_room(&mut self) {
        capacity::clear(&mut self.firsts);
        capacity::clear(&mut self.seconds);
        capacity::clear(&mut self.bounds);
    }

    /// The number of pairs.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bounds.len()
    }

    /// Whether the list has no pairs.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bounds.is_empty()
    }

    /// The pairs.
    pub fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        self.firsts.iter().zip(&self.seconds).map(|(&first, &second)| [first, second])
    }

    /// Appends pairs with lower bounds of their distances, found before any motion.
    pub fn extend_from_slices(&mut self, firsts: &[u32], seconds: &[u32], bounds: &[f32]) {
        self.firsts.extend_from_slice(firsts);
        self.seconds.extend_from_slice(seconds);
        self.bounds.extend_from_slice(bounds);
    }

    /// Appends the results of a later part of a traversal.
    pub fn append(&mut self, later: &mut Self) {
        self.firsts.append(&mut later.firsts);
        self.seconds.append(&mut later.seconds);
        self.bounds.append(&mut later.bounds);
    }

    /// Swaps the triangles of every pair.
    pub fn reverse(&mut self) {
        std::mem::swap(&mut self.firsts, &mut self.seconds);
    }

    /// Sorts the pairs by their triangles, so that the results are sorted too. Both surfaces have at most `triangles`
    /// triangles.
    pub fn sort(&mut self, triangles: usize) {
        // One number per first triangle: where its pairs begin, and in the end where they end.
        let mut places = vec![0_u32; triangles];
        for &first in &self.firsts {
            places[first as usize] += 1;
        }
        let mut start = 0;
        for place in &mut places {
            start += std::mem::replace(place, start);
        }
        // Sorts single numbers, with the second triangle in the upper half. Few pairs have the same first triangle, and
        // no two of those the same second.
        let mut seconds_and_bounds = vec![0_u64; self.len()];
        for ((&first, &second), &bound) in self.firsts.iter().zip(&self.seconds).zip(&self.bounds) {
            let place = &mut places[first as usize];
            seconds_and_bounds[*place as usize] = u64::from(second) << u32::BITS | u64::from(bound.to_bits());
            *place += 1;
        }
        let mut start = 0;
        for (first, end) in (0..).zip(places) {
            let own = start..end as usize;
            start = own.end;
            self.firsts[own.clone()].fill(first);
            seconds_and_bounds[own].sort_unstable();
        }
        for ((second, bound), number) in self.seconds.iter_mut().zip(&mut self.bounds).zip(seconds_and_bounds) {
            (*second, *bound) = ((number >> u32::BITS) as u32, f32::from_bits(number as u32));
        }
    }

    /// Appends the pairs whose bounds do not exceed `limit`, the range plus the motion, and their indices in the list.
    /// A NaN bound exceeds nothing.
    pub fn append_near(&self, limit: f32, near: &mut Vec<[u32; 2]>, places: &mut Vec<u32>) {
        /// Which pairs are near is unpredictable, so all are written, and the next ones overwrite those that are not.
        const ROOM: usize = 512;
        let (mut recent, mut recent_places) = ([[0; 2]; ROOM], [0; ROOM]);
        let mut place = 0;
        let chunks = self.firsts.chunks(ROOM).zip(self.seconds.chunks(ROOM)).zip(self.bounds.chunks(ROOM));
        for ((firsts, seconds), bounds) in chunks {
            let mut count = 0;
            for ((&first, &second), &bound) in firsts.iter().zip(seconds).zip(bounds) {
                recent[count % ROOM] = [first, second];
                recent_places[count % ROOM] = place;
                place += 1;
                count += usize::from(is_near(bound, limit));
            }
            near.extend_from_slice(&recent[..count]);
            places.extend_from_slice(&recent_places[..count]);
        }
    }

    /// Stores new lower bounds for the pairs at some indices, in the same order, found after `motion`. Does nothing if
    /// the numbers of indices and bounds differ.
    pub fn learn(&mut self, places: &[u32], motion: f32, found: &[f32]) {
        if places.len() != found.len() {
            return;
        }
        for (&place, &bound) in places.iter().zip(found) {
            self.bounds[place as usize] = bound + motion;
        }
    }
}

fn is_near(bound: f32, limit: f32) -> bool {
    bound <= limit || bound.is_nan()
}
