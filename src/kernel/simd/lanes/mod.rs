//! Vectors of eight triangles or pairs, one per lane.
//!
//! Built on the lanes of `fearless_simd`. A kernel is dispatched as a whole to the widest instruction set of the
//! machine, and everything below it is inlined into it.

mod angles;
mod corners;
pub(in crate::kernel) mod fused;
mod pairs;
mod transpose;
mod triangles;

use std::ops::Sub;

use fearless_simd::{f32x4, f32x8, f64x8, mask32x8, mask64x8, prelude::*};
use glam::{DMat3, DVec3, Vec3};

pub(in crate::kernel) use self::{
    angles::{arc_tangent, sine_cosine, tangent},
    corners::{CornerLanes, TrianglePairLanes},
    pairs::{LARGEST_EXTENT, PairLanes},
    transpose::{columns, columns_from, rows, transposed},
    triangles::{EdgeChoice, FrameLanes, LEAST_EXACT_SQUARE, RADIUS_SLACK, TriangleLanes, ZERO_AREA},
};
use crate::kernel::pose::Pose;

/// How many triangles or pairs are processed at a time.
pub(in crate::kernel) const WIDTH: usize = 8;

/// Declares the types of one precision.
macro_rules! vectors {
    ($Lanes:ident, $Rows:ident, $numbers:ident, $mask:ident, $number:ty, $Vector:ident, $align:literal) => {
        /// One vector per lane.
        #[derive(Clone, Copy)]
        pub(in crate::kernel) struct $Lanes<S: Simd> {
            pub(in crate::kernel) x: $numbers<S>,
            pub(in crate::kernel) y: $numbers<S>,
            pub(in crate::kernel) z: $numbers<S>,
        }

        /// The same vectors in memory, where single lanes are read and written.
        #[derive(Clone, Copy, Debug)]
        #[repr(align($align))]
        pub(in crate::kernel) struct $Rows([[$number; WIDTH]; 3]);

        impl<S: Simd> $Lanes<S> {
            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn splat(simd: S, vector: $Vector) -> Self {
                Self {
                    x: $numbers::splat(simd, vector.x),
                    y: $numbers::splat(simd, vector.y),
                    z: $numbers::splat(simd, vector.z),
                }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn load(simd: S, $Rows([x, y, z]): &$Rows) -> Self {
                Self {
                    x: $numbers::from_slice(simd, x),
                    y: $numbers::from_slice(simd, y),
                    z: $numbers::from_slice(simd, z),
                }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn store(self, $Rows([x, y, z]): &mut $Rows) {
                self.x.store_slice(x);
                self.y.store_slice(y);
                self.z.store_slice(z);
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn dot(self, other: Self) -> $numbers<S> {
                self.x * other.x + self.y * other.y + self.z * other.z
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn cross(self, other: Self) -> Self {
                Self {
                    x: self.y * other.z - self.z * other.y,
                    y: self.z * other.x - self.x * other.z,
                    z: self.x * other.y - self.y * other.x,
                }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn plus(self, other: Self) -> Self {
                Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
            }

            /// Unlike a subtraction from zero, this also flips the sign of zeros.
            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn negated(self) -> Self {
                Self { x: -self.x, y: -self.y, z: -self.z }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn min(self, other: Self) -> Self {
                Self { x: self.x.min(other.x), y: self.y.min(other.y), z: self.z.min(other.z) }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn max(self, other: Self) -> Self {
                Self { x: self.x.max(other.x), y: self.y.max(other.y), z: self.z.max(other.z) }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn abs(self) -> Self {
                Self { x: self.x.abs(), y: self.y.abs(), z: self.z.abs() }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn scaled(self, factor: $numbers<S>) -> Self {
                Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
            }

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn select(mask: $mask<S>, yes: Self, no: Self) -> Self {
                Self { x: mask.select(yes.x, no.x), y: mask.select(yes.y, no.y), z: mask.select(yes.z, no.z) }
            }
        }

        impl<S: Simd> Sub for $Lanes<S> {
            type Output = Self;
            #[cfg_attr(not(unoptimized), inline(always))]
            fn sub(self, other: Self) -> Self {
                Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
            }
        }

        impl $Rows {
            pub(in crate::kernel) const ZERO: Self = Self([[0.0; WIDTH]; 3]);

            #[cfg_attr(not(unoptimized), inline(always))]
            pub(in crate::kernel) fn get(&self, lane: usize) -> $Vector {
                let Self([x, y, z]) = self;
                $Vector::new(x[lane], y[lane], z[lane])
            }
        }
    };
}

vectors!(VectorLanes, VectorRows, f32x8, mask32x8, f32, Vec3, 32);
vectors!(DoubleVectorLanes, DoubleVectorRows, f64x8, mask64x8, f64, DVec3, 64);

impl<S: Simd> VectorLanes<S> {
    /// Loads one vector per lane in registers only. In memory they would be written in parts and read back as a whole.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of(simd: S, vectors: [Vec3; WIDTH]) -> Self {
        let mut rows = [f32x4::splat(simd, 0.0); WIDTH];
        for lane in 0..WIDTH {
            rows[lane] = row(simd, vectors[lane]);
        }
        Self::of_rows(rows)
    }

    /// The first three numbers of each row.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of_rows(rows: [f32x4<S>; WIDTH]) -> Self {
        let [x, y, z, _] = columns(rows);
        Self { x, y, z }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn stored(self) -> VectorRows {
        let mut rows = VectorRows::ZERO;
        self.store(&mut rows);
        rows
    }

    /// Loads the first eight vectors. If there are fewer, the other lanes are zero.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of_arrays(simd: S, vectors: &[[f32; 3]]) -> Self {
        let mut block = [Vec3::ZERO; WIDTH];
        if let Some(vectors) = vectors.first_chunk::<WIDTH>() {
            for lane in 0..WIDTH {
                block[lane] = vectors[lane].into();
            }
            return Self::of(simd, block);
        }
        for (own, &vector) in block.iter_mut().zip(vectors) {
            *own = vector.into();
        }
        Self::of(simd, block)
    }

    /// Writes the first lanes to memory, at most eight.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn write<T: From<[f32; 3]>>(self, vectors: &mut [T]) {
        let rows = rows([self.x, self.y, self.z, self.z]);
        let Some(vectors) = vectors.first_chunk_mut::<WIDTH>() else {
            for (vector, row) in vectors.iter_mut().zip(rows) {
                *vector = [row[0], row[1], row[2]].into();
            }
            return;
        };
        for (vector, row) in vectors.iter_mut().zip(rows) {
            *vector = [row[0], row[1], row[2]].into();
        }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn over(self, divisor: f32x8<S>) -> Self {
        Self { x: self.x / divisor, y: self.y / divisor, z: self.z / divisor }
    }

    /// Transforms points like [`Pose::transform_point`], rounded once.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn moved(self, simd: S, pose: Option<&Pose>) -> Self {
        self.widened().moved(simd, pose).rounded()
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn widened(self) -> DoubleVectorLanes<S> {
        DoubleVectorLanes { x: widened(self.x), y: widened(self.y), z: widened(self.z) }
    }
}

impl VectorRows {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn set(&mut self, lane: usize, vector: Vec3) {
        let Self([x, y, z]) = self;
        (x[lane], y[lane], z[lane]) = (vector.x, vector.y, vector.z);
    }
}

impl<S: Simd> DoubleVectorLanes<S> {
    /// Transforms points like [`Pose::transform_point`].
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn moved(self, simd: S, pose: Option<&Pose>) -> Self {
        let Some(pose) = pose else { return self };
        let affine = pose.to_affine();
        self.turned(simd, &affine.matrix3).plus(Self::splat(simd, affine.translation))
    }

    /// Transforms directions like [`Pose::transform_direction`].
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn moved_direction(self, simd: S, pose: &Pose) -> Self {
        let (turned, scale) = (self.turned(simd, &pose.to_affine().matrix3), pose.scale());
        Self { x: turned.x / scale, y: turned.y / scale, z: turned.z / scale }
    }

    /// Multiplies by a matrix, in the operation order of `glam`.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn turned(self, simd: S, matrix: &DMat3) -> Self {
        let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
        let (x, y, z) = (Self::splat(simd, x), Self::splat(simd, y), Self::splat(simd, z));
        x.scaled(self.x).plus(y.scaled(self.y)).plus(z.scaled(self.z))
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn rounded(self) -> VectorLanes<S> {
        VectorLanes { x: rounded(self.x), y: rounded(self.y), z: rounded(self.z) }
    }
}

/// Converts to f64.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn widened<S: Simd>(numbers: f32x8<S>) -> f64x8<S> {
    let (low, high) = numbers.widen();
    low.combine(high)
}

/// Rounds to the nearest f32.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn rounded<S: Simd>(numbers: f64x8<S>) -> f32x8<S> {
    let (low, high) = numbers.split();
    low.narrow(high)
}

/// Stores the numbers of eight lanes.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn stored<S: Simd>(numbers: f32x8<S>) -> [f32; WIDTH] {
    let mut row = [0.0; WIDTH];
    numbers.store_slice(&mut row);
    row
}

/// Loads the first eight numbers. If there are fewer, the other lanes are 0.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn load_first<S: Simd>(simd: S, numbers: &[f32]) -> f32x8<S> {
    if let Some(numbers) = numbers.first_chunk::<WIDTH>() {
        return f32x8::from_slice(simd, numbers);
    }
    let mut row = [0.0; WIDTH];
    row[..numbers.len()].copy_from_slice(numbers);
    f32x8::from_slice(simd, &row)
}

/// Writes the numbers of the first lanes to memory, at most eight.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn store_first<S: Simd>(numbers: f32x8<S>, row: &mut [f32]) {
    if let Some(row) = row.first_chunk_mut::<WIDTH>() {
        numbers.store_slice(row);
    } else {
        row.copy_from_slice(&stored(numbers)[..row.len()]);
    }
}

/// One bit for each of the first `count` lanes, at least one.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn first_lanes(count: usize) -> u64 {
    u64::MAX >> (u64::BITS as usize - count)
}

/// Iterates over the lanes whose bits are set, ascending.
pub(in crate::kernel) struct SetLanes(pub(in crate::kernel) u32);

impl Iterator for SetLanes {
    type Item = usize;

    #[cfg_attr(not(unoptimized), inline(always))]
    fn next(&mut self) -> Option<usize> {
        let lane = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        if lane < WIDTH { Some(lane) } else { None }
    }
}

/// The three coordinates of a vector, followed by 0.
#[cfg_attr(not(unoptimized), inline(always))]
fn row<S: Simd>(simd: S, Vec3 { x, y, z }: Vec3) -> f32x4<S> {
    f32x4::load_array(simd, [x, y, z, 0.0])
}

/// Calls a test with every instruction set of the machine, and with the baseline of the build.
#[cfg(test)]
macro_rules! by_all_instructions {
    ($test:ident) => {
        dispatch!(simd => $test(simd));
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = fearless_simd::Level::new().as_avx2() {
            $test(simd);
        }
        fearless_simd::dispatch!(fearless_simd::Level::baseline(), simd => $test(simd));
    };
}
#[cfg(test)]
pub(in crate::kernel) use by_all_instructions;
