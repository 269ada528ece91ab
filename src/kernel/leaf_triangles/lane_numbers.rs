//! Numbers of eight lanes in another order.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256, __m256i, _mm256_permutevar8x32_ps};

use fearless_simd::{Level, f32x8, prelude::*, u32x8};

/// Eight lanes by their numbers, 0 to 7.
#[derive(Clone, Copy)]
pub(super) struct LaneNumbers<S: Simd>(pub(super) u32x8<S>);

#[cfg(target_arch = "x86_64")]
fearless_simd::kernel!(
    #[inline(always)]
    fn permuted(avx2: Avx2, numbers: __m256, lanes: __m256i) -> __m256 {
        _mm256_permutevar8x32_ps(numbers, lanes)
    }
);

impl<S: Simd> LaneNumbers<S> {
    /// The numbers of those lanes.
    #[inline(always)]
    pub(super) fn of(self, numbers: f32x8<S>) -> f32x8<S> {
        let Self(lanes) = self;
        // One instruction. That for the bytes of a vector is one only on later processors, and four here.
        #[cfg(target_arch = "x86_64")]
        if let Level::Avx2(avx2) = lanes.simd.level() {
            return permuted(avx2, numbers.into(), lanes.into()).simd_into(lanes.simd);
        }
        // A lane's number is four bytes long.
        numbers.swizzle_dyn((lanes * 0x0404_0404 + 0x0302_0100).to_bytes())
    }
}
