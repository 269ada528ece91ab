//! Screens eight pairs of triangles side by side, before any pair is examined by itself: which features count, and how
//! far apart the triangles are.
//!
//! Every operation is that of `triangle_pair`, so a feature passes here exactly if it passes there, and distances are
//! the same numbers. Only edges that pierce a face are decided by the signs of volumes that are computed differently.
//! What may have either sign passes, and is left to the exact test.

use fearless_simd::{f64x8, prelude::*};

use self::{
    features::{certainly_pierce, features, may_pierce},
    gather::corners_in_lanes,
    rows::Rows,
};
use super::{
    cases::{BoundaryCases, Cases},
    tolerances::{ROUND_OFF, SQUARE_SLACK, TIE},
};
use crate::kernel::{
    mesh::corner_rows::CornerRow,
    pose::Pose,
    simd::lanes::{WIDTH, first_lanes},
};

mod features;
mod gather;
mod rows;

/// A volume of three edges may have either sign if it is below this share of the cube of the pair's largest coordinate:
/// seven times its rounding error.
const VOLUME_ROUNDING: f64 = 1.0e-12;

/// An edge certainly pierces a face if its rise over the face, times the pair's size, is more than this share of the
/// fourth power of the largest coordinate. The rounding of the volumes then moves the piercing point by less than a
/// tenth of what `triangle_pair` allows: 3e-13 of that power over the rise and the size, compared with 1e-10.
const FIRM_PIERCING: f64 = 3.0e-2;

/// A pair of triangles that may be within range.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct ScreenedPair {
    /// What counts, or may count.
    pub(in crate::kernel) cases: Cases,
    /// Smallest squared distance of a vertex of one triangle from an edge of the other.
    pub(super) boundary: f64,
    /// Which boundary features within the range are that close, or nearly: bit `3 v + e` for vertex `v` of the first
    /// triangle and edge `e` of the second, plus nine for a vertex of the second.
    pub(super) on_boundary: u32,
    /// Squared distance of the triangles, unless they cross.
    pub(super) nearest: f64,
    /// The square root of `nearest`.
    distance: f64,
    /// The largest coordinate of either triangle.
    pub(super) largest: f64,
    /// The closest vertex over a face or pair of edges, the first of equally close ones. None if boundaries are at
    /// least as close.
    pub(in crate::kernel) closest: Cases,
}

impl ScreenedPair {
    /// The distance below which features of the pair touch within the precision of f64.
    pub(in crate::kernel) fn nothing(&self) -> f64 {
        ROUND_OFF * self.largest
    }

    /// Whether the distance of the triangles counts as 0.
    pub(in crate::kernel) fn touches(&self) -> bool {
        self.distance <= self.nothing()
    }
}

/// A lower bound of a distance, in f32.
#[inline]
pub(in crate::kernel) fn rounded_down(distance: f64) -> f32 {
    // The conversion rounds to nearest, by at most half of that.
    (distance * (1.0 - f64::from(f32::EPSILON))).max(0.0) as f32
}

/// The distances of interest, in world units. One unit of the pairs' frame is `scale` world units.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct ScreenLimits {
    pub(in crate::kernel) scale: f64,
    /// For each pair, how far its features are searched.
    pub(in crate::kernel) ranges: [f64; WIDTH],
    pub(in crate::kernel) contact_distance: f64,
}

/// Subsets of the eight pairs of a screen, one bit each.
#[derive(Clone, Copy, Default)]
pub(in crate::kernel) struct Screened {
    /// Pairs that may be within the range.
    pub(in crate::kernel) possible: u32,
    /// Of these, the pairs that may or may not cross.
    pub(in crate::kernel) doubtful: u32,
    /// Pairs without doubt that are within the range.
    pub(in crate::kernel) near: u32,
    /// Pairs without doubt that are within the contact distance.
    pub(in crate::kernel) touching: u32,
    /// Pairs with features inside faces or edges that are within the range, or cross.
    pub(in crate::kernel) with_cases: u32,
    /// Pairs in which nothing is closer than the boundary features.
    pub(in crate::kernel) on_boundary: u32,
}

/// A screen of eight pairs of triangles, and its results.
#[repr(align(64))]
pub(in crate::kernel) struct PairScreen {
    cases: [u64; WIDTH],
    closest: [u64; WIDTH],
    boundary: [f64; WIDTH],
    on_boundary: [u64; WIDTH],
    /// For pairs in which nothing is closer: where the vertex is closest to the start of the edge, or to its end.
    at_start: [u64; WIDTH],
    at_end: [u64; WIDTH],
    nearest: [f64; WIDTH],
    distance: [f64; WIDTH],
    largest: [f64; WIDTH],
    world_distance: [f64; WIDTH],
    rows: Rows,
}

impl PairScreen {
    pub(in crate::kernel) const WIDTH: usize = WIDTH;

    pub(in crate::kernel) fn new() -> Self {
        Self {
            cases: [0; WIDTH],
            closest: [0; WIDTH],
            boundary: [0.0; WIDTH],
            on_boundary: [0; WIDTH],
            at_start: [0; WIDTH],
            at_end: [0; WIDTH],
            nearest: [0.0; WIDTH],
            distance: [0.0; WIDTH],
            largest: [0.0; WIDTH],
            world_distance: [0.0; WIDTH],
            rows: Rows::ZERO,
        }
    }

    /// Screens eight pairs, and returns results for the first `count`. The triangles of each side are in the side's own
    /// frame, which its `pose`, if any, transforms.
    pub(in crate::kernel) fn screen(
        &mut self,
        sides: [&[&CornerRow; WIDTH]; 2],
        poses: [Option<&Pose>; 2],
        count: usize,
        limits: &ScreenLimits,
    ) -> Screened {
        let mut screened = Screened::default();
        dispatch!(simd => screened = self.screen_in_lanes(simd, sides, poses, limits));
        let requested = first_lanes(count) as u32;
        Screened {
            possible: screened.possible & requested,
            doubtful: screened.doubtful & requested,
            near: screened.near & requested,
            touching: screened.touching & requested,
            ..screened
        }
    }

    /// The result for one of the pairs.
    #[inline]
    pub(in crate::kernel) fn pair(&self, place: usize) -> ScreenedPair {
        ScreenedPair {
            cases: Cases(self.cases[place] as u32),
            boundary: self.boundary[place],
            on_boundary: self.on_boundary[place] as u32,
            nearest: self.nearest[place],
            distance: self.distance[place],
            largest: self.largest[place],
            closest: Cases(self.closest[place] as u32),
        }
    }

    /// The distances of the pairs in world units, 0 if they cross. Meaningless where that is in doubt.
    pub(in crate::kernel) fn distances(&self) -> &[f64; WIDTH] {
        &self.world_distance
    }

    /// The boundary features of a pair in which nothing is closer.
    pub(in crate::kernel) fn boundary_cases(&self, place: usize) -> BoundaryCases {
        // The end of an edge is the start of the next one.
        let cases = self.on_boundary[place] & !self.at_end[place];
        let vertices = cases & self.at_start[place];
        // Two vertices count from the first triangle only, whose bits are the first nine.
        BoundaryCases((cases & !vertices) | ((vertices & 0x1ff) * BoundaryCases::of_vertices(0)))
    }

    /// Lower bounds of the distances of the screened pairs, whether within the range or not. The distance except for
    /// rounding, and 0 for pairs that may cross.
    #[inline]
    pub(in crate::kernel) fn lower_bounds(&self) -> [f32; WIDTH] {
        let mut bounds = [0.0; WIDTH];
        for place in 0..WIDTH {
            let apart = rounded_down(self.distance[place] - ROUND_OFF * self.largest[place]);
            let may_cross = self.cases[place] & u64::from(Cases::PIERCING.0) != 0;
            bounds[place] = if may_cross { 0.0 } else { apart };
        }
        bounds
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn screen_in_lanes<S: Simd>(
        &mut self,
        simd: S,
        sides: [&[&CornerRow; WIDTH]; 2],
        poses: [Option<&Pose>; 2],
        limits: &ScreenLimits,
    ) -> Screened {
        let zero = f64x8::splat(simd, 0.0);
        let [origin, second, third] = corners_in_lanes(simd, sides[0], poses[0]);
        let (second, third) = (second - origin, third - origin);
        let corners = corners_in_lanes(simd, sides[1], poses[1]);
        let b = [corners[0] - origin, corners[1] - origin, corners[2] - origin];
        let mut largest = zero;
        for corner in [second, third, b[0], b[1], b[2]] {
            largest = largest.max(corner.x.abs()).max(corner.y.abs()).max(corner.z.abs());
        }
        let nothing = largest * ROUND_OFF;
        let ranges = f64x8::from_slice(simd, &limits.ranges);
        let range = nothing.max(ranges / limits.scale);
        let range_squared = range * range * (1.0 + SQUARE_SLACK);
        // An infinite distance does not count, however large the range.
        let limit = range_squared.min(f64::MAX);
        self.rows.set(simd, [second, third], &b);
        let mut found = features(simd, &mut self.rows, limit);
        let boundary = found.boundary;
        let most = (boundary * (1.0 + TIE)).min(range_squared);
        self.rows.boundaries_within(simd, most).store_slice(&mut self.on_boundary);
        let is_case = !boundary.simd_gt(range_squared);
        found.cases = is_case.select(found.cases | u64::from(Cases::BOUNDARY.0), found.cases);
        let cube = largest * largest * largest;
        let rounding = cube * VOLUME_ROUNDING;
        let piercing = may_pierce(simd, &self.rows, rounding);
        found.cases |= piercing;
        let crossing = !piercing.simd_eq(0);
        let mut doubtful = crossing;
        if crossing.any_true() {
            let certain = certainly_pierce(simd, &self.rows, rounding, cube * largest * FIRM_PIERCING);
            doubtful = !(piercing & !certain).simd_eq(0);
        }
        found.cases.store_slice(&mut self.cases);
        found.closest.store_slice(&mut self.closest);
        found.nearest.store_slice(&mut self.nearest);
        let distance = found.nearest.sqrt();
        distance.store_slice(&mut self.distance);
        boundary.store_slice(&mut self.boundary);
        largest.store_slice(&mut self.largest);

        let apart = (crossing | distance.simd_le(nothing)).select(zero, distance) * limits.scale;
        apart.store_slice(&mut self.world_distance);
        let is_certain = !found.cases.simd_eq(0) & !doubtful;
        let on_boundary = !(found.cases & u64::from(Cases::BOUNDARY.0)).simd_eq(0)
            & boundary.simd_le(found.nearest)
            & !crossing
            & is_certain;
        if on_boundary.any_true() {
            let [at_start, at_end] = self.rows.at_ends(simd);
            at_start.store_slice(&mut self.at_start);
            at_end.store_slice(&mut self.at_end);
        }
        Screened {
            possible: (!found.cases.simd_eq(0)).to_bitmask() as u32,
            doubtful: doubtful.to_bitmask() as u32,
            near: (is_certain & !apart.simd_gt(ranges)).to_bitmask() as u32,
            touching: (is_certain & apart.simd_le(limits.contact_distance)).to_bitmask() as u32,
            with_cases: (!(found.cases & !u64::from(Cases::BOUNDARY.0)).simd_eq(0)).to_bitmask() as u32,
            on_boundary: on_boundary.to_bitmask() as u32,
        }
    }
}
