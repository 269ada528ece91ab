//! Triangles of a surface in the frame of another one, eight at a time, with their boxes there.
//!
//! Read and written by the broad phase: positions and names of triangles in, moved positions and boxes out.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f32x8, prelude::*};
use glam::Vec3;

use super::{
    bounds::{Aabb, ROUNDING_GROWTH},
    lanes::{TriangleLanes, VectorLanes, WIDTH},
    pose::Pose,
};

/// Moves the corners of the triangles `named` by `pose` and writes them to their places in `moved`, rounded once. Appends each
/// of the triangles with its box there, [grown](Aabb::grown) by `growth`. Returns the largest coordinate of any corner, by its
/// magnitude.
///
/// # Panics
/// If there is no such triangle or vertex, or `moved` has no place for it.
pub fn move_triangles(
    pose: &Pose,
    own: &[Vec3],
    triangles: &[[u32; 3]],
    named: &[u32],
    growth: f32,
    moved: &mut [Vec3],
    bounds: &mut Vec<(u32, Aabb)>,
) -> f32 {
    let mut largest = 0.0;
    dispatch!(Level::new(), simd => {
        for named in named.chunks(WIDTH) {
            let largest_of_these = move_eight(simd, pose, own, triangles, named, growth, moved, bounds);
            largest = f32::max(largest, largest_of_these);
        }
    });
    largest
}

#[expect(clippy::too_many_arguments, reason = "those of `move_triangles`")]
#[inline(always)]
fn move_eight<S: Simd>(
    simd: S,
    pose: &Pose,
    own: &[Vec3],
    triangles: &[[u32; 3]],
    named: &[u32],
    growth: f32,
    moved: &mut [Vec3],
    bounds: &mut Vec<(u32, Aabb)>,
) -> f32 {
    // Of fewer than eight the first one fills up.
    let mut vertices = [triangles[named[0] as usize]; WIDTH];
    for (vertices, &triangle) in vertices.iter_mut().zip(named) {
        *vertices = triangles[triangle as usize];
    }
    let TriangleLanes([a, b, c]) = TriangleLanes::gather(simd, own, &vertices);
    let [a, b, c] = [in_frame(simd, a, pose), in_frame(simd, b, pose), in_frame(simd, c, pose)];
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

#[inline(always)]
fn in_frame<S: Simd>(simd: S, corners: VectorLanes<S>, pose: &Pose) -> VectorLanes<S> {
    corners.widened().moved(simd, Some(pose)).rounded()
}

impl<S: Simd> VectorLanes<S> {
    #[inline(always)]
    fn largest_coordinate(self) -> f32x8<S> {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }
}
