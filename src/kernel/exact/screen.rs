//! Which features of eight pairs of triangles count, and how far apart the triangles are, side by side, before any pair is
//! looked at alone.
//!
//! The arithmetic is that of `triangle_pair`, operation by operation, so that a feature passes here exactly where it
//! passes there and a distance is the same number. Only edges that pierce a face are told by the signs of volumes that
//! are computed another way: what may be of either sign passes, and is left to the exact test.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f64x8, prelude::*};

use self::{
    features::{certainly_pierce, features, may_pierce},
    gather::corners_in_lanes,
    rows::Rows,
};
use super::{
    cases::{BoundaryCases, Cases},
    triangle_pair::{ROUND_OFF, SQUARE_SLACK, TIE},
};
use crate::kernel::{
    mesh::corner_rows::CornerRow,
    pose::Pose,
    simd::lanes::{WIDTH, first_lanes},
};

mod features;
mod gather;
mod rows;

/// A volume of three edges may be of either sign where it is below this share of the cube of the pair's largest
/// coordinate: seven times what its rounding amounts to.
const VOLUME_ROUNDING: f64 = 1.0e-12;

/// An edge pierces a face beyond doubt where its rise over the face, times the pair's size, is more than this share of the fourth
/// power of the largest coordinate: then the volumes' rounding moves the point of piercing by less than a tenth of what
/// `triangle_pair` allows, 3e-13 of that power over the rise and the size against 1e-10.
const FIRM_PIERCING: f64 = 3.0e-2;

/// A pair of triangles that may be within range.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct ScreenedPair {
    /// What of it counts, or may.
    pub(in crate::kernel) cases: Cases,
    /// Least squared distance of a vertex of either from an edge of the other.
    pub(super) boundary: f64,
    /// Which vertices and edges within the range are that close, or nearly: bit `3 v + e` for vertex `v` of the first triangle and edge `e` of
    /// the second, nine bits further for a vertex of the second.
    pub(super) on_boundary: u32,
    /// Squared distance of the two, unless they cross.
    pub(super) nearest: f64,
    /// Its root.
    distance: f64,
    /// The largest coordinate of either.
    pub(super) largest: f64,
    /// Which of the vertices over faces and pairs of edges is closest, the first of those that are equally close; none
    /// where boundaries are closer.
    pub(in crate::kernel) closest: Cases,
}

impl ScreenedPair {
    /// The distance below which the pair's features touch as far as f64 tells.
    pub(in crate::kernel) fn nothing(&self) -> f64 {
        ROUND_OFF * self.largest
    }

    /// Whether there is no distance between the two.
    pub(in crate::kernel) fn touches(&self) -> bool {
        self.distance <= self.nothing()
    }
}

/// A lower bound of a distance in f32.
#[inline]
pub(in crate::kernel) fn rounded_down(distance: f64) -> f32 {
    // The conversion rounds to the nearest, at most by half of that.
    (distance * (1.0 - f64::from(f32::EPSILON))).max(0.0) as f32
}

/// What distances are asked about. They are in world units, of which one unit of the frame of the pairs is `scale`.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct ScreenLimits {
    pub(in crate::kernel) scale: f64,
    /// Up to where the nearest pair is looked for.
    pub(in crate::kernel) range: f64,
    pub(in crate::kernel) contact_distance: f64,
}

/// Some of the eight pairs of a screen, one bit each.
#[derive(Clone, Copy, Default)]
pub(in crate::kernel) struct Screened {
    /// Those that may be within the range.
    pub(in crate::kernel) possible: u32,
    /// Those of them of which there is no telling whether they cross.
    pub(in crate::kernel) doubtful: u32,
    /// Those with a vertex of either on the boundary of the other, without any distance.
    pub(in crate::kernel) meeting: u32,
    /// Of those without doubt: those within the range.
    pub(in crate::kernel) near: u32,
    /// Those within the contact distance.
    pub(in crate::kernel) touching: u32,
    /// Those with features inside of faces or edges that are within the range, or cross.
    pub(in crate::kernel) with_cases: u32,
    /// Those with nothing closer than what is on the boundaries of both.
    pub(in crate::kernel) on_boundary: u32,
}

/// Eight pairs of triangles and what is known of them.
#[repr(align(64))]
pub(in crate::kernel) struct PairScreen {
    cases: [u64; WIDTH],
    closest: [u64; WIDTH],
    boundary: [f64; WIDTH],
    on_boundary: [u64; WIDTH],
    /// Where the vertex is closest to the start of the edge, or to its end, of pairs with nothing closer.
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

    /// Screens pairs, of which the first `count` are asked about. The triangles of either side are given in the frame of the
    /// side's `pose`, if it has one.
    pub(in crate::kernel) fn screen(
        &mut self,
        sides: [&[&CornerRow; WIDTH]; 2],
        poses: [Option<&Pose>; 2],
        count: usize,
        limits: &ScreenLimits,
    ) -> Screened {
        let mut screened = Screened::default();
        dispatch!(Level::new(), simd => screened = self.screen_in_lanes(simd, sides, poses, limits));
        let asked = first_lanes(count) as u32;
        Screened {
            possible: screened.possible & asked,
            doubtful: screened.doubtful & asked,
            meeting: screened.meeting & asked,
            near: screened.near & asked,
            touching: screened.touching & asked,
            ..screened
        }
    }

    /// One of the pairs.
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

    /// The distances of the pairs in world units, 0 where they cross; without meaning where that is in doubt.
    pub(in crate::kernel) fn distances(&self) -> &[f64; WIDTH] {
        &self.world_distance
    }

    /// What of a pair is on the boundaries of both, where nothing is closer.
    pub(in crate::kernel) fn boundary_cases(&self, place: usize) -> BoundaryCases {
        // The end of an edge is the start of the next one.
        let cases = self.on_boundary[place] & !self.at_end[place];
        let vertices = cases & self.at_start[place];
        // Two vertices count from the first triangle only, whose bits are the first nine.
        BoundaryCases((cases & !vertices) | ((vertices & 0x1ff) * BoundaryCases::of_vertices(0)))
    }

    /// Lower bounds of the distances of the pairs, as they were screened: within the range or not, the distance but for
    /// rounding, and 0 of pairs that may cross.
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

    #[inline(always)]
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
        let range = nothing.max(limits.range / limits.scale);
        let range_squared = range * range * (1.0 + SQUARE_SLACK);
        // A distance that is infinite is none, however far the range goes.
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
            meeting: boundary.simd_eq(zero).to_bitmask() as u32,
            near: (is_certain & !apart.simd_gt(limits.range)).to_bitmask() as u32,
            touching: (is_certain & apart.simd_le(limits.contact_distance)).to_bitmask() as u32,
            with_cases: (!(found.cases & !u64::from(Cases::BOUNDARY.0)).simd_eq(0)).to_bitmask() as u32,
            on_boundary: on_boundary.to_bitmask() as u32,
        }
    }
}
