//! Angles and their tangents, eight at a time, computed in f64 and rounded once.
//!
//! Uses only additions, multiplications, and divisions, so that the results are the same on every platform. The
//! coefficients interpolate the functions at Chebyshev nodes over the stated ranges (40 digits). The stated relative
//! errors are far below half a unit in the last place of f32, 6e-8.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use fearless_simd::{f32x8, f64x8, prelude::*};

use super::{rounded, widened};

/// tan(π/8). Above it, an angle is closer to π/4 than to 0.
const TAN_EIGHTH: f64 = 0.414_213_562_373_095_03;

/// atan(√z)/√z for z up to tan²(π/8), to 8e-13.
const ARC_TANGENT: [f64; 8] = [
    0.999_999_999_999_244_7,
    -0.333_333_332_769_224_94,
    0.199_999_930_535_558_15,
    -0.142_853_865_537_521_4,
    0.111_034_569_089_474_64,
    -0.089_925_529_061_509_12,
    0.069_741_976_865_952_65,
    -0.037_655_106_012_914_02,
];

/// sin(√z)/√z for z up to (π/4)², to 5e-12.
const SINE: [f64; 5] = [
    0.999_999_999_995_673_1,
    -0.166_666_666_315_911_65,
    0.008_333_328_782_458_88,
    -0.000_198_392_022_122_311,
    2.717_345_684_108_995_3e-6,
];

/// cos(√z) for z up to (π/4)², to 8e-14.
const COSINE: [f64; 6] = [
    0.999_999_999_999_944_4,
    -0.499_999_999_993_511_13,
    0.041_666_666_543_911_19,
    -0.001_388_888_039_377_642_4,
    2.479_892_875_532_366_7e-5,
    -2.717_342_984_102_282e-7,
];

#[cfg_attr(not(unoptimized), inline(always))]
fn polynomial<S: Simd, const COUNT: usize>(coefficients: &[f64; COUNT], z: f64x8<S>) -> f64x8<S> {
    let mut sum = f64x8::splat(z.simd, coefficients[COUNT - 1]);
    for power in (0..COUNT - 1).rev() {
        sum = sum * z + coefficients[power];
    }
    sum
}

/// The angle from the x axis to the direction (`x`, `y`), from −π to π; 0 if both are 0.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn arc_tangent<S: Simd>(y: f32x8<S>, x: f32x8<S>) -> f32x8<S> {
    let (y, x) = (widened(y), widened(x));
    let [zero, quarter, half] = [0.0, FRAC_PI_2, PI].map(|angle| f64x8::splat(y.simd, angle));
    let (height, width) = (y.abs(), x.abs());
    let (low, high) = (height.min(width), height.max(width));
    let beyond = low.simd_gt(high * TAN_EIGHTH);
    // The direction (0, 0) has no angle. It gets 0.
    let divisor = beyond.select(low + high, high).max(f64::MIN_POSITIVE);
    let ratio = beyond.select(low - high, low) / divisor;
    let start = beyond.select(f64x8::splat(y.simd, FRAC_PI_4), zero);
    let angle = start + ratio * polynomial(&ARC_TANGENT, ratio * ratio);
    let angle = height.simd_gt(width).select(quarter - angle, angle);
    let angle = x.simd_lt(0.0).select(half - angle, angle);
    rounded(angle.copysign(y))
}

/// Sine and cosine of angles from −π/4 to π/4.
#[cfg_attr(not(unoptimized), inline(always))]
fn small_sine_cosine<S: Simd>(angle: f64x8<S>) -> (f64x8<S>, f64x8<S>) {
    let squared = angle * angle;
    (angle * polynomial(&SINE, squared), polynomial(&COSINE, squared))
}

/// Sine and cosine of angles from 0 to 5π/4.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn sine_cosine<S: Simd>(angle: f32x8<S>) -> (f32x8<S>, f32x8<S>) {
    let angle = widened(angle);
    let half_circle = angle.simd_gt(3.0 * FRAC_PI_4);
    let quarter = angle.simd_gt(FRAC_PI_4);
    let [none, one, two] = [0.0, FRAC_PI_2, PI].map(|angle_of| f64x8::splat(angle.simd, angle_of));
    let from = half_circle.select(two, quarter.select(one, none));
    let (sine, cosine) = small_sine_cosine(angle - from);
    // A quarter turn maps a sine to a cosine, and a cosine to a negative sine. A half turn flips both signs.
    let turned_sine = quarter.select(cosine, sine);
    let turned_cosine = quarter.select(-sine, cosine);
    (rounded(half_circle.select(-sine, turned_sine)), rounded(half_circle.select(-cosine, turned_cosine)))
}

/// Tangent of angles from 0 to π/2.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn tangent<S: Simd>(angle: f32x8<S>) -> f32x8<S> {
    let angle = widened(angle);
    let steep = angle.simd_gt(FRAC_PI_4);
    let quarter = f64x8::splat(angle.simd, FRAC_PI_2);
    let (sine, cosine) = small_sine_cosine(steep.select(quarter - angle, angle));
    rounded(steep.select(cosine, sine) / steep.select(sine, cosine))
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::kernel::simd::lanes::WIDTH;

    /// Half a unit in the last place of f32, plus the error of f64.
    const ROUNDED: f64 = 0.500_000_1;

    fn units(found: f32, expected: f64) -> f64 {
        let unit = f64::from((expected as f32).abs().next_up()) - f64::from((expected as f32).abs());
        (f64::from(found) - expected).abs() / unit
    }

    #[test]
    fn angles_and_tangents_are_those_of_double_precision_rounded_once() {
        dispatch!(simd => compare_with_double_precision(simd));
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn compare_with_double_precision<S: Simd>(simd: S) {
        let lanes = |value: &dyn Fn(usize) -> f32| f32x8::from_fn(simd, value);
        let mut worst = [0.0f64; 4];
        for step in 0..50_000u32 {
            let at = |lane: usize| f64::from(step * 8 + lane as u32) / 400_000.0;
            let turned = |lane: usize| f64::from(((at(lane) - 0.5) * 2.0 * PI) as f32);
            let (y, x) = (lanes(&|lane| turned(lane).sin() as f32), lanes(&|lane| turned(lane).cos() as f32));
            let found = arc_tangent(y, x);
            let wide = lanes(&|lane| (at(lane) * 1.25 * PI) as f32);
            let (sine, cosine) = sine_cosine(wide);
            let acute = lanes(&|lane| (at(lane) * FRAC_PI_2) as f32);
            let slope = tangent(acute);
            for lane in 0..WIDTH {
                let angle = f64::from(y[lane]).atan2(f64::from(x[lane]));
                worst[0] = worst[0].max(units(found[lane], angle));
                let (expected_sine, expected_cosine) = f64::from(wide[lane]).sin_cos();
                worst[1] = worst[1].max(units(sine[lane], expected_sine));
                worst[2] = worst[2].max(units(cosine[lane], expected_cosine));
                worst[3] = worst[3].max(units(slope[lane], f64::from(acute[lane]).tan()));
            }
        }
        println!("worst error in units of the last place: {worst:?}");
        // The f64 sine of a rounded π is accurate to 1e-16, which counts in units of an f32 result near 0.
        assert!(worst.iter().all(|&units| units <= ROUNDED + 1.0e-3), "{worst:?}");
        assert!(worst.iter().all(|&units| units > 0.4), "nothing was rounded: {worst:?}");
    }

    #[test]
    fn axes_and_opposite_directions_have_their_angles() {
        let [y, x]: [[f32; WIDTH]; 2] =
            [[0.0, 1.0, 0.0, -1.0, -0.0, 1.0, -1.0, 0.0], [1.0, 0.0, -1.0, 0.0, -1.0, 1.0, -1.0, 0.0]];
        let expected = [0.0, FRAC_PI_2, PI, -FRAC_PI_2, -PI, FRAC_PI_4, -3.0 * FRAC_PI_4, 0.0];
        dispatch!(simd => {
            let found = arc_tangent(f32x8::from_slice(simd, &y), f32x8::from_slice(simd, &x));
            assert_eq!(found.to_array(), expected.map(|angle| angle as f32));
        });
    }
}
