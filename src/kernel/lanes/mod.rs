//! Eight numbers or vectors side by side, in arrays that the compiler turns into vector instructions.
//!
//! The arithmetic of the culls (`exact::cull`). Everything is inlined into a function that is compiled for several instruction sets and chosen at run time,
//! so a default build uses the machine's widest: what is not inlined is not compiled for it.

mod angles;
mod caps;
mod corners;
mod pairs;
mod triangles;

use std::ops::{Add, Div, Mul, Sub};

use glam::{DVec3, Vec3};

pub(in crate::kernel) use angles::{arc_tangent, sine_cosine, tangent};
pub(in crate::kernel) use caps::{CapContactLanes, CapLanes};
pub(in crate::kernel) use corners::TrianglePairLanes;
pub(in crate::kernel) use pairs::{PairLanes, normal, project};
pub(in crate::kernel) use triangles::{EdgeChoice, FrameLanes, TriangleLanes};

/// How many pairs are worked on at a time.
pub(in crate::kernel) const WIDTH: usize = 8;

/// The types of one precision.
macro_rules! lanes {
    ($Lanes:ident, $Mask:ident, $VectorLanes:ident, $number:ty, $bits:ty, $Vector:ty, $align:literal) => {
        /// One number of each of eight pairs.
        #[derive(Clone, Copy, Debug)]
        #[repr(align($align))]
        pub(in crate::kernel) struct $Lanes(pub(in crate::kernel) [$number; WIDTH]);

        /// Where a condition holds: all bits of a lane set or none, which is what vector comparisons give.
        #[derive(Clone, Copy)]
        #[repr(align($align))]
        pub(in crate::kernel) struct $Mask(pub(in crate::kernel) [$bits; WIDTH]);

        /// One vector of each of eight pairs.
        #[derive(Clone, Copy)]
        pub(in crate::kernel) struct $VectorLanes {
            pub(in crate::kernel) x: $Lanes,
            pub(in crate::kernel) y: $Lanes,
            pub(in crate::kernel) z: $Lanes,
        }

        #[allow(dead_code, reason = "not every precision needs all of it")]
        impl $Lanes {
            pub(in crate::kernel) const ZERO: Self = Self([0.0; WIDTH]);

            #[inline(always)]
            pub(in crate::kernel) fn splat(value: $number) -> Self {
                Self([value; WIDTH])
            }

            #[inline(always)]
            fn zip(self, other: Self, combine: impl Fn($number, $number) -> $number) -> Self {
                let mut result = Self::ZERO;
                for lane in 0..WIDTH {
                    result.0[lane] = combine(self.0[lane], other.0[lane]);
                }
                result
            }

            // Comparisons rather than min, whose care for NaN costs instructions.
            #[inline(always)]
            pub(in crate::kernel) fn min(self, other: Self) -> Self {
                self.zip(other, |a, b| if a < b { a } else { b })
            }

            #[inline(always)]
            pub(in crate::kernel) fn max(self, other: Self) -> Self {
                self.zip(other, |a, b| if a > b { a } else { b })
            }

            #[inline(always)]
            pub(in crate::kernel) fn sqrt(self) -> Self {
                let mut result = self;
                for lane in 0..WIDTH {
                    result.0[lane] = result.0[lane].sqrt();
                }
                result
            }

            #[inline(always)]
            pub(in crate::kernel) fn recip(self) -> Self {
                self.zip(self, |value, _| 1.0 / value)
            }

            #[inline(always)]
            pub(in crate::kernel) fn abs(self) -> Self {
                self.zip(self, |value, _| value.abs())
            }

            #[inline(always)]
            pub(in crate::kernel) fn greater_than(self, other: Self) -> $Mask {
                let mut mask = [0; WIDTH];
                for lane in 0..WIDTH {
                    mask[lane] = if self.0[lane] > other.0[lane] { <$bits>::MAX } else { 0 };
                }
                $Mask(mask)
            }

            #[inline(always)]
            pub(in crate::kernel) fn select(mask: $Mask, yes: Self, no: Self) -> Self {
                let mut result = no;
                for lane in 0..WIDTH {
                    let bits = (yes.0[lane].to_bits() & mask.0[lane]) | (no.0[lane].to_bits() & !mask.0[lane]);
                    result.0[lane] = <$number>::from_bits(bits);
                }
                result
            }
        }

        #[allow(dead_code, reason = "not every precision needs all of it")]
        impl $Mask {
            #[inline(always)]
            pub(in crate::kernel) fn or(self, other: Self) -> Self {
                let mut mask = self;
                for lane in 0..WIDTH {
                    mask.0[lane] |= other.0[lane];
                }
                mask
            }

            #[inline(always)]
            pub(in crate::kernel) fn not(self) -> Self {
                let mut mask = self;
                for lane in 0..WIDTH {
                    mask.0[lane] = !mask.0[lane];
                }
                mask
            }

            #[inline(always)]
            pub(in crate::kernel) fn and(self, other: Self) -> Self {
                let mut mask = self;
                for lane in 0..WIDTH {
                    mask.0[lane] &= other.0[lane];
                }
                mask
            }
        }

        impl Add for $Lanes {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.zip(other, |a, b| a + b)
            }
        }

        impl Sub for $Lanes {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.zip(other, |a, b| a - b)
            }
        }

        impl Div for $Lanes {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                self.zip(other, |a, b| a / b)
            }
        }

        impl Mul for $Lanes {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.zip(other, |a, b| a * b)
            }
        }

        #[allow(dead_code, reason = "not every precision needs all of it")]
        impl $VectorLanes {
            pub(in crate::kernel) const ZERO: Self = Self { x: $Lanes::ZERO, y: $Lanes::ZERO, z: $Lanes::ZERO };

            #[inline(always)]
            pub(in crate::kernel) fn set(&mut self, lane: usize, vector: $Vector) {
                self.x.0[lane] = vector.x;
                self.y.0[lane] = vector.y;
                self.z.0[lane] = vector.z;
            }

            #[inline(always)]
            pub(in crate::kernel) fn dot(self, other: Self) -> $Lanes {
                self.x * other.x + self.y * other.y + self.z * other.z
            }

            #[inline(always)]
            pub(in crate::kernel) fn cross(self, other: Self) -> Self {
                Self {
                    x: self.y * other.z - self.z * other.y,
                    y: self.z * other.x - self.x * other.z,
                    z: self.x * other.y - self.y * other.x,
                }
            }

            #[inline(always)]
            pub(in crate::kernel) fn scaled(self, factor: $Lanes) -> Self {
                Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
            }

            #[inline(always)]
            pub(in crate::kernel) fn select(mask: $Mask, yes: Self, no: Self) -> Self {
                Self {
                    x: $Lanes::select(mask, yes.x, no.x),
                    y: $Lanes::select(mask, yes.y, no.y),
                    z: $Lanes::select(mask, yes.z, no.z),
                }
            }
        }

        impl Sub for $VectorLanes {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
            }
        }
    };
}

lanes!(Lanes, Mask, VectorLanes, f32, u32, Vec3, 32);
lanes!(DoubleLanes, DoubleMask, DoubleVectorLanes, f64, u64, DVec3, 64);
