//! Which features of eight pairs of triangles count, and how far apart the triangles are, side by side, before any pair is
//! looked at alone.
//!
//! The arithmetic is that of `triangle_pair`, operation by operation, so that a feature passes here exactly where it
//! passes there and a distance is the same number. Only edges that pierce a face are told by the signs of volumes that
//! are computed another way: what may be of either sign passes, and is left to the exact test.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f64x8, prelude::*, u64x8};

use self::{
    features::{Found, Side, boundary_cases, edge_edge, may_pierce, vertices_and_edges, vertices_over_face},
    gather::corners_in_lanes,
};
use super::{
    cases::{BoundaryCases, Cases},
    triangle_pair::{ROUND_OFF, TIE},
};
use crate::kernel::{
    corner_rows::CornerRow,
    lanes::{WIDTH, first_lanes},
    pose::Pose,
};

mod features;
mod gather;

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
    /// Which vertices and edges are that close, or nearly: bit `3 v + e` for vertex `v` of the first triangle and edge `e` of
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
pub(in crate::kernel) struct PairScreen {
    cases: [u64; WIDTH],
    closest: [u64; WIDTH],
    boundary: [f64; WIDTH],
    on_boundary: [u64; WIDTH],
    nearest: [f64; WIDTH],
    distance: [f64; WIDTH],
    largest: [f64; WIDTH],
    world_distance: [f64; WIDTH],
    boundary_cases: [u64; WIDTH],
}

impl PairScreen {
    pub(in crate::kernel) const WIDTH: usize = WIDTH;

    pub(in crate::kernel) fn new() -> Self {
        Self {
            cases: [0; WIDTH],
            closest: [0; WIDTH],
            boundary: [0.0; WIDTH],
            on_boundary: [0; WIDTH],
            nearest: [0.0; WIDTH],
            distance: [0.0; WIDTH],
            largest: [0.0; WIDTH],
            world_distance: [0.0; WIDTH],
            boundary_cases: [0; WIDTH],
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
        BoundaryCases(self.boundary_cases[place])
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
        let mut triangles = [corners_in_lanes(simd, sides[0], poses[0]), corners_in_lanes(simd, sides[1], poses[1])];
        let origin = triangles[0][0];
        let mut largest = zero;
        for corners in &mut triangles {
            for corner in corners {
                *corner = *corner - origin;
                largest = largest.max(corner.x.abs()).max(corner.y.abs()).max(corner.z.abs());
            }
        }
        let nothing = largest * ROUND_OFF;
        let range = nothing.max(limits.range / limits.scale);
        let range_squared = range * range;
        let (a, b) = (Side::new(simd, triangles[0]), Side::new(simd, triangles[1]));

        let (mut boundaries, mut alongs) = ([zero; 18], [zero; 18]);
        vertices_and_edges(simd, &a, &b, &mut boundaries[..9], &mut alongs[..9]);
        vertices_and_edges(simd, &b, &a, &mut boundaries[9..], &mut alongs[9..]);
        let mut boundary = boundaries[0];
        for &distance_squared in &boundaries[1..] {
            boundary = boundary.min(distance_squared);
        }
        let tie = boundary * (1.0 + TIE);
        let mut on_boundary = u64x8::splat(simd, 0);
        for (place, &distance_squared) in boundaries.iter().enumerate() {
            on_boundary = distance_squared.simd_le(tie).select(on_boundary | (1u64 << place), on_boundary);
        }
        on_boundary.store_slice(&mut self.on_boundary);
        let mut found = Found { cases: u64x8::splat(simd, 0), nearest: boundary, closest: u64x8::splat(simd, 0) };
        found.add(!boundary.simd_gt(range_squared), Cases::BOUNDARY);
        let heights_over_b = vertices_over_face(simd, &a, &b, range_squared, true, &mut found);
        let heights_over_a = vertices_over_face(simd, &b, &a, range_squared, false, &mut found);
        let mut volumes = [[zero; 3]; 3];
        for edge_a in 0..3 {
            for edge_b in 0..3 {
                volumes[edge_a][edge_b] = edge_edge(simd, &a, &b, [edge_a, edge_b], range_squared, &mut found);
            }
        }
        let cube = largest * largest * largest;
        let (rounding, firm) = (cube * VOLUME_ROUNDING, cube * largest * FIRM_PIERCING);
        let mut certain = u64x8::splat(simd, 0);
        for edge in 0..3 {
            let [along_a, along_b] = [volumes[edge], [volumes[0][edge], volumes[1][edge], volumes[2][edge]]];
            for (of_a, own, other, heights, volumes) in
                [(true, &a, &b, &heights_over_b, along_a), (false, &b, &a, &heights_over_a, along_b)]
            {
                let (possible, clear) = may_pierce(simd, heights, edge, volumes, rounding);
                let case = Cases::piercing(of_a, edge);
                found.add(possible, case);
                let size_squared = own.lengths_squared[edge] + other.lengths_squared[0] + other.lengths_squared[1];
                let (from, to) = (heights[edge], heights[(edge + 1) % 3]);
                let fall = from - to;
                let is_firm = clear & (fall * fall * size_squared).simd_gt(firm * firm);
                certain = is_firm.select(certain | u64::from(case.0), certain);
            }
        }
        found.cases.store_slice(&mut self.cases);
        found.closest.store_slice(&mut self.closest);
        found.nearest.store_slice(&mut self.nearest);
        let distance = found.nearest.sqrt();
        distance.store_slice(&mut self.distance);
        boundary.store_slice(&mut self.boundary);
        largest.store_slice(&mut self.largest);

        let none = u64x8::splat(simd, 0);
        let piercing = found.cases & u64::from(Cases::PIERCING.0);
        let crossing = !piercing.simd_eq(none);
        let doubtful = !(piercing & !certain).simd_eq(none);
        let apart = (crossing | distance.simd_le(nothing)).select(zero, distance) * limits.scale;
        apart.store_slice(&mut self.world_distance);
        let is_certain = !found.cases.simd_eq(none) & !doubtful;
        let on_boundary = !(found.cases & u64::from(Cases::BOUNDARY.0)).simd_eq(none)
            & boundary.simd_le(found.nearest)
            & !crossing
            & is_certain;
        if on_boundary.any_true() {
            boundary_cases(simd, &boundaries, &alongs, tie.min(range_squared)).store_slice(&mut self.boundary_cases);
        }
        Screened {
            possible: (!found.cases.simd_eq(none)).to_bitmask() as u32,
            doubtful: doubtful.to_bitmask() as u32,
            meeting: boundary.simd_eq(zero).to_bitmask() as u32,
            near: (is_certain & !apart.simd_gt(limits.range)).to_bitmask() as u32,
            touching: (is_certain & apart.simd_le(limits.contact_distance)).to_bitmask() as u32,
            with_cases: (!(found.cases & !u64::from(Cases::BOUNDARY.0)).simd_eq(none)).to_bitmask() as u32,
            on_boundary: on_boundary.to_bitmask() as u32,
        }
    }
}
