//! Sorts pairs of triangles into the order of the contacts they may give.
//!
//! Eight bytes a pair are moved rather than whole contacts: the sphere stages sort what overlaps, and make contacts in
//! order. A radix sort, least significant digit first.

use super::{prefetch::prefetch, share::Share};

/// Least bits of a digit: the counts of its values stay in the first cache.
const LEAST_DIGIT: u32 = 12;

/// Shorter lists are sorted by comparisons.
const SHORT: usize = 256;

/// How many pairs ahead the place is asked for that one is written to: with its neighbors it moves on until then, but
/// hardly ever beyond the line of the cache.
const AHEAD: usize = 64;

/// Room to sort in, kept from list to list.
#[derive(Clone, Debug, Default)]
pub struct PairSorter {
    between: Vec<[u32; 2]>,
    places: Vec<u32>,
    sorted: Vec<[u32; 2]>,
}

impl PairSorter {
    /// Sorts `pairs` by their contacts' [keys](super::contact::ContactKey): by the first triangle, then by the second; of a
    /// surface with itself (`same_surface`) by the lower one, then by the higher.
    pub fn sort(&mut self, pairs: &mut Vec<[u32; 2]>, same_surface: bool) {
        if same_surface && pairs.iter().any(|&[a, b]| b < a) {
            pairs.sort_unstable_by_key(|&[a, b]| (a.min(b), a.max(b), a));
        } else if pairs.len() < SHORT {
            pairs.sort_unstable();
        } else if !pairs.is_sorted() {
            let largest = pairs.iter().fold([0; 2], |largest, pair| [0, 1].map(|side| pair[side].max(largest[side])));
            let bits = largest.map(|largest| u32::BITS - largest.leading_zeros());
            let all_bits = bits[0] + bits[1];
            // Neighbors in the list are neighbors in space, so that a digit of as many values as there are pairs costs less
            // than one more pass over them.
            let digits = all_bits.div_ceil(pairs.len().ilog2().max(LEAST_DIGIT));
            let width = all_bits.div_ceil(digits);
            self.between.resize(pairs.len(), [0; 2]);
            for digit in 0..digits {
                self.distribute(pairs, bits[1], digit * width, width);
                std::mem::swap(pairs, &mut self.between);
            }
        }
    }

    /// `pairs` in the order of their triangles, each once; of a surface with itself the lower one first. The list itself
    /// where it is in order.
    pub fn sorted<'a>(&'a mut self, pairs: &'a [[u32; 2]], same_surface: bool, _share: &impl Share) -> &'a [[u32; 2]] {
        if pairs.is_sorted_by(|one, other| one < other) && !(same_surface && pairs.iter().any(|&[a, b]| b < a)) {
            return pairs;
        }
        let mut list = std::mem::take(&mut self.sorted);
        list.clear();
        list.extend(pairs.iter().map(|&[a, b]| if same_surface && b < a { [b, a] } else { [a, b] }));
        self.sort(&mut list, same_surface);
        list.dedup();
        self.sorted = list;
        &self.sorted
    }

    /// Writes `pairs` between, sorted by `width` bits from `shift` on of the number whose lower `low` bits are the second
    /// triangle, and the others the first; equals keep their order.
    fn distribute(&mut self, pairs: &[[u32; 2]], low: u32, shift: u32, width: u32) {
        let Self { between, places, .. } = self;
        let mask = (1 << width) - 1;
        let digit = |&[first, second]: &[u32; 2]| {
            let number = (u64::from(first) << low) | u64::from(second);
            ((number >> shift) & mask) as usize
        };
        places.clear();
        places.resize(1 << width, 0);
        for pair in pairs {
            places[digit(pair)] += 1;
        }
        let mut next = 0;
        for place in &mut *places {
            next += std::mem::replace(place, next);
        }
        for (here, pair) in pairs.iter().enumerate() {
            if let Some(later) = pairs.get(here + AHEAD) {
                prefetch(between, places[digit(later)]);
            }
            let place = &mut places[digit(pair)];
            between[*place as usize] = *pair;
            *place += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that look random, below `end`.
    fn numbers(count: usize, end: u32) -> impl Iterator<Item = u32> {
        (0..count as u64)
            .map(move |place| ((place * 2_654_435_761 + place * place * 40_503) % 4_294_967_291) as u32 % end)
    }

    #[test]
    fn pairs_come_out_as_a_comparison_sorts_them() {
        let mut sorter = PairSorter::default();
        for count in [0, 1, 2, SHORT - 1, SHORT, 5_000, 100_000] {
            for end in [1, 2, 300, 92_230, 1 << 28] {
                for same_surface in [false, true] {
                    let second = numbers(2 * count, end).skip(count);
                    let mut pairs: Vec<[u32; 2]> = numbers(count, end).zip(second).map(<[u32; 2]>::from).collect();
                    let mut expected = pairs.clone();
                    if same_surface {
                        expected.sort_by_key(|&[a, b]| (a.min(b), a.max(b), a));
                    } else {
                        expected.sort_unstable();
                    }
                    assert!(count < SHORT || end < 300 || pairs != expected, "there is something to sort");
                    sorter.sort(&mut pairs, same_surface);
                    assert!(pairs == expected, "{count} pairs below {end}");
                    // Lower triangle first, as broad phases list them: not by comparisons.
                    let mut ordered: Vec<[u32; 2]> = pairs.iter().rev().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
                    let mut expected = ordered.clone();
                    expected.sort_unstable();
                    sorter.sort(&mut ordered, same_surface);
                    assert!(ordered == expected, "{count} pairs below {end}");
                }
            }
        }
    }
}
