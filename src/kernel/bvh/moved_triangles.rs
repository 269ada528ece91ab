//! Triangles of a surface in the frame of another one, eight at a time, with their boxes there.
//!
//! Read and written by the broad phase: which boxes of a tree reach another surface, then positions and names of their
//! triangles in, moved positions and boxes out.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f32x8, f64x8, prelude::*};
use glam::{DMat3, DVec3, Vec3};

use crate::kernel::{
    mesh::bounds::{Aabb, ROUNDING_GROWTH},
    pose::Pose,
    simd::lanes::{DoubleVectorLanes, TriangleLanes, VectorLanes, WIDTH},
};

/// Whether boxes, brought into another frame, reach a box there.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    linear: DMat3,
    absolute: DMat3,
    translation: DVec3,
    center: DVec3,
    half: DVec3,
}

/// Boxes are rounded to f32 on the way here by a few units in the last place: far more than those are allowed for.
const ROUNDING: f64 = 32.0 * f32::EPSILON as f64;

impl Reach {
    /// `pose` brings boxes into the frame of `target`.
    #[must_use]
    pub fn new(pose: &Pose, target: &Aabb) -> Self {
        let affine = pose.to_affine();
        let (low, high) = (target.min.as_dvec3(), target.max.as_dvec3());
        let linear = affine.matrix3;
        let absolute = DMat3::from_cols(linear.x_axis.abs(), linear.y_axis.abs(), linear.z_axis.abs());
        Self { linear, absolute, translation: affine.translation, center: (low + high) * 0.5, half: (high - low) * 0.5 }
    }

    /// One bit for each of eight boxes that reaches the target. Never says that something is apart that is not: what is no number
    /// reaches.
    #[inline(always)]
    pub(in crate::kernel) fn reached_by<S: Simd>(&self, simd: S, min: VectorLanes<S>, max: VectorLanes<S>) -> u32 {
        let (low, high, half) = (min.widened(), max.widened(), f64x8::splat(simd, 0.5));
        let center = low.plus(high).scaled(half).turned(simd, &self.linear);
        let center = center.plus(DoubleVectorLanes::splat(simd, self.translation));
        let half = (high - low).scaled(half).turned(simd, &self.absolute);
        let apart = (center - DoubleVectorLanes::splat(simd, self.center)).abs()
            - DoubleVectorLanes::splat(simd, self.half)
            - half;
        let sides = center.abs().plus(half);
        let slack = sides.x.max(sides.y).max(sides.z) * ROUNDING;
        let is_apart = apart.x.simd_gt(slack) | apart.y.simd_gt(slack) | apart.z.simd_gt(slack);
        !is_apart.to_bitmask() as u32
    }
}

/// A mesh of which triangles are to be moved.
#[derive(Clone, Copy, Debug)]
pub struct MovingMesh<'a> {
    /// Moves it.
    pub pose: &'a Pose,
    /// Its vertices before they are moved.
    pub positions: &'a [Vec3],
    /// Its triangles.
    pub triangles: &'a [[u32; 3]],
    /// How far boxes of moved triangles are grown.
    pub growth: f32,
}

impl MovingMesh<'_> {
    /// Moves the corners of the triangles `named` to their places in `moved`, rounded once. Appends each of the triangles with its
    /// box there, [grown](Aabb::grown). Returns the largest coordinate of any corner, by its magnitude.
    ///
    /// # Panics
    /// If there is no such triangle or vertex, or `moved` has no place for it.
    pub fn move_triangles(&self, named: &[u32], moved: &mut [Vec3], bounds: &mut Vec<(u32, Aabb)>) -> f32 {
        let mut largest = 0.0;
        dispatch!(Level::new(), simd => {
            for named in named.chunks(WIDTH) {
                largest = f32::max(largest, self.move_eight(simd, named, moved, bounds));
            }
        });
        largest
    }

    #[inline(always)]
    fn move_eight<S: Simd>(&self, simd: S, named: &[u32], moved: &mut [Vec3], bounds: &mut Vec<(u32, Aabb)>) -> f32 {
        let Self { pose, positions, triangles, growth } = *self;
        // Of fewer than eight the first one fills up.
        let mut vertices = [triangles[named[0] as usize]; WIDTH];
        for (vertices, &triangle) in vertices.iter_mut().zip(named) {
            *vertices = triangles[triangle as usize];
        }
        let TriangleLanes([a, b, c]) = TriangleLanes::gather(simd, positions, &vertices);
        let pose = Some(pose);
        let [a, b, c] = [a.moved(simd, pose), b.moved(simd, pose), c.moved(simd, pose)];
        for (corner, lanes) in [a, b, c].into_iter().enumerate() {
            let mut places = [Vec3::ZERO; WIDTH];
            lanes.write(&mut places);
            for (vertices, place) in vertices.iter().zip(places) {
                moved[vertices[corner] as usize] = place;
            }
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        // As `Aabb::grown` has it.
        let largest = low.largest_coordinate().max(high.largest_coordinate());
        let grown = (largest + growth) * ROUNDING_GROWTH + growth;
        let grown = VectorLanes { x: grown, y: grown, z: grown };
        let (mut lows, mut highs) = ([Vec3::ZERO; WIDTH], [Vec3::ZERO; WIDTH]);
        (low - grown).write(&mut lows);
        high.plus(grown).write(&mut highs);
        let boxes = lows.into_iter().zip(highs).map(|(min, max)| Aabb { min, max });
        bounds.extend(named.iter().copied().zip(boxes));
        largest.reduce_max()
    }
}

impl<S: Simd> VectorLanes<S> {
    #[inline(always)]
    fn largest_coordinate(self) -> f32x8<S> {
        let sizes = self.abs();
        sizes.x.max(sizes.y).max(sizes.z)
    }
}
