//! Raises the bounds of pairs that may have come within range since they were last tested, from the current positions
//! of their triangles.

use std::sync::atomic::{AtomicUsize, Ordering};

use fearless_simd::{f32x8, mask32x8, prelude::*, u32x8};
use glam::Vec3;

use super::BoundedPairs;
use crate::kernel::simd::{
    approach::{Approach, Corners, bounds_by, in_units},
    lanes::{
        PairLanes, TriangleLanes, VectorLanes, WIDTH,
        fused::{Vectors, dot, project},
    },
    parallel::Parallel,
    slab::ROUNDING,
};

/// List entries per task.
const PART: usize = 1 << 14;

/// How many entries are collected before they are tested.
const ROOM: usize = 64;

/// The current triangles of a list's pairs: of the surface that is named first, and of the other one, which may be the
/// same.
#[derive(Clone, Copy, Debug)]
pub struct ListedTriangles<'a> {
    /// The vertices of both surfaces, in one frame.
    pub positions: [&'a [Vec3]; 2],
    /// The vertices of each triangle.
    pub triangles: [&'a [[u32; 3]]; 2],
}

impl BoundedPairs {
    /// Raises bounds that exceed the first of `limits` but not the second, after `motion`, where gaps between the
    /// triangles allow it. These are the pairs that were not within range when they were last tested, but may be by
    /// now. NaN bounds do not change. Returns the number of tested pairs.
    pub fn look_closer(
        &mut self,
        parallel: &impl Parallel,
        triangles: &ListedTriangles<'_>,
        limits: [f32; 2],
        motion: f32,
    ) -> usize {
        let (looked_at, count) = (AtomicUsize::new(0), self.len().div_ceil(PART));
        let names = self.firsts.chunks(PART).zip(self.seconds.chunks(PART));
        parallel.run_tasks(names.zip(self.bounds.chunks_mut(PART)), count, |((firsts, seconds), bounds)| {
            let mut part = Part { names: [firsts, seconds], bounds, triangles, motion };
            let mut count = 0;
            dispatch!(simd => count = part.look_closer(simd, limits));
            looked_at.fetch_add(count, Ordering::Relaxed);
        });
        looked_at.into_inner()
    }
}

/// Consecutive pairs of a list.
struct Part<'a> {
    names: [&'a [u32]; 2],
    bounds: &'a mut [f32],
    triangles: &'a ListedTriangles<'a>,
    motion: f32,
}

impl Part<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn look_closer<S: Simd>(&mut self, simd: S, limits: [f32; 2]) -> usize {
        let (mut places, mut count, mut looked_at) = ([0; ROOM + WIDTH], 0, 0);
        let lanes = u32x8::from_slice(simd, &[0, 1, 2, 3, 4, 5, 6, 7]);
        for first in (0..self.bounds.len()).step_by(WIDTH) {
            let requested = self.requested(simd, first, limits);
            if requested == 0 {
                continue;
            }
            let requested_lanes = (lanes + first as u32).compress(mask32x8::from_bitmask(simd, requested));
            requested_lanes.store_slice(&mut places[count..count + WIDTH]);
            count += requested.count_ones() as usize;
            if count >= ROOM {
                self.raise(simd, &places[..ROOM]);
                places.copy_within(ROOM.., 0);
                count -= ROOM;
                looked_at += ROOM;
            }
        }
        self.raise(simd, &places[..count]);
        looked_at + count
    }

    /// One bit for each of the eight pairs from index `first` on that must be tested.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn requested<S: Simd>(&self, simd: S, first: usize, [passed, limit]: [f32; 2]) -> u64 {
        let (bounds, mut last) = (&self.bounds[first..], [f32::NAN; WIDTH]);
        let bounds = bounds.first_chunk().unwrap_or_else(|| {
            last[..bounds.len()].copy_from_slice(bounds);
            &last
        });
        let bounds = f32x8::from_slice(simd, bounds);
        (bounds.simd_gt(passed) & bounds.simd_le(limit)).to_bitmask()
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn raise<S: Simd>(&mut self, simd: S, places: &[u32]) {
        for places in places.chunks(WIDTH) {
            let (a, b) = (self.corners::<0, S>(simd, places), self.corners::<1, S>(simd, places));
            let mut found = [0.0; WIDTH];
            (lower_bounds(&PairLanes::new(&a.0, &b.0)) + self.motion).store_slice(&mut found);
            for (&place, found) in places.iter().zip(found) {
                let bound = &mut self.bounds[place as usize];
                // NaN gives no bound.
                *bound = if found > *bound { found } else { *bound };
            }
        }
    }

    /// The triangles of one side of up to eight pairs.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn corners<const SIDE: usize, S: Simd>(&self, simd: S, places: &[u32]) -> TriangleLanes<S> {
        let ListedTriangles { positions, triangles } = self.triangles;
        let mut vertices = [[0; 3]; WIDTH];
        for (vertices, &place) in vertices.iter_mut().zip(places) {
            *vertices = triangles[SIDE][self.names[SIDE][place as usize] as usize];
        }
        TriangleLanes::gather(simd, positions[SIDE], &vertices[..places.len()])
    }
}

/// Lower bounds of the distances of eight pairs. Not above 0, or NaN, where nothing separates a pair.
#[cfg_attr(not(unoptimized), inline(always))]
fn lower_bounds<S: Simd>(pairs: &PairLanes<S>) -> f32x8<S> {
    let PairLanes { a: [a, b, c], b: [d, e, f], extent } = *pairs;
    let corners = [[numbers(a), numbers(b), numbers(c)], [numbers(d), numbers(e), numbers(f)]];
    let by_first = gap_along(&corners, numbers((b - a).cross(c - a)));
    let by_second = gap_along(&corners, numbers((e - d).cross(f - d)));
    // A normal may be so long that its gap is NaN. If either operand is NaN, some processors return the second.
    let widest = by_first.max(by_second).max(Approach::new(&corners).widest_gap());
    bounds_by(widest, extent * ROUNDING)
}

#[cfg_attr(not(unoptimized), inline(always))]
fn gap_along<S: Simd>([corners, others]: &Corners<S>, direction: Vectors<S>) -> f32x8<S> {
    let ((low, high), (other_low, other_high)) = (project(corners, direction), project(others, direction));
    in_units((other_low - high).max(low - other_high), dot(direction, direction))
}

#[cfg_attr(not(unoptimized), inline(always))]
fn numbers<S: Simd>(VectorLanes { x, y, z }: VectorLanes<S>) -> Vectors<S> {
    [x, y, z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::simd::parallel::{OnTwoThreads, Sequential};

    #[test]
    fn bounds_do_not_depend_on_parts_and_threads_nor_on_what_is_beside() {
        // Triangles along a helix, some of which are near each other.
        let positions: Vec<Vec3> = (0..900)
            .map(|place| {
                let (sine, cosine) = bevy_math::ops::sin_cos(place as f32 * 0.7);
                Vec3::new(cosine, sine, place as f32 * 0.007)
            })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..300).map(|number| [3 * number, 3 * number + 1, 3 * number + 2]).collect();
        let at = ListedTriangles { positions: [&positions; 2], triangles: [&triangles; 2] };
        let pairs: Vec<[u32; 2]> = (0..300).flat_map(|a| (0..300).map(move |b| [a, b])).collect();
        let [firsts, seconds] = [0, 1].map(|side: usize| pairs.iter().map(|pair| pair[side]).collect::<Vec<_>>());
        let bounds: Vec<f32> = (0..pairs.len()).map(|place| (place % 11) as f32 * 0.05).collect();
        assert!(pairs.len() > 5 * PART);
        let looked_at = |share: &dyn Fn(&mut BoundedPairs) -> usize, range: std::ops::Range<usize>| {
            let mut list = BoundedPairs::default();
            list.extend_from_slices(&firsts[range.clone()], &seconds[range.clone()], &bounds[range]);
            let count = share(&mut list);
            (list.bounds, count)
        };
        let limits = [0.1, 0.4];
        let by_one = |list: &mut BoundedPairs| list.look_closer(&Sequential, &at, limits, 0.02);
        let by_two = |list: &mut BoundedPairs| list.look_closer(&OnTwoThreads, &at, limits, 0.02);
        let whole = looked_at(&by_one, 0..pairs.len());
        assert_eq!(whole, looked_at(&by_two, 0..pairs.len()));
        let (mut pieces, mut count, mut start) = (Vec::new(), 0, 0);
        for length in (1..).map(|number| number * number) {
            let end = (start + length).min(pairs.len());
            let (bounds, looked_at) = looked_at(&by_one, start..end);
            pieces.extend(bounds);
            count += looked_at;
            start = end;
            if start == pairs.len() {
                break;
            }
        }
        assert_eq!((pieces, count), whole);
        let raised = whole.0.iter().zip(&bounds).filter(|(now, before)| now > before).count();
        assert!(raised > 10_000 && raised < whole.1, "{raised} of {}", whole.1);
    }
}
