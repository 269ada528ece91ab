//! Sorts pairs of triangles into the order of the contacts they may give.
//!
//! Eight bytes a pair are moved rather than whole contacts: the sphere stages sort what overlaps, and make contacts in
//! order. A radix sort, least significant digit first.

/// Bits of a digit: one count for each of its values stays in the first cache.
const LARGEST_DIGIT: u32 = 10;

/// Shorter lists are sorted by comparisons.
const SHORT: usize = 256;

/// Sorts `pairs` by their contacts' [keys](super::contact::ContactKey): by the first triangle, then by the second; of a
/// surface with itself (`same_surface`) by the lower one, then by the higher. `spare` is room to work in.
pub fn sort_pairs(pairs: &mut Vec<[u32; 2]>, same_surface: bool, spare: &mut Vec<[u32; 2]>) {
    if same_surface && pairs.iter().any(|&[a, b]| b < a) {
        pairs.sort_unstable_by_key(|&[a, b]| (a.min(b), a.max(b), a));
    } else if pairs.len() < SHORT {
        pairs.sort_unstable();
    } else if !pairs.is_sorted() {
        spare.resize(pairs.len(), [0; 2]);
        let largest =
            pairs.iter().fold([0; 2], |largest: [u32; 2], pair| [largest[0].max(pair[0]), largest[1].max(pair[1])]);
        for side in [1, 0] {
            let bits = u32::BITS - largest[side].leading_zeros();
            let digits = bits.div_ceil(LARGEST_DIGIT);
            for digit in 0..digits {
                let width = bits.div_ceil(digits);
                distribute(pairs, spare, side, digit * width, width);
                std::mem::swap(pairs, spare);
            }
        }
    }
}

/// Writes `pairs` into `sorted`, sorted by `width` bits from `shift` on of one of their triangles; equals keep their order.
fn distribute(pairs: &[[u32; 2]], sorted: &mut [[u32; 2]], side: usize, shift: u32, width: u32) {
    let mut places = [0u32; 1 << LARGEST_DIGIT];
    let digit = |pair: &[u32; 2]| (pair[side] >> shift & ((1 << width) - 1)) as usize % (1 << LARGEST_DIGIT);
    for pair in pairs {
        places[digit(pair)] += 1;
    }
    let mut next = 0;
    for place in &mut places {
        next += std::mem::replace(place, next);
    }
    for pair in pairs {
        let place = &mut places[digit(pair)];
        sorted[*place as usize] = *pair;
        *place += 1;
    }
}
