//! Which candidate pairs come within range as spheres, and what the sphere stages read of each side.
//!
//! Reads candidate pairs and the spheres of both sides, and writes the pairs that pass, eight at a time. `contacts`
//! computes their contacts. Spheres are stored in the frame of their own surface. If a side is moved, they are
//! transformed pair by pair.

use fearless_simd::{f32x8, mask32x8, prelude::*, u32x8};

use super::{
    cap_lanes::CapLanes,
    circumsphere::{Ball, OffsetSpheres},
    cone::{Cap, SafetyCones},
    rows::{BallRows, CapRows, RowLanes, TriangleRow, own_corners},
};
use crate::kernel::{
    pair::{PairSettings, SurfaceSide},
    pose::Pose,
    simd::{
        lanes::{PairLanes, VectorLanes, WIDTH, first_lanes},
        parallel::Parallel,
        prefetch::{Prefetch, ask_ahead, ask_for_room},
    },
};

/// The enclosing balls of one side, and the transform to the pair's frame.
#[derive(Clone, Copy)]
pub struct BallSide<'a> {
    /// The surface in the pair's frame.
    pub surface: SurfaceSide<'a>,
    /// One ball per triangle, in the side's own frame.
    pub balls: &'a [Ball],
    /// From the side's own frame to the pair's frame, the same transform as the surface's. If there are
    /// [rows](Self::rows), the surface need not have one, because rows contain everything to be transformed. `None` if
    /// the two frames are the same.
    pub pose: Option<&'a Pose>,
    /// [Its rows](Self::rows), if they have been made.
    pub rows: Option<&'a BallRows>,
}

impl Prefetch for BallSide<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn prefetch(&self, triangle: u32) {
        if let Some(rows) = self.rows {
            rows.prefetch(triangle);
        }
    }
}

impl BallSide<'_> {
    /// Writes a row for each triangle, in the side's own frame. Worthwhile if most triangles are in several pairs.
    pub fn rows(&self, parallel: &impl Parallel, rows: &mut BallRows) {
        rows.fill(parallel, self.balls.len(), |triangle| self.row(triangle));
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn row(&self, triangle: u32) -> TriangleRow {
        TriangleRow::of_ball(own_corners(&self.surface, triangle), &self.balls[triangle as usize])
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn gather<const SIDE: usize, S: Simd>(&self, simd: S, pairs: &[[u32; 2]]) -> RowLanes<S> {
        debug_assert!(
            self.rows.is_some() || self.surface.is_moved_by(self.pose),
            "corners would be where they are not"
        );
        let own = if let Some(rows) = self.rows {
            RowLanes::gather_balls::<SIDE>(simd, rows, pairs)
        } else {
            let rows = self.make_rows::<SIDE>(pairs);
            RowLanes::new(simd, |lane| &rows[lane], &[[0.0; WIDTH]; 2])
        };
        own.with_balls_moved(simd, self.pose)
    }

    #[inline(never)]
    fn make_rows<const SIDE: usize>(&self, pairs: &[[u32; 2]]) -> [TriangleRow; WIDTH] {
        let mut rows = [TriangleRow::EMPTY; WIDTH];
        for (row, pair) in rows.iter_mut().zip(pairs) {
            *row = self.row(pair[SIDE]);
        }
        rows
    }

    /// One triangle's ball in the pair's frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    #[must_use]
    pub fn ball(&self, triangle: u32) -> Ball {
        let ball = self.balls[triangle as usize];
        let Some(pose) = self.pose else { return ball };
        Ball {
            center: pose.transform_point(ball.center.as_dvec3()).as_vec3(),
            radius: (f64::from(ball.radius) * pose.scale()) as f32,
        }
    }
}

/// The offset spheres and cones of one side, and the transform to the pair's frame.
#[derive(Clone, Copy)]
pub struct CapSide<'a> {
    /// The surface in the pair's frame. A sheet, which has no inside, has a cap on both sides of each triangle.
    pub surface: SurfaceSide<'a>,
    /// Offset spheres, in the side's own frame.
    pub spheres: &'a OffsetSpheres,
    /// Safety cones, in the side's own frame.
    pub cones: &'a SafetyCones,
    /// From the side's own frame to the pair's frame, the same transform as the surface's. If there are
    /// [rows](Self::rows), the surface need not have one, because rows contain everything to be transformed. `None` if
    /// the two frames are the same.
    pub pose: Option<&'a Pose>,
    /// [Its rows](Self::rows), if they have been made.
    pub rows: Option<&'a CapRows>,
}

impl Prefetch for CapSide<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn prefetch(&self, triangle: u32) {
        if let Some(rows) = self.rows {
            rows.prefetch(triangle);
        }
    }
}

impl CapSide<'_> {
    /// Writes a row for each triangle, in the side's own frame. Worthwhile if most triangles are in several pairs.
    pub fn rows(&self, parallel: &impl Parallel, rows: &mut CapRows) {
        rows.fill(parallel, self.spheres.radii.len(), |triangle| self.row(triangle));
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn row(&self, triangle: u32) -> (TriangleRow, [f32; 2]) {
        let cap = Cap::of(self.spheres, self.cones, triangle as usize);
        TriangleRow::of_cap(own_corners(&self.surface, triangle), &cap)
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn gather<const SIDE: usize, S: Simd>(&self, simd: S, pairs: &[[u32; 2]]) -> RowLanes<S> {
        debug_assert!(
            self.rows.is_some() || self.surface.is_moved_by(self.pose),
            "corners would be where they are not"
        );
        let own = if let Some(rows) = self.rows {
            RowLanes::gather_caps::<SIDE>(simd, rows, pairs)
        } else {
            let (rows, rest) = self.make_rows::<SIDE>(pairs);
            RowLanes::new(simd, |lane| &rows[lane], &rest)
        };
        own.with_caps_moved(simd, self.pose)
    }

    #[inline(never)]
    fn make_rows<const SIDE: usize>(&self, pairs: &[[u32; 2]]) -> ([TriangleRow; WIDTH], [[f32; WIDTH]; 2]) {
        let (mut rows, mut rest) = ([TriangleRow::EMPTY; WIDTH], [[0.0; WIDTH]; 2]);
        for (lane, pair) in pairs.iter().enumerate().take(WIDTH) {
            (rows[lane], [rest[0][lane], rest[1][lane]]) = self.row(pair[SIDE]);
        }
        (rows, rest)
    }

    /// One triangle's sphere and cone in the pair's frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    #[must_use]
    pub fn cap(&self, triangle: u32) -> Cap {
        let cap = Cap::of(self.spheres, self.cones, triangle as usize);
        let Some(pose) = self.pose else { return cap };
        let scale = pose.scale();
        Cap {
            center: pose.transform_point(cap.center.as_dvec3()).as_vec3(),
            radius: (f64::from(cap.radius) * scale) as f32,
            height: (f64::from(cap.height) * scale) as f32,
            // A pose may stretch slightly more along one axis than along another.
            axis: pose.transform_direction(cap.axis.as_dvec3()).normalize_or_zero().as_vec3(),
            cosine: cap.cosine,
        }
    }
}

/// One bit for each pair of balls that are no farther apart than `reach`.
#[cfg_attr(not(unoptimized), inline(always))]
fn reach_each_other<S: Simd>([a, b]: [VectorLanes<S>; 2], [radius_a, radius_b]: [f32x8<S>; 2], reach: f32) -> u64 {
    let between = a - b;
    let sum = radius_a + radius_b + reach;
    between.dot(between).simd_le(sum * sum).to_bitmask()
}

/// One bit for each of eight pairs whose enclosing balls come within range.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn balls_within<S: Simd>(
    rows: &[RowLanes<S>; 2],
    pairs: &[[u32; 2]],
    settings: &PairSettings,
) -> u64 {
    let [a, b] = rows;
    let reach = (settings.range / settings.scale) as f32;
    reach_each_other([a.center(), b.center()], [a.radius(), b.radius()], reach) & first_lanes(pairs.len())
}

/// Appends the candidates whose offset spheres come within range and, if `settings.cull` is set, that neither normals
/// nor the line between the sphere centers separate by more.
pub fn overlapping_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    let tests = if settings.cull { CapTests::ALL } else { CapTests::SPHERES };
    caps_passing(a, b, candidates, tests, settings, overlapping);
}

/// The tests that can separate the caps of two triangles.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct CapTests {
    /// A slab along the normal of either triangle.
    planes: bool,
    /// The offset spheres.
    spheres: bool,
    /// A slab along the line between the sphere centers.
    center_line: bool,
}

impl CapTests {
    const NONE: Self = Self { planes: false, spheres: false, center_line: false };
    const ALL: Self = Self { planes: true, spheres: true, center_line: true };
    pub(in crate::kernel) const PLANES: Self = Self { planes: true, ..Self::NONE };
    pub(in crate::kernel) const SPHERES: Self = Self { spheres: true, ..Self::NONE };
    pub(in crate::kernel) const CENTER_LINE: Self = Self { center_line: true, ..Self::NONE };
}

/// The caps of eight pairs of triangles. For a sheet, the caps that face the other triangle.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn facing_caps<S: Simd>(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    rows: &[RowLanes<S>; 2],
) -> [CapLanes<S>; 2] {
    let [cap_a, cap_b] = [rows[0].cap(), rows[1].cap()];
    let centers = [cap_a.in_plane_center(), cap_b.in_plane_center()];
    [
        if a.surface.one_sided { cap_a } else { cap_a.facing(centers[1]) },
        if b.surface.one_sided { cap_b } else { cap_b.facing(centers[0]) },
    ]
}

/// Appends the pairs that no test separates.
pub(in crate::kernel) fn caps_passing(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    pairs: &[[u32; 2]],
    tests: CapTests,
    settings: &PairSettings,
    passing: &mut Vec<[u32; 2]>,
) {
    dispatch!(simd => overlap_in_lanes(simd, a, b, pairs, tests, settings, passing));
}

#[cfg_attr(not(unoptimized), inline(always))]
fn overlap_in_lanes<S: Simd>(
    simd: S,
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    tests: CapTests,
    settings: &PairSettings,
    kept: &mut Vec<[u32; 2]>,
) {
    let reach = (settings.range / settings.scale) as f32;
    let rounded_reach = reach + a.surface.rounding() + b.surface.rounding();
    for (block, pairs) in candidates.chunks(WIDTH).enumerate() {
        ask_ahead(a, b, candidates, block);
        let rows = [a.gather::<0, S>(simd, pairs), b.gather::<1, S>(simd, pairs)];
        let [corners_a, corners_b] = [rows[0].corners(), rows[1].corners()];
        let corners = PairLanes::new(&corners_a, &corners_b);
        let [cap_a, cap_b] = facing_caps(a, b, &rows);
        let mut apart = mask32x8::splat(simd, false);
        if tests.planes {
            apart |= corners.excess_along_normals(rounded_reach).simd_gt(0.0);
        }
        if tests.spheres {
            apart |= !cap_a.overlap(&cap_b, reach);
        }
        if tests.center_line {
            apart |= corners.excess_along(cap_a.center - cap_b.center, rounded_reach).simd_gt(0.0);
        }
        let within = !apart.to_bitmask() & first_lanes(pairs.len());
        ListedPairs::new(simd, pairs).append(simd, within, kept);
    }
}

/// The triangles of up to eight pairs.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct ListedPairs<S: Simd> {
    firsts: u32x8<S>,
    seconds: u32x8<S>,
}

impl<S: Simd> ListedPairs<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(simd: S, pairs: &[[u32; 2]]) -> Self {
        let mut block = [[0; 2]; WIDTH];
        if let Some(pairs) = pairs.first_chunk() {
            block = *pairs;
        } else {
            block[..pairs.len()].copy_from_slice(pairs);
        }
        let (low, high) = block.as_flattened().split_at(WIDTH);
        let (firsts, seconds) = u32x8::from_slice(simd, low).deinterleave(u32x8::from_slice(simd, high));
        Self { firsts, seconds }
    }

    /// Appends the pairs whose bits are set. Which ones those are is unpredictable, so eight are appended, those first,
    /// and the rest is dropped.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn append(&self, simd: S, set: u64, list: &mut Vec<[u32; 2]>) {
        let mask = mask32x8::from_bitmask(simd, set);
        let (low, high) = self.firsts.compress(mask).interleave(self.seconds.compress(mask));
        ask_for_room(list);
        let mut block = [[0; 2]; WIDTH];
        let (first, second) = block.as_flattened_mut().split_at_mut(WIDTH);
        low.store_slice(first);
        high.store_slice(second);
        append_first(&block, set.count_ones() as usize, list);
    }
}

/// Appends the first `count` of eight items.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn append_first<T: Copy>(items: &[T; WIDTH], count: usize, list: &mut Vec<T>) {
    let before = list.len();
    list.extend_from_slice(items);
    list.truncate(before + count);
}
