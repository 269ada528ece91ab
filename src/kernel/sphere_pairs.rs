//! Which candidate pairs come within range as spheres, and what the sphere stages read of either side.
//!
//! Reads candidate pairs and the spheres of both sides, writes the pairs that pass, eight pairs at a time; their contacts
//! are made in `sphere_contacts`. Spheres are kept in the frame of their own surface; those of a moved side are brought over
//! pair by pair.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f32x4, f32x8, mask32x8, prelude::*};

use super::{
    circumsphere::{Ball, OffsetSpheres},
    cone::{Cap, SafetyCones},
    ids::TriangleId,
    lanes::{CapLanes, PairLanes, VectorLanes, WIDTH, first_lanes, transposed},
    pair::{PairSettings, SurfaceSide, without_neighbors},
    pair_fate::{PairFate, StepObserver, Unobserved},
    pose::Pose,
    prefetch::{Prefetch, ask_ahead, prefetch},
    share::Share,
    sphere_rows::{BallRows, CapRows, RowLanes, TriangleRow, rounded_corners},
};

/// The enclosing balls of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct BallSide<'a> {
    /// The surface in the frame of the pair.
    pub surface: SurfaceSide<'a>,
    /// One ball a triangle, in the side's own frame.
    pub balls: &'a [Ball],
    /// From the side's own frame to the frame of the pair; `None` where they are the same.
    pub pose: Option<&'a Pose>,
    /// [Its rows](Self::rows), where somebody has made them, and the side has not been moved.
    pub rows: Option<&'a BallRows>,
}

impl Prefetch for BallSide<'_> {
    #[inline(always)]
    fn prefetch(&self, triangle: u32) {
        if let Some(rows) = self.rows {
            rows.prefetch(triangle);
        }
    }
}

impl BallSide<'_> {
    /// Writes a row for each triangle: worth it where most triangles are in several pairs.
    pub fn rows(&self, share: &impl Share, rows: &mut BallRows) {
        rows.fill(share, self.balls.len(), |triangle| self.row(triangle));
    }

    #[inline(always)]
    fn row(&self, triangle: u32) -> TriangleRow {
        TriangleRow::of_ball(rounded_corners(&self.surface, triangle), &self.ball(triangle))
    }

    #[inline(always)]
    pub(super) fn gather<const SIDE: usize, S: Simd>(&self, simd: S, pairs: &[[u32; 2]]) -> RowLanes<S> {
        if let Some(rows) = self.rows {
            return RowLanes::gather_balls::<SIDE>(simd, rows, pairs);
        }
        let rows = self.make_rows::<SIDE>(pairs);
        RowLanes::new(simd, |lane| &rows[lane], &[[0.0; WIDTH]; 2])
    }

    #[inline(never)]
    fn make_rows<const SIDE: usize>(&self, pairs: &[[u32; 2]]) -> [TriangleRow; WIDTH] {
        let mut rows = [TriangleRow::EMPTY; WIDTH];
        for (row, pair) in rows.iter_mut().zip(pairs) {
            *row = self.row(pair[SIDE]);
        }
        rows
    }

    /// One triangle's ball in the frame of the pair.
    #[inline(always)]
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

/// The offset spheres and cones of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct CapSide<'a> {
    /// The surface in the frame of the pair. A sheet, which has no inside, has a cap on either side of each triangle.
    pub surface: SurfaceSide<'a>,
    /// Offset spheres, in the side's own frame.
    pub spheres: &'a OffsetSpheres,
    /// Safety cones, in the side's own frame.
    pub cones: &'a SafetyCones,
    /// From the side's own frame to the frame of the pair; `None` where they are the same.
    pub pose: Option<&'a Pose>,
    /// [Its rows](Self::rows), where somebody has made them, and the side has not been moved.
    pub rows: Option<&'a CapRows>,
}

impl Prefetch for CapSide<'_> {
    #[inline(always)]
    fn prefetch(&self, triangle: u32) {
        if let Some(rows) = self.rows {
            rows.prefetch(triangle);
        }
    }
}

impl CapSide<'_> {
    /// Writes a row for each triangle: worth it where most triangles are in several pairs.
    pub fn rows(&self, share: &impl Share, rows: &mut CapRows) {
        rows.fill(share, self.spheres.radii.len(), |triangle| self.row(triangle));
    }

    #[inline(always)]
    fn row(&self, triangle: u32) -> (TriangleRow, [f32; 2]) {
        TriangleRow::of_cap(rounded_corners(&self.surface, triangle), &self.cap(triangle))
    }

    #[inline(always)]
    pub(super) fn gather<const SIDE: usize, S: Simd>(&self, simd: S, pairs: &[[u32; 2]]) -> RowLanes<S> {
        if let Some(rows) = self.rows {
            return RowLanes::gather_caps::<SIDE>(simd, rows, pairs);
        }
        let (rows, rest) = self.make_rows::<SIDE>(pairs);
        RowLanes::new(simd, |lane| &rows[lane], &rest)
    }

    #[inline(never)]
    fn make_rows<const SIDE: usize>(&self, pairs: &[[u32; 2]]) -> ([TriangleRow; WIDTH], [[f32; WIDTH]; 2]) {
        let (mut rows, mut rest) = ([TriangleRow::EMPTY; WIDTH], [[0.0; WIDTH]; 2]);
        for (lane, pair) in pairs.iter().enumerate().take(WIDTH) {
            (rows[lane], [rest[0][lane], rest[1][lane]]) = self.row(pair[SIDE]);
        }
        (rows, rest)
    }

    /// One triangle's sphere and cone in the frame of the pair.
    #[inline(always)]
    #[must_use]
    pub fn cap(&self, triangle: u32) -> Cap {
        let cap = Cap::of(self.spheres, self.cones, triangle as usize);
        let Some(pose) = self.pose else { return cap };
        let scale = pose.scale();
        Cap {
            center: pose.transform_point(cap.center.as_dvec3()).as_vec3(),
            radius: (f64::from(cap.radius) * scale) as f32,
            height: (f64::from(cap.height) * scale) as f32,
            axis: pose.transform_direction(cap.axis.as_dvec3()).as_vec3(),
            cosine: cap.cosine,
        }
    }
}

/// Appends the candidates whose enclosing balls come within range. In a self-collision, pairs that share a vertex are
/// left out.
pub fn overlapping_balls(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping_balls_in_steps(a, b, candidates, settings, overlapping, &mut Unobserved);
}

/// [`overlapping_balls`], telling after each step which pairs are left.
pub(super) fn overlapping_balls_in_steps<O: StepObserver>(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
    observer: &mut O,
) {
    let before = overlapping.len();
    if O::ASKS {
        observer.passed(PairFate::Neighbors, without_neighbors(&a.surface, candidates, settings).iter().copied());
    }
    dispatch!(Level::new(), simd => keep_overlapping_balls(simd, a, b, candidates, settings, overlapping));
    if O::ASKS {
        observer.passed(PairFate::Spheres, overlapping[before..].iter().copied());
    }
}

/// What the overlap of balls reads of one side.
struct OverlapNumbers<'a> {
    side: &'a BallSide<'a>,
    settings: &'a PairSettings,
}

impl Prefetch for OverlapNumbers<'_> {
    #[inline(always)]
    fn prefetch(&self, triangle: u32) {
        prefetch(self.side.balls, triangle);
        if self.settings.same_surface {
            prefetch(self.side.surface.topology.welded_triangles(), triangle);
        }
    }
}

/// Of each pair both balls, four numbers each, are the row that is turned into lanes.
#[inline(always)]
fn keep_overlapping_balls<S: Simd>(
    simd: S,
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    kept: &mut Vec<[u32; 2]>,
) {
    let reach = (settings.range / settings.scale) as f32;
    for (block, pairs) in candidates.chunks(WIDTH).enumerate() {
        ask_ahead(&OverlapNumbers { side: a, settings }, &OverlapNumbers { side: b, settings }, candidates, block);
        let mut rows = [f32x8::splat(simd, 0.0); WIDTH];
        for (row, &[triangle_a, triangle_b]) in rows.iter_mut().zip(pairs) {
            let (ball_a, ball_b) = (a.ball(triangle_a), b.ball(triangle_b));
            *row = f32x4::load_array(simd, ball_a.into()).combine(f32x4::load_array(simd, ball_b.into()));
        }
        let [x, y, z, radius_a, other_x, other_y, other_z, radius_b] = transposed(rows);
        let between = VectorLanes { x, y, z } - VectorLanes { x: other_x, y: other_y, z: other_z };
        let sum = radius_a + radius_b + reach;
        let mut apart = (!between.dot(between).simd_le(sum * sum)).to_bitmask();
        if settings.same_surface {
            apart |= neighbors(&a.surface, pairs);
        }
        keep(pairs, !apart, kept);
    }
}

/// Appends the candidates whose offset spheres come within range and, where asked, which neither their planes nor the
/// line between the sphere centers separate by more. In a self-collision, pairs that share a vertex are left out.
pub fn overlapping_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping_caps_in_steps(a, b, candidates, settings, overlapping, &mut Unobserved);
}

/// [`overlapping_caps`], telling after each step which pairs are left.
pub(super) fn overlapping_caps_in_steps<O: StepObserver>(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
    observer: &mut O,
) {
    let steps: &[PairFate] =
        if settings.cull { &[PairFate::Planes, PairFate::Spheres, PairFate::CenterLine] } else { &[PairFate::Spheres] };
    if O::ASKS {
        let mut left = without_neighbors(&a.surface, candidates, settings).into_owned();
        observer.passed(PairFate::Neighbors, left.iter().copied());
        for &step in steps {
            let mut passed = Vec::new();
            keep_overlapping_caps(a, b, &left, &[step], settings, &mut passed);
            observer.passed(step, passed.iter().copied());
            left = passed;
        }
        overlapping.extend(left);
        return;
    }
    keep_overlapping_caps(a, b, candidates, steps, settings, overlapping);
}

/// The caps of eight pairs of triangles, of sheets those that face the other triangle.
#[inline(always)]
pub(super) fn facing_caps<S: Simd>(a: &CapSide<'_>, b: &CapSide<'_>, rows: &[RowLanes<S>; 2]) -> [CapLanes<S>; 2] {
    let [cap_a, cap_b] = [rows[0].cap(), rows[1].cap()];
    let centers = [cap_a.in_plane_center(), cap_b.in_plane_center()];
    [
        if a.surface.one_sided { cap_a } else { cap_a.facing(centers[1]) },
        if b.surface.one_sided { cap_b } else { cap_b.facing(centers[0]) },
    ]
}

/// Appends the pairs that pass all of some steps.
fn keep_overlapping_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    pairs: &[[u32; 2]],
    steps: &[PairFate],
    settings: &PairSettings,
    kept: &mut Vec<[u32; 2]>,
) {
    dispatch!(Level::new(), simd => overlap_in_lanes(simd, a, b, pairs, steps, settings, kept));
}

#[inline(always)]
fn overlap_in_lanes<S: Simd>(
    simd: S,
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    steps: &[PairFate],
    settings: &PairSettings,
    kept: &mut Vec<[u32; 2]>,
) {
    let [planes, spheres, center_line] =
        [PairFate::Planes, PairFate::Spheres, PairFate::CenterLine].map(|step| steps.contains(&step));
    let reach = (settings.range / settings.scale) as f32;
    let rounded_reach = reach + a.surface.rounding() + b.surface.rounding();
    for (block, pairs) in candidates.chunks(WIDTH).enumerate() {
        ask_ahead(a, b, candidates, block);
        let rows = [a.gather::<0, S>(simd, pairs), b.gather::<1, S>(simd, pairs)];
        let [corners_a, corners_b] = [rows[0].corners(), rows[1].corners()];
        let corners = PairLanes::new(&corners_a, &corners_b);
        let [cap_a, cap_b] = facing_caps(a, b, &rows);
        let mut apart = mask32x8::splat(simd, false);
        if planes {
            apart |= corners.excess_along_normals(rounded_reach).simd_gt(0.0);
        }
        if spheres {
            apart |= !cap_a.overlap(&cap_b, reach);
        }
        if center_line {
            apart |= corners.excess_along(cap_a.center - cap_b.center, rounded_reach).simd_gt(0.0);
        }
        let mut apart = apart.to_bitmask();
        if settings.same_surface {
            let near = if a.surface.topology.is_welded() { !apart } else { !apart & meeting(&corners_a, &corners_b) };
            if near & first_lanes(pairs.len()) != 0 {
                apart |= neighbors(&a.surface, pairs);
            }
        }
        keep(pairs, !apart, kept);
    }
}

/// One bit for each pair with a corner of either triangle as far along the first axis as one of the other: where no vertices
/// are welded, all that share a vertex are among them, but for those with corners that are not numbers.
#[inline(always)]
fn meeting<S: Simd>(a: &[VectorLanes<S>; 3], b: &[VectorLanes<S>; 3]) -> u64 {
    let mut meet = mask32x8::splat(a[0].x.simd, false);
    for own in a {
        for other in b {
            meet |= own.x.simd_eq(other.x);
        }
    }
    meet.to_bitmask()
}

/// One bit for each pair of triangles that share a vertex.
#[inline(always)]
fn neighbors(surface: &SurfaceSide<'_>, pairs: &[[u32; 2]]) -> u64 {
    let mut bits = 0;
    for (lane, &[triangle_a, triangle_b]) in pairs.iter().enumerate().take(WIDTH) {
        let share_vertex = surface.topology.share_vertex(TriangleId(triangle_a), TriangleId(triangle_b));
        bits |= u64::from(share_vertex) << lane;
    }
    bits
}

/// Appends the pairs whose bits are set.
#[inline(always)]
pub(super) fn keep(pairs: &[[u32; 2]], mask: u64, kept: &mut Vec<[u32; 2]>) {
    let (mut block, mut count) = ([[0; 2]; WIDTH], 0);
    for (lane, &pair) in pairs.iter().enumerate().take(WIDTH) {
        block[count] = pair;
        count += usize::from(mask & (1 << lane) != 0);
    }
    kept.extend_from_slice(&block[..count]);
}
