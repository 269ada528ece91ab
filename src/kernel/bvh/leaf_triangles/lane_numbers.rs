//! Permutes the numbers of eight lanes.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256, __m256i, _mm256_permutevar8x32_ps};

use fearless_simd::{f32x8, prelude::*, u32x8};

/// The indices of eight lanes, 0 to 7.
#[derive(Clone, Copy)]
pub(super) struct LaneNumbers<S: Simd>(pub(super) u32x8<S>);

#[cfg(target_arch = "x86_64")]
fearless_simd::kernel!(
    #[cfg_attr(not(unoptimized), inline(always))]
    fn permuted(avx2: Avx2, numbers: __m256, lanes: __m256i) -> __m256 {
        _mm256_permutevar8x32_ps(numbers, lanes)
    }
);

impl<S: Simd> LaneNumbers<S> {
    /// The numbers of these lanes.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn of(self, numbers: f32x8<S>) -> f32x8<S> {
        let Self(lanes) = self;
        // One instruction. Permuting the bytes of a vector is one instruction on later processors only, and four here.
        #[cfg(target_arch = "x86_64")]
        if let fearless_simd::Level::Avx2(avx2) = lanes.simd.level() {
            return permuted(avx2, numbers.into(), lanes.into()).simd_into(lanes.simd);
        }
        // A lane is four bytes wide.
        numbers.swizzle_dyn((lanes * 0x0404_0404 + u32::from_ne_bytes([0, 1, 2, 3])).to_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::simd::lanes::by_all_instructions;

    fn permuted_by<S: Simd>(simd: S) {
        let numbers = [1.5, -2.0, f32::NAN, 4.0e-40, 5.0e30, -0.0, 7.0, f32::INFINITY];
        for seed in 0..64_u32 {
            let lanes: [u32; 8] = std::array::from_fn(|lane| (seed / 8 * lane as u32 + seed) % 8);
            let mut found = [0.0; 8];
            LaneNumbers(u32x8::from_slice(simd, &lanes)).of(f32x8::from_slice(simd, &numbers)).store_slice(&mut found);
            let expected = lanes.map(|lane| numbers[lane as usize].to_bits());
            assert_eq!(found.map(f32::to_bits), expected, "{lanes:?} by {:?}", simd.level());
        }
    }

    #[test]
    fn numbers_go_to_the_lanes_that_ask_for_them_by_any_instructions() {
        by_all_instructions!(permuted_by);
    }
}
