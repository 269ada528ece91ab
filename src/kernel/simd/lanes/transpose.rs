//! Transposes rows in memory into lanes, and back.
//!
//! Works in 4×4 blocks, one in each half of a vector, and crosses the halves at most once: crossing takes three times
//! as long on some processors, and waits for the only unit that can do it on others.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256, _mm256_shuffle_ps, _mm256_unpackhi_ps, _mm256_unpacklo_ps};

use fearless_simd::{f32x4, f32x8, prelude::*};

use super::WIDTH;

/// Transposes eight rows of four numbers.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn columns<S: Simd>([a, b, c, d, e, f, g, h]: [f32x4<S>; WIDTH]) -> [f32x8<S>; 4] {
    halves_transposed([a.combine(e), b.combine(f), c.combine(g), d.combine(h)])
}

/// Transposes back into eight rows.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn rows<S: Simd>(columns: [f32x8<S>; 4]) -> [f32x4<S>; WIDTH] {
    let [a, b, c, d] = halves_transposed(columns);
    let ((a, e), (b, f), (c, g), (d, h)) = (a.split(), b.split(), c.split(), d.split());
    [a, b, c, d, e, f, g, h]
}

/// Transposes four numbers of each of eight rows in memory, starting with `FIRST`.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn columns_from<const FIRST: usize, S: Simd>(simd: S, rows: [&[f32]; WIDTH]) -> [f32x8<S>; 4] {
    let mut part = [f32x4::splat(simd, 0.0); WIDTH];
    for lane in 0..WIDTH {
        part[lane] = f32x4::from_slice(simd, &rows[lane][FIRST..FIRST + 4]);
    }
    columns(part)
}

/// Transposes eight rows of eight numbers.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn transposed<S: Simd>([a, b, c, d, e, f, g, h]: [f32x8<S>; WIDTH]) -> [f32x8<S>; WIDTH] {
    let [a, b, c, d] = halves_transposed([a, b, c, d]);
    let [e, f, g, h] = halves_transposed([e, f, g, h]);
    let ((a, other_a), (b, other_b), (c, other_c), (d, other_d)) = (a.split(), b.split(), c.split(), d.split());
    let ((e, other_e), (f, other_f), (g, other_g), (h, other_h)) = (e.split(), f.split(), g.split(), h.split());
    [
        a.combine(e),
        b.combine(f),
        c.combine(g),
        d.combine(h),
        other_a.combine(other_e),
        other_b.combine(other_f),
        other_c.combine(other_g),
        other_d.combine(other_h),
    ]
}

/// Transposes the block in the lower halves of four vectors, and the block in the upper halves.
#[cfg_attr(not(unoptimized), inline(always))]
fn halves_transposed<S: Simd>([a, b, c, d]: [f32x8<S>; 4]) -> [f32x8<S>; 4] {
    // Eight instructions. One half by itself takes eight too, and both would have to be split and joined again.
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = a.simd.level().as_avx2() {
        let simd = a.simd;
        let [x, y, z, w] = halves_transposed_by_avx2(avx2, a.into(), b.into(), c.into(), d.into());
        return [x.simd_into(simd), y.simd_into(simd), z.simd_into(simd), w.simd_into(simd)];
    }
    let ((a, e), (b, f), (c, g), (d, h)) = (a.split(), b.split(), c.split(), d.split());
    let ([x, y, z, w], [other_x, other_y, other_z, other_w]) =
        (square_transposed([a, b, c, d]), square_transposed([e, f, g, h]));
    [x.combine(other_x), y.combine(other_y), z.combine(other_z), w.combine(other_w)]
}

#[cfg(target_arch = "x86_64")]
fearless_simd::kernel!(
    #[cfg_attr(not(unoptimized), inline(always))]
    fn halves_transposed_by_avx2(avx2: Avx2, a: __m256, b: __m256, c: __m256, d: __m256) -> [__m256; 4] {
        const FIRST: i32 = 0b01_00_01_00;
        const SECOND: i32 = 0b11_10_11_10;
        let (xy_ab, zw_ab) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
        let (xy_cd, zw_cd) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
        [
            _mm256_shuffle_ps::<FIRST>(xy_ab, xy_cd),
            _mm256_shuffle_ps::<SECOND>(xy_ab, xy_cd),
            _mm256_shuffle_ps::<FIRST>(zw_ab, zw_cd),
            _mm256_shuffle_ps::<SECOND>(zw_ab, zw_cd),
        ]
    }
);

#[cfg_attr(not(unoptimized), inline(always))]
fn square_transposed<S: Simd>([a, b, c, d]: [f32x4<S>; 4]) -> [f32x4<S>; 4] {
    let ((low, high), (other_low, other_high)) = (a.interleave(c), b.interleave(d));
    let ((x, y), (z, w)) = (low.interleave(other_low), high.interleave(other_high));
    [x, y, z, w]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::simd::lanes::by_all_instructions;

    /// Different numbers, including some that no arithmetic would preserve: NaN, negative zero, and a subnormal number.
    fn number(row: usize, column: usize) -> f32 {
        match (row, column) {
            (2, 3) => f32::NAN,
            (5, 0) => -0.0,
            (7, 6) => f32::from_bits(1),
            _ => (100 * row + column) as f32,
        }
    }

    fn assert_column<S: Simd>(column: f32x8<S>, place: usize) {
        let found = <[f32; WIDTH]>::from(column).map(f32::to_bits);
        let expected: [u32; WIDTH] = std::array::from_fn(|row| number(row, place).to_bits());
        assert_eq!(found, expected, "column {place} by {:?}", column.simd.level());
    }

    fn turn<S: Simd>(simd: S) {
        let table: [[f32; WIDTH]; WIDTH] = std::array::from_fn(|row| std::array::from_fn(|place| number(row, place)));
        let whole = transposed(table.map(|row| f32x8::from_slice(simd, &row)));
        for (place, column) in whole.into_iter().enumerate() {
            assert_column(column, place);
        }
        let slices: [&[f32]; WIDTH] = std::array::from_fn(|row| &table[row][..]);
        for (place, column) in columns_from::<4, S>(simd, slices).into_iter().enumerate() {
            assert_column(column, 4 + place);
        }
        let part = columns(table.map(|row| f32x4::from_slice(simd, &row[..4])));
        for (place, column) in part.into_iter().enumerate() {
            assert_column(column, place);
        }
        let back = rows(part).map(|row| <[f32; 4]>::from(row).map(f32::to_bits));
        assert_eq!(back, table.map(|row| [row[0], row[1], row[2], row[3]].map(f32::to_bits)));
    }

    #[test]
    fn rows_become_columns_and_rows_again_by_any_instructions() {
        by_all_instructions!(turn);
    }
}
