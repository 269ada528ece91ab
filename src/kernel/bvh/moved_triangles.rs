//! Transforms triangles of a surface into the frame of another one, eight at a time, with their boxes there.
//!
//! Used by the broad phase. First it finds the boxes of a tree that reach the other surface. Then it turns the
//! positions of their triangles into positions and boxes in the other frame.

use fearless_simd::{f32x8, f64x8, prelude::*};
use glam::{DMat3, DVec3, Vec3};

use crate::kernel::{
    mesh::bounds::{Aabb, ROUNDING_GROWTH},
    pose::Pose,
    simd::lanes::{DoubleVectorLanes, TriangleLanes, VectorLanes, WIDTH},
};

/// Tests whether boxes, transformed into another frame, reach a box there.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    linear: DMat3,
    absolute: DMat3,
    translation: DVec3,
    center: DVec3,
    half: DVec3,
}

/// Allowance for the f32 rounding of the boxes, which is a few units in the last place: far less than this.
const ROUNDING: f64 = 32.0 * f32::EPSILON as f64;

impl Reach {
    /// `pose` transforms boxes into the frame of `target`.
    #[must_use]
    pub fn new(pose: &Pose, target: &Aabb) -> Self {
        let affine = pose.to_affine();
        let (low, high) = (target.min.as_dvec3(), target.max.as_dvec3());
        let linear = affine.matrix3;
        let absolute = DMat3::from_cols(linear.x_axis.abs(), linear.y_axis.abs(), linear.z_axis.abs());
        Self { linear, absolute, translation: affine.translation, center: (low + high) * 0.5, half: (high - low) * 0.5 }
    }

    /// One bit for each of eight boxes that reaches the target. Conservative: no box that reaches the target is left
    /// out, and NaN counts as reaching.
    #[cfg_attr(not(unoptimized), inline(always))]
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

/// A mesh whose triangles are to be transformed.
#[derive(Clone, Copy, Debug)]
pub struct MovingMesh<'a> {
    /// The transform.
    pub pose: &'a Pose,
    /// Its vertices before the transform.
    pub positions: &'a [Vec3],
    /// Its triangles.
    pub triangles: &'a [[u32; 3]],
    /// How far the boxes of transformed triangles are grown.
    pub growth: f32,
}

impl MovingMesh<'_> {
    /// Transforms the corners of the triangles `named`, and writes them to their indices in `moved`, rounded once.
    /// Appends each of the triangles with its transformed box, [grown](Aabb::grown). Returns the largest coordinate
    /// magnitude of any corner.
    ///
    /// # Panics
    /// If a triangle or vertex does not exist, or `moved` has no entry for it.
    pub fn move_triangles(&self, named: &[u32], moved: &mut [Vec3], bounds: &mut Vec<(u32, Aabb)>) -> f32 {
        let mut largest = 0.0;
        dispatch!(simd => {
            for named in named.chunks(WIDTH) {
                largest = f32::max(largest, self.move_eight(simd, named, moved, bounds));
            }
        });
        largest
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn move_eight<S: Simd>(&self, simd: S, named: &[u32], moved: &mut [Vec3], bounds: &mut Vec<(u32, Aabb)>) -> f32 {
        let Self { pose, positions, triangles, growth } = *self;
        // The first triangle fills unused lanes.
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
        // Like `Aabb::grown`.
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
    #[cfg_attr(not(unoptimized), inline(always))]
    fn largest_coordinate(self) -> f32x8<S> {
        let sizes = self.abs();
        sizes.x.max(sizes.y).max(sizes.z)
    }
}
